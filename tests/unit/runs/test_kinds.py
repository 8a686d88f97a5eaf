"""A kind of job that only this test knows, from the check at the door to its artifacts: no other module is touched."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import Field, ValidationError

from meshdeform import runs
from meshdeform.api.jobs import JobView
from meshdeform.client import Client
from meshdeform.errors import ParameterError
from meshdeform.record.ids import new_job_id
from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.requests import document
from meshdeform.requests.document import JobKind, JobRequest, resolve
from meshdeform.requests.parameters import StrictModel
from meshdeform.runs import check_request, file_parts, kind_of, register, start_run
from meshdeform.runs.base import ArtifactData, ArtifactKind, FilePart, JobRun, Kind, RunInput, StartRun, StepReport
from meshdeform.settings import Settings
from service.http.multipart import ReceivedFile
from service.jobs.documents import JobDocument
from service.jobs.intake import check_params
from service.jobs.sources import Submission, missing_files
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import new_world, working

TEXT = "text/plain"


class CountParams(StrictModel):
    """Parameters of a job that counts a letter."""

    letter: str = Field("a", min_length=1, max_length=1)
    checkpoint_every_steps: int = 2


class Count:
    """Count a letter, one byte of the asset in each step."""

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
    assert "asset" in files
    if params.letter == "z":
        raise ParameterError("Nobody counts z.")
    return params


def load() -> StartRun:
    def start(given: RunInput) -> JobRun:
        params: object = given.request.params
        assert isinstance(params, CountParams)
        state = struct.unpack("<QQ", given.checkpoint) if given.checkpoint else (0, 0)
        return Count(given.files["asset"].data, params.letter, *state)

    return start


@pytest.fixture(scope="module", autouse=True)
def kind() -> Iterator[Kind]:
    made = Kind(
        name=JobKind.named("count"),
        summary="Counts a letter.",
        reads=(FilePart("asset", "Any file.", required=True, media_types=(TEXT,)),),
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
    return JobRequest.model_validate({"kind": "count", "params": params, "prompt": "count"})


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


def test_the_door_checks_it() -> None:
    assert set(file_parts()) == {"asset", "target"}
    assert check_request(request(), Settings(), files=["asset"]) == CountParams()
    with pytest.raises(ParameterError, match="does not read `target`"):
        check_request(request(), Settings(), files=["asset", "target"])
    with pytest.raises(ParameterError, match="is missing"):
        check_request(request(), Settings(), files=[])
    with pytest.raises(ParameterError, match="Nobody counts z"):
        check_request(request(letter="z"), Settings(), files=["asset"])


def test_the_service_asks_for_the_files_that_it_reads(tmp_path: Path) -> None:
    document = JobDocument.model_validate({"kind": "count"})
    assert missing_files(document, []) == ["asset"]
    sent = {"asset": ReceivedFile(tmp_path / "asset", "a.txt", 8, "0" * 64)}
    assert check_params(document, Settings(), files=Submission(document, sent, tmp_path).names) == CountParams()
    with pytest.raises(ParameterError, match="8 steps are more"):
        check_params(document, Settings(max_steps=7), files=["asset"])
    named = JobDocument.model_validate({"kind": "count", "target": {"job_id": new_job_id()}})
    with pytest.raises(ParameterError, match="does not read `target`"):
        check_params(named, Settings(), files=Submission(named, sent, tmp_path).names)


def test_a_worker_runs_it_from_a_checkpoint_to_its_artifacts(tmp_path: Path, kind: Kind) -> None:
    with new_world(tmp_path) as world:
        stored = world.store.put("assets/a", b"an asset", TEXT)
        asset = StoredFile(key="assets/a", filename="a.txt", size=stored.size, sha256=stored.sha256)
        job = world.record.create(NewJob(request(letter="s"), asset))
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


def test_it_is_described_posted_and_downloaded_over_http(tmp_path: Path, redis_url: str, repository: Path) -> None:
    settings = Settings(data_dir=tmp_path, redis_url=redis_url, queue="test-kinds")
    asset = (repository / "service/web/examples/cube.glb").read_bytes()
    with serving(settings) as url, working(settings, start_run), Client(url) as client:
        described = {kind.name: kind for kind in client.limits().kinds}
        assert set(described) == {"text_deform", "count"}
        count = described["count"]
        assert count.reads == [
            {"name": "asset", "summary": "Any file.", "required": True, "media_types": [TEXT]},
        ]
        assert set(count.params["properties"]) == {"letter", "checkpoint_every_steps"}
        assert [artifact["name"] for artifact in count.artifacts] == ["count.txt"]
        checked = client.validate(asset, kind="count", params={"letter": "e"})
        assert checked.params.letter == "e"  # type: ignore[attr-defined]
        params = {"letter": "e", "checkpoint_every_steps": len(asset)}
        result = client.deform(asset, kind="count", params=params, timeout_s=DEADLINE_S)
        assert (str(result.job.kind), [each.name for each in result.job.artifacts]) == ("count", ["count.txt"])
        assert int(result.read("count.txt")) == asset.count(b"e")
        assert [path.read_bytes() for path in result.save(tmp_path / "results")] == [result.read("count.txt")]
        with pytest.raises(ParameterError, match="Nobody counts z"):
            client.submit(asset, kind="count", params={"letter": "z"})


def test_a_kind_that_is_registered_first_does_not_hide_the_built_in_ones(
    kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "_registered", {})
    register(kind)
    assert [known.name for known in runs.kinds()] == [JobKind.TEXT_DEFORM, kind.name]
