"""Silhouettes as targets: scales, places, gradients, and what a whole run reaches, against shapes whose silhouettes are
known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from meshdeform.deformation.loop import Deformation
from meshdeform.errors import SilhouetteError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView, picture_scales
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.masks import placed_masks
from meshdeform.guidance.silhouettes import SilhouetteGuide, SilhouetteTerm
from meshdeform.rendering.cameras import CameraFrame, fixed_cameras
from meshdeform.rendering.coverage import CoverageRenderer
from tests.unit.deformation.worlds import params
from training.shapes import box, lathe

IDENTITY = {"id": "silhouettes", "revision": "", "sha256": ""}


def framed(mesh: TriangleMesh) -> TriangleMesh:
    return CameraFrame.around(mesh.verts).place(mesh)


def drawn(mesh: TriangleMesh, azimuth: float, elevation: float = 0.0, side: int = 200) -> NDArray[np.bool_]:
    renderer = CoverageRenderer(faces_of(mesh), len(mesh.verts), side)
    cameras = fixed_cameras(azimuth, elevation, 20.0, views=1, fitting_radius=0.75)
    return np.asarray(renderer.render(verts_of(mesh).float(), cameras)[0].numpy() > 0.5)


def view(mesh: TriangleMesh, azimuth: float, elevation: float = 0.0, side: int = 200) -> SilhouetteView:
    return SilhouetteView(drawn(mesh, azimuth, elevation, side), azimuth, elevation)


def rectangle(height: int, width: int) -> NDArray[np.bool_]:
    mask = np.zeros((200, 200), bool)
    mask[20 : 20 + height, 30 : 30 + width] = True
    return mask


def vase() -> TriangleMesh:
    profile = [(0.3 + 0.15 * math.sin(5 * y), y) for y in np.linspace(-1, 1, 25)]
    return framed(lathe([(0.0, -1.0), *profile, (0.0, 1.0)], 32))


def test_coverage_is_the_area_of_a_disk_and_its_gradient_the_growth_of_that_area() -> None:
    mesh = icosphere(4)
    renderer = CoverageRenderer(faces_of(mesh), len(mesh.verts), 128)
    cameras = fixed_cameras(30.0, 10.0, 20.0, views=1, fitting_radius=1.5)
    size = torch.tensor(0.8, requires_grad=True)
    area = renderer.render(verts_of(mesh).float() * size, cameras)[0].sum()
    # A sphere that just fits has the whole height; the radius seen grows with tan(asin(r / distance)).
    distance = 1.5 / math.sin(math.radians(10.0))
    radius = 64 * math.tan(math.asin(0.8 / distance)) / math.tan(math.radians(10.0))
    assert area.item() == pytest.approx(math.pi * radius**2, rel=0.01)
    (slope,) = torch.autograd.grad(area, size)
    assert slope.item() == pytest.approx(2 * area.item() / 0.8, rel=0.02)


def test_pictures_of_any_resolution_agree_on_the_size_of_one_object() -> None:
    # A block of 4 x 2 x 1, from the front in 10 pixels for a unit, from the side in 20, from above in 5.
    front = SilhouetteView(rectangle(20, 40), 0.0)
    side = SilhouetteView(rectangle(40, 20), 90.0)
    above = SilhouetteView(rectangle(5, 20), 0.0, 90.0)
    np.testing.assert_allclose(picture_scales([front, side, above]), [1, 0.5, 2], rtol=1e-6)
    np.testing.assert_allclose(picture_scales([side, front]), [1, 2], rtol=1e-6)
    np.testing.assert_allclose(picture_scales([above]), [1])


def test_pictures_that_contradict_their_directions_are_refused_with_their_sizes() -> None:
    # The front and the back of one object are equally wide.
    views = [SilhouetteView(rectangle(20, 40), 0.0), SilhouetteView(rectangle(40, 20), 180.0)]
    with pytest.raises(SilhouetteError, match=r"azimuth 180, elevation 0: 40 high and 20 wide"):
        picture_scales(views)


def test_the_own_silhouettes_of_a_shape_overlap_wherever_they_are_in_their_pictures() -> None:
    mesh = vase()
    masks = [np.roll(drawn(mesh, azimuth), (7, -11), (0, 1)) for azimuth in (0.0, 50.0)]
    views = [SilhouetteView(masks[0], 0.0), SilhouetteView(masks[1], 50.0)]
    term = SilhouetteTerm(views)
    term.begin(mesh)
    assert min(each.overlap(mesh.verts, mesh.faces) for each in placed_masks(views, mesh)) > 0.97
    loss, logs = term.loss(verts_of(mesh))
    assert loss.item() < 0.05
    assert logs["silhouette_iou"] > 0.95
    worse, _ = term.loss(verts_of(mesh) * torch.tensor([1.3, 0.8, 1.3], dtype=torch.float64))
    assert worse.item() > 3 * loss.item()


def test_the_gradient_leads_to_the_silhouette() -> None:
    mesh = framed(icosphere(3))
    term = SilhouetteTerm([view(framed(box(4, (0.5, 1.0, 0.5))), 0.0)])
    term.begin(mesh)
    stretch = torch.ones(3, dtype=torch.float64, requires_grad=True)
    value, _ = term.loss(verts_of(mesh) * stretch)
    (slope,) = torch.autograd.grad(value, stretch)
    assert slope[0] > 0 > slope[1]
    assert abs(slope[2]) < 0.1 * slope.abs().max()


def fitted(rest: TriangleMesh, views: list[SilhouetteView], **given: object) -> Deformation:
    listed = [{"azimuth": each.azimuth_deg, "elevation": each.elevation_deg} for each in views]
    settings = params(guidance="silhouettes", silhouettes=listed, **given)
    guidance = SilhouetteGuide(SilhouetteTerm(views, side=64), settings.silhouette_weight, IDENTITY)
    run = Deformation(rest, guidance, settings)
    for _ in run:
        pass
    return run


def test_a_sphere_takes_the_silhouettes_of_a_vase() -> None:
    rest = framed(icosphere(3))
    views = [view(vase(), 0.0), view(vase(), 90.0)]
    run = fitted(rest, views, steps=50)
    placed = placed_masks(views, rest)
    before, after = (
        [each.overlap(verts, rest.faces) for each in placed] for verts in (rest.verts, run.verts().numpy())
    )
    assert max(before) < 0.75
    assert min(after) > 0.93
