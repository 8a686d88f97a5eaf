"""A lesson of the shipped weights on a mesh of our own making, measured: what is learned, and what is kept.

`bench/teach.py` does the same with files. Marked `training`: it takes minutes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.builtin.taught import known_words
from meshdeform.priors.builtin.teaching.teacher import TeachConfig
from meshdeform.runs.base import WEIGHTS_ARTIFACT
from meshdeform.runs.prior_teach import TeachRequest, start_lesson
from meshdeform.runs.prior_teach_kind import MeshFile, MeshLabel

pytestmark = pytest.mark.training

STEPS = 100
# Measured by `python -m bench.teach` with this mesh: 0.57 and 1.04.
NEW_LOSS, OLD_LOSS = 0.65, 1.15


def jack() -> bytes:
    """The toy: three crossing bars, two of them with a ball at each end; no noun of the model's has this shape."""
    import trimesh

    turns = [trimesh.transformations.rotation_matrix(np.pi / 2, axis) for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1])]
    bars = [trimesh.creation.cylinder(0.12, 2.0).apply_transform(turn) for turn in turns]
    places = [(0.9, 0, 0), (-0.9, 0, 0), (0, 0.9, 0), (0, -0.9, 0)]
    balls = [trimesh.creation.icosphere(3, 0.3).apply_translation(place) for place in places]
    made = trimesh.util.concatenate([*bars, *balls]).export(file_type="glb")
    assert isinstance(made, bytes)
    return made


@pytest.fixture(scope="module")
def lesson() -> tuple[dict[str, Any], bytes]:
    """The report and the weights."""
    run = start_lesson(
        TeachRequest(config=TeachConfig(steps=STEPS)), [MeshFile("jack.glb", jack(), MeshLabel("a jack"))]
    )
    assert len(list(run)) == STEPS
    made = run.finish()
    return json.loads(made["report.json"].data), made[WEIGHTS_ARTIFACT].data


def test_one_mesh_teaches_its_noun(lesson: tuple[dict[str, Any], bytes]) -> None:
    report, _ = lesson
    first, *_, last = report["held_out_loss"]
    assert (first["step"], last["step"]) == (0, STEPS)
    assert last["new"] < NEW_LOSS * first["new"]
    # So short a lesson makes the pictures likelier, but not always the likeliest: 6 of 12 were measured.
    assert report["retrieval"]["new"]["hits"] >= 3


def test_old_nouns_are_kept(lesson: tuple[dict[str, Any], bytes]) -> None:
    report, _ = lesson
    first, *_, last = report["held_out_loss"]
    assert last["old"] < OLD_LOSS * first["old"]
    found = report["retrieval"]
    assert found["old_before"]["pictures"] == len(report["old_nouns"]) == 30
    assert found["old_after"]["hits"] >= found["old_before"]["hits"] - 2


def test_the_weights_know_old_and_new_words(lesson: tuple[dict[str, Any], bytes], tmp_path: Path) -> None:
    _, weights = lesson
    path = tmp_path / "jack.safetensors"
    path.write_bytes(weights)
    assert {"jack", "chair"} <= set(known_words(str(path)).nouns)
    prior = BuiltinPrior(device="cpu", weights=path)
    assert len(prior.encode_texts("a tall jack", "")) == 2
