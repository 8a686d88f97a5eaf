"""Render the training pictures of the builtin prior: members of the families, rendered as in a deformation.

Every picture is made with the cameras, renderer and 2 x 2 grid of the deformation, or is a single view, so the prior is
trained on what the optimisation shows it. Labels are true by construction (see `families/traits.py`); the combinations
of `held_out.py` are never drawn.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.families import FAMILIES, member
from meshdeform.priors.builtin.prior import STYLE
from meshdeform.priors.builtin.vocabulary import tokenise
from meshdeform.vocabulary.grammar import ParsedPrompt
from training.collections.members import RealShapes
from training.prior.held_out import attributes_of, is_held_out
from training.prior.pictures import CAMERAS, SINGLE_STYLE, PictureSet, drawn_from, pictures, single_views

__all__ = ["SINGLES_EACH", "PictureFolder", "draw_prompt", "draw_set"]

_log = logging.getLogger(__name__)

_ATTRIBUTE_COUNT_ODDS = (0.45, 0.42, 0.13)
"""Odds of none, one and two attributes."""
SINGLES_EACH = 1
"""Single views of every member, in addition to its grids."""
_REAL_EVERY = 3
"""Every third member of a noun with a family is of a collection, where one has the noun; of other nouns all are."""


def draw_prompt(noun: str, rng: np.random.Generator, *, whole: bool = False) -> ParsedPrompt:
    """Draw a prompt about a noun: mostly plain, sometimes with one attribute, rarely with two compatible ones.

    Attributes that are held out for this noun are never drawn, and those of parts not if `whole`.
    """
    known = [attribute for attribute in attributes_of(noun) if not is_held_out(noun, attribute)]
    known = [attribute for attribute in known if not whole or attribute.part == "whole"]
    return drawn_from(noun, known, _ATTRIBUTE_COUNT_ODDS, rng)


def draw_set(noun: str, members: int, pictures_each: int, seed: int, real: RealShapes | None = None) -> PictureSet:
    """Draw members of a noun, and of every member `pictures_each` grids and `SINGLES_EACH` single views."""
    each = pictures_each + SINGLES_EACH
    images, azimuths, tokens = [], [], []
    for number in range(members):
        prompt, shape, generator = _drawn_member(noun, number, seed, real)
        for pictures_drawn, angles in (
            pictures(shape, pictures_each, generator),
            single_views(shape, SINGLES_EACH, generator),
        ):
            images.append(pictures_drawn)
            azimuths.append(angles)
        tokens += [tokenise(prompt)] * each
    single = (torch.arange(members * each) % each) >= pictures_each
    return PictureSet(torch.cat(images), torch.tensor(tokens), torch.cat(azimuths), single)


def _drawn_member(
    noun: str, number: int, seed: int, real: RealShapes | None
) -> tuple[ParsedPrompt, Part, torch.Generator]:
    """Draw a member, seeded by (seed, noun, number), and the generator of its cameras.

    A set thus depends neither on the order in which it is drawn nor on the other nouns of the vocabulary.
    """
    prompt, rng = _drawn_prompt(noun, number, seed, real)
    if real is not None and _is_real(noun, number, real):
        shape = real.draw(noun, prompt.attributes, rng)
    else:
        shape = member(noun, prompt.attributes, rng)
    return prompt, shape, torch.Generator().manual_seed(int(rng.integers(2**62)))


def _is_real(noun: str, number: int, real: RealShapes | None) -> bool:
    return real is not None and noun in real and (noun not in FAMILIES or number % _REAL_EVERY == 0)


def _drawn_prompt(
    noun: str, number: int, seed: int, real: RealShapes | None
) -> tuple[ParsedPrompt, np.random.Generator]:
    """Draw the prompt of a member, and return the generator that draws the rest of it."""
    rng = np.random.default_rng([seed, int.from_bytes(hashlib.sha256(noun.encode()).digest()[:8]), number])
    return draw_prompt(noun, rng, whole=_is_real(noun, number, real)), rng


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
        real: RealShapes | None = None,
    ) -> PictureFolder:
        """Read the pictures of some nouns from a folder; draw and write what is missing or was drawn otherwise.

        A noun is drawn anew if its counts, seed, prompts, cameras or family differ from those of its file.
        """
        folder.mkdir(parents=True, exist_ok=True)
        sets = {}
        for noun in nouns:
            path = folder / f"{noun}.safetensors"
            recipe = _recipe(noun, members, pictures_each, seed, real)
            if _stored_recipe(path) != recipe:
                noun_set = draw_set(noun, members, pictures_each, seed, real)
                part = path.with_suffix(".part")
                tensors = {name: getattr(noun_set, name) for name in _KEPT}
                save_file(tensors, part, recipe)
                part.replace(path)
                _log.info("drew %d pictures of %s", len(noun_set), noun)
            prompts = [_drawn_prompt(noun, number, seed, real)[0] for number in range(members)]
            tokens = torch.tensor([tokenise(prompt) for prompt in prompts])
            sets[noun] = PictureSet(tokens=tokens.repeat_interleave(pictures_each + SINGLES_EACH, 0), **load_file(path))
        return cls(sets, odds)


_KEPT = ("images", "azimuth_deg", "single")
"""Tensors of a file. Tokens are made when it is read, so that a change of the vocabulary does not redraw everything."""
_TOLD_MEMBERS = 8
"""Members whose shapes are part of a recipe: enough to notice that a family was changed."""


def _recipe(noun: str, members: int, pictures_each: int, seed: int, real: RealShapes | None) -> dict[str, str]:
    """Return the fingerprint of a noun's pictures."""
    prompts = [_drawn_prompt(noun, number, seed, real)[0] for number in range(members)]
    digest = hashlib.sha256(repr((CAMERAS, STYLE, SINGLE_STYLE)).encode())
    for number in range(min(members, _TOLD_MEMBERS)):
        prompt, shape, _ = _drawn_member(noun, number, seed, real)
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
        "real": real.digest(noun) if real is not None and noun in real else "",
    }


def _stored_recipe(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata() or {})
