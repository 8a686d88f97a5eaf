"""Whole jobs with `exemplar` guidance, by the real fit: the same bytes again, what is kept, rigs, several prompts."""

from __future__ import annotations

import functools
import json
from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.runs.exemplar_kind import STEPS
from tests.unit.plain.shapes import rigged_dog
from tests.unit.runs.jobs import started

ASSET = rigged_dog()
KNOWN: dict[str, Any] = {"guidance": "exemplar", "source_noun": "dog", "orientation": 0.0}
BEHIND = {"box": {"min": [-3, -3, -3], "max": [3, 3, -0.9]}, "action": "keep"}


def places(glb: bytes) -> np.ndarray:
    return load_asset(glb, "a.glb").surface.positions


REST = places(ASSET)


@functools.cache
def horse() -> dict[str, bytes]:
    run = started(ASSET, "a horse", prior=None, output={"morph": True}, **KNOWN)
    assert len(list(run)) == STEPS
    return {name: artifact.data for name, artifact in run.finish().items()}


def finished(prompt: str = "a horse", **more: Any) -> tuple[np.ndarray, dict[str, Any]]:
    run = started(ASSET, prompt, prior=None, **{**KNOWN, **more})
    for _ in run:
        pass
    files = run.finish()
    return places(files["result.glb"].data), json.loads(files["report.json"].data)


def test_a_dog_becomes_a_horse_without_a_fold() -> None:
    told = json.loads(horse()["report.json"])
    (entry,) = told["exemplars"]
    assert entry["member"]["noun"] == "horse"
    assert entry["distance"] < 0.5 * entry["distance_before"]
    assert {"asset": "leg", "exemplar": "leg"} in entry["pairs"]
    assert told["quality"]["flipped_faces"] == entry["flipped_faces"] == 0
    assert told["verdict"]["structure"]["cut_share"] <= 0.01
    assert told["mesh"]["same_faces"]
    lowest = places(horse()["result.glb"])[:, 1].min()
    assert abs(lowest - REST[:, 1].min()) < 0.02 * np.ptp(REST[:, 1])


def test_a_rig_follows_and_a_morph_shows_the_way() -> None:
    files = horse()
    before, after = load_asset(ASSET, "a.glb"), load_asset(files["result.glb"], "a.glb")
    assert json.loads(files["report.json"])["rig"]["mode"] == "follow"
    assert before.rig_digest() != after.rig_digest()
    assert [joint["name"] for joint in before.pieces().joints] == [joint["name"] for joint in after.pieces().joints]
    assert np.allclose(places(files["morph.glb"]), after.surface.positions, atol=1e-5)


def test_a_run_that_is_resumed_gives_the_same_bytes() -> None:
    run = started(ASSET, "a horse", prior=None, **KNOWN)
    steps = iter(run)
    for _ in range(STEPS // 4):
        next(steps)
    again = started(ASSET, "a horse", prior=None, checkpoint=run.checkpoint(), **KNOWN)
    for _ in again:
        pass
    assert again.finish()["result.glb"].data == horse()["result.glb"]


def test_what_is_kept_stays_while_two_prompts_move_the_rest() -> None:
    result, told = finished(prompts=[{"prompt": "a pig"}], regions=[BEHIND], falloff=0.1)
    assert [entry["member"]["noun"] for entry in told["exemplars"]] == ["horse", "pig"]
    still = np.abs(result - REST).max(1) < 1e-6
    assert still[REST[:, 2] < -0.95].all()
    assert not still[REST[:, 2] > 0].any()
    assert told["regions"]["max_moved"] < 1e-6
    assert told["quality"]["flipped_faces"] == 0


def test_an_attribute_of_what_it_is_already_changes_that_alone() -> None:
    result, told = finished("a dog with long legs")
    assert told["way"] == "change"
    assert [(entry["operation"], entry["part"]) for entry in told["changes"]] == [("long", "leg")]
    raised = (result - REST)[REST[:, 1] > 2.2]  # the head
    assert raised[:, 1].min() > 0.05
    assert np.ptp(raised[:, 1]) < 0.02  # as a whole
