"""What breaks such systems, small: every input of the benchmark goes the whole way and keeps what it must.

Only the hardest are read for their front, each as one noun: what else they might be does not matter here.

Below, what these inputs found in the guard of the surface, each on the smallest mesh that shows it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from bench.input_meshes import INPUTS
from bench.inputs import glb, outcome
from meshdeform.assets import load_asset
from meshdeform.deformation import surface_guard
from meshdeform.deformation.surface_guard import SurfaceGuard
from meshdeform.deformation.variables import Adam, JacobianField, Variables, placed
from meshdeform.geometry.folds import FaceNeighbours
from meshdeform.geometry.intersections import cutting_pairs
from meshdeform.geometry.mesh import TriangleMesh, connected_components
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from meshdeform.requests.document import Safeguard
from tests.cases import each_case
from tests.displacements import VertexDisplacements
from tests.fakes import FakePrior
from training.shapes import grid

SIZE = 0.3


def shape(name: str, size: float = SIZE) -> TriangleMesh:
    surface = load_asset(glb(INPUTS[name](size))).surface
    return weld(surface.positions, surface.triangles).mesh


def guarded(
    mesh: TriangleMesh, kind: Callable[[TriangleMesh], Variables] = JacobianField
) -> tuple[Variables, SurfaceGuard, Adam]:
    variables = kind(mesh)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, mesh, variables)
    groups = [{"params": list(variables.tensors.values()), "lr": 1.0}]
    return variables, guard, Adam(groups)


def first_part(mesh: TriangleMesh) -> NDArray[np.bool_]:
    labels = connected_components(mesh.faces, len(mesh.verts))
    return labels == labels[0]


def shifted(mesh: TriangleMesh, *by: float) -> TriangleMesh:
    return TriangleMesh(mesh.verts + np.array(by), mesh.faces)


@each_case("name", INPUTS)
def test_every_input_keeps_what_it_must(name: str) -> None:
    found = outcome(INPUTS[name](SIZE), FakePrior(), 4, orientation="keep")
    assert found.broken == []


HARDEST = ["parts", "book", "zero-area", "moebius-narrow", "confetti", "pinched", "walled"]


@each_case("name", HARDEST)
def test_the_dirichlet_energy_takes_the_hardest_inputs(name: str) -> None:
    given = {"learning_rate": 0.05, "dirichlet_weight": 1.0, "source_noun": "mushroom"}
    assert outcome(INPUTS[name](SIZE), FakePrior(), 3, **given).broken == []


@each_case("name", HARDEST)
def test_the_guard_holds_what_a_much_too_great_rate_would_break(name: str) -> None:
    rates = {"learning_rate": 0.1, "jacobian_reg_weight": 0.0, "normal_weight": 0.0, "laplacian_weight": 0.0}
    found = outcome(INPUTS[name](SIZE), FakePrior(), 10, orientation="keep", **rates)
    assert found.flipped == found.cuts == 0
    assert found.broken == []


@each_case("name", ["moebius", "moebius-narrow", "winding", "double-sided", "book", "walled", "repeated"])
def test_what_cannot_be_wound_alike_is_not_folded(name: str) -> None:
    mesh = shape(name, 1.0)
    assert not FaceNeighbours(mesh.faces).folded(mesh.verts).any()


@each_case("turned", [False, True])
def test_a_fold_is_seen_whichever_way_faces_are_wound(turned: bool) -> None:
    mesh = grid(6)
    verts = mesh.verts.copy()
    verts[int(np.linalg.norm(verts, axis=1).argmin()), :2] += 0.3
    usual = FaceNeighbours(mesh.faces).folded(verts)
    assert 1 <= usual.sum() <= 6
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1] if turned else np.roll(faces[::3], 1, axis=1)
    beside = FaceNeighbours(faces)
    assert np.array_equal(beside.folded(verts), usual)
    assert not beside.folded(mesh.verts).any()
    both = FaceNeighbours(np.concatenate([faces, faces[:, ::-1]]))
    assert np.array_equal(both.folded(verts), np.tile(usual, 2))


def test_parts_that_meet_at_rest_may_move_through_each_other() -> None:
    """Else a toy of overlapping parts, or a box on a table, could not move at all."""
    for name in ("overlapping", "touching"):
        mesh = shape(name)
        variables, guard, optimizer = guarded(mesh, VertexDisplacements)
        with torch.no_grad():
            variables.tensors["displacements"][first_part(mesh), :2] -= 0.04
        assert len(cutting_pairs(placed(variables).detach().numpy(), mesh.faces))
        assert guard.correct(optimizer) == 0


def test_parts_that_are_apart_at_rest_may_not_and_hold_nobody_else_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_guard, "_HOLD_RINGS", ())  # the last resort
    ball = TriangleMesh(0.3 * icosphere(2).verts, icosphere(2).faces)
    mesh = join(ball, shifted(ball, 1.0, 0, 0), shifted(ball, 0, 1.0, 0), shifted(ball, 0, 1.4, 0))
    variables, guard, optimizer = guarded(mesh, VertexDisplacements)
    (tensor,) = variables.tensors.values()
    optimizer.state[tensor]["exp_avg"] = torch.ones_like(tensor)
    parts = tensor.detach().view(4, -1, 3)
    parts[0, :, 0] += 0.8  # into the second
    parts[2, :, 2] += 0.2  # along the fourth, which it cuts at rest
    assert guard.correct(optimizer) == 0.5
    pairs = cutting_pairs(placed(variables).detach().numpy(), mesh.faces) // len(ball.faces)
    assert (pairs.min(1) == 2).all()
    assert float(parts[0, 0, 0]) in (pytest.approx(0.4), pytest.approx(0.2), pytest.approx(0.08))
    assert (parts[2, :, 2] == 0.2).all()
    forgotten = (optimizer.state[tensor]["exp_avg"] == 0).all(1).view(4, -1).all(1)
    assert forgotten.tolist() == [True, True, False, False]


def test_as_many_faces_as_vertices_are_not_mistaken_for_each_other() -> None:
    """On a strip of one row, a tensor's length does not say whether its rows are faces or vertices."""
    mesh = shape("moebius-narrow", 1.0)
    assert len(mesh.faces) == len(mesh.verts)
    variables, guard, optimizer = guarded(mesh)
    jacobians = variables.tensors["jacobians"]
    optimizer.state[jacobians]["exp_avg"] = torch.ones_like(jacobians)
    crushed = int(mesh.verts[mesh.faces].mean(1)[:, 2].argmax())
    with torch.no_grad():
        jacobians[crushed] = -20 * torch.eye(3, dtype=torch.float64)
    assert 0 < guard.correct(optimizer) < 1
    assert torch.equal(jacobians[crushed].detach(), torch.eye(3, dtype=torch.float64))
    assert (optimizer.state[jacobians]["exp_avg"][crushed] == 0).all()
    assert not FaceNeighbours(mesh.faces).folded(placed(variables).detach().numpy()).any()


def test_a_guard_that_goes_on_excuses_what_it_did_before() -> None:
    mesh = shape("overlapping")
    variables, guard, _ = guarded(mesh)
    _, other, optimizer = guarded(shifted(mesh, 0, 0, 0))
    saved = {name: tensor.clone() for name, tensor in guard.state.items()}
    assert len(saved["guard.meeting"]) == 1
    other.restore({**saved, "guard.meeting": torch.empty(0, dtype=torch.int64)})
    assert other.correct(optimizer) > 0, "nothing is excused between the parts"
    other.restore(saved)
    assert other.correct(optimizer) == 0
    assert variables.tensors.keys() <= {name.removeprefix("guard.") for name in saved}
