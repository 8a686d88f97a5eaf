"""The guard of the surface: what is broken is put back, the rest keeps what it gained."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from meshdeform.deformation import surface_guard
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.surface_guard import SurfaceGuard
from meshdeform.deformation.variables import Adam, JacobianField, Variables, placed
from meshdeform.geometry.intersections import intersecting_faces
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.quality import FaceNeighbours
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from meshdeform.guidance.target import TargetGuidance
from meshdeform.requests.document import DeformParams, Safeguard, resolve
from tests.cases import each_case
from tests.close import assert_close
from tests.creased import creased
from training.evaluation.ablations import VertexDisplacements
from training.shapes import box

MESH = icosphere(2)


def broken(mesh: TriangleMesh, verts: torch.Tensor) -> int:
    faces = mesh.faces.numpy()
    folded = FaceNeighbours(faces, mesh.verts.numpy()).folded(verts.numpy())
    return int((folded | intersecting_faces(verts.numpy(), faces)).sum())


def poked(variables: Variables, mesh: TriangleMesh, depth: float) -> None:
    """Push the top of the sphere down by `depth`, and stretch its equator a little."""
    verts = mesh.verts.clone()
    near = torch.exp(-8 * (verts - verts[verts[:, 1].argmax()]).square().sum(1))
    verts[:, 1] -= depth * near
    verts[:, [0, 2]] *= 1 + 0.2 * torch.exp(-8 * verts[:, 1:2].square())
    with torch.no_grad():
        variables.tensors["displacements"].copy_(verts - mesh.verts)


def test_a_whole_shape_is_left_as_it_is() -> None:
    variables = VertexDisplacements(MESH)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, MESH, variables)
    poked(variables, MESH, 0.3)
    before = placed(variables).detach().clone()
    optimizer = Adam([{"params": list(variables.tensors.values()), "lr": 1.0}])
    assert guard.correct(optimizer) == 0
    assert torch.equal(placed(variables), before)


def test_a_crease_beside_a_large_face_may_bend() -> None:
    """A strip that was bent up by 70 degrees and now is by 100: it used to hold back a whole asset on its lattice."""
    mesh = creased(70)
    variables = VertexDisplacements(mesh)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, mesh, variables)
    tensor = variables.tensors["displacements"]
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    for degrees, held in ((100, False), (175, True)):
        with torch.no_grad():
            tensor.copy_(creased(degrees).verts - mesh.verts)
        assert (guard.correct(optimizer) > 0) is held


def test_what_went_through_is_put_back_and_the_rest_keeps_its_gain() -> None:
    variables = VertexDisplacements(MESH)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, MESH, variables)
    poked(variables, MESH, 2.6)
    assert broken(MESH, placed(variables).detach()) > 0
    tensor = variables.tensors["displacements"]
    wished = tensor.detach().clone()
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    optimizer.state[tensor]["exp_avg"] = torch.ones_like(tensor)
    held = guard.correct(optimizer)
    assert 0 < held < 1
    assert broken(MESH, placed(variables).detach()) == 0
    kept = (tensor.detach() == wished).all(1)
    assert 0.3 < float(kept.double().mean()) < 1
    assert wished[kept].norm(dim=1).max() > 0.1, "the equator keeps its stretch"
    forgotten = optimizer.state[tensor]["exp_avg"].norm(dim=1) == 0
    assert 0 < int(forgotten.sum()) < len(tensor)


def pair_of_balls() -> TriangleMesh:
    small = TriangleMesh(MESH.verts * 0.3, MESH.faces)
    return join(small, TriangleMesh(small.verts + torch.tensor([1.0, 0.0, 0.0]), small.faces))


def test_parts_that_run_into_each_other_are_held_where_they_meet() -> None:
    pair = pair_of_balls()
    variables = VertexDisplacements(pair)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, pair, variables)
    (tensor,) = variables.tensors.values()
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    assert broken(pair, placed(variables).detach()) > 0
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    optimizer.state[tensor]["exp_avg"] = torch.ones_like(tensor)
    assert guard.correct(optimizer) > 0
    assert not optimizer.state[tensor]["exp_avg"].all(), "what drove them into each other would do so again"
    after = placed(variables).detach()
    assert broken(pair, after) == 0
    assert float((after - pair.verts).norm(dim=1).max()) > 0.1, "their far sides went on"


def test_where_nothing_helps_the_step_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two spheres that are pushed through each other as wholes, and no region may be moved by itself."""
    monkeypatch.setattr(surface_guard, "_HOLD_RINGS", ())
    pair = pair_of_balls()
    variables = VertexDisplacements(pair)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, pair, variables)
    (tensor,) = variables.tensors.values()
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    assert guard.correct(optimizer) == 1
    assert broken(pair, placed(variables).detach()) == 0
    assert float(tensor.detach()[0, 0]) in (pytest.approx(0.4), pytest.approx(0.2), pytest.approx(0.08))


