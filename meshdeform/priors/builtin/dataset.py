"""The pictures that the builtin prior learns from: members of the families, seen as the deformer sees its mesh.

Every picture is made by the deformer's own cameras, renderer and 2 x 2 grid, so what the prior knows is what
the optimisation shows it. A label is true by construction (see `families/traits.py`).

Source of the picture: Xu et al. 2024, FusionDeformer (orthogonal views combination).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from meshdeform.cameras import sample_orthogonal_cameras
from meshdeform.priors.builtin.families import Part, member
from meshdeform.priors.builtin.grammar import (
    ADJECTIVES,
    ATTRIBUTES,
    NOUNS,
    OPPOSITES,
    PARTS,
    SEQUENCE_LENGTH,
    Attribute,
    ParsedPrompt,
    tokenise,
)
from meshdeform.priors.builtin.style import CAMERAS, STYLE
from meshdeform.shading import Renderer, combine_views

__all__ = ["PictureSet", "draw_prompt", "pictures"]

_log = logging.getLogger(__name__)

_ATTRIBUTE_COUNT_ODDS = (0.55, 0.35, 0.10)
"""Odds of none, one and two attributes."""


def draw_prompt(noun: str, rng: np.random.Generator) -> ParsedPrompt:
    """A prompt about a noun: mostly plain, sometimes with one attribute, seldom with two that agree."""
    known = [Attribute("whole", word) for word in ADJECTIVES]
    known += [Attribute(part, degree) for part in NOUNS[noun] for degree in PARTS[part]]
    chosen: list[Attribute] = []
    for _ in range(int(rng.choice(3, p=_ATTRIBUTE_COUNT_ODDS))):
        free = [attribute for attribute in known if all(_agree(attribute, other) for other in chosen)]
        chosen.append(free[int(rng.integers(len(free)))])
    return ParsedPrompt(noun, tuple(sorted(chosen, key=ATTRIBUTES.index)))


def _agree(one: Attribute, other: Attribute) -> bool:
    """Whether one shape can have both, and they say different things."""
    if one.part != other.part:
        return True
    return one.part == "whole" and one != other and {one.degree, other.degree} not in OPPOSITES


def pictures(shape: Part, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Pictures of one mesh from random cameras.

    Returns
    -------
    images : (count, 3, 128, 128) uint8
    azimuth_deg : (count,) float32
        Azimuth of each picture's first view.
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


@dataclass(frozen=True)
class PictureSet:
    """Pictures with what they show.

    `images` (N, 3, 128, 128) uint8, `tokens` (N, SEQUENCE_LENGTH) int64, `azimuth_deg` (N,) float32.
    """

    images: Tensor
    tokens: Tensor
    azimuth_deg: Tensor

    def __len__(self) -> int:
        return len(self.images)

    @classmethod
    def drawn(cls, members: int, pictures_each: int, seed: int) -> PictureSet:
        """Draw `members` of every family and `pictures_each` pictures of every member.

        Each member has a generator of its own, seeded by (seed, noun, member): a set is the same wherever
        and in whatever order it is drawn.
        """
        total = len(NOUNS) * members * pictures_each
        images = torch.empty(total, 3, 2 * STYLE.view_size, 2 * STYLE.view_size, dtype=torch.uint8)
        tokens = torch.empty(total, SEQUENCE_LENGTH, dtype=torch.int64)
        azimuth = torch.empty(total)
        start = 0
        for kind, noun in enumerate(NOUNS):
            for number in range(members):
                rng = np.random.default_rng([seed, kind, number])
                prompt = draw_prompt(noun, rng)
                shape = member(noun, prompt.attributes, rng)
                generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
                rows = slice(start, start + pictures_each)
                images[rows], azimuth[rows] = pictures(shape, pictures_each, generator)
                tokens[rows] = torch.tensor(tokenise(prompt))
                start += pictures_each
            _log.info("drew %d pictures, the last of them of a %s", start, noun)
        return cls(images, tokens, azimuth)

    @classmethod
    def cached(cls, path: Path, members: int, pictures_each: int, seed: int) -> PictureSet:
        """Read the set from `path`, or draw it and write it there."""
        if path.is_file():
            held = cls(**load_file(path))
            if len(held) == len(NOUNS) * members * pictures_each:
                return held
            _log.warning("%s holds another set and is drawn anew", path)
        drawn = cls.drawn(members, pictures_each, seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        save_file({"images": drawn.images, "tokens": drawn.tokens, "azimuth_deg": drawn.azimuth_deg}, part)
        part.replace(path)
        return drawn
