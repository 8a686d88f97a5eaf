"""Silhouette gradients against finite differences of a fine picture, at triangles from coarse to subpixel."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.shapes import grid, icosphere, torus
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.rasterizer import SilhouetteEdges, antialias, rasterize
from tests.cases import each_case


def draw(
    verts: Tensor, faces: Tensor, edges: SilhouetteEdges, size: int, weights: Tensor | None, smooth: bool
) -> Tensor:
    """Mean over the picture of (weighted) coverage."""
    cameras = fixed_cameras(13.0, 10.0)
    clip = verts @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]
    fragments = rasterize(clip, faces, size, size)
    image = (fragments.face_ids >= 0).float()[..., None]
    if smooth:
        image = antialias(image, clip, edges, fragments.depth)
    if weights is None:
        return image.mean()
    scaled = torch.nn.functional.interpolate(weights, size=(size, size), mode="bilinear", align_corners=False)
    return (image[..., 0] * scaled[:, 0]).mean()


def silhouette_edges(faces: Tensor) -> SilhouetteEdges:
    edges = edges_of(faces)
    return SilhouetteEdges(edges.edges, edges.opposite)


@each_case("subdivisions", [1, 2, 3, 4, 5])
@each_case("size", [64, 256])
def test_the_area_of_a_sphere_grows_as_it_should(subdivisions: int, size: int) -> None:
    mesh = icosphere(subdivisions)
    edges = silhouette_edges(mesh.faces)
    verts = mesh.verts.float()
    scale = torch.tensor(0.6, requires_grad=True)
    draw(verts * scale, mesh.faces, edges, size, None, True).backward()
    with torch.no_grad():
        above = draw(verts * 0.61, mesh.faces, edges, 1024, None, False)
        below = draw(verts * 0.59, mesh.faces, edges, 1024, None, False)
    assert scale.grad is not None
    assert scale.grad.item() == pytest.approx(((above - below) / 0.02).item(), rel=0.05)


def test_a_torus_moves_and_stretches_as_finite_differences_say() -> None:
    mesh = torus(n=60, m=40)
    edges = silhouette_edges(mesh.faces)
    verts = mesh.verts.float()
    weights = torch.rand(4, 1, 9, 9, generator=torch.Generator().manual_seed(1))

    def value(p: Tensor, size: int, smooth: bool) -> Tensor:
        return draw(verts * (1 + p[3:]) + p[:3], mesh.faces, edges, size, weights, smooth)

    p = torch.zeros(6, requires_grad=True)
    value(p, 128, True).backward()
    differences = []
    for i in range(6):
        e = torch.zeros(6)
        e[i] = 0.02
        with torch.no_grad():
            differences.append(((value(e, 768, False) - value(-e, 768, False)) / 0.04).item())
    expected = torch.tensor(differences)
    assert p.grad is not None
    assert (p.grad - expected).norm() < 0.06 * expected.norm()


def test_an_open_border_has_a_gradient() -> None:
    mesh = grid(8)
    edges = silhouette_edges(mesh.faces)
    scale = torch.tensor(1.0, requires_grad=True)
    draw(mesh.verts.float() * scale, mesh.faces, edges, 64, None, True).backward()
    with torch.no_grad():
        above = draw(mesh.verts.float() * 1.02, mesh.faces, edges, 1024, None, False)
        below = draw(mesh.verts.float() * 0.98, mesh.faces, edges, 1024, None, False)
    assert scale.grad is not None
    assert scale.grad.item() == pytest.approx(((above - below) / 0.04).item(), rel=0.05)


def test_coverage_after_antialiasing_is_nearer_to_the_truth() -> None:
    mesh = icosphere(3)
    edges = silhouette_edges(mesh.faces)
    verts = mesh.verts.float() * 0.7
    true = draw(verts, mesh.faces, edges, 1024, None, False)
    errors = [abs((draw(verts, mesh.faces, edges, 32, None, smooth) - true).item()) for smooth in (False, True)]
    assert errors[1] < 0.002
    assert errors[1] <= errors[0]


def test_hidden_edges_change_nothing() -> None:
    """A small sphere behind a large one leaves the picture as it is, and gets no gradient."""
    front, back = icosphere(3), icosphere(2, 0.2)
    faces = torch.cat([front.faces, back.faces + front.verts.shape[0]])
    shift = torch.zeros(3, requires_grad=True)
    cameras = fixed_cameras(0.0, 0.0, views=1)
    verts = torch.cat([front.verts.float() * 0.6, back.verts.float() + torch.tensor([0.0, 0.0, -0.75]) + shift])
    clip = verts @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]
    fragments = rasterize(clip, faces, 64, 64)
    image = antialias((fragments.face_ids >= 0).float()[..., None], clip, silhouette_edges(faces), fragments.depth)
    image.sum().backward()
    assert shift.grad is not None
    assert shift.grad.abs().max() == 0
