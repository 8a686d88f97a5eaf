"""Render the training pictures of the builtin prior: members of the families, rendered as in a deformation.

Every picture is made with the cameras, renderer and 2 x 2 grid of the deformation, or is a single view, so the prior is
trained on what the optimisation shows it. Labels are true by construction (see `families/traits.py`); the combinations
of `held_out.py` are never drawn.

Source of the grid: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8 (orthogonal views).
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from meshdeform.priors.builtin.grammar import (
    ATTRIBUTES,
    OPPOSITES,
    Attribute,
    ParsedPrompt,
    tokenise,
)
from meshdeform.priors.builtin.style import CAMERAS, SINGLE_STYLE, STYLE
from meshdeform.priors.builtin.training.families import Part, member
from meshdeform.priors.builtin.training.held_out import attributes_of, is_held_out
from meshdeform.rendering.cameras import fixed_cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import Renderer, combine_views

__all__ = ["SINGLES_EACH", "PictureFolder", "PictureSet", "draw_prompt", "drawn_from", "pictures", "single_views"]

_log = logging.getLogger(__name__)

_ATTRIBUTE_COUNT_ODDS = (0.45, 0.42, 0.13)
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

    def sample(self, size: int, generator: torch.Generator) -> PictureSet:
        """Draw pictures with replacement, all equally likely."""
        return self.rows(torch.randint(len(self), (size,), generator=generator))

    def rows(self, rows: Tensor) -> PictureSet:
        """Return some pictures of the set."""
        return PictureSet(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def drawn(cls, noun: str, members: int, pictures_each: int, seed: int) -> PictureSet:
        """Draw members of a family, and of every member `pictures_each` grids and `SINGLES_EACH` single views."""
        each = pictures_each + SINGLES_EACH
        images, azimuths, tokens = [], [], []
        for number in range(members):
            prompt, shape, generator = _drawn_member(noun, number, seed)
            for drawn, angles in (
                pictures(shape, pictures_each, generator),
                single_views(shape, SINGLES_EACH, generator),
            ):
                images.append(drawn)
                azimuths.append(angles)
            tokens += [tokenise(prompt)] * each
        single = (torch.arange(members * each) % each) >= pictures_each
        return cls(torch.cat(images), torch.tensor(tokens), torch.cat(azimuths), single)


def _drawn_member(noun: str, number: int, seed: int) -> tuple[ParsedPrompt, Part, torch.Generator]:
    """Draw a member, seeded by (seed, noun, number), and the generator of its cameras.

    A set thus depends neither on the order in which it is drawn nor on the other nouns of the vocabulary.
    """
    prompt, rng = _drawn_prompt(noun, number, seed)
    shape = member(noun, prompt.attributes, rng)
    return prompt, shape, torch.Generator().manual_seed(int(rng.integers(2**62)))


def _drawn_prompt(noun: str, number: int, seed: int) -> tuple[ParsedPrompt, np.random.Generator]:
    """Draw the prompt of a member, and return the generator that draws the rest of it."""
    rng = np.random.default_rng([seed, int.from_bytes(hashlib.sha256(noun.encode()).digest()[:8]), number])
    return draw_prompt(noun, rng), rng


class PictureFolder:
    """Pictures of many nouns, one file for each noun; the images stay on the disk and are mapped into memory.

    Attributes
    ----------
    sets : dict of str to PictureSet
        By noun.
    odds : Tensor
        Odds of each noun, float32, in the order of `sets`.
    """

    def __init__(self, sets: Mapping[str, PictureSet], odds: Mapping[str, float] | None = None) -> None:
        self.sets = dict(sets)
        self.odds = torch.tensor([(odds or {}).get(noun, 1.0) for noun in self.sets])

    def __len__(self) -> int:
        return sum(map(len, self.sets.values()))

    def sample(self, size: int, generator: torch.Generator) -> PictureSet:
        """Draw nouns by their odds, and of each noun a picture, all equally likely."""
        sets = list(self.sets.values())
        numbers = torch.multinomial(self.odds, size, replacement=True, generator=generator).tolist()
        shares = torch.rand(size, generator=generator, dtype=torch.float64).tolist()
        picked = [(sets[number], int(share * len(sets[number]))) for number, share in zip(numbers, shares, strict=True)]
        return PictureSet(
            *(torch.stack([getattr(one, field.name)[row] for one, row in picked]) for field in fields(PictureSet))
        )

    @classmethod
    def cached(
        cls,
        folder: Path,
        nouns: Sequence[str],
        members: int,
        pictures_each: int,
        seed: int,
        odds: Mapping[str, float] | None = None,
    ) -> PictureFolder:
        """Read the pictures of some nouns from a folder; draw and write what is missing or was drawn otherwise.

        A noun is drawn anew if its counts, seed, prompts, cameras or family differ from those of its file.
        """
        folder.mkdir(parents=True, exist_ok=True)
        sets = {}
        for noun in nouns:
            path = folder / f"{noun}.safetensors"
            recipe = _recipe(noun, members, pictures_each, seed)
            if _stored_recipe(path) != recipe:
                drawn = PictureSet.drawn(noun, members, pictures_each, seed)
                part = path.with_suffix(".part")
                kept = {name: getattr(drawn, name) for name in _KEPT}
                save_file(kept, part, recipe)
                part.replace(path)
                _log.info("drew %d pictures of %s", len(drawn), noun)
            prompts = [_drawn_prompt(noun, number, seed)[0] for number in range(members)]
            tokens = torch.tensor([tokenise(prompt) for prompt in prompts])
            sets[noun] = PictureSet(tokens=tokens.repeat_interleave(pictures_each + SINGLES_EACH, 0), **load_file(path))
        return cls(sets, odds)


_KEPT = ("images", "azimuth_deg", "single")
"""What a file holds. Tokens are made when it is read, so that a change of the vocabulary does not redraw everything."""
_TOLD_MEMBERS = 8
"""Members whose shapes are part of a recipe: enough to notice that a family was changed."""


def _recipe(noun: str, members: int, pictures_each: int, seed: int) -> dict[str, str]:
    """Return what the pictures of a noun depend on."""
    prompts = [_drawn_prompt(noun, number, seed)[0] for number in range(members)]
    digest = hashlib.sha256(repr((CAMERAS, STYLE, SINGLE_STYLE)).encode())
    for number in range(min(members, _TOLD_MEMBERS)):
        prompt, shape, _ = _drawn_member(noun, number, seed)
        digest.update(str(prompt).encode())
        digest.update(np.round(shape.verts, 6).tobytes())
        digest.update(np.asarray(shape.faces, dtype=np.int64).tobytes())
    return {
        "noun": noun,
        "prompts": hashlib.sha256("\n".join(map(str, prompts)).encode()).hexdigest(),
        "members": str(members),
        "pictures": str(pictures_each),
        "singles": str(SINGLES_EACH),
        "seed": str(seed),
        "family": digest.hexdigest(),
    }


def _stored_recipe(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata() or {})