def test_a_region_moves_as_a_whole_where_its_parts_would_fold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two balls that pass through each other also move up together: that part of the step is kept."""
    monkeypatch.setattr(surface_guard, "_BLEND_RINGS", ())
    pair = join(pair_of_balls(), TriangleMesh(MESH.verts * 0.5 - 4.0, MESH.faces))
    variables = VertexDisplacements(pair)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, pair, variables)
    (tensor,) = variables.tensors.values()
    count = len(MESH.verts)
    with torch.no_grad():
        tensor[: 2 * count, 1] += 0.7
        tensor[:count, 0] += 0.8
    assert 0 < guard.correct(Adam([{"params": [tensor], "lr": 1.0}])) < 1
    after = placed(variables).detach()
    assert broken(pair, after) == 0
    moved = after - pair.verts - (after - pair.verts)[2 * count :].mean(0)
    assert_close(moved[: 2 * count, 1], torch.full((2 * count,), 0.7, dtype=torch.float64))


def test_a_second_blend_that_suffices_is_the_end_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hard random steps on a sphere: what the second, wider blend has mended must not be thrown away."""
    entered: list[str] = []
    hold = surface_guard.StepRepair._hold_regions

    def noted(self, *args):  # type: ignore[no-untyped-def]
        entered.append("hold")
        return hold(self, *args)

    monkeypatch.setattr(surface_guard.StepRepair, "_hold_regions", noted)
    blends: list[int] = []
    blend = surface_guard.StepRepair._blend

    def counted(self, *args):  # type: ignore[no-untyped-def]
        blends.append(1)
        return blend(self, *args)

    monkeypatch.setattr(surface_guard.StepRepair, "_blend", counted)
    for seed in (1, 2, 20, 35):
        variables = JacobianField(MESH)
        guard = SurfaceGuard(Safeguard.INTERSECTIONS, MESH, variables)
        generator = torch.Generator().manual_seed(seed)
        noise = torch.randn(len(MESH.faces), 3, 3, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            variables.tensors["jacobians"].add_(noise)
        blends.clear()
        entered.clear()
        optimizer = Adam([{"params": list(variables.tensors.values()), "lr": 1.0}])
        guard.correct(optimizer)
        assert broken(MESH, placed(variables).detach()) == 0
        assert (len(blends), entered) == (2, []), f"seed {seed}"


def test_what_was_broken_at_rest_may_stay() -> None:
    verts = MESH.verts.clone()
    verts[verts[:, 1].argmax(), 1] = -3.0
    spiked = TriangleMesh(verts, MESH.faces)
    assert broken(spiked, verts) > 0
    variables = JacobianField(spiked)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, spiked, variables)
    optimizer = Adam([{"params": [variables.tensors["jacobians"]], "lr": 1.0}])
    assert guard.correct(optimizer) == 0


