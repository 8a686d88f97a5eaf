"""A kind of job with files of its own names, from the check of its requests to its artifacts, in no other module."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from pydantic import Field, ValidationError

from meshdeform import runs
from meshdeform.api.jobs import JobView
from meshdeform.client import Client
from meshdeform.errors import NotFoundError, ParameterError
from meshdeform.record.ids import new_job_id
from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.requests import document
from meshdeform.requests.document import JobKind, JobRequest, read_stored, resolve
from meshdeform.requests.parameters import SILHOUETTE_PARTS, StrictModel
from meshdeform.requests.removed import grouped
from meshdeform.runs import check_request, file_parts, kind_of, register, start_run
from meshdeform.runs.base import (
    ArtifactData,
    ArtifactKind,
    FilePart,
    InputFile,
    JobRun,
    Kind,
    RunInput,
    StartRun,
    StepReport,
)
from meshdeform.runs.text_deform_kind import resolved_params
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.http.bodies import ReceivedFile
from service.jobs.documents import JobDocument
from service.jobs.intake import check_params
from service.jobs.sources import Submission, missing_files
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import new_world, working

TEXT = "text/plain"
WORDS = {"mesh_1": b"an a", "mesh_2": b"sset"}


class CountParams(StrictModel):
    """Parameters of a job that counts a letter."""

    letter: str = Field("a", min_length=1, max_length=1)
    checkpoint_every_steps: int = 2


class Count:
    """Count a letter, one byte of the files in each step."""

    def __init__(self, data: bytes, letter: str, step: int = 0, found: int = 0) -> None:
        self._data, self._letter, self._step, self.found = data, letter.encode(), step, found
        self.total_steps = len(data)

    @property
    def step(self) -> int:
        return self._step

    def __iter__(self) -> Iterator[StepReport]:
        while self._step < self.total_steps:
            self.found += self._data[self._step : self._step + 1] == self._letter
            self._step += 1
            yield StepReport(self._step, self.total_steps, {"found": float(self.found)})

    def checkpoint(self) -> bytes:
        return struct.pack("<QQ", self._step, self.found)

    def snapshot(self) -> ArtifactData:
        return ArtifactData(self._data, TEXT)

    def finish(self) -> dict[str, ArtifactData]:
        return {"count.txt": ArtifactData(str(self.found).encode(), TEXT)}


def refuse_z(request: JobRequest, settings: Settings, files: frozenset[str]) -> CountParams:
    params: object = request.params
    assert isinstance(params, CountParams)
    assert settings.max_steps > 0
    assert "mesh_1" in files
    if params.letter == "z":
        raise ParameterError("Nobody counts z.")
    return params


def load() -> StartRun:
    def start(given: RunInput) -> JobRun:
        params: object = given.request.params
        assert isinstance(params, CountParams)
        state = struct.unpack("<QQ", given.checkpoint) if given.checkpoint else (0, 0)
        return Count(b"".join(file.data for file in given.files.values()), params.letter, *state)

    return start


@pytest.fixture(scope="module", autouse=True)
def kind() -> Iterator[Kind]:
    made = Kind(
        name=JobKind.named("count"),
        summary="Counts a letter.",
        reads=(
            FilePart("mesh_1", "Any file.", required=True, media_types=(TEXT,)),
            FilePart("mesh_2", "Another file.", required=False, media_types=(TEXT,)),
        ),
        params=CountParams,
        check=refuse_z,
        steps=lambda request, default_model, kept: 8,
        load=load,
        artifacts=(ArtifactKind("count.txt", TEXT, "How often the letter was found."),),
    )
    register(made)
    yield made
    # Other tests of this process, such as that of the generated pages, must not see it.
    runs._registered.pop(made.name)
    document._PARAMS.pop(made.name)
    JobKind._value2member_map_.pop("count")


def request(**params: object) -> JobRequest:
    return JobRequest.model_validate({"kind": "count", "params": grouped(params), "prompt": "count"})


def test_a_request_has_the_parameters_of_its_kind() -> None:
    assert request(letter="n").params == CountParams(letter="n")
    assert JobRequest.model_validate({"kind": "count"}).params == CountParams()
    assert JobRequest.model_validate_json(request(letter="n").model_dump_json()) == request(letter="n")
    assert request(letter="n").model_dump(mode="json", exclude_unset=True)["params"] == {"letter": "n"}
    with pytest.raises(ValidationError, match="guidance_scale"):
        request(guidance_scale=7.5)
    with pytest.raises(ValidationError, match="kind"):
        JobRequest.model_validate({"kind": "nobody knows it"})
    # Documents of before, which name no kind, mean what they meant.
    assert JobRequest(prompt="a vase").kind is JobKind.TEXT_DEFORM
    assert kind_of(JobKind.TEXT_DEFORM).artifacts[0].name == "result.glb"


def test_the_kept_parameters_decide_unless_another_version_wrote_them() -> None:
    asked = JobRequest.model_validate({"prompt": "a vase", "params": {"preset": "preview"}})
    kept = resolve(asked.params).model_dump(mode="json")
    steps = kind_of(JobKind.TEXT_DEFORM).steps
    assert steps(asked, "builtin", None) == kept["steps"]
    assert steps(asked, "builtin", {**kept, "steps": 7}) == 7
    assert steps(asked, "builtin", {**kept, "steps": 7, "a_parameter_of_before": 1}) == kept["steps"]


def test_constants_that_an_earlier_edition_took_stay_those_of_its_job() -> None:
    asked = read_stored({"prompt": "a vase", "params": {"framing": 0.5}})
    kept = {**resolve(asked.params).model_dump(mode="json"), "framing": 0.5}
    assert resolved_params(asked, "builtin", kept).framing == 0.5
    assert resolved_params(asked, "builtin", None).framing != 0.5


def test_the_door_checks_it() -> None:
    built_in = (
        "asset",
        "target",
        *SILHOUETTE_PARTS,
        "weights",
        "base",
        "scalars",
        "collection",
        "family",
        "meshes",
    )
    assert file_parts() == (*built_in, "mesh_1", "mesh_2")
    assert check_request(request(), Settings(), files=["mesh_1"]) == CountParams()
    assert check_request(request(), Settings(), files=["mesh_1", "mesh_2"]) == CountParams()
    with pytest.raises(ParameterError, match="does not read `target`"):
        check_request(request(), Settings(), files=["mesh_1", "target"])
    with pytest.raises(ParameterError, match="is missing"):
        check_request(request(), Settings(), files=[])
    with pytest.raises(ParameterError, match="Nobody counts z"):
        check_request(request(letter="z"), Settings(), files=["mesh_1"])


def test_the_service_asks_for_the_files_that_it_reads(tmp_path: Path) -> None:
    document = JobDocument.model_validate({"kind": "count"})
    assert missing_files(document, []) == ["mesh_1"]
    sent = {"mesh_1": ReceivedFile(tmp_path / "mesh_1", "a.txt", 8, "0" * 64)}
    assert check_params(document, Settings(), files=Submission(document, sent, tmp_path).names) == CountParams()
    with pytest.raises(ParameterError, match="8 steps are more"):
        check_params(document, Settings(max_steps=7), files=["mesh_1"])
    both = JobDocument.model_validate({"kind": "count", "files": {"mesh_1": {"job_id": new_job_id()}}})
    assert missing_files(both, []) == []
    with pytest.raises(ParameterError, match="both sent as a part and named"):
        Submission(both, sent, tmp_path)
    with pytest.raises(ValidationError, match="target is also in files"):
        JobDocument.model_validate({"target": {"job_id": new_job_id()}, "files": {"target": {"job_id": new_job_id()}}})
    named = JobDocument.model_validate({"kind": "count", "target": {"job_id": new_job_id()}})
    with pytest.raises(ParameterError, match="does not read `target`"):
        check_params(named, Settings(), files=Submission(named, sent, tmp_path).names)


def test_a_worker_runs_it_from_a_checkpoint_to_its_artifacts(tmp_path: Path, kind: Kind) -> None:
    with new_world(tmp_path) as world:
        stored = {name: world.store.put(f"assets/{name}", data, TEXT) for name, data in WORDS.items()}
        files = {
            name: StoredFile(key=f"assets/{name}", filename=f"{name}.txt", size=each.size, sha256=each.sha256)
            for name, each in stored.items()
        }
        job = world.record.create(NewJob(request(letter="s"), files))
        claimed = world.record.leases.claim(job.id, "one that dies", 60.0)
        assert claimed is not None
        left = Count(b"an asset", "s", 5, 1).checkpoint()
        kept = world.store.put(f"jobs/{job.id}/1/checkpoint", left, TEXT)
        world.record.leases.set_checkpoint(job.id, 1, f"jobs/{job.id}/1/checkpoint", 5, kept.sha256)
        world.record.leases.release(job.id, 1)
        world.runner(start=start_run).run(job.id)
        done = world.record.get(job.id)
        assert (done.state, done.error, done.progress.step) == (JobState.SUCCEEDED, None, 8)
        (artifact,) = world.record.artifacts(job.id)
        assert (artifact.name, artifact.content_type) == (kind.artifacts[0].name, kind.artifacts[0].media_type)
        assert world.store.get(artifact.key) == b"2"
        assert JobView.of(done).as_json()["params"] == {"letter": "s"}


@pytest.fixture
def settings(tmp_path: Path, redis_url: str) -> Settings:
    return Settings(data_dir=tmp_path, redis_url=redis_url, queue="test-kinds")


@pytest.fixture
def meshes(tmp_path: Path) -> dict[str, Path]:
    """The files of a job of this kind, of a few bytes each."""
    found = {part: tmp_path / f"{part}.obj" for part in ("mesh_1", "mesh_2")}
    for size, path in enumerate(found.values(), 1):
        path.write_text(f"# sheet\nv 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf 1 2 3\n")
    return found


def test_it_is_described_posted_and_downloaded_over_http(
    tmp_path: Path, settings: Settings, meshes: dict[str, Path]
) -> None:
    content = b"".join(path.read_bytes() for path in meshes.values())
    with serving(settings) as url, working(settings, start_run), Client(url) as client:
        described = {kind.name: kind for kind in client.limits().kinds}
        assert set(described) == {"text_deform", "surface_fit", "family_fit", "family_synthesize", "prior_teach"} | {
            "count"
        }
        count = described["count"]
        assert count.reads == [
            {"name": "mesh_1", "summary": "Any file.", "required": True, "media_types": [TEXT]},
            {"name": "mesh_2", "summary": "Another file.", "required": False, "media_types": [TEXT]},
        ]
        assert set(count.params["properties"]) == {"letter", "checkpoint_every_steps"}
        assert [artifact["name"] for artifact in count.artifacts] == ["count.txt"]
        checked = client.validate(files=meshes, kind="count", params={"letter": "e"})
        assert checked.params.letter == "e"  # type: ignore[attr-defined]
        assert checked.files == {"mesh_1": checked.asset, "mesh_2": checked.files["mesh_2"]}
        params = {"letter": "e", "checkpoint_every_steps": len(content)}
        result = client.deform(files=meshes, kind="count", params=params, timeout_s=DEADLINE_S)
        assert (str(result.job.kind), [each.name for each in result.job.artifacts]) == ("count", ["count.txt"])
        assert int(result.read("count.txt")) == content.count(b"e")
        assert [path.read_bytes() for path in result.save(tmp_path / "results")] == [result.read("count.txt")]
        assert list(result.job.files) == list(meshes)
        assert (result.job.asset, result.job.target) == (result.job.files["mesh_1"], None)
        for part, path in meshes.items():
            saved = client.download_file(result.job, part, tmp_path / part)
            assert saved.read_bytes() == path.read_bytes()
        assert client.download_asset(result.job, tmp_path / "asset").read_bytes() == meshes["mesh_1"].read_bytes()
        with pytest.raises(NotFoundError, match="no file 'asset'"):
            client.download_file(result.job, "asset", tmp_path / "asset")
        with pytest.raises(ParameterError, match="Nobody counts z"):
            client.submit(files=meshes, kind="count", params={"letter": "z"})


def test_it_is_retried_and_branched_and_its_files_go_with_the_last_job(
    settings: Settings, meshes: dict[str, Path]
) -> None:
    store = ObjectStore(settings.resolved_storage_url)
    files = {f"assets/{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in meshes.values()}
    with serving(settings) as url, Client(url) as client:
        params = {"letter": "e", "checkpoint_every_steps": 50}
        uploads = {part: client.upload(path) for part, path in meshes.items()}
        first = client.submit(files={**meshes, "mesh_2": uploads["mesh_2"]}, kind="count", params=params)
        client.cancel(first)
        second = client.retry(first)
        assert second.files == first.files
        with working(settings, start_run):
            done = client.wait(second, timeout_s=DEADLINE_S)
        assert done.artifacts[0].name == "count.txt"
        step = client.checkpoints(done)[0].step
        with pytest.raises(ParameterError, match="has the kind of its job: count"):
            client.branch(done, step, "a vase")
        with pytest.raises(ParameterError, match="keeps its job's `mesh_1`"):
            client.branch(done, step, kind="count", files={"mesh_1": uploads["mesh_2"]})
        branch = client.branch(done, step, kind="count", files={"mesh_2": uploads["mesh_1"]})
        assert branch.files["mesh_2"].sha256 == branch.files["mesh_1"].sha256 == first.files["mesh_1"].sha256
        assert client.branch(done, step, kind="count").files == first.files
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


def test_a_kind_that_is_registered_first_does_not_hide_the_built_in_ones(
    kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "_registered", {})
    register(kind)
    assert [known.name for known in runs.kinds()] == [
        JobKind.TEXT_DEFORM,
        JobKind.SURFACE_FIT,
        JobKind.FAMILY_FIT,
        JobKind.FAMILY_SYNTHESIZE,
        JobKind.PRIOR_TEACH,
        kind.name,
    ]


def test_a_queued_job_with_a_drawing_fails_with_what_to_do() -> None:
    """Earlier editions made the target; without it the job must not run towards anything else."""
    stored = read_stored({"params": {"sketch": {"family": "vase"}, "guidance": {"kind": "target"}}})
    kept = {**resolve(stored.params).model_dump(mode="json"), "sketch": {"family": "vase", "values": {}}}
    implied = read_stored({"params": {"sketch": {"family": "vase"}}})  # the guidance was resolved at the door
    for job in (stored, implied):
        with pytest.raises(ParameterError, match="made of a drawing") as caught:
            start_run(RunInput(job, {"asset": InputFile(b"", "a.glb")}, resolved=kept))
        assert "`target`" in caught.value.advice_text
