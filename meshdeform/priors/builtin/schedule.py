"""Define the noise schedule of the builtin prior, and convert its prediction of the clean picture to noise.

::

    x_t     = sqrt(abar) x0 + sqrt(1 - abar) eps
    eps_hat = (x_t - sqrt(abar) x0_hat) / sqrt(1 - abar)
    loss    = min(1 / (1 - abar), 5) |x0_hat - x0|^2

The network predicts x0 rather than eps or v: its stem maps patches of 4 x 4 x 3 numbers to 48 channels, which preserves
the smooth pictures but not noise. With the weight 1 / (1 - abar) = SNR + 1, this is the loss of v; the upper bound
keeps the nearly clean timesteps, where there is little to learn, from dominating.

Sources: Ho et al. 2020, eq. 4; Nichol & Dhariwal 2021, eq. 17; Salimans & Ho 2022, section 4 (SNR + 1 weighting);
Hang et al. 2023 (bounded SNR); Li & He 2025, Back to basics (predict x0 where patches are wide).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

__all__ = [
    "NUM_TIMESTEPS",
    "add_noise",
    "cosine_alphas_cumprod",
    "loss_weight",
    "noise_from_clean",
]

NUM_TIMESTEPS = 1000
_LARGEST_WEIGHT = 5.0


def cosine_alphas_cumprod(steps: int = NUM_TIMESTEPS) -> Tensor:
    """Return the products of the alphas, (steps,) float32: cos^2((t/T + s) / (1 + s) * pi/2) with s = 0.008.

    Source: Nichol & Dhariwal 2021, eq. 17, shifted by one so that no level is exactly 0 or 1.
    """
    at = torch.arange(1, steps + 1, dtype=torch.float64) / (steps + 1)
    level = torch.cos((at + 0.008) / 1.008 * math.pi / 2) ** 2
    return level.to(torch.float32)


def _levels(alphas_cumprod: Tensor, timestep: Tensor) -> tuple[Tensor, Tensor]:
    """Return sqrt(abar_t) and sqrt(1 - abar_t), each (B, 1, 1, 1)."""
    level = alphas_cumprod[timestep][:, None, None, None]
    return level.sqrt(), (1.0 - level).sqrt()


def add_noise(clean: Tensor, noise: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return x_t of pictures (B, C, H, W) at timesteps (B,)."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return signal * clean + sigma * noise


def noise_from_clean(clean: Tensor, noisy: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return eps, given x0 and x_t."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return (noisy - signal * clean) / sigma


def loss_weight(timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return the weights (B, 1, 1, 1) of the squared error of x0."""
    return (1.0 / (1.0 - alphas_cumprod[timestep])).clamp_max(_LARGEST_WEIGHT)[:, None, None, None]
