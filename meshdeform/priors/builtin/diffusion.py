"""The noise schedule of the builtin prior and the algebra of v-prediction.

::

    x_t = sqrt(abar) x0 + sqrt(1 - abar) eps
    v   = sqrt(abar) eps - sqrt(1 - abar) x0
    eps = sqrt(abar) v + sqrt(1 - abar) x_t        x0 = sqrt(abar) x_t - sqrt(1 - abar) v

Sources: Ho et al. 2020, eq. 4; Nichol & Dhariwal 2021, eq. 17; Salimans & Ho 2022, appendix D.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

__all__ = [
    "NUM_TIMESTEPS",
    "add_noise",
    "clean_from_velocity",
    "cosine_alphas_cumprod",
    "noise_from_velocity",
    "velocity",
]

NUM_TIMESTEPS = 1000


def cosine_alphas_cumprod(steps: int = NUM_TIMESTEPS) -> Tensor:
    """(steps,) float32 products of the alphas: cos^2((t/T + s) / (1 + s) * pi/2) with s = 0.008.

    Source: Nichol & Dhariwal 2021, eq. 17, without its clip: v-prediction needs none.
    """
    at = torch.arange(1, steps + 1, dtype=torch.float64) / (steps + 1)
    level = torch.cos((at + 0.008) / 1.008 * math.pi / 2) ** 2
    return level.to(torch.float32)


def _levels(alphas_cumprod: Tensor, timestep: Tensor) -> tuple[Tensor, Tensor]:
    """sqrt(abar_t) and sqrt(1 - abar_t), each (B, 1, 1, 1)."""
    level = alphas_cumprod[timestep][:, None, None, None]
    return level.sqrt(), (1.0 - level).sqrt()


def add_noise(clean: Tensor, noise: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """x_t of pictures (B, C, H, W) at timesteps (B,)."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return signal * clean + sigma * noise


def velocity(clean: Tensor, noise: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """v, what the network learns to predict."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return signal * noise - sigma * clean


def noise_from_velocity(v: Tensor, noisy: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Eps from v and x_t."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return signal * v + sigma * noisy


def clean_from_velocity(v: Tensor, noisy: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """x0 from v and x_t."""
    signal, sigma = _levels(alphas_cumprod, timestep)
    return signal * noisy - sigma * v
