"""Render the training pictures of the builtin prior: members of the families, rendered as in a deformation.

Every picture is made with the cameras, renderer and 2 x 2 grid of the deformation, or is a single view, so the prior is
trained on what the optimisation shows it. Labels are true by construction (see `families/traits.py`); the combinations
of `held_out.py` are never drawn.

Source of the grid: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8 (orthogonal views).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from meshdeform.priors.builtin.grammar import (
    ATTRIBUTES,
    NOUNS,
    OPPOSITES,
    SEQUENCE_LENGTH,
    Attribute,
    ParsedPrompt,
    tokenise,
)
from meshdeform.priors.builtin.style import CAMERAS, SINGLE_STYLE, STYLE
from meshdeform.priors.builtin.training.families import Part, member
from meshdeform.priors.builtin.training.held_out import attributes_of, is_held_out
from meshdeform.priors.builtin.weights_file import vocabulary_hash
from meshdeform.rendering.cameras import fixed_cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import Renderer, combine_views

__all__ = ["SINGLES_EACH", "PictureSet", "draw_prompt", "drawn_from", "pictures", "single_views"]

_log = logging.getLogger(__name__)

_ATTRIBUTE_COUNT_ODDS = (0.55, 0.35, 0.10)
"""Odds of none, one and two attributes."""
SINGLES_EACH = 1
"""Single views of every member, in addition to its grids."""


def draw_prompt(noun: str, rng: np.random.Generator, *, held_out: bool = False) -> ParsedPrompt:
    """Draw a prompt about a noun: mostly plain, sometimes with one attribute, rarely with two compatible ones.

    Attributes that are held out for this noun are drawn only if `held_out` is true.
    """
    known = [attribute for attribute in attributes_of(noun) if held_out or not is_held_out(noun, attribute)]
    return drawn_from(noun, known, _ATTRIBUTE_COUNT_ODDS, rng)


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


def single_views(shape: Part, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Render single views of one mesh from random cameras; return them like `pictures`, with their azimuths."""
    verts = torch.from_numpy(shape.verts)
    renderer = Renderer(torch.from_numpy(shape.faces), len(verts), SINGLE_STYLE)
    images, azimuths = [], []
    with torch.no_grad():
        for _ in range(count):
            drawn = sample_orthogonal_cameras(CAMERAS, generator)
            camera = fixed_cameras(drawn.azimuth_deg, drawn.elevation_deg[:1], drawn.fov_deg, views=1)
            view = renderer.render(verts, camera)[0].permute(2, 0, 1)
            images.append((view * 255.0).round().clamp(0, 255).to(torch.uint8))
            azimuths.append(camera.azimuth_deg)
    return torch.stack(images), torch.tensor(azimuths, dtype=torch.float32)


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

    @classmethod
    def drawn(cls, members: int, pictures_each: int, seed: int) -> PictureSet:
        """Draw `members` of every family, and of every member `pictures_each` grids and `SINGLES_EACH` single views.

        Each member has its own generator, seeded by (seed, noun, member), so a set does not depend on the order in
        which it is drawn.
        """
        each = pictures_each + SINGLES_EACH
        total = len(NOUNS) * members * each
        images = torch.empty(total, 3, 2 * STYLE.view_size, 2 * STYLE.view_size, dtype=torch.uint8)
        tokens = torch.empty(total, SEQUENCE_LENGTH, dtype=torch.int64)
        azimuth = torch.empty(total)
        single = (torch.arange(total) % each) >= pictures_each
        start = 0
        for kind, noun in enumerate(NOUNS):
            for number in range(members):
                rng = np.random.default_rng([seed, kind, number])
                prompt = draw_prompt(noun, rng)
                shape = member(noun, prompt.attributes, rng)
                generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
                grids, alone = slice(start, start + pictures_each), slice(start + pictures_each, start + each)
                images[grids], azimuth[grids] = pictures(shape, pictures_each, generator)
                images[alone], azimuth[alone] = single_views(shape, SINGLES_EACH, generator)
                tokens[start : start + each] = torch.tensor(tokenise(prompt))
                start += each
            _log.info("drew %d pictures, the last of them of a %s", start, noun)
        return cls(images, tokens, azimuth, single)

    @classmethod
    def cached(cls, path: Path, members: int, pictures_each: int, seed: int) -> PictureSet:
        """Read the set from `path`, or draw it and write it there."""
        recipe = {
            "members": str(members),
            "pictures": str(pictures_each),
            "singles": str(SINGLES_EACH),
            "seed": str(seed),
            "vocabulary": vocabulary_hash(),
        }
        if path.is_file():
            with safe_open(path, framework="pt") as file:
                stored = dict(file.metadata() or {})
            if stored == recipe:
                return cls(**load_file(path))
            _log.warning("%s contains another set and is replaced", path)
        drawn = cls.drawn(members, pictures_each, seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        save_file({field.name: getattr(drawn, field.name) for field in fields(cls)}, part, recipe)
        part.replace(path)
        return drawn
