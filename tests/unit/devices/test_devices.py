"""Every device computes what the CPU computes: rasterizer, shading, antialiasing, score distillation, a whole step.

On a machine with a GPU, `scripts/test tests/unit/devices` proves or refutes it in one command; elsewhere the CPU is
compared with itself through the code that other devices use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.alignment import aligned
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.guidance.target import TargetGuide
from meshdeform.priors import load_prior
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering import rasterizer
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.rasterizer import projected, rasterize_compiled, rasterize_spans
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from tests.cases import each_case
from tests.close import assert_close
from tests.fakes import build_tiny_stable_diffusion, plain_appearance
from training.shapes import torus

MESHES = {
    "sphere": icosphere(3, 0.6),
    "torus": TriangleMesh(0.6 * torus().verts, torus().faces),
    "small faces": icosphere(5, 0.6),
    # Reaches through the near plane and beyond the far one.
    "far": TriangleMesh(icosphere(3).verts * [0.4, 0.4, 6.0], icosphere(3).faces),
}
SIZE = 96


@contextmanager
def torch_path() -> Iterator[None]:
    """Send the CPU through the code of the other devices."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("meshdeform.rendering.rasterizer.is_compiled", lambda _: False)
        yield


def clip_of(mesh: TriangleMesh, cameras: Cameras) -> Tensor:
    return projected(verts_of(mesh).float(), cameras)


@each_case("name", MESHES)
def test_the_rasterizer_sees_the_same_faces(device: str, name: str) -> None:
    mesh = MESHES[name]
    clip = clip_of(mesh, fixed_cameras(20.0, 15.0))
    expected, depth = rasterize_compiled(clip, faces_of(mesh), SIZE, SIZE)
    found, found_depth = rasterize_spans(clip.to(device), faces_of(mesh).to(device), SIZE, SIZE)
    other = found.cpu() != expected
    # Ties in depth at shared edges are broken by the order of faces, or not.
    assert int(other.sum()) <= 1e-3 * int((expected >= 0).sum())
    assert_close(found_depth.cpu()[~other], depth[~other], atol=2e-6, rtol=0)
    assert float(depth.max()) == rasterizer.EMPTY_DEPTH


def painted(mesh: TriangleMesh) -> Appearance:
    """Return the look of a mesh with a texture that is laid on from the front and has holes."""
    pixels = np.random.default_rng(0).integers(0, 256, (16, 16, 4), np.uint8)
    look = plain_appearance(len(mesh.verts), mesh.faces)
    paint = Paint((1.0, 1.0, 1.0, 1.0), Texture(pixels), "MASK")
    return replace(look, texcoords=mesh.verts[:, :2].astype(np.float32), paints=(paint,))


SHADINGS = ["normals", "lambert", "textured"]


@each_case("name, shading", [("torus", "normals"), ("small faces", "lambert"), *product(["sphere"], SHADINGS)])
def test_pictures_and_their_gradients_agree(device: str, name: str, shading: str) -> None:
    mesh = MESHES[name]
    style = RenderStyle(view_size=SIZE, supersample=1, shading=shading)  # type: ignore[arg-type]
    cameras = fixed_cameras(20.0, 15.0)
    weights = torch.rand(4, SIZE, SIZE, 3, generator=torch.Generator().manual_seed(0))

    def drawn(where: str) -> tuple[Tensor, Tensor]:
        verts = verts_of(mesh).clone().to(where).requires_grad_()
        renderer = Renderer(faces_of(mesh), len(mesh.verts), style, where, appearance=painted(mesh))
        image = renderer.render(verts, cameras)
        (image * weights.to(where)).sum().backward()
        assert verts.grad is not None
        return image.detach().cpu(), verts.grad.cpu()

    image, gradient = drawn("cpu")
    with torch_path():
        other_image, other_gradient = drawn(device)
    different = (image - other_image).abs().amax(-1) > 1e-4
    assert int(different.sum()) <= 1e-3 * different.numel()
    assert float((gradient - other_gradient).norm()) < 0.02 * float(gradient.norm())


def test_score_distillation_gives_the_same_gradient(device: str) -> None:
    image = torch.rand(1, 3, 128, 128, generator=torch.Generator().manual_seed(1))

    def gradient(where: str) -> Tensor:
        prior = load_prior("builtin", device=where, dtype="float32")
        guidance = ScoreDistillation(prior, "a mushroom", guidance_scale=7.5)
        drawn = image.clone().to(where).requires_grad_()
        context = StepContext(0, 10, fixed_cameras(0.0, 15.0), torch.Generator().manual_seed(3))
        guidance.loss(drawn, context)[0].backward()
        assert drawn.grad is not None
        return drawn.grad.cpu()

    expected = gradient("cpu")
    assert float((gradient(device) - expected).norm()) < 1e-3 * float(expected.norm())


def one_step(guidance: Callable[[TriangleMesh, str], object], device: str) -> tuple[dict[str, float], Tensor]:
    mesh = MESHES["sphere"]
    params = resolve(DeformParams(preset="preview", steps=1, seed=5, checkpoint_every_steps=1))
    run = Deformation(mesh, guidance(mesh, device), params, device=device)  # type: ignore[arg-type]
    losses = next(iter(run)).losses
    return losses, run._optimizer.state[next(iter(run._variables.tensors.values()))]["exp_avg"]


def with_prior(mesh: TriangleMesh, device: str) -> object:
    prior = load_prior("builtin", device=device, dtype="float32")
    return ScoreDistillation(prior, "a mushroom", guidance_scale=7.5)


def with_target(mesh: TriangleMesh, device: str) -> object:
    return TargetGuide(aligned(torus(), mesh).place_mesh(torus()), device=device)


@each_case("guidance", [with_prior, with_target])
def test_a_whole_step_is_the_same(device: str, guidance: Callable[[TriangleMesh, str], object]) -> None:
    losses, direction = one_step(guidance, "cpu")
    with torch_path():
        other_losses, other = one_step(guidance, device)
    for name in ("total", "guidance", "jacobian", "laplacian", "normal", "dirichlet"):
        assert other_losses[name] == pytest.approx(losses[name], rel=1e-3, abs=1e-6), name
    assert float((direction - other).norm()) < 0.02 * float(direction.norm())


def test_stable_diffusion_predicts_the_same_as_kernel_by_kernel(device: str, tmp_path: Path) -> None:
    prior = StableDiffusionPrior(str(build_tiny_stable_diffusion(tmp_path)), device=device)
    generator = torch.Generator().manual_seed(7)
    side = prior.image_size // 8

    def compare(texts: list[str], step: int) -> None:
        z_t, timestep = torch.randn(1, 4, side, side, generator=generator), torch.tensor([step])
        embedding = prior.encode_texts(*texts)
        predictions = prior.predict_noise(z_t, timestep, embedding, fixed_cameras(0.0, 15.0))
        for row, prediction in zip(embedding, predictions, strict=True):
            inputs = z_t.to(device, prior.dtype)
            expected = prior._run_unet(inputs, timestep.to(device), row[None]).detach()
            assert_close(prediction.cpu(), expected.float().cpu(), atol=2e-2 if device == "cuda" else 1e-5)

    compare(["a mushroom", ""], 500)
    compare(["a goblet", "a chair"], 20)
    compare(["a mushroom", "", "blurry"], 500)
    compare(["a vase", ""], 999)
