"""The front of a source: the cameras turn to it, and it is part of the checkpoint."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import torch

from meshdeform.deformation.checkpoint import dump_checkpoint, load_checkpoint
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import AHEAD, Orientation, OrientationSource
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.goals import score_distillation
from tests.cases import each_case
from tests.meshes import mesh_of
from tests.unit.deformation import worlds
from training.evaluation.sources import source_mesh

BEHIND = Orientation(180.0, OrientationSource.FOUND)


@cache
def prior() -> BuiltinPrior:
    return BuiltinPrior()


def params(**changes: object) -> ResolvedParams:
    return worlds.params(**{"guidance": "sds", "steps": 2, "safeguard": "none", **changes})


def turned(mesh: TriangleMesh, degrees: float) -> TriangleMesh:
    """The mesh turned about the up axis: its front is then at this azimuth."""
    s, c = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    matrix = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    return mesh_of(verts_of(mesh) @ matrix.T, faces_of(mesh))


def placed(name: str, degrees: float = 0.0) -> TriangleMesh:
    mesh = turned(source_mesh(name), degrees)
    return CameraFrame.around(mesh.verts).place(mesh)


def deformation(mesh: TriangleMesh, front: Orientation = AHEAD, **changes: object) -> Deformation:
    settings = params(**changes)
    return Deformation(mesh, score_distillation(prior(), "a giraffe", settings), settings, front=front)


@each_case("found", [False, True])
def test_a_turned_source_with_its_angle_gives_the_same_result_turned(found: bool) -> None:
    plain = deformation(placed("quadruped"), orientation="keep", steps=4)
    front = Orientation(90.0, OrientationSource.FOUND) if found else AHEAD
    other = deformation(placed("quadruped", 90.0), front, orientation="auto" if found else 90.0, steps=4)
    losses = [[step.losses["sds_mse"] for step in run] for run in (plain, other)]
    assert losses[0] == pytest.approx(losses[1], rel=3e-3)
    moved = float((plain.verts() - verts_of(plain.mesh)).norm())
    expected = verts_of(turned(mesh_of(plain.verts(), plain.mesh.faces), 90.0))
    assert float((other.verts() - expected).norm()) < 0.05 * moved


def test_a_resumed_run_has_the_turn_of_its_checkpoint() -> None:
    mesh = placed("quadruped", 180.0)
    whole = deformation(mesh, BEHIND, steps=4)
    next(iter(whole))
    stored = dump_checkpoint(whole.checkpoint(), "run")
    list(whole)
    settings = params(steps=4)
    guidance = score_distillation(prior(), "a giraffe", settings)
    second = Deformation(mesh, guidance, settings, checkpoint=load_checkpoint(stored, "run"))
    assert second.orientation == whole.orientation == BEHIND
    list(second)
    for name, value in whole.checkpoint().tensors.items():
        assert np.array_equal(second.checkpoint().tensors[name], value), name


@each_case(
    ("changes", "expected"),
    [
        ({}, (75.0, OrientationSource.CONTINUED)),
        ({"orientation": "keep"}, (0.0, OrientationSource.KEPT)),
        ({"orientation": -30}, (-30.0, OrientationSource.GIVEN)),
    ],
)
def test_a_continued_run_takes_the_turn_of_its_origin(
    changes: dict[str, object], expected: tuple[float, OrientationSource]
) -> None:
    mesh = placed("quadruped")
    origin = deformation(mesh, orientation=75.0).checkpoint().tensors
    settings = params(**changes)
    guidance = score_distillation(prior(), "a fish", settings)
    found = Deformation(mesh, guidance, settings, initial=origin, front=BEHIND).orientation
    assert (found.turn_deg, found.source) == expected


def test_checkpoints_hold_the_front_and_those_of_a_search_hold_more() -> None:
    for source in OrientationSource:
        assert Orientation.from_array(Orientation(-75.0, source).to_array()) == Orientation(-75.0, source)
    older = np.array([180.0, 2.0, 0.437, 0.2, 0.1])
    assert Orientation.from_array(older) == BEHIND
