"""Kinds of job: their parameters as they are stored, and files beside the asset from the request to their removal."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

from meshdeform.client import Client
from meshdeform.errors import NotFoundError, ParameterError
from meshdeform.record.ids import new_job_id
from meshdeform.requests.document import JobKind, JobRequest, resolve
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.base import ArtifactData, JobRun, RunInput
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.http.forms import ReceivedFile
from service.jobs.documents import JobDocument
from service.jobs.intake import Submission, check, missing_files
from tests.fake_kind import FakeKind, _FakeRun
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import working


class Run(_FakeRun):
    """Ends with a report, as runs of this kind do."""

    def finish(self) -> dict[str, ArtifactData]:
        return {"report.json": ArtifactData(b"{}", "application/json")}


def start(_given: RunInput) -> JobRun:
    run: Any = Run(FakeKind(), 100, 1, 0)
    return run


KIND = "surface_fit"
"""A kind of several files, none of whose own code these tests run."""


def test_the_kept_parameters_decide_unless_another_version_wrote_them() -> None:
    asked = JobRequest.model_validate({"prompt": "a vase", "params": {"preset": "preview"}})
    kept = resolve(asked.params).model_dump(mode="json")
    steps = kind_of(JobKind.TEXT_DEFORM).steps
    assert steps(asked, "builtin", None) == kept["steps"]
    assert steps(asked, "builtin", {**kept, "steps": 7}) == 7
    assert steps(asked, "builtin", {**kept, "steps": 7, "a_parameter_of_before": 1}) == kept["steps"]


def test_the_service_asks_for_the_files_that_a_kind_reads(tmp_path: Path) -> None:
    document = JobDocument.model_validate({"kind": KIND, "params": {"steps": 8}})
    assert missing_files(document, []) == ["asset"]
    sent = {"asset": ReceivedFile(tmp_path / "asset", "a.obj", 8, "0" * 64)}
    names = Submission(document, sent, tmp_path).names
    assert check(document, Settings(), files=names) == check_request(document, Settings(), files=names)
    with pytest.raises(ParameterError, match="8 steps are more"):
        check(document, Settings(max_steps=7), files=names)
    both = JobDocument.model_validate({"kind": KIND, "files": {"asset": {"job_id": new_job_id()}}})
    assert missing_files(both, []) == []
    with pytest.raises(ParameterError, match="both sent as a field and named"):
        Submission(both, sent, tmp_path)
    with pytest.raises(ValidationError, match="target is also in files"):
        JobDocument.model_validate({"target": {"job_id": new_job_id()}, "files": {"target": {"job_id": new_job_id()}}})
    named = JobDocument.model_validate({"kind": KIND, "target": {"job_id": new_job_id()}})
    with pytest.raises(ParameterError, match="does not read `target`"):
        check(named, Settings(), files=Submission(named, sent, tmp_path).names)


@pytest.fixture
def settings(tmp_path: Path, redis_url: str) -> Settings:
    return Settings(data_dir=tmp_path, redis_url=redis_url, queue="test-kinds")


@pytest.fixture
def meshes(tmp_path: Path) -> dict[str, Path]:
    """The files of a job of this kind, of a few bytes each."""
    found = {part: tmp_path / f"{part}.obj" for part in ("asset", "base")}
    for size, path in enumerate(found.values(), 1):
        path.write_text(f"# sheet\nv 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf 1 2 3\n")
    return found


def test_it_is_retried_and_branched_and_its_files_go_with_the_last_job(
    tmp_path: Path, settings: Settings, meshes: dict[str, Path]
) -> None:
    store = ObjectStore(settings.resolved_storage_url)
    files = {f"assets/{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in meshes.values()}
    with serving(settings) as url, Client(url) as client:
        params = {"checkpoint_every_steps": 50}
        uploads = {part: client.upload(path) for part, path in meshes.items()}
        first = client.submit(files={**meshes, "base": uploads["base"]}, kind=KIND, params=params)
        client.cancel(first)
        second = client.retry(first)
        assert second.files == first.files
        with working(settings, start):
            done = client.wait(second, timeout_s=DEADLINE_S)
        assert done.artifacts[0].name == "report.json"
        assert (done.asset, done.target) == (done.files["asset"], None)
        for part, path in meshes.items():
            assert client.download_file(done, part, tmp_path / part).read_bytes() == path.read_bytes()
        with pytest.raises(NotFoundError, match="no file 'scalars'"):
            client.download_file(done, "scalars", tmp_path / "scalars")
        step = client.checkpoints(done)[0].step
        with pytest.raises(ParameterError, match=f"has the kind of its job: {KIND}"):
            client.branch(done, step, "a vase")
        with pytest.raises(ParameterError, match="keeps its job's `asset`"):
            client.branch(done, step, kind=KIND, files={"asset": uploads["base"]})
        branch = client.branch(done, step, kind=KIND, files={"base": uploads["asset"]})
        assert branch.files["base"].sha256 == branch.files["asset"].sha256 == first.files["asset"].sha256
        assert client.branch(done, step, kind=KIND).files == first.files
        for upload in uploads.values():
            assert httpx.delete(f"{url}/v1/uploads/{upload.id}").status_code == 204
        *others, last = client.jobs()
        for job in (*others, last):
            if not job.state.terminal:
                client.cancel(job)
        for job in others:
            client.delete(job)
        assert {key for key, _ in store.list()} == files
        client.delete(last)
        assert list(store.list()) == []
