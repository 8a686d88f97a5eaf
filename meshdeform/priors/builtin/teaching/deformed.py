"""Deform whole shapes as attributes say: tall, fat, twisted. Numpy alone.

Labels are true by construction: a shape without an attribute of the whole is not deformed.

Source of twist, bend and taper: Barr 1984, Global and local deformations of solid primitives.

Render labelled pictures of shapes as a deformation shows them to the prior, and draw prompts for them.

Source of the grid: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8 (orthogonal views).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.priors.builtin.grammar import ATTRIBUTES, Attribute, ParsedPrompt
from meshdeform.priors.builtin.prior import CAMERAS, SINGLE_STYLE, STYLE
from meshdeform.priors.builtin.vocabulary import OPPOSITES
from meshdeform.rendering.cameras import fixed_cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import Renderer, combine_views

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rng = np.random.Generator


class Part(NamedTuple):
    """Vertices (V, 3) float64 and faces (F, 3) int64 of a surface."""

    verts: Array
    faces: Index


def normalised(part: Part) -> Part:
    """Centre the bounding box at the origin and scale the farthest vertex to distance 1."""
    centred = part.verts - (part.verts.min(0) + part.verts.max(0)) / 2
    return Part(centred / np.linalg.norm(centred, axis=1).max(), part.faces)


def _scaled(x: float, y: float, z: float) -> Array:
    return np.array([x, y, z])


def _height(verts: Array) -> Array:
    """Return the height of each vertex, from 0 at the bottom to 1 at the top."""
    low, high = verts[:, 1].min(), verts[:, 1].max()
    return np.asarray((verts[:, 1] - low) / (high - low))


def _slimness(verts: Array) -> Array:
    """Return the shares (x, z) of a change of girth: 1 along the slimmer axis, less along the longer one."""
    # A fat dog is thus wider, not longer.
    extent = np.ptp(verts, axis=0)[[0, 2]]
    return np.asarray(extent.min() / extent)


def _tall(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(1.4, 1.75), 1.0)


def _short(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(0.5, 0.62), 1.0)


def _thin(verts: Array, rng: Rng) -> Array:
    x, z = 1.0 - rng.uniform(0.42, 0.52) * _slimness(verts)
    return verts * _scaled(x, 1.0, z)


def _fat(verts: Array, rng: Rng) -> Array:
    bulge = 0.15 + rng.uniform(0.5, 0.7) * np.sin(np.pi * _height(verts))
    x, z = _slimness(verts)
    scale: Array = np.stack([1.0 + x * bulge, np.ones_like(bulge), 1.0 + z * bulge], 1)
    return verts * scale


def _wide(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(rng.uniform(1.5, 1.85), 1.0, 1.0)


def _long(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, 1.0, rng.uniform(1.5, 1.85))


def _flat(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(0.28, 0.36), 1.0)


def _twisted(verts: Array, rng: Rng) -> Array:
    # Twisting a solid of revolution has no visible effect, so its cross-section becomes a rounded square first.
    azimuth = np.arctan2(verts[:, 0], verts[:, 2])
    fluted = 1.0 + 0.16 * np.cos(4 * azimuth)
    angle = np.radians(rng.uniform(80, 115)) * (_height(verts) - 0.5)
    x, z = verts[:, 0] * fluted, verts[:, 2] * fluted
    return np.stack([np.cos(angle) * x + np.sin(angle) * z, verts[:, 1], np.cos(angle) * z - np.sin(angle) * x], 1)


def _leaning(verts: Array, rng: Rng) -> Array:
    sheared = verts.copy()
    sheared[:, 0] += rng.uniform(0.45, 0.65) * verts[:, 1]
    return sheared


def _bent(verts: Array, rng: Rng) -> Array:
    low, high = verts[:, 1].min(), verts[:, 1].max()
    angle = np.radians(rng.uniform(65, 90)) * (verts[:, 1] - low) / (high - low)
    radius = (high - low) / np.radians(80)
    # Never past the bend's centre, where the shape would turn inside out.
    arm = radius - np.minimum(verts[:, 0], 0.85 * radius)
    return np.stack([radius - arm * np.cos(angle), arm * np.sin(angle), verts[:, 2]], 1)


def _tapered(verts: Array, rng: Rng) -> Array:
    scale = 1.2 - rng.uniform(0.75, 0.85) * _height(verts)
    return verts * np.stack([scale, np.ones_like(scale), scale], 1)


def _pinched(verts: Array, rng: Rng) -> Array:
    # A bell curve around half height: the ends keep their girth, unlike in a thin shape.
    waist = np.exp(-(((_height(verts) - 0.5) / 0.2) ** 2))
    scale = 1.1 - rng.uniform(0.62, 0.72) * waist
    return verts * np.stack([scale, np.ones_like(scale), scale], 1)


WHOLE: dict[str, Callable[[Array, Rng], Array]] = {
    "tall": _tall,
    "short": _short,
    "thin": _thin,
    "fat": _fat,
    "wide": _wide,
    "long": _long,
    "flat": _flat,
    "tapered": _tapered,
    "pinched": _pinched,
    "twisted": _twisted,
    "bent": _bent,
    "leaning": _leaning,
}
"""Deformation for each attribute of the whole, in the order of application."""


def deformed(part: Part, attributes: Iterable[Attribute], rng: Rng) -> Part:
    """Apply every attribute of the whole, then centre the shape and scale it to the unit sphere.

    All deformations preserve the orientation of the faces.
    """
    degrees = {attribute.degree for attribute in attributes if attribute.part == "whole"}
    shape = normalised(part)
    for word, apply in WHOLE.items():
        if word in degrees:
            shape = normalised(Part(apply(shape.verts, rng), shape.faces))
    return shape


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
        return self.rows(torch.randint(len(self), (size,), generator=generator))

    def rows(self, rows: Tensor) -> PictureSet:
        """Return some pictures of the set."""
        return PictureSet(*(getattr(self, field.name)[rows] for field in fields(self)))


def joined(sets: Sequence[PictureSet]) -> PictureSet:
    """Return all pictures of several sets, in order."""
    return PictureSet(*(torch.cat([getattr(each, field.name) for each in sets]) for field in fields(PictureSet)))


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
