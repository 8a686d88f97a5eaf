"""The guard of the surface: what is broken is put back, the rest keeps what it gained."""

from __future__ import annotations

import pytest
import torch

from meshdeform.deformation import surface_guard
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.surface_guard import SurfaceGuard
from meshdeform.deformation.variables import Adam
from meshdeform.geometry.folds import FaceNeighbours
from meshdeform.geometry.intersections import intersecting_faces
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from meshdeform.guidance.target import TargetGuidance
from meshdeform.requests.document import Safeguard
from tests.cases import each_case
from tests.close import assert_close
from tests.creased import creased
from tests.displacements import VertexDisplacements
from tests.unit.deformation.worlds import params
from training.shapes import box

MESH = icosphere(2)


def broken(mesh: TriangleMesh, verts: torch.Tensor) -> int:
    faces = mesh.faces
    folded = FaceNeighbours(faces, mesh.verts).folded(verts.numpy())
    return int((folded | intersecting_faces(verts.numpy(), faces)).sum())


def guarded(mesh: TriangleMesh) -> tuple[torch.Tensor, SurfaceGuard, Adam]:
    """Displacements of all vertices, their guard, and an optimiser that remembers a gradient."""
    variables = VertexDisplacements(mesh)
    (tensor,) = variables.tensors.values()
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, mesh, variables)
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    optimizer.state[tensor]["exp_avg"] = torch.ones_like(tensor)
    return tensor, guard, optimizer


def poked(depth: float) -> torch.Tensor:
    """Push the top of the sphere down by `depth`, and stretch its equator a little."""
    verts = MESH.verts.clone()
    near = torch.exp(-8 * (verts - verts[verts[:, 1].argmax()]).square().sum(1))
    verts[:, 1] -= depth * near
    verts[:, [0, 2]] *= 1 + 0.2 * torch.exp(-8 * verts[:, 1:2].square())
    return verts - MESH.verts


def test_a_crease_beside_a_large_face_may_bend() -> None:
    """A strip that was bent up by 70 degrees and now is by 100: it used to hold back a whole asset on its lattice."""
    mesh = creased(70)
    tensor, guard, optimizer = guarded(mesh)
    for degrees, held in ((100, False), (175, True)):
        with torch.no_grad():
            tensor.copy_(creased(degrees).verts - mesh.verts)
        assert (guard.correct(optimizer) > 0) is held


def test_what_went_through_is_put_back_and_the_rest_keeps_its_gain() -> None:
    tensor, guard, optimizer = guarded(MESH)
    with torch.no_grad():
        tensor.copy_(poked(0.3))
    assert guard.correct(optimizer) == 0
    assert torch.equal(tensor, poked(0.3)), "a whole shape is left as it is"
    wished = poked(2.6)
    assert broken(MESH, MESH.verts + wished) > 0
    with torch.no_grad():
        tensor.copy_(wished)
    assert 0 < guard.correct(optimizer) < 1
    assert broken(MESH, MESH.verts + tensor.detach()) == 0
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
    tensor, guard, optimizer = guarded(pair)
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    assert broken(pair, pair.verts + tensor.detach()) > 0
    assert guard.correct(optimizer) > 0
    assert not optimizer.state[tensor]["exp_avg"].all(), "what drove them into each other would do so again"
    assert broken(pair, pair.verts + tensor.detach()) == 0
    assert float(tensor.detach().norm(dim=1).max()) > 0.1, "their far sides went on"


