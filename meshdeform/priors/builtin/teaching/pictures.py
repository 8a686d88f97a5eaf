"""Draw the pictures of a lesson: members of the new nouns, replay of the old ones, and pictures that are held out.

Source of replay: Robins 1995, Catastrophic forgetting, rehearsal and pseudorehearsal.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from meshdeform.priors.builtin.grammar import ParsedPrompt, Words, tokenise
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.priors.builtin.teaching.picture_set import PictureSet, joined, pictures, single_views
from meshdeform.priors.builtin.teaching.replay import shipped_pictures
from meshdeform.priors.builtin.teaching.shapes import Shape, member, prompt_of

KEPT_PICTURES, _FEWEST_KEPT = 32, 8
"""Pictures of taught nouns that their file keeps, for replay when it is taught again: of all, and at least of each."""
_OLD_TO_NEW = 2 / 3
"""Least number of pictures of old nouns in the training for each of a new one; they are repeated for it."""
_HELD_MEMBERS, _HELD_MEMBERS_EACH = 6, 2
"""Of the only noun, and of each of several."""
_HELD_GRIDS = 1
_HELD_NOUNS = 30
"""Old nouns by which a lesson measures what it forgets: every one costs a pass for each noun of the vocabulary."""
_NEW, _HELD = 0, 1
"""First numbers of the seeds of members; the second is the member, so that a set does not depend on the order."""
_FEWEST_TO_HOLD_OUT = 3


@dataclass(frozen=True)
class LessonSize:
    """How many pictures are drawn."""

    members: int = 60  # least number of members of the only noun; at least `each` of every mesh
    members_each: int = 24  # of each of several nouns
    each: int = 4
    grids: int = 3  # grids of four views of a member, in addition to one single view


@dataclass(frozen=True)
class LessonPictures:
    """The pictures of a lesson."""

    training: PictureSet  # of the new nouns and of the old ones
    held_new: PictureSet
    """Of the new nouns: other members of the meshes; of a noun with three, of a mesh that the training does not see."""
    held_old: PictureSet  # of up to 30 old nouns, one member each that the training does not see
    held_meshes: frozenset[str]  # names of the meshes that are held out
    kept: dict[str, PictureSet]  # pictures of the new nouns for the file


def draw_lesson(
    words: Words,
    shapes: Mapping[str, Sequence[Shape]],
    replayed: Mapping[str, PictureSet],
    size: LessonSize,
    seed: int,
) -> LessonPictures:
    """Draw the pictures of a lesson; the same seed gives the same pictures.

    Parameters
    ----------
    words : Words
        Those of the new weights.
    shapes : mapping of str to sequence of Shape
        By noun, at least one of each.
    replayed : mapping of str to PictureSet
        Pictures of nouns that were taught before.
    """
    several = len(shapes) > 1
    if several:
        size = replace(size, members=size.members_each)
    drawn = {
        noun: _of_noun(noun, words, own, size, seed + number, _HELD_MEMBERS_EACH if several else _HELD_MEMBERS)
        for number, (noun, own) in enumerate(shapes.items())
    }
    shipped = shipped_pictures(words)
    old = [noun for noun in words.nouns if noun in shipped and noun not in drawn and noun not in replayed]
    replay = [*(shipped[noun].training for noun in old), *replayed.values()]
    held_old = [
        shipped[noun].held_out for number, noun in enumerate(old) if number * _HELD_NOUNS % len(old) < _HELD_NOUNS
    ]
    new = joined([each.training for each in drawn.values()])
    order, most = torch.Generator().manual_seed(seed), max(KEPT_PICTURES // len(drawn), _FEWEST_KEPT)
    repeats = max(1, round(len(new) * _OLD_TO_NEW / max(sum(map(len, replay)), 1)))
    return LessonPictures(
        joined([new, *replay * repeats]),
        joined([each.held_out for each in drawn.values()]),
        joined(held_old),
        frozenset(each.held_mesh for each in drawn.values() if each.held_mesh),
        {
            noun: each.training.rows(torch.randperm(len(each.training), generator=order)[:most])
            for noun, each in drawn.items()
        },
    )


@dataclass(frozen=True)
class _NounPictures:
    """The pictures of a noun, and the name of the mesh that is held out, if one is."""

    training: PictureSet
    held_out: PictureSet
    held_mesh: str


def _of_noun(noun: str, words: Words, shapes: Sequence[Shape], size: LessonSize, seed: int, held: int) -> _NounPictures:
    """Draw members of a noun, and of a mesh that they do not show if there are three."""
    number = int(np.random.default_rng(seed).integers(len(shapes)))
    apart = shapes[number] if len(shapes) >= _FEWEST_TO_HOLD_OUT else None
    seen = [shape for shape in shapes if shape is not apart]
    count = max(size.members, size.each * len(seen))
    tests = [apart] if apart is not None else seen

    def pictures_of(shape: Shape, which: tuple[int, int], grids: int) -> PictureSet:
        rng = np.random.default_rng((seed, *which))
        part, attributes = member(shape, rng)
        return _drawn(part, prompt_of(noun, attributes), words, rng, grids)

    return _NounPictures(
        joined([pictures_of(seen[k % len(seen)], (_NEW, k), size.grids) for k in range(count)]),
        joined([pictures_of(tests[k % len(tests)], (_HELD, k), _HELD_GRIDS) for k in range(held)]),
        apart.name if apart is not None else "",
    )


def _drawn(part: Part, prompt: ParsedPrompt, words: Words, rng: np.random.Generator, grids: int) -> PictureSet:
    """Render grids and one single view of a member."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    several, azimuths = pictures(part, grids, generator)
    alone, azimuth = single_views(part, 1, generator)
    return PictureSet(
        torch.cat([several, alone]),
        torch.tensor([tokenise(prompt, words)] * (grids + 1)),
        torch.cat([azimuths, azimuth]),
        torch.arange(grids + 1) >= grids,
    )


def replay_of(tensors: Mapping[str, PictureSet], words: Words, new: Collection[str]) -> dict[str, PictureSet]:
    """Return the kept pictures of nouns that were taught before and keep their meaning."""
    return {noun: kept for noun, kept in tensors.items() if noun in words.nouns and noun not in new}
