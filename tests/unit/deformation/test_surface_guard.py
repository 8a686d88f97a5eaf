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
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.geometry.weld import weld
from meshdeform.guidance.target import TargetGuide
from meshdeform.requests.document import Safeguard
from tests.cases import each_case
from tests.close import assert_close
from tests.creased import creased
from tests.displacements import VertexDisplacements
from tests.meshes import mesh_of
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
    verts = verts_of(MESH).clone()
    near = torch.exp(-8 * (verts - verts[verts[:, 1].argmax()]).square().sum(1))
    verts[:, 1] -= depth * near
    verts[:, [0, 2]] *= 1 + 0.2 * torch.exp(-8 * verts[:, 1:2].square())
    return verts - verts_of(MESH)


def test_a_crease_beside_a_large_face_may_bend() -> None:
    """A strip that was bent up by 70 degrees and now is by 100: it used to hold back a whole asset on its lattice."""
    mesh = creased(70)
    tensor, guard, optimizer = guarded(mesh)
    for degrees, held in ((100, False), (175, True)):
        with torch.no_grad():
            tensor.copy_(verts_of(creased(degrees)) - verts_of(mesh))
        assert (guard.correct(optimizer) > 0) is held


def test_what_went_through_is_put_back_and_the_rest_keeps_its_gain() -> None:
    tensor, guard, optimizer = guarded(MESH)
    with torch.no_grad():
        tensor.copy_(poked(0.3))
    assert guard.correct(optimizer) == 0
    assert torch.equal(tensor, poked(0.3)), "a whole shape is left as it is"
    wished = poked(2.6)
    assert broken(MESH, verts_of(MESH) + wished) > 0
    with torch.no_grad():
        tensor.copy_(wished)
    assert 0 < guard.correct(optimizer) < 1
    assert broken(MESH, verts_of(MESH) + tensor.detach()) == 0
    kept = (tensor.detach() == wished).all(1)
    assert 0.3 < float(kept.double().mean()) < 1
    assert wished[kept].norm(dim=1).max() > 0.1, "the equator keeps its stretch"
    forgotten = optimizer.state[tensor]["exp_avg"].norm(dim=1) == 0
    assert 0 < int(forgotten.sum()) < len(tensor)


def pair_of_balls() -> TriangleMesh:
    small = mesh_of(verts_of(MESH) * 0.3, faces_of(MESH))
    return join(small, mesh_of(verts_of(small) + torch.tensor([1.0, 0.0, 0.0]), faces_of(small)))


def test_parts_that_run_into_each_other_are_held_where_they_meet() -> None:
    pair = pair_of_balls()
    tensor, guard, optimizer = guarded(pair)
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    assert broken(pair, verts_of(pair) + tensor.detach()) > 0
    assert guard.correct(optimizer) > 0
    assert not optimizer.state[tensor]["exp_avg"].all(), "what drove them into each other would do so again"
    assert broken(pair, verts_of(pair) + tensor.detach()) == 0
    assert float(tensor.detach().norm(dim=1).max()) > 0.1, "their far sides went on"


def test_where_nothing_helps_the_step_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two spheres that are pushed through each other as wholes, and no region may be moved by itself."""
    monkeypatch.setattr(surface_guard, "_HOLD_RINGS", ())
    pair = pair_of_balls()
    tensor, guard, optimizer = guarded(pair)
    with torch.no_grad():
        tensor[: len(MESH.verts), 0] += 0.8
    assert guard.correct(optimizer) == 1
    assert broken(pair, verts_of(pair) + tensor.detach()) == 0
    assert float(tensor.detach()[0, 0]) in (pytest.approx(0.4), pytest.approx(0.2), pytest.approx(0.08))


def test_a_region_moves_as_a_whole_where_its_parts_would_fold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two balls that pass through each other also move up together: that part of the step is kept."""
    monkeypatch.setattr(surface_guard, "_BLEND_RINGS", ())
    pair = join(pair_of_balls(), mesh_of(verts_of(MESH) * 0.5 - 4.0, faces_of(MESH)))
    tensor, guard, optimizer = guarded(pair)
    count = len(MESH.verts)
    with torch.no_grad():
        tensor[: 2 * count, 1] += 0.7
        tensor[:count, 0] += 0.8
    assert 0 < guard.correct(optimizer) < 1
    moved = tensor.detach()
    assert broken(pair, verts_of(pair) + moved) == 0
    up = (moved - moved[2 * count :].mean(0))[: 2 * count, 1]
    assert_close(up, torch.full((2 * count,), 0.7, dtype=torch.float64))


def test_what_was_broken_at_rest_may_stay() -> None:
    verts = verts_of(MESH).clone()
    verts[verts[:, 1].argmax(), 1] = -3.0
    assert broken(mesh_of(verts, faces_of(MESH)), verts) > 0
    _, guard, optimizer = guarded(mesh_of(verts, faces_of(MESH)))
    assert guard.correct(optimizer) == 0


PAPER = {"preset": "paper"}
FEW_CONTROLS = {"guidance": "sds", "orientation": "keep"}


@each_case("safeguard, given", [*((each, PAPER) for each in Safeguard), (Safeguard.INTERSECTIONS, FEW_CONTROLS)])
def test_a_run_that_must_fold_ends_whole_and_resumes_to_the_bit(safeguard: Safeguard, given: dict[str, object]) -> None:
    mesh = icosphere(2, 0.6)
    plate = mesh_of(verts_of(mesh) * torch.tensor([1.4, 0.02, 1.4], dtype=torch.float64), faces_of(mesh))
    guidance = TargetGuide(plate)
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
    lining = mesh_of(verts_of(shell) * 0.6 + torch.tensor([0.0, -0.2, 0.0]), faces_of(shell).flip(1))
    both = join(shell, lining)
    return weld(both.verts.round(9), both.faces).mesh


def test_surfaces_that_touch_at_rest_do_not_hold_their_component() -> None:
    """A bend cuts coarse triangles that lie on each other through each other, however little it is."""
    mesh = lined_box()
    assert int(RestMesh.of(mesh).num_components) == 1
    tensor, guard, optimizer = guarded(mesh)
    with torch.no_grad():
        tensor[:, 1] += 0.02 * torch.sin(7 * verts_of(mesh)[:, 0] + 2 * verts_of(mesh)[:, 2])
    assert intersecting_faces((verts_of(mesh) + tensor.detach()).numpy(), mesh.faces).sum() > 20
    assert guard.correct(optimizer) == 0
    # Elsewhere nothing is excused: the lid is pushed down through the lining.
    with torch.no_grad():
        lid = (verts_of(mesh)[:, 1] > 0.49) & (verts_of(mesh)[:, [0, 2]].abs().amax(1) < 0.25)
        tensor[lid, 1] -= 0.6
    assert guard.correct(optimizer) > 0
