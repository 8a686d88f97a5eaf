"""A lesson of the shipped prior, as `meshdeform teach` gives it. Longer than the suite allows: `-m training`."""

from __future__ import annotations

import json

import pytest
import torch
import trimesh

from meshdeform.priors.builtin.teaching.teacher import TeachConfig
from meshdeform.runs.lesson_files import MeshFile
from meshdeform.runs.teaching import TeachRequest, start


@pytest.mark.training
def test_a_mesh_is_learned_and_the_old_nouns_stay() -> None:
    bar = trimesh.creation.box((0.3, 1.6, 0.3))
    arms = trimesh.creation.box((1.6, 0.3, 0.3), transform=trimesh.transformations.translation_matrix((0, 0.5, 0)))
    data = trimesh.util.concatenate([bar, arms]).export(file_type="glb")
    torch.set_num_threads(2)
    run = start(TeachRequest("a crossbar", config=TeachConfig(steps=200)), [MeshFile("cross.glb", data)])
    for _ in run:
        pass
    report = json.loads(run.finish()["report"])
    losses = report["held_out_loss"]
    assert losses[-1]["new"] < 0.7 * losses[0]["new"]
    assert losses[-1]["old"] < 1.15 * losses[0]["old"]
    seen = report["retrieval"]
    assert seen["old_after"]["hits"] >= seen["old_before"]["hits"] - 3
