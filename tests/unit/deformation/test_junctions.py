"""T-junctions stay closed whatever carries the surface: in the solve, through a stand-in, with what is kept."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.constraints import Constraints, HandleConstraint, RigidBody, freedom_around
from meshdeform.deformation.differentiable import identity_jacobians, jacobians_of, solve_linear
from meshdeform.deformation.edit_map import EditMap
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.path import ShapePath
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.stand_in import StandIn
from meshdeform.deformation.variables import JacobianField, placed
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import join
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.target import TargetGuide
from tests.cases import each_case
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import params
from training.shapes import grid

F64 = torch.float64


def moved(mesh: TriangleMesh, x: float, y: float, z: float = 0.0) -> TriangleMesh:
    return mesh_of(verts_of(mesh) + torch.tensor([x, y, z], dtype=F64), faces_of(mesh))


def plate(coarse: int = 2, fine: int = 8, *, joined: bool = False) -> RestMesh:
    """A coarse square beside a fine one: on each of its edges lie vertices of the other. `joined`: by one vertex."""
    mesh = join(grid(coarse, 1.0), moved(grid(fine, 1.0), 1.0, 0.0))
    if joined:
        corner = (verts_of(mesh) - torch.tensor([0.5, -0.5, 0.0], dtype=F64)).norm(dim=1) < 1e-9
        first, second = corner.nonzero().flatten().tolist()
        faces = torch.where(faces_of(mesh) == second, first, faces_of(mesh))
        used, corners = torch.unique(faces, return_inverse=True)
        mesh = mesh_of(verts_of(mesh)[used], corners.view(-1, 3))
    return RestMesh.of(mesh)


def gap(mesh: RestMesh, verts: Tensor | NDArray[np.float64]) -> float:
    """The greatest distance of a vertex from where its edge has it."""
    seen, points = mesh.junctions, torch.as_tensor(verts).detach().numpy()
    assert len(seen) >= 2
    share = seen.shares[:, None]
    on = (1 - share) * points[seen.ends[:, 0]] + share * points[seen.ends[:, 1]]
    return float(np.abs(points[seen.verts] - on).max())


def random(*shape: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0), dtype=F64)


@each_case("mesh", [plate(), plate(joined=True)])
def test_the_solve_gives_back_what_is_closed_and_closes_what_is_not(mesh: RestMesh) -> None:
    system = PoissonSystem(mesh)
    closed = mesh.junctions.closed(mesh.verts, (verts_of(mesh) + 0.2 * random(*verts_of(mesh).shape)).numpy())
    answer = torch.from_numpy(closed)
    solved = solve_linear(system, jacobians_of(mesh.gradient, answer))
    torch.testing.assert_close(solved - solved.mean(0), answer - answer.mean(0), atol=1e-10, rtol=0)
    torch.testing.assert_close(
        solve_linear(system, identity_jacobians(len(mesh.faces))), verts_of(mesh), atol=1e-11, rtol=0
    )
    jacobians = identity_jacobians(len(mesh.faces)) + 0.3 * random(len(mesh.faces), 3, 3)
    assert gap(mesh, solve_linear(system, jacobians)) < 1e-12


def test_the_gradient_of_the_solve_is_exact() -> None:
    mesh = plate(1, 2)
    pinned = np.zeros(len(mesh.verts), bool)
    pinned[int(verts_of(mesh)[:, 0].argmin())] = True
    jacobians = (identity_jacobians(len(mesh.faces)) + 0.1 * random(len(mesh.faces), 3, 3)).requires_grad_()
    for system in (PoissonSystem(mesh), PoissonSystem(mesh, pinned)):
        assert torch.autograd.gradcheck(partial(solve_linear, system), (jacobians,), atol=1e-7)


def test_pinned_vertices_stay_and_what_is_on_their_edges_follows() -> None:
    mesh = plate()
    pinned = (verts_of(mesh)[:, 0] < 0.4).numpy()
    jacobians = identity_jacobians(len(mesh.faces)) + 0.3 * random(len(mesh.faces), 3, 3)
    solved = solve_linear(PoissonSystem(mesh, pinned), jacobians)
    assert torch.equal(solved[pinned], verts_of(mesh)[pinned])
    assert gap(mesh, solved) < 1e-12


def bent(variables: JacobianField | LatticeField) -> JacobianField | LatticeField:
    with torch.no_grad():
        for tensor in variables.tensors.values():
            tensor += 0.2 * random(*tensor.shape)
    return variables


@each_case("carrier", [JacobianField, LatticeField])
def test_both_carriers_keep_it_closed_with_all_constraints(carrier: type[JacobianField] | type[LatticeField]) -> None:
    mesh = plate()
    kept = mesh.junctions.completed((verts_of(mesh)[:, 0] > 1.3).numpy())
    everything = Constraints(freedom_around(mesh, kept, 0.3), 0.3)
    corner = int((verts_of(mesh)[:, 0] - verts_of(mesh)[:, 1]).argmin())
    pulled = Constraints(
        handles=[HandleConstraint((corner,), (1.0,), verts_of(mesh)[corner].numpy() + [0.0, 0.0, 0.4])]
    )
    for given in (Constraints(), everything, pulled):
        shape = placed(bent(carrier(mesh, constraints=given)))
        assert gap(mesh, shape) < 1e-12
        if given.kept is not None:
            assert torch.equal(shape[given.kept], verts_of(mesh)[given.kept])
        for handle in given.handles:
            np.testing.assert_allclose(shape[handle.corners[0]].detach().numpy(), handle.goal, atol=1e-9)


def test_what_lies_on_an_edge_of_a_rigid_body_follows_it_and_a_body_keeps_its_shape() -> None:
    mesh = plate()
    coarse = np.arange(9)
    shape = placed(bent(LatticeField(mesh, bodies=[RigidBody(coarse)])))
    assert gap(mesh, shape) < 1e-12
    lengths = torch.cdist(shape[coarse], shape[coarse])
    torch.testing.assert_close(lengths, torch.cdist(verts_of(mesh)[coarse], verts_of(mesh)[coarse]), atol=1e-7, rtol=0)
    fine = np.arange(9, len(mesh.verts))
    alone = placed(bent(LatticeField(mesh, bodies=[RigidBody(fine)])))
    lengths = torch.cdist(alone[fine], alone[fine])
    torch.testing.assert_close(lengths, torch.cdist(verts_of(mesh)[fine], verts_of(mesh)[fine]), atol=1e-7, rtol=0)


@each_case("joined", [False, True])
@each_case("carrier", ["auto", "surface"])
def test_a_run_leaves_it_closed_and_resumes_at_the_same_bits(joined: bool, carrier: str) -> None:
    mesh = plate(joined=joined)
    goal = verts_of(mesh).clone()
    goal[:, 2] += 0.6 * (goal[:, 0] * 3).sin() + 0.4 * (goal[:, 1] * 5).cos()
    guidance, settings = TargetGuide(mesh_of(goal, faces_of(mesh))), params(steps=6, carrier=carrier)
    whole = Deformation(mesh, guidance, settings)
    for step in whole:
        if step.step == 3:
            state = whole.checkpoint()
    assert gap(mesh, whole.verts()) < 1e-12
    assert float((whole.verts() - verts_of(mesh)).abs().max()) > 0.01
    resumed = Deformation(mesh, guidance, settings, checkpoint=state)
    for _ in resumed:
        pass
    assert torch.equal(whole.verts(), resumed.verts())


@each_case("lattice", [False, True])
def test_a_large_mesh_follows_its_stand_in_closed(lattice: bool) -> None:
    mesh = plate(20, 80)
    stand_in = StandIn(mesh)
    assert len(stand_in.mesh.faces) < len(mesh.faces)
    variables = LatticeField(stand_in.mesh, mesh) if lattice else JacobianField(stand_in.mesh)
    with torch.no_grad():
        for tensor in variables.tensors.values():
            tensor += 0.05 * random(*tensor.shape)
    assert gap(mesh, stand_in.follow(variables)) < 1e-12


@each_case("share", [0.3, 0.9, 1.4])
def test_the_way_to_a_result_is_closed(share: float) -> None:
    mesh = plate()
    goal = verts_of(mesh).clone()
    goal[:, 2] += 0.6 * (goal[:, 0] * 3).sin()
    closed = torch.from_numpy(mesh.junctions.closed(mesh.verts, goal.numpy()))
    path = ShapePath(mesh, closed.numpy())
    assert gap(mesh, path.at(share)) < 1e-10
    assert np.array_equal(path.at(1.0), closed)
    # What an earlier result opened is open in proportion.
    opened = ShapePath(mesh, goal.numpy()).at(share)
    assert gap(mesh, opened) == pytest.approx(share * gap(mesh, goal), rel=1e-6)


def test_a_shape_carried_to_another_file_leaves_it_closed_there() -> None:
    smooth = RestMesh.of(moved(grid(12, 4.0), 0.0, 0.0))
    verts = verts_of(smooth).clone()
    verts[:, 2] += 0.5 * (2 * verts[:, 0]).sin() * (3 * verts[:, 1]).cos()
    mesh = plate()
    assert gap(mesh, EditMap.between(smooth, verts.numpy()).move(mesh)) < 1e-12


def test_a_detail_on_a_face_follows_it_where_its_corners_follow_an_edge() -> None:
    """The edge is that of a narrow strip, so the corners follow no larger face."""
    strip = grid(1, 1.0)
    strip = mesh_of(verts_of(strip) * torch.tensor([0.02, 1.0, 1.0], dtype=F64), faces_of(strip))
    points = [[0.06, 0.1, 0.002], [0.10, 0.1, 0.002], [0.06, 0.14, 0.002]]
    detail = mesh_of(torch.tensor(points, dtype=F64), torch.tensor([[0, 1, 2]]))
    mesh = RestMesh.of(join(strip, moved(grid(4, 1.0), 0.51, 0.0), detail))
    assert mesh.junctions.verts.tolist() == [5, 6, 7]
    field = bent(LatticeField(mesh))
    shape, nodes = placed(field).detach().numpy(), field.solve().detach().numpy()
    point, corners = verts_of(mesh)[-3].numpy(), mesh.verts[mesh.faces[2:-1]]
    shares = [np.linalg.lstsq(np.stack([b - a, c - a], 1), point - a, rcond=None)[0] for a, b, c in corners]
    within = [min(u, v, 1 - u - v) >= 0 for u, v in shares].index(True)
    weights, face = np.array([1 - shares[within].sum(), *shares[within]]), mesh.faces[2 + within]
    assert np.isin(face, mesh.junctions.verts).any()
    off = field.lattice.embedding(np.stack([point, weights @ corners[within]])) @ nodes
    np.testing.assert_allclose(shape[-3] - weights @ shape[face], off[0] - off[1], atol=1e-12)
