"""The fakes keep what they promise to the tests that lean on them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import torch

from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.rendering.cameras import CameraRange, fixed_cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import Renderer, combine_views
from tests.close import assert_close
from tests.fakes import FakePrior, build_tiny_stable_diffusion

CAMERAS = fixed_cameras(0.0, 0.0)


def test_the_gradient_points_from_the_optimum_whatever_the_noise() -> None:
    optimum = torch.full((1, 3, 8, 8), 0.8)
    prior = FakePrior(optimum)
    guidance = ScoreDistillation(prior, "", guidance_scale=100.0)
    for seed in range(5):
        image = torch.full((1, 3, 8, 8), 0.3, requires_grad=True)
        loss, _ = guidance.loss(image, StepContext(0, 1, CAMERAS, torch.Generator().manual_seed(seed)))
        loss.backward()
        level = prior.alphas_cumprod[prior.timesteps[-1]]
        known = (level * (1 - level)).sqrt() * 2 * (image.detach() - optimum)
        factor = image.grad / known
        assert_close(factor, factor.mean().expand_as(factor), rtol=1e-2, atol=0.0)
        assert factor.mean() > 0
    # A mesh is its own optimum, from every side.
    mesh = icosphere(2, 0.7)
    prior = FakePrior(mesh)
    renderer = Renderer(mesh.faces, mesh.verts.shape[0], prior.style)
    for seed in range(3):
        cameras = sample_orthogonal_cameras(CameraRange(), torch.Generator().manual_seed(seed))
        assert torch.equal(prior.picture(cameras), combine_views(renderer.render(mesh.verts, cameras)))


def test_the_tiny_checkpoint_is_the_same_every_time_and_leaves_the_random_state(tmp_path: Path) -> None:
    before = torch.get_rng_state()
    folders = [
        build_tiny_stable_diffusion(tmp_path / str(n), seed=seed, sample_size=8) for n, seed in enumerate((0, 0, 1))
    ]
    assert torch.equal(torch.get_rng_state(), before)
    hashes = [
        hashlib.sha256((folder / "unet" / "diffusion_pytorch_model.safetensors").read_bytes()).hexdigest()
        for folder in folders
    ]
    assert hashes[0] == hashes[1] != hashes[2]
    assert not [path for path in folders[0].rglob("*") if path.suffix in {".bin", ".ckpt", ".pt"}]
