"""The answer is manufactured: vertices give Jacobians, and the solve must give the vertices back."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from meshdeform.deformation import poisson
from meshdeform.deformation.differentiable import identity_jacobians, jacobians_of, solve_linear
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import faces_of, verts_of
from tests.cases import each_case
from tests.close import assert_close
from tests.meshes import mesh_of
from training.shapes import box, cylinder, grid, torus, uv_sphere

F64 = torch.float64
BALL = icosphere(1)
MESHES = [
    icosphere(2),
    box(3),
    grid(5),
    torus(),
    uv_sphere(8, 40),
    cylinder(capped=False),
    join(icosphere(1), grid(2), torus(n=8, m=5)),
    # Doubled, flipped and not a manifold.
    mesh_of(
        verts_of(BALL),
        torch.cat([faces_of(BALL), faces_of(BALL)[:7], faces_of(BALL)[3:9].flip(1), torch.tensor([[0, 1, 2]])]),
    ),
]


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def rotation(seed: int = 0) -> Tensor:
    q = torch.linalg.qr(random(3, 3, seed=seed)).Q
    return q * torch.linalg.det(q)


def centred(system: PoissonSystem, verts: Tensor) -> Tensor:
    """Positions relative to their component's centre of mass."""
    labels, areas = torch.from_numpy(system.rest.components), torch.from_numpy(system.rest.vertex_areas)[:, None]
    total = torch.zeros(system.rest.num_components, 1, dtype=F64).index_add(0, labels, areas)
    sums = torch.zeros(system.rest.num_components, 3, dtype=F64).index_add(0, labels, areas * verts)
    return verts - (sums / total.clamp_min(1e-300))[labels]


@each_case("mesh", MESHES)
def test_the_vertices_come_back_up_to_each_components_centre(mesh: TriangleMesh) -> None:
    system = PoissonSystem(mesh)
    wanted = verts_of(mesh) + 0.2 * random(*verts_of(mesh).shape)
    found = solve_linear(system, jacobians_of(RestMesh.of(mesh).gradient, wanted))
    assert_close(centred(system, found), centred(system, wanted), atol=1e-10, rtol=0)
    assert_close(found - centred(system, found), verts_of(mesh) - centred(system, verts_of(mesh)))


@each_case("mesh", MESHES)
@each_case("unit", [1e-6, 1.0, 1e6])
def test_identities_give_the_rest_mesh_in_any_unit_at_any_place(mesh: TriangleMesh, unit: float) -> None:
    moved = mesh_of(unit * (verts_of(mesh) + 3), faces_of(mesh))
    found = solve_linear(PoissonSystem(moved), identity_jacobians(len(mesh.faces)))
    assert_close(found, verts_of(moved), atol=1e-11 * unit, rtol=0)


@each_case("mesh", [icosphere(1), grid(3)])
def test_it_is_the_least_squares_solution(mesh: TriangleMesh) -> None:
    jacobians = random(len(mesh.faces), 3, 3)
    system = PoissonSystem(mesh)
    rest = RestMesh.of(mesh)
    right = rest.gradient.T @ (np.repeat(rest.areas, 3)[:, None] * jacobians.mT.reshape(-1, 3).numpy())
    dense = np.linalg.lstsq(rest.laplacian.toarray(), right, rcond=None)[0]
    expected = centred(system, torch.from_numpy(dense))
    assert_close(centred(system, solve_linear(system, jacobians)), expected, atol=1e-10, rtol=0)


@each_case("mesh", [icosphere(0), grid(2), join(icosphere(0), grid(1))])
def test_the_backward_pass_is_the_gradient(mesh: TriangleMesh) -> None:
    system = PoissonSystem(mesh)
    assert torch.autograd.gradcheck(
        lambda jacobians: solve_linear(system, jacobians), (random(len(mesh.faces), 3, 3).requires_grad_(),)
    )


def soup(verts: list[list[float]], faces: list[list[int]]) -> TriangleMesh:
    return mesh_of(torch.tensor(verts, dtype=F64), torch.tensor(faces, dtype=torch.int64).reshape(-1, 3))