def test_where_nothing_helps_the_step_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two spheres that are pushed through each other as wholes, and no region may be moved by itself."""
    monkeypatch.setattr(surface_guard, "_HOLD_RINGS", ())
    pair = pair_of_balls()
    tensor, guard, optimizer = guarded(pair)
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    assert guard.correct(optimizer) == 1
    assert broken(pair, pair.verts + tensor.detach()) == 0
    assert float(tensor.detach()[0, 0]) in (pytest.approx(0.4), pytest.approx(0.2), pytest.approx(0.08))


def test_a_region_moves_as_a_whole_where_its_parts_would_fold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two balls that pass through each other also move up together: that part of the step is kept."""
    monkeypatch.setattr(surface_guard, "_BLEND_RINGS", ())
    pair = join(pair_of_balls(), TriangleMesh(MESH.verts * 0.5 - 4.0, MESH.faces))
    tensor, guard, optimizer = guarded(pair)
    count = len(MESH.verts)
    with torch.no_grad():
        tensor[: 2 * count, 1] += 0.7
        tensor[:count, 0] += 0.8
    assert 0 < guard.correct(optimizer) < 1
    moved = tensor.detach()
    assert broken(pair, pair.verts + moved) == 0
    up = (moved - moved[2 * count :].mean(0))[: 2 * count, 1]
    assert_close(up, torch.full((2 * count,), 0.7, dtype=torch.float64))


def test_what_was_broken_at_rest_may_stay() -> None:
    verts = MESH.verts.clone()
    verts[verts[:, 1].argmax(), 1] = -3.0
    assert broken(TriangleMesh(verts, MESH.faces), verts) > 0
    _, guard, optimizer = guarded(TriangleMesh(verts, MESH.faces))
    assert guard.correct(optimizer) == 0


PAPER = {"preset": "paper"}
FEW_CONTROLS = {"guidance": "sds", "orientation": "keep"}


@each_case("safeguard, given", [*((each, PAPER) for each in Safeguard), (Safeguard.INTERSECTIONS, FEW_CONTROLS)])
def test_a_run_that_must_fold_ends_whole_and_resumes_to_the_bit(safeguard: Safeguard, given: dict[str, object]) -> None:
    mesh = icosphere(2, 0.6)
    plate = TriangleMesh(mesh.verts * torch.tensor([1.4, 0.02, 1.4], dtype=torch.float64), mesh.faces)
    guidance = TargetGuidance(plate)
    free = dict.fromkeys(("normal_weight", "laplacian_weight", "jacobian_reg_weight"), 0.0)
    settings = params(steps=37, learning_rate=0.08, safeguard=safeguard, **free, **given)
    whole = Deformation(mesh, guidance, settings)
    steps = iter(whole)
    for _ in range(18):
        next(steps)
    resumed = Deformation(mesh, guidance, settings, checkpoint=whole.checkpoint())
    for run in (steps, iter(resumed)):
        for _ in run:
            pass
    assert torch.equal(whole.verts(), resumed.verts())
    folded = FaceNeighbours(mesh.faces, mesh.verts).folded(whole.verts().numpy()).any()
    cut = intersecting_faces(whole.verts().numpy(), mesh.faces).any()
    assert bool(folded) is (safeguard is Safeguard.NONE)
    assert bool(cut) is (safeguard is not Safeguard.INTERSECTIONS)


def lined_box() -> TriangleMesh:
    """A box with a lining that lies on its floor, in one piece: they have a few vertices in common."""
    shell = box(10)
    lining = TriangleMesh(shell.verts * 0.6 + torch.tensor([0.0, -0.2, 0.0]), shell.faces.flip(1))
    both = join(shell, lining)
    return weld(both.verts.round(9), both.faces).mesh


def test_surfaces_that_touch_at_rest_do_not_hold_their_component() -> None:
    """A bend cuts coarse triangles that lie on each other through each other, however little it is."""
    mesh = lined_box()
    assert int(RestMesh.of(mesh).num_components) == 1
    tensor, guard, optimizer = guarded(mesh)
    with torch.no_grad():
        tensor[:, 1] += 0.02 * torch.sin(7 * mesh.verts[:, 0] + 2 * mesh.verts[:, 2])
    assert intersecting_faces((mesh.verts + tensor.detach()).numpy(), mesh.faces).sum() > 20
    assert guard.correct(optimizer) == 0
    # Elsewhere nothing is excused: the lid is pushed down through the lining.
    with torch.no_grad():
        lid = (mesh.verts[:, 1] > 0.49) & (mesh.verts[:, [0, 2]].abs().amax(1) < 0.25)
        tensor[lid, 1] -= 0.6
    assert guard.correct(optimizer) > 0
