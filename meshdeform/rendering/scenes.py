"""Draw backgrounds and lights that change with every view.

The paper renders with an arbitrary background colour (section 4.1); its code draws, for every view, one of three kinds
of background and a light from anywhere on the camera's side. The gradient then averages over surroundings, so the shape
has to match the prompt whatever the background and light.

A background is, with equal odds,

* noise: an independent colour at every pixel, blurred;
* a checkerboard of two colours, 2 to 8 squares a side, blurred;
* one colour.

The density of the light's direction is proportional to the cosine of its angle to the camera's: 45 degrees on average.

Sources: Xu et al. 2024, FusionDeformer, section 4.1 and its public code; Jain et al. 2022, Zero-shot text-guided object
generation with Dream Fields, section 4.2 (the three kinds of background).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

_SQUARES = (2, 8)
_BLUR = (0.01, 0.06)
"""Standard deviation of the blur, as a share of the view's side."""


@dataclass(frozen=True)
class Lighting:
    """Background and light of B views."""

    backgrounds: Tensor  # (B, S, S, 3) float32 in [0, 1]
    lights: Tensor
    """(B, 3) float32: unit vectors towards the light, in each camera's frame (x right, y up, z towards the viewer)."""


def sample_scene(views: int, side: int, generator: torch.Generator, device: torch.device | str = "cpu") -> Lighting:
    """Draw the backgrounds and lights of one step.

    `views`: number of views, B; `side`: side of a view, S, in pixels; `generator`: the job's only source of randomness.
    """
    backgrounds = torch.stack([_background(side, generator) for _ in range(views)])
    u = torch.rand(views, 2, generator=generator, dtype=torch.float64)
    sine, turn = u[:, 0].sqrt(), 2 * math.pi * u[:, 1]
    lights = torch.stack([sine * turn.cos(), sine * turn.sin(), (1 - u[:, 0]).sqrt()], 1).float()
    return Lighting(backgrounds.to(device), lights.to(device))


def _background(side: int, generator: torch.Generator) -> Tensor:
    """Draw one background (S, S, 3)."""
    kind, width, count = torch.rand(3, generator=generator).tolist()
    colours = torch.rand(2, 3, generator=generator)
    if kind >= 2 / 3:
        return colours[0].expand(side, side, 3)
    sigma = (_BLUR[0] + (_BLUR[1] - _BLUR[0]) * width) * side
    if kind < 1 / 3:
        return _blurred(torch.rand(side, side, 3, generator=generator), sigma)
    squares = _SQUARES[0] + int(count * (_SQUARES[1] - _SQUARES[0] + 1))
    cell = torch.div(torch.arange(side) * squares, side, rounding_mode="floor")
    odd = ((cell[:, None] + cell[None, :]) % 2).bool()
    return _blurred(torch.where(odd[..., None], colours[0], colours[1]), sigma)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blur an image (S, S, 3) with a Gaussian of standard deviation `sigma`, in pixels."""
    reach = min(max(math.ceil(2.5 * sigma), 1), image.shape[0] - 1)
    kernel = torch.exp(-torch.arange(-reach, reach + 1).float().square() / (2 * max(sigma, 1e-3) ** 2))
    kernel = (kernel / kernel.sum()).view(1, 1, 1, -1)
    planes = functional.pad(image.permute(2, 0, 1)[:, None], (reach,) * 4, mode="reflect")
    planes = functional.conv2d(functional.conv2d(planes, kernel), kernel.mT)
    return planes[:, 0].permute(1, 2, 0)
