"""Render labelled pictures of shapes as a deformation shows them to the prior, and draw prompts for them.

Source of the grid: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8 (orthogonal views).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from meshdeform.nouns.deformed import Part
from meshdeform.priors.builtin.prior import STYLE
from meshdeform.rendering.cameras import CameraRange, fixed_cameras
from meshdeform.rendering.shading import Renderer
from meshdeform.rendering.views import combine_views, sample_orthogonal_cameras
from meshdeform.vocabulary.grammar import ParsedPrompt
from meshdeform.vocabulary.lookup import ATTRIBUTES, Attribute
from meshdeform.vocabulary.words import OPPOSITES

SINGLE_STYLE = replace(STYLE, view_size=128)
"""Style of a single view that fills the picture."""
CAMERAS = CameraRange(elevation_min_deg=0.0, elevation_max_deg=30.0, fov_min_deg=30.0, fov_max_deg=45.0)


@dataclass(frozen=True)
class PictureSet:
    """Pictures with their labels.

    `images` (N, 3, 128, 128) uint8, `tokens` (N, SEQUENCE_LENGTH) int64, `azimuth_deg` (N,) float32 of the first view,
    `single` (N,) bool: a single view instead of a grid of four.
    """

    images: Tensor
    tokens: Tensor
    azimuth_deg: Tensor
    single: Tensor

    def __len__(self) -> int:
        return len(self.images)

    def sample(self, size: int, generator: torch.Generator) -> PictureSet:
        """Draw pictures with replacement, all equally likely."""
        rows = torch.randint(len(self), (size,), generator=generator)
        return PictureSet(*(getattr(self, field.name)[rows] for field in fields(self)))


def drawn_from(
    noun: str, known: Sequence[Attribute], odds: tuple[float, float, float], rng: np.random.Generator
) -> ParsedPrompt:
    """Draw a prompt about a noun with compatible attributes of `known`; `odds` are those of none, one and two."""
    chosen: list[Attribute] = []
    for _ in range(int(rng.choice(3, p=odds))):
        free = [attribute for attribute in known if all(_agree(attribute, other) for other in chosen)]
        chosen.append(free[int(rng.integers(len(free)))])
    return ParsedPrompt(noun, tuple(sorted(chosen, key=ATTRIBUTES.index)))


def _agree(one: Attribute, other: Attribute) -> bool:
    """Return whether the attributes differ and a shape can have both."""
    if one.part != other.part:
        return True
    return one.part == "whole" and one != other and {one.degree, other.degree} not in OPPOSITES


def pictures(shape: Part, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Render grids of four views of one mesh from random cameras.

    Returns `images` (count, 3, 128, 128) uint8. Returns `azimuth_deg` (count,) float32: azimuth of each picture's first
    view.
    """
    verts = torch.from_numpy(shape.verts)
    renderer = Renderer(torch.from_numpy(shape.faces), len(verts), STYLE)
    images, azimuths = [], []
    with torch.no_grad():
        for _ in range(count):
            cameras = sample_orthogonal_cameras(CAMERAS, generator)
            grid = combine_views(renderer.render(verts, cameras))[0]
            images.append((grid * 255.0).round().clamp(0, 255).to(torch.uint8))
            azimuths.append(cameras.azimuth_deg)
    return torch.stack(images), torch.tensor(azimuths, dtype=torch.float32)


def single_views(shape: Part, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Render single views of one mesh from random cameras; return them like `pictures`, with their azimuths."""
    verts = torch.from_numpy(shape.verts)
    renderer = Renderer(torch.from_numpy(shape.faces), len(verts), SINGLE_STYLE)
    images, azimuths = [], []
    with torch.no_grad():
        for _ in range(count):
            cameras = sample_orthogonal_cameras(CAMERAS, generator)
            camera = fixed_cameras(cameras.azimuth_deg, cameras.elevation_deg[:1], cameras.fov_deg, views=1)
            view = renderer.render(verts, camera)[0].permute(2, 0, 1)
            images.append((view * 255.0).round().clamp(0, 255).to(torch.uint8))
            azimuths.append(camera.azimuth_deg)
    return torch.stack(images), torch.tensor(azimuths, dtype=torch.float32)