@each_case("safeguard", list(Safeguard))
def test_a_run_that_must_fold_ends_whole_and_resumes_to_the_bit(safeguard: Safeguard) -> None:
    mesh = icosphere(2, 0.6)
    plate = TriangleMesh(mesh.verts * torch.tensor([1.4, 0.02, 1.4], dtype=torch.float64), mesh.faces)
    guidance = TargetGuidance(plate)
    params = resolve(
        DeformParams.model_validate(
            {
                "guidance": {"kind": "target"}, "preset": "paper", "steps": 37, "learning_rate": 0.08,
                "safeguard": safeguard, "normal_weight": 0.0, "laplacian_weight": 0.0, "jacobian_reg_weight": 0.0,
            }
        )
    )  # fmt: skip
    whole = Deformation(mesh, guidance, params)
    steps = iter(whole)
    for _ in range(18):
        next(steps)
    resumed = Deformation(mesh, guidance, params, checkpoint=whole.checkpoint())
    for run in (steps, iter(resumed)):
        for _ in run:
            pass
    assert torch.equal(whole.verts(), resumed.verts())
    folded = FaceNeighbours(mesh.faces.numpy(), mesh.verts.numpy()).folded(whole.verts().numpy()).any()
    cut = intersecting_faces(whole.verts().numpy(), mesh.faces.numpy()).any()
    assert bool(folded) is (safeguard is Safeguard.NONE)
    assert bool(cut) is (safeguard is not Safeguard.INTERSECTIONS)


def lined_box() -> TriangleMesh:
    """A box with a lining that lies on its floor, in one piece: they have a few vertices in common."""
    shell = box(10)
    lining = TriangleMesh(shell.verts * 0.6 + torch.tensor([0.0, -0.2, 0.0]), shell.faces.flip(1))
    both = join(shell, lining)
    return weld(both.verts.numpy().round(9), both.faces.numpy()).mesh


def test_surfaces_that_touch_at_rest_do_not_hold_their_component() -> None:
    """A bend cuts coarse triangles that lie on each other through each other, however little it is."""
    mesh = lined_box()
    faces = mesh.faces.numpy()
    assert int(RestMesh.of(mesh).num_components) == 1
    variables = VertexDisplacements(mesh)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, mesh, variables)
    with torch.no_grad():
        variables.tensors["displacements"][:, 1] += 0.02 * torch.sin(7 * mesh.verts[:, 0] + 2 * mesh.verts[:, 2])
    assert intersecting_faces(placed(variables).detach().numpy(), faces).sum() > 20
    optimizer = Adam([{"params": list(variables.tensors.values()), "lr": 1.0}])
    assert guard.correct(optimizer) == 0
    # Elsewhere nothing is excused: the lid is pushed down through the lining.
    with torch.no_grad():
        lid = (mesh.verts[:, 1] > 0.49) & (mesh.verts[:, [0, 2]].abs().amax(1) < 0.25)
        variables.tensors["displacements"][lid, 1] -= 0.6
    assert guard.correct(optimizer) > 0


@pytest.mark.parametrize("posed", [False, True])
def test_what_only_meets_in_the_pose_that_viewers_show_is_held_as_well(posed: bool) -> None:
    pair = join(MESH, TriangleMesh(MESH.verts + torch.tensor([6.0, 0.0, 0.0]), MESH.faces))
    pose = np.tile(np.eye(3, 4), (len(pair.verts), 1, 1))
    pose[len(MESH.verts) :, 0, 3] = -3.5  # viewers show the second one beside the first
    variables = VertexDisplacements(pair)
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, pair, variables, pose if posed else None)
    tensor = variables.tensors["displacements"]
    with torch.no_grad():
        tensor[len(MESH.verts) :, 0] -= 1.5
    held = guard.correct(Adam([{"params": [tensor], "lr": 1.0}]))
    assert (held > 0) is posed
    verts = placed(variables).detach().numpy().copy()
    verts[len(MESH.verts) :, 0] -= 3.5
    assert bool(intersecting_faces(verts, pair.faces.numpy()).any()) is not posed
    again = SurfaceGuard(Safeguard.INTERSECTIONS, pair, variables, pose if posed else None)
    again.restore(guard.state)
    assert {name: value.tolist() for name, value in again.state.items()} == {
        name: value.tolist() for name, value in guard.state.items()
    }
