"""Jobs of several stages: each begins where the last one ended, and all are in one morph."""

from __future__ import annotations

import json

import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.errors import AlignmentError
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import ArtifactData, InputFile
from meshdeform.testing import FakePrior
from tests.unit.assets.builders import unpack

SPHERE = icosphere(2)
STEPS, FRAMES = 6, 2


def glb(*scale: float, offset: float = 0.0) -> bytes:
    return build_glb(SPHERE.verts.numpy() * scale + offset, SPHERE.faces.numpy())


FILES = {"target": InputFile(glb(1.0, 1.4, 1.0), "tall.glb"), "target_2": InputFile(glb(1.4, 0.8, 1.0), "wide.glb")}
STAGES = [{"target": "target"}, {"prompt": "an egg"}, {"target": "target_2", "name": "egg"}, {"target": "target"}]


def start(stages: list[dict], checkpoint: bytes | None = None, **params: object) -> text_deform.TextDeformRun:
    document = {
        "params": {"preset": "preview", "steps": STEPS, "stages": stages, **params},
        "output": {"morph_path": {"frames": FRAMES}},
    }
    return text_deform.start(
        asset=glb(1.0, 1.0, 1.0),
        filename="a.glb",
        request=JobRequest.model_validate(document),
        prior=FakePrior(),
        targets=FILES,
        checkpoint=checkpoint,
    )


@pytest.fixture(scope="module")
def walked() -> tuple[dict[str, ArtifactData], dict[int, bytes], dict[int, np.ndarray]]:
    """The results of four stages, with the checkpoint and the positions after each step."""
    run = start(STAGES)
    assert run.total_steps == len(STAGES) * STEPS
    checkpoints, positions = {}, {}
    for report in run:
        checkpoints[report.step], positions[report.step] = run.checkpoint(), run.positions()
    assert list(checkpoints) == list(range(1, run.total_steps + 1))
    return run.finish(), checkpoints, positions


Walked = tuple[dict[str, ArtifactData], dict[int, bytes], dict[int, np.ndarray]]


def test_each_stage_begins_where_the_last_one_ended(walked: Walked) -> None:
    artifacts, _, positions = walked
    for number in range(1, len(STAGES)):
        end = positions[number * STEPS]
        jump = np.abs(positions[number * STEPS + 1] - end).max()
        away = np.abs(end - load_asset(glb(1.0, 1.0, 1.0)).surface.positions).max()
        assert jump < 0.5 * away
    reports = json.loads(artifacts["report.json"].data)["stages"]
    assert [each["name"] for each in reports] == ["tall", "an egg", "egg", "tall 2"]
    assert all(each["moved"] > 0.005 for each in reports)
    assert [("fit" in each, "prompt" in each) for each in reports] == [(True, False), (False, True), (True, False)] + [
        (True, False)
    ]
    assert reports[0]["guidance"]["sha256"] == reports[3]["guidance"]["sha256"] != reports[2]["guidance"]["sha256"]


def test_every_checkpoint_leads_to_the_same_bytes(walked: Walked) -> None:
    """In the middle of a stage, and after its last step."""
    artifacts, checkpoints, _ = walked
    for step in (STEPS + 4, 3 * STEPS):
        run = start(STAGES, checkpoints[step])
        assert run.step == step
        assert [report.step for report in run] == list(range(step + 1, run.total_steps + 1))
        again = run.finish()
        for name in ("result.glb", "morph.glb", "preview.png"):
            assert again[name].data == artifacts[name].data, (step, name)


def test_the_morph_has_the_stages_as_targets_and_one_animation(walked: Walked) -> None:
    artifacts, _, positions = walked
    document, _, _ = unpack(artifacts["morph.glb"].data)
    (mesh,), (animation,) = document["meshes"], document["animations"]
    names = ["tall", "an egg", "egg", "tall 2"]
    assert mesh["extras"]["targetNames"] == [label for name in names for label in (f"{name} 1/2", name)]
    assert mesh["weights"] == [0.0] * 7 + [1.0]
    times = document["accessors"][animation["samplers"][0]["input"]]
    assert (times["count"], times["min"], times["max"]) == (9, [0.0], [4.0])
    base = load_asset(glb(1.0, 1.0, 1.0)).surface.positions
    result = load_asset(artifacts["result.glb"].data).surface.positions
    np.testing.assert_allclose(result, positions[4 * STEPS], atol=1e-6)
    for number in range(4):
        accessor = mesh["primitives"][0]["targets"][2 * number + 1]["POSITION"]
        moved = read(artifacts["morph.glb"].data, accessor)
        np.testing.assert_allclose(base + moved, positions[(number + 1) * STEPS], atol=1e-6)


def read(data: bytes, accessor: int) -> np.ndarray:
    from meshdeform.assets.accessors import read_floats
    from meshdeform.assets.document import Document
    from meshdeform.assets.limits import Limits

    return read_floats(Document.parse(data, Limits.unlimited(), glb=True), accessor)


def test_a_target_that_is_too_far_away_is_refused_before_the_first_stage() -> None:
    far = {**FILES, "target_2": InputFile(glb(1.0, 1.0, 1.0, offset=9.0), "far.glb")}
    request = JobRequest.model_validate({"params": {"stages": STAGES, "align": "none", "preset": "preview"}})
    with pytest.raises(AlignmentError, match="Stage 3: Only 0%"):
        text_deform.start(asset=glb(1.0, 1.0, 1.0), filename="a.glb", request=request, prior=FakePrior(), targets=far)
