"""Weights that a job has taught belong to the key that made them: no other one uses, lists or learns of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.client import Client
from meshdeform.errors import (
    AssetFormatError,
    ConflictError,
    MeshdeformError,
    NotFoundError,
    ParameterError,
    RequestError,
    StoredFileError,
    VocabularyError,
)
from meshdeform.record.repository import JobRecord
from meshdeform.requests.groups import grouped
from meshdeform.runs import start_run
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.in_process import children_in_process
from tests.integration.conftest import DEADLINE_S, serving
from tests.taught import shorten_lessons, write_small_weights
from tests.worker_world import working
from worker.process import PriorCache

LESSON: dict[str, Any] = {"noun": "a teapot", "model": "small.safetensors", "steps": 1}
QUICK = {"preset": "preview", "steps": 2, "checkpoint_every_steps": 1, "orientation": "keep"}


@pytest.fixture
def settings(tmp_path: Path, redis_url: str) -> Settings:
    (tmp_path / "models").mkdir()
    write_small_weights(tmp_path / "models" / "small.safetensors")
    return Settings(
        data_dir=tmp_path, redis_url=redis_url, queue="test-taught", auth="on", models=str(tmp_path / "models")
    )


@pytest.fixture
def clients(settings: Settings) -> Iterator[tuple[Client, Client]]:
    """The clients of two keys at one service."""
    record = JobRecord(settings.resolved_database_url)
    keys = [record.keys.create(name)[1] for name in ("one", "two")]
    record.close()
    with (
        children_in_process(),
        serving(settings) as url,
        Client(url, api_key=keys[0]) as one,
        Client(url, api_key=keys[1]) as two,
    ):
        yield one, two


def refusal(client: Client, ball: Path, model: str) -> tuple[str, str, str, Any]:
    with pytest.raises(MeshdeformError) as caught:
        client.submit(ball, "a teapot", params={"guidance": {"model": model}})
    error = caught.value
    return error.code, error.detail.replace(model[4:], "ID"), error.advice_text, error.extra.get("errors")


def test_a_taught_word_is_used_by_its_owner_alone_until_the_lesson_is_deleted(
    clients: tuple[Client, Client], settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import trimesh

    shorten_lessons(monkeypatch)
    one, two = clients
    ball, priors = tmp_path / "ball.glb", PriorCache()
    trimesh.creation.icosphere(1).export(ball)
    absent = "job:job_01kg9zqk2xf3v8c5m7n9p1r4t6"
    waiting = one.teach("a teapot", ball, params=LESSON)
    with pytest.raises(ConflictError, match="is queued"):
        one.submit(ball, "a teapot", params={"guidance": {"model": f"job:{waiting.id}"}})
    with working(settings, start_run, lambda model: priors.get(model, device="cpu")):
        taught = one.wait(waiting, timeout_s=DEADLINE_S)
        assert (str(taught.state), taught.error) == ("succeeded", None)
        model = f"job:{taught.id}"

        # What the other key gets is what it gets for a job that never was.
        assert refusal(two, ball, model)[0] == "parameter_invalid"
        assert json.dumps(refusal(two, ball, model)).replace(taught.id, "ID") == json.dumps(
            refusal(two, ball, absent)
        ).replace(absent[4:], "ID")
        with pytest.raises(ParameterError, match="no job"):
            two.submit(
                ball,
                "a teapot",
                params={"guidance": {"model": "weights"}},
                files={"weights": {"job_id": taught.id, "artifact": "weights.safetensors"}},
            )
        with pytest.raises(NotFoundError):
            two.download(taught.id, "weights.safetensors", tmp_path / "stolen.safetensors")
        assert model not in [each.id for each in two.models().models]
        (mine,) = [each for each in one.models().models if each.id == model]
        assert (mine.title, mine.available, [lesson.noun for lesson in mine.lessons]) == ("teapot", True, ["teapot"])
        assert mine.vocabulary is not None
        assert "teapot" in mine.vocabulary.nouns
        assert str(tmp_path) not in mine.model_dump_json()

        with pytest.raises(VocabularyError, match="'giraffe'"):
            one.submit(ball, "a giraffe", params={"guidance": {"model": model}})
        with pytest.raises(ParameterError, match="knows 'teapot' already"):
            one.submit(kind="prior_teach", files={"meshes": ball}, params={**LESSON, "model": model})
        assert one.validate(
            kind="prior_teach", files={"meshes": ball}, params={**LESSON, "noun": "a goblet", "model": model}
        )
        used = one.deform(ball, "a tall teapot", params=grouped({**QUICK, "model": model}), timeout_s=DEADLINE_S)
        report = json.loads(used.read("report.json"))
        assert (report["guidance"]["id"], str(tmp_path) in json.dumps(report)) == (model, False)
        with pytest.raises(ParameterError, match="no such artifact"):
            one.submit(ball, "a teapot", params={"guidance": {"model": f"job:{used.job.id}"}})
        one.delete(taught)
        code, detail, _, errors = refusal(one, ball, model)
        assert (code, detail, errors[0]["loc"]) == (
            "parameter_invalid",
            "There is no job ID.",
            ["params", "guidance", "model"],
        )
        assert model not in [each.id for each in one.models().models]
        # Jobs that were accepted keep what they need, and so do their branches.
        branch = one.branch(used.job, 1, "a teapot", params=grouped({**QUICK, "model": model}))
        assert branch.files["weights"] == one.get(used.job.id).files["weights"]
        one.wait(branch, timeout_s=DEADLINE_S)
        with pytest.raises(VocabularyError, match="'giraffe'"):
            one.branch(used.job, 1, "a giraffe", params={"guidance": {"model": model}})
        with pytest.raises(ParameterError, match="no job"):
            one.branch(used.job, 1, "a teapot", params={"guidance": {"model": absent}})
        assert (
            "weights" not in one.branch(used.job, 1, "a giraffe", params=grouped({**QUICK, "model": "builtin"})).files
        )
        with pytest.raises(RequestError, match="after `job:` stands the id of a job"):
            one.submit(ball, "a teapot", params={"guidance": {"model": "job:../x"}})
    assert refusal(two, ball, model)[0] == "parameter_invalid"


def test_weights_that_are_damaged_or_from_elsewhere_are_refused(
    clients: tuple[Client, Client], settings: Settings, tmp_path: Path
) -> None:
    import trimesh

    one, _ = clients
    ball = tmp_path / "ball.glb"
    trimesh.creation.icosphere(1).export(ball)
    good = (tmp_path / "models" / "small.safetensors").read_bytes()
    header = json.dumps({"unet.weight": {"dtype": "F16", "shape": [2], "data_offsets": [0, 4]}}).encode()
    for data in (good[:-7], b"\x80\x04K\x01.", len(header).to_bytes(8, "little") + header + bytes(4)):
        (tmp_path / "sent.safetensors").write_bytes(data)
        with pytest.raises(AssetFormatError) as caught:
            one.submit(
                ball,
                "a vase",
                params={"guidance": {"model": "weights"}},
                files={"weights": tmp_path / "sent.safetensors"},
            )
        assert str(tmp_path) not in f"{caught.value.detail}{caught.value.advice_text}"
    (tmp_path / "sent.safetensors").write_bytes(good)
    files = {"weights": tmp_path / "sent.safetensors"}
    with pytest.raises(ParameterError, match=r"was sent, but params\.guidance\.model does not use it"):
        one.submit(ball, "a vase", files=files)
    job = one.submit(ball, "a vase", params={"guidance": {"model": "weights"}}, files=files)
    # The worker compares the bytes with the hash that was recorded.
    stored = ObjectStore(settings.resolved_storage_url)
    key = f"assets/{job.files['weights'].sha256}"
    stored.put(key, good[:-1] + bytes([good[-1] ^ 1]), "application/octet-stream")
    at_once = settings.model_copy(update={"retry_delay_s": 0})
    with working(at_once, start_run), pytest.raises(StoredFileError, match="differs from what was stored"):
        one.wait(job, timeout_s=DEADLINE_S)
