"""Interpolation: linear functions come back, perspective included; gradients checked twice."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.rasterizer import interpolate, interpolate_torch, rasterize
from tests.close import assert_close

SIZE = 24


def scene() -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    mesh = icosphere(1, 0.8)
    cameras = fixed_cameras(20.0, 10.0)
    clip = mesh.verts.float() @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]
    ids = rasterize(clip, mesh.faces, SIZE, SIZE).face_ids.view(-1)
    pixels = (ids >= 0).nonzero()[:, 0]
    return mesh.verts, clip, mesh.faces, pixels, ids[pixels]


def test_a_function_that_is_linear_in_space_is_exact() -> None:
    """The clip coordinates themselves, interpolated, project back to the pixel: perspective is right."""
    _, clip, faces, pixels, face = scene()
    found = interpolate(clip, clip, faces, pixels, face, SIZE, SIZE)
    within = pixels % (SIZE * SIZE)
    x = (within % SIZE + 0.5) * 2 / SIZE - 1
    y = 1 - (within // SIZE + 0.5) * 2 / SIZE
    assert_close(found[:, 0] / found[:, 3], x, atol=1e-5, rtol=0)
    assert_close(found[:, 1] / found[:, 3], y, atol=1e-5, rtol=0)


def test_the_backends_agree_in_values_and_gradients() -> None:
    verts, clip, faces, pixels, face = scene()
    values = torch.stack([verts.float().sin()] * 4)
    weights = torch.rand(len(pixels), 3, generator=torch.Generator().manual_seed(0))
    found = []
    for function in (interpolate, interpolate_torch):
        c, v = clip.clone().requires_grad_(), values.clone().requires_grad_()
        out = function(c, v, faces, pixels, face, SIZE, SIZE)
        (out * weights).sum().backward()
        found.append((out, c.grad, v.grad))
    for a, b in zip(*found, strict=True):
        assert_close(a, b, atol=2e-4, rtol=1e-3)


def test_the_backends_agree_on_small_faces() -> None:
    """20,480 faces of a few pixels each: x - p w cancels, and float32 would leave percents of the gradients."""
    mesh = icosphere(5, 0.6)
    cameras = fixed_cameras(20.0, 15.0)
    clip = mesh.verts.float() @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]
    ids = rasterize(clip, mesh.faces, SIZE, SIZE).face_ids.view(-1)
    pixels = (ids >= 0).nonzero()[:, 0]
    values = torch.stack([mesh.verts.float().sin()] * 4)
    weights = torch.rand(len(pixels), 3, generator=torch.Generator().manual_seed(0))
    gradients = []
    for function in (interpolate, interpolate_torch):
        c = clip.clone().requires_grad_()
        (function(c, values, mesh.faces, pixels, ids[pixels], SIZE, SIZE) * weights).sum().backward()
        assert c.grad is not None
        gradients.append(c.grad)
    assert float((gradients[0] - gradients[1]).abs().max()) < 1e-5 * float(gradients[0].abs().max())


def test_gradcheck() -> None:
    verts, clip, faces, pixels, face = scene()
    values = torch.stack([verts.sin()] * 4)
    some = slice(None, None, 37)

    def function(c: Tensor, v: Tensor) -> Tensor:
        return interpolate(c, v, faces, pixels[some], face[some], SIZE, SIZE)

    inputs = (clip.double().requires_grad_(), values.requires_grad_())
    assert torch.autograd.gradcheck(function, inputs, atol=1e-6)


def test_a_face_seen_exactly_edge_on_gives_its_mean_and_pushes_nothing() -> None:
    """Three corners on one line through the pixel's centre: the areas sum to zero in exact arithmetic."""
    clip = torch.tensor([[[-0.5, 0.25, 0.0, 1.0], [0.0, 0.25, 0.5, 1.0], [0.5, 0.25, 0.2, 1.0]]])
    values = torch.tensor([[[3.0], [6.0], [0.0]]])
    pixels, face = torch.tensor([5]), torch.tensor([0])
    for function in (interpolate, interpolate_torch):
        c, v = clip.clone().requires_grad_(), values.clone().requires_grad_()
        out = function(c, v, torch.tensor([[0, 1, 2]]), pixels, face, 4, 4)
        assert_close(out, torch.tensor([[3.0]]))
        out.sum().backward()
        assert c.grad is not None
        assert v.grad is not None
        assert torch.equal(c.grad, torch.zeros_like(clip))
        assert_close(v.grad, torch.full_like(values, 1 / 3))
