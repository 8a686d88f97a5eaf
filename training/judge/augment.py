"""Augment training views by random changes that preserve their meaning and resemble deformed meshes.

Background is 1 and the surface is darker, so a minimum filter grows the surface (closing gaps between legs, where a
deformed sphere has webs) and a maximum filter shrinks it (removing thin parts).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional


def augmented(images: Tensor, generator: torch.Generator) -> Tensor:
    """Mirror, move, scale, close, open, blur, and change brightness and contrast, independently for each view.

    Parameters
    ----------
    images : (B, 1, H, W) float32 in [0, 1]
    generator : torch.Generator
        The only source of randomness.

    Returns
    -------
    (B, 1, H, W) float32.
    """
    count = len(images)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, generator=generator)

    kind = uniform(0.0, 1.0)
    images = images.clone()
    for side, low, high in ((3, 0.0, 0.12), (5, 0.12, 0.25)):
        rows = ((kind >= low) & (kind < high)).nonzero()[:, 0]
        images[rows] = _maximum(_minimum(images[rows], side), side)
    rows = ((kind >= 0.25) & (kind < 0.33)).nonzero()[:, 0]
    images[rows] = _minimum(_maximum(images[rows], 3), 3)
    images = _blurred(images, uniform(-1.0, 1.2).clamp_min(0.0))
    images = _moved(images, uniform(0.88, 1.08), uniform(-0.07, 0.07), uniform(-0.07, 0.07), uniform(-1.0, 1.0))
    gain, power = uniform(0.85, 1.1)[:, None, None, None], uniform(0.75, 1.3)[:, None, None, None]
    # The background stays white; the clay gets lighter or darker.
    shade = (1.0 - images).clamp(0.0, 1.0) * gain
    noise = torch.randn(images.shape, generator=generator) * uniform(-0.02, 0.03).clamp_min(0.0)[:, None, None, None]
    return 1.0 - shade.clamp_min(1e-6).pow(power) + noise


def _maximum(images: Tensor, side: int) -> Tensor:
    return functional.max_pool2d(images, side, stride=1, padding=side // 2)


def _minimum(images: Tensor, side: int) -> Tensor:
    return -_maximum(-images, side)


def _blurred(images: Tensor, sigma: Tensor) -> Tensor:
    """Blur each view with a Gaussian of its own sigma (B,), in pixels; 0 does not change it."""
    at = torch.arange(-3.0, 4.0)
    kernel = torch.exp(-0.5 * (at / sigma.clamp_min(0.05)[:, None]) ** 2)
    kernel = kernel / kernel.sum(1, keepdim=True)
    count = len(images)
    planes = functional.pad(images.transpose(0, 1), (3, 3, 3, 3), value=1.0)
    planes = functional.conv2d(planes, kernel.view(count, 1, 7, 1), groups=count)
    planes = functional.conv2d(planes, kernel.view(count, 1, 1, 7), groups=count)
    return planes.transpose(0, 1)


def _moved(images: Tensor, scale: Tensor, right: Tensor, up: Tensor, side: Tensor) -> Tensor:
    """Scale about the centre, move by shares of half a picture, and mirror where `side` is negative."""
    mirror = torch.where(side < 0, -1.0, 1.0)
    roll = math.radians(4.0) * side
    theta = torch.zeros(len(images), 2, 3)
    theta[:, 0, 0], theta[:, 0, 1], theta[:, 0, 2] = mirror * roll.cos() / scale, -roll.sin() / scale, right
    theta[:, 1, 0], theta[:, 1, 1], theta[:, 1, 2] = mirror * roll.sin() / scale, roll.cos() / scale, up
    grid = functional.affine_grid(theta, list(images.shape), align_corners=False)
    return 1.0 - functional.grid_sample(1.0 - images, grid, align_corners=False)
