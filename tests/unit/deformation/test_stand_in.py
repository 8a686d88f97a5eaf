"""Stand-ins of large meshes: what follows them, that nothing is lost, and that runs resume."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation import stand_in
from meshdeform.deformation.binding import Binding
from meshdeform.deformation.checkpoint import dump_checkpoint, load_checkpoint
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.stand_in import StandIn, stand_in_of
from meshdeform.deformation.variables import placed
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import join
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.target import TargetGuide
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.choices import Carrier
from tests.cases import each_case
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import moved, params
from training.shapes import box, grid, torus

F64 = torch.float64
TORUS = RestMesh.of(torus(0.4, 0.15, 120, 50))
"""12,000 faces."""


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stand_in, "MAX_FACES", 1500)
    monkeypatch.setattr(stand_in, "FACES", 800)


def turned(verts: Tensor) -> Tensor:
    """A similarity: a rotation of 50 degrees about a diagonal, 1.3 times as large, and moved."""
    axis = torch.tensor([1.0, 2.0, -1.0], dtype=F64)
    axis = np.radians(50) * axis / axis.norm()
    x, y, z = axis.tolist()
    rotation = torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=F64))
    return 1.3 * verts @ rotation.T + torch.tensor([0.1, -0.2, 0.3], dtype=F64)


def bent(verts: Tensor) -> Tensor:
    x, y, z = verts.unbind(1)
    angle = 1.5 * y
    return torch.stack([x * angle.cos() - z * angle.sin() + 0.3 * y.square(), y, x * angle.sin() + z * angle.cos()], 1)


def test_vertices_follow_the_simplified_surface() -> None:
    simple = stand_in_of(TORUS)
    assert faces_of(simple).shape[0] == 800
    binding = Binding(simple, TORUS)
    assert np.array_equal(binding.move(simple.verts), TORUS.verts)
    np.testing.assert_allclose(
        binding.move(turned(verts_of(simple)).numpy()), turned(verts_of(TORUS)).numpy(), atol=1e-12
    )
    followed = binding.move(bent(verts_of(simple)).numpy())
    expected = bent(verts_of(TORUS)).numpy()
    assert float((bent(verts_of(TORUS)) - verts_of(TORUS)).abs().max()) > 0.1
    assert np.linalg.norm(followed - expected, axis=1).max() < 0.01
    quality = measure(TORUS.verts, TORUS.faces, followed)
    assert (quality.flipped_faces, quality.self_intersecting_faces_after) == (0, 0)


def test_the_sides_of_a_thin_wall_follow_their_own_sides() -> None:
    """Each side stretches its own way, which is no map of space: vertices must find the side that they are on."""
    wall = RestMesh.of(mesh_of(verts_of(box(30)) * torch.tensor([1.0, 1.0, 0.1], dtype=F64), faces_of(box(30))))
    simple = stand_in_of(wall)
    assert faces_of(simple).shape[0] < faces_of(wall).shape[0] / 2

    def parted(verts: Tensor) -> Tensor:
        return verts + torch.tensor([0.0, 0.0, 1.0], dtype=F64) * verts[:, 2:].sign()

    followed = Binding(simple, wall).move(parted(verts_of(simple)).numpy())
    middle = (verts_of(wall)[:, :2].abs() < 0.3).all(1).numpy()
    assert (np.sign(followed[middle, 2]) == np.sign(wall.verts[middle, 2])).all()
    assert np.abs(followed[middle, 2]).min() > 0.5


def test_a_lattice_carries_the_whole_mesh_as_if_there_were_no_stand_in() -> None:
    whole = RestMesh.of(join(moved(TORUS, -0.5, 0, 0), moved(TORUS, 0.5, 0, 0)))
    stands = StandIn(whole)
    field = stands.carry(Carrier.AUTO)
    assert isinstance(field, LatticeField)
    np.testing.assert_allclose(stands.follow(field), verts_of(whole), atol=1e-12)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        field.tensors["cell_jacobians"] += 0.1 * torch.randn(
            field.tensors["cell_jacobians"].shape, generator=generator, dtype=F64
        )
    expected = field.lattice.embedding(whole.verts) @ field.solve().detach().numpy()
    np.testing.assert_array_equal(stands.follow(field), expected)
    assert len(placed(field)) < verts_of(whole).shape[0] / 4


def test_a_stand_in_loses_no_part() -> None:
    """A thousand separate leaves: edges of theirs can collapse only with the whole leaf."""
    places = torch.rand(1000, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    leaf = mesh_of(verts_of(grid(1)) * 0.02, faces_of(grid(1)))
    leaves = RestMesh.of(join(*(moved(leaf, *place.tolist()) for place in places)))
    simple = stand_in_of(leaves)
    assert float(simple.areas.sum()) > 0.5 * float(leaves.areas.sum())


@each_case("carrier", [Carrier.SURFACE, Carrier.LATTICE])
def test_a_large_mesh_reaches_its_target_and_a_run_resumes_bit_for_bit(carrier: Carrier) -> None:
    goal = mesh_of(verts_of(TORUS) * torch.tensor([0.7, 1.6, 0.9], dtype=F64), faces_of(TORUS))
    guidance = TargetGuide(goal, style=RenderStyle(view_size=32, supersample=1))
    given = params(steps=24, learning_rate=0.02, carrier=carrier)
    whole = Deformation(TORUS, guidance, given)
    steps = iter(whole)
    for _ in range(11):
        next(steps)
    stored = dump_checkpoint(whole.checkpoint(), "run")
    assert whole.optimized_faces == 800
    if carrier is Carrier.SURFACE:
        assert {t.shape for t in whole.checkpoint().tensors.values() if t.ndim == 3} == {(800, 3, 3)}
    resumed = Deformation(TORUS, guidance, given, checkpoint=load_checkpoint(stored, "run"))
    for run in (steps, iter(resumed)):
        for _ in run:
            pass
    assert torch.equal(whole.verts(), resumed.verts())
    assert whole.verts().shape == verts_of(TORUS).shape
    way = whole.verts() - verts_of(TORUS)
    wanted = verts_of(goal) - verts_of(TORUS)
    assert float((way * wanted).sum() / (way.norm() * wanted.norm())) > 0.5
    quality = measure(TORUS.verts, TORUS.faces, whole.verts().numpy())
    assert (quality.flipped_faces, quality.self_intersecting_faces_after) == (0, 0)