def test_unused_vertices_keep_their_place() -> None:
    ball = icosphere(1)
    mesh = mesh_of(torch.cat([torch.tensor([[9.0, 8, 7]], dtype=F64), verts_of(ball)]), faces_of(ball) + 1)
    system = PoissonSystem(mesh)
    assert system.rest.num_components == 2
    variable = random(len(mesh.faces), 3, 3).requires_grad_()
    found = solve_linear(system, variable)
    assert_close(found[0], verts_of(mesh)[0])
    found[0].sum().backward()
    assert variable.grad is not None
    assert variable.grad.abs().max() == 0


def test_a_vertex_within_a_collapsed_edge_follows_that_edge() -> None:
    """A T-junction closed by a face without area: vertex 2 lies within the edge 0 1, and only that face has it."""
    mesh = soup([[0, 0, 0], [3, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 3], [0, 1, 2]])
    system = PoissonSystem(mesh)
    assert system.rest.solid.tolist() == [True, False]
    assert system.rest.num_components == 1
    field = 2 * rotation(1).expand(2, 3, 3).clone()
    field[1] = torch.eye(3, dtype=F64)  # what stands for the collapsed face does not matter within it
    found = solve_linear(system, field)
    assert_close(found[2], (2 * found[0] + found[1]) / 3, atol=1e-6, rtol=0)
    assert_close(found[1] - found[0], 2 * rotation(1) @ (verts_of(mesh)[1] - verts_of(mesh)[0]), atol=1e-4, rtol=0)


def test_what_only_a_collapsed_face_connects_turns_as_one() -> None:
    left = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    right = [[3, 0, 0], [4, 0, 0], [3, 1, 0]]
    mesh = soup([*left, *right], [[0, 1, 2], [3, 4, 5], [0, 1, 3]])
    system, turn = PoissonSystem(mesh), rotation(2)
    found = solve_linear(system, turn.expand(3, 3, 3).contiguous())
    assert_close(centred(system, found), centred(system, verts_of(mesh)) @ turn.T, atol=1e-8, rtol=0)


@each_case("height", [1e-2, 1e-6, 1e-10, 1e-16, 0.0])
def test_needles_of_any_thinness_do_not_break_the_factor(height: float) -> None:
    """A grid whose rows are squeezed: every other row of triangles is that thin."""
    flat = grid(8)
    verts = verts_of(flat).clone()
    odd = (verts[:, 1] * 8 + 4).round().long() % 2 == 1
    verts[odd, 1] += height - 1 / 8
    mesh = mesh_of(verts, faces_of(flat))
    system = PoissonSystem(mesh)
    found = solve_linear(system, identity_jacobians(len(mesh.faces)))
    assert_close(found, verts_of(mesh), atol=1e-8, rtol=0)
    assert torch.isfinite(solve_linear(system, random(len(mesh.faces), 3, 3))).all()


coordinate = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-9, 1 + 1e-12, 0.5]), st.floats(-1e3, 1e3, allow_nan=False, width=32)
)


@settings(max_examples=120, deadline=None)
@given(
    st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=9),
    st.lists(st.tuples(*[st.integers(0, 99)] * 3), max_size=16),
)
def test_any_triangle_soup_is_solved(rows: list[tuple[float, float, float]], faces: list[tuple[int, int, int]]) -> None:
    verts = torch.tensor(rows, dtype=F64)
    mesh = mesh_of(verts, torch.tensor(faces, dtype=torch.int64).reshape(-1, 3) % len(rows))
    system = PoissonSystem(mesh)
    variable = identity_jacobians(len(faces)).requires_grad_()
    found = solve_linear(system, variable)
    found.square().sum().backward()
    size = float(verts.abs().max()) + 1e-30
    assert_close(found, verts, atol=1e-5 * size, rtol=0)
    assert variable.grad is None or bool(torch.isfinite(variable.grad).all())


def test_wrong_shapes_types_and_values_are_refused() -> None:
    system, infinite = PoissonSystem(icosphere(0)), identity_jacobians(20)
    infinite[3, 1, 2] = float("nan")
    for wrong in (torch.zeros(19, 3, 3, dtype=F64), torch.zeros(20, 3, 3), torch.zeros(20, 9, dtype=F64)):
        with pytest.raises(ShapeError, match="expected jacobians"):
            solve_linear(system, wrong)
    with pytest.raises(NumericalError, match="finite"):
        solve_linear(system, infinite)


def test_a_factor_that_fails_everywhere_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poisson, "factorise", lambda *_: None)
    with pytest.raises(NumericalError) as caught:
        PoissonSystem(icosphere(0))
    assert "merge vertices" in caught.value.advice_text
