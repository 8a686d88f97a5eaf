"""Few degrees of freedom: affine where they are equal, their own mirror image, level, and unlocked level by level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.degrees_of_freedom import BasisLevel
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.loop import Deformation, RegionalGradients
from meshdeform.deformation.structure import Nature, Structure, is_convex, is_level, mirror_planes, plane_of
from meshdeform.deformation.variables import JacobianField, placed
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.target import TargetGuide
from tests.cases import each_case
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import moved, params
from training.shapes import box

F64 = torch.float64


def sled() -> TriangleMesh:
    """A block on a longer one, at its front: its own mirror image across x = 0 only."""
    low = mesh_of(verts_of(box(6)) * torch.tensor([0.5, 0.25, 1.0], dtype=F64), faces_of(box(6)))
    high = mesh_of(verts_of(box(6)) * 0.4 + torch.tensor([0.0, 0.6, 0.6], dtype=F64), faces_of(box(6)))
    return join(low, high)


def bean() -> TriangleMesh:
    """A bent ball, in one part: its own mirror image across x = 0 only."""
    ball = icosphere(3)
    x, y, z = verts_of(ball).unbind(1)
    return mesh_of(torch.stack([0.6 * x, y + 0.4 * z**2 + 0.2 * z, z], 1), faces_of(ball))


Carrier = Callable[..., LatticeField | JacobianField]


def lattice(**more: Structure) -> LatticeField:
    return LatticeField(sled(), **more)


def surface(**more: Structure) -> JacobianField:
    return JacobianField(bean(), **more)


CARRIERS: list[Carrier] = [lattice, surface]
PREVIEW = params(steps=3, guidance="sds", orientation="keep")


def randomized(field: LatticeField | JacobianField, seed: int = 0, size: float = 0.2) -> LatticeField | JacobianField:
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for tensor in field.tensors.values():
            tensor.copy_(size * torch.randn(tensor.shape, generator=generator, dtype=F64))
    return field


@each_case("carried", CARRIERS)
def test_equal_coefficients_give_an_affine_map(carried: Carrier) -> None:
    field = carried(structure=Structure())
    linear = 0.3 * torch.randn(3, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    with torch.no_grad():
        next(iter(field.tensors.values())).add_(linear)
    centre = torch.from_numpy(field.rest.centre_of_mass())
    arms = verts_of(field.rest) - centre
    expected = centre + arms @ (torch.eye(3, dtype=F64) + linear).T
    torch.testing.assert_close(placed(field).detach(), expected, atol=1e-9, rtol=0)


@each_case("carried", CARRIERS)
def test_the_whole_does_not_turn_if_structure_is_kept(carried: Carrier) -> None:
    for structure in (Structure(planes=(0,)), Structure(level=True), Structure()):
        mean = randomized(carried(structure=structure)).jacobians().mean(0)
        assert (mean - torch.eye(3, dtype=F64)).abs().max() > 1e-3
        assert bool((mean - mean.T).abs().max() > 1e-3) is (structure == Structure())


@each_case(
    "carrier, mesh, planes",
    [
        (LatticeField, sled(), (0,)),
        (JacobianField, bean(), (0,)),
        (LatticeField, box(6), (0, 2)),
        (JacobianField, icosphere(2), (0, 2)),
    ],
)
def test_a_mirrored_map_gives_a_mirrored_shape(carrier: Carrier, mesh: TriangleMesh, planes: tuple[int, ...]) -> None:
    source = verts_of(mesh)
    kept, free = (placed(randomized(carrier(mesh, structure=Structure(planes=p)))).detach() for p in (planes, ()))
    for plane in planes:
        mirror = torch.ones(3, dtype=F64)
        mirror[plane] = -1
        partner = torch.cdist(source * mirror, source).argmin(1)
        torch.testing.assert_close(kept * mirror, kept[partner], atol=1e-9, rtol=0)
        assert (free * mirror - free[partner]).abs().max() > 0.05


def test_a_face_has_the_nearest_one_that_looks_the_same_way_as_its_mirror_image() -> None:
    """The two sides of a thin plate, whose triangles are no mirror images of each other."""
    plate = mesh_of(verts_of(box(5)) * torch.tensor([1.0, 1.0, 1e-3], dtype=F64), faces_of(box(5)))
    rest = RestMesh.of(plate)
    centres, normals = verts_of(rest)[faces_of(rest)].mean(1).numpy(), rest.normals
    level = BasisLevel.of_elements(centres, normals, np.zeros(3), Structure(planes=(0,)))
    assert level is not None
    with torch.no_grad():
        level.coefficients[:, 2, 2] = torch.from_numpy(rest.normals[:, 2])
    np.testing.assert_allclose(level.jacobians().detach()[:, 2, 2], rest.normals[:, 2], rtol=1e-7)


def test_faces_without_mirror_images_across_two_planes_get_no_coefficients_of_their_own() -> None:
    """Or a shape that is to be round would lean."""
    planes, ball = Structure(planes=(0, 2)), icosphere(3)
    bent = mesh_of(verts_of(ball) + 0.1 * verts_of(ball).roll(1, 1), faces_of(ball))
    assert JacobianField(ball, structure=planes).local
    assert not JacobianField(bent, structure=planes).local


def test_a_level_map_keeps_what_is_level() -> None:
    source = sled()
    field = LatticeField(source, structure=Structure(level=True))
    generator = torch.Generator().manual_seed(2)
    with torch.no_grad():
        for tensor in field.tensors.values():
            tensor.copy_(0.2 * torch.randn(tensor.shape, generator=generator, dtype=F64))
            tensor[:, 1, 1] = 0.3  # as high everywhere
    verts = placed(field).detach()
    for height in verts_of(source)[:, 1].unique():
        level = verts[verts_of(source)[:, 1] == height, 1]
        torch.testing.assert_close(level, level.mean().expand_as(level), atol=1e-9, rtol=0)
    assert "cell_level_2" in LatticeField(source, structure=Structure()).tensors
    assert "cell_level_2" not in field.tensors, "what is built gets no free cells"


@each_case("carried", CARRIERS)
def test_gradients_reach_the_coefficients(carried: Carrier) -> None:
    field = randomized(carried(structure=Structure(planes=(0,))), size=0.1)
    field.begin_step(1.0)
    towards = torch.randn(verts_of(field.rest).shape, generator=torch.Generator().manual_seed(3), dtype=F64)

    def value() -> Tensor:
        return (placed(field) * towards).sum()

    value().backward()  # type: ignore[no-untyped-call]
    for name, tensor in field.tensors.items():
        assert tensor.grad is not None
        step = torch.randn(tensor.shape, generator=torch.Generator().manual_seed(4), dtype=F64)
        with torch.no_grad():
            tensor += 1e-3 * step
            above = value()
            tensor -= 2e-3 * step
            below = value()
            tensor += 1e-3 * step
        difference = (above - below) / 2e-3
        assert difference.item() == pytest.approx(float((tensor.grad * step).sum()), rel=1e-6), name


@each_case("fraction, free", [(0.0, 1), (0.1, 1), (0.2, 2), (0.3, 3), (1.0, 3)])
def test_levels_are_unlocked_one_after_the_other_and_all_count(fraction: float, free: int) -> None:
    field = randomized(LatticeField(sled(), structure=Structure()))
    shape = placed(field).detach()
    field.begin_step(fraction)
    torch.testing.assert_close(placed(field).detach(), shape, atol=0, rtol=0)
    placed(field).square().sum().backward()
    assert [tensor.grad is not None for tensor in field.tensors.values()] == [True] * free + [False] * (3 - free)


def test_what_holds_an_element_holds_every_coefficient_that_reaches_it() -> None:
    field = lattice(structure=Structure())
    held = np.linspace(1.0, 0.5, len(field.elements))
    coarse, *_, own = field.rows(held).values()
    np.testing.assert_array_equal(own, held)
    assert coarse.min() == 0.5
    assert (coarse < 0.75).mean() > (held < 0.75).mean(), "a coefficient has the least of its elements"


def test_all_coefficients_are_held_if_all_elements_are() -> None:
    """Also those that reach each element with less than a tenth of their weight, at the corners of the box."""
    for field in (surface(structure=Structure(planes=(0,))), lattice(structure=Structure())):
        count = len(field.elements)
        for rows in field.rows(np.zeros(count)).values():
            assert not rows.any()
        for rows in field.rows(np.ones(count)).values():
            assert (rows == 1).all()


def test_a_loss_for_a_region_reaches_the_coefficients_by_its_cells_alone() -> None:
    mesh = sled()
    field = LatticeField(mesh, structure=Structure())
    upper = (verts_of(mesh)[faces_of(mesh)].mean(1)[:, 1] > 0.3).double().numpy()
    regional = RegionalGradients([upper], RestMesh.of(mesh), field)
    field.begin_step(1.0)
    loss = placed(field).square().sum()
    on_cells = regional.of([loss])
    heights = field.lattice.origin[1] + (field.lattice.cells[:, 1] + 0.5) * field.lattice.spacing
    assert (on_cells[heights < 0.0] == 0).all()
    assert (on_cells[heights > 0.6] != 0).any()
    regional.add(on_cells)
    torch.testing.assert_close(field.tensors["cell_level_2"].grad, on_cells)


def test_mirror_planes_are_found_with_a_part_that_has_no_partner() -> None:
    assert mirror_planes(RestMesh.of(icosphere(3))) == (0, 2)
    assert mirror_planes(RestMesh.of(sled())) == (0,)
    knob = moved(icosphere(1), 0.55, 0.0, 0.0, scale=0.05)
    shifted = join(sled(), knob)
    assert mirror_planes(RestMesh.of(join(shifted, moved(icosphere(1), -0.55, 0.3, 0.0, scale=0.05)))) == (0,)
    blob, direction = icosphere(3), torch.tensor([[2.0], [1.0], [3.0]], dtype=F64)
    lumpy = mesh_of(verts_of(blob) * (1 + 0.3 * torch.sin(verts_of(blob) @ direction)), faces_of(blob))
    assert mirror_planes(RestMesh.of(lumpy)) == ()


@each_case(
    "planes, front, kept",
    [((0, 2), 0.0, (0,)), ((0, 2), 180.0, (0,)), ((0, 2), 90.0, (2,)), ((0,), 90.0, (0,)), ((2,), 0.0, (2,)),
     ((), 0.0, ())],
)  # fmt: skip
def test_the_plane_with_the_front_is_kept_and_in_checkpoints(
    planes: tuple[int, ...], front: float, kept: tuple[int, ...]
) -> None:
    assert plane_of(planes, front) == kept
    structure = Structure(planes, level=True)
    assert Structure.from_array(structure.to_array()) == structure


def test_built_things_are_level() -> None:
    assert is_level(RestMesh.of(sled()))
    assert not is_level(RestMesh.of(box(6))), "a block is to be shaped"
    assert not is_level(RestMesh.of(icosphere(3)))


def test_a_surface_is_convex_if_it_is_its_hull() -> None:
    assert is_convex(RestMesh.of(box(6)))
    assert is_convex(RestMesh.of(icosphere(3)))
    assert not is_convex(RestMesh.of(sled()))
    assert not is_convex(RestMesh.of(mesh_of(torch.eye(3, dtype=torch.float64), torch.tensor([[0, 1, 2]]))))


@each_case(
    "mesh, nature, kept",
    [
        (sled(), Nature(built=True), Structure((0,), level=True)),
        (sled(), Nature(built=True, grown=True), Structure((0,), level=True)),
        (sled(), Nature(built=True, crooked=True), Structure()),
        (icosphere(3), Nature(built=True), Structure((0,), level=True)),
        (icosphere(3), Nature(built=True, grown=True), Structure((0,))),
        (icosphere(3), Nature(built=True, turned=True), Structure((0, 2))),
        (box(6), Nature(built=True), Structure((0,))),
    ],
)
def test_what_the_result_is_decides_what_is_kept(mesh: TriangleMesh, nature: Nature, kept: Structure) -> None:
    """One part may bend into an animal and a block into anything; what is alike from all sides keeps both planes."""
    run = Deformation(mesh, TargetGuide(mesh), PREVIEW, nature=nature)
    assert run.structure == kept


@each_case("mesh", [sled(), bean()])
def test_a_run_goes_on_from_a_shape_with_other_levels(mesh: TriangleMesh) -> None:
    taller = mesh_of(verts_of(mesh) * torch.tensor([1.0, 1.4, 1.0], dtype=F64), faces_of(mesh))
    for nature in (Nature(built=True), Nature(built=True, crooked=True)):
        first = Deformation(mesh, TargetGuide(taller), PREVIEW, nature=nature)
        list(first)
        for given in (PREVIEW, params(steps=3)):
            second = Deformation(mesh, TargetGuide(taller), given, initial=first.checkpoint().tensors)
            torch.testing.assert_close(second.verts(), first.verts(), atol=1e-9, rtol=0)
