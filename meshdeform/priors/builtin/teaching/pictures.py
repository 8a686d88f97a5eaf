"""Draw the pictures of a lesson: members of the new noun, replay of the old ones, and pictures that are held out.

Source of replay: Robins 1995, Catastrophic forgetting, rehearsal and pseudorehearsal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from meshdeform.priors.builtin.grammar import ParsedPrompt, Words, tokenise
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.priors.builtin.teaching.lesson import NewNoun
from meshdeform.priors.builtin.teaching.picture_set import PictureSet, joined, pictures, single_views, taken
from meshdeform.priors.builtin.teaching.replay import shipped_pictures
from meshdeform.priors.builtin.teaching.shapes import Shape, member, prompt_of

KEPT_PICTURES = 32
"""Pictures of a taught noun that its file keeps, for replay when the file is taught again."""
_HELD_MEMBERS = 6
_HELD_GRIDS = 1
_HELD_NOUNS = 30
"""Old nouns by which a lesson measures what it forgets: every one costs a pass for each noun of the vocabulary."""
_NEW, _HELD = 0, 1
"""First numbers of the seeds of members; the second is the member, so that a set does not depend on the order."""
_FEWEST_TO_HOLD_OUT = 3


@dataclass(frozen=True)
class LessonSize:
    """How many pictures are drawn."""

    members: int = 60  # least number of members of the new noun; at least `each` of every mesh
    each: int = 4
    grids: int = 3  # grids of four views of a member, in addition to one single view


@dataclass(frozen=True)
class LessonPictures:
    """The pictures of a lesson."""

    training: PictureSet  # of the new noun and of the old ones
    held_new: PictureSet
    """Of the new noun: other members of the meshes, and of a mesh that the training does not see if there are three."""
    held_old: PictureSet  # of up to 30 old nouns, one member each that the training does not see
    held_mesh: str  # name of the mesh that is held out, or empty
    kept: PictureSet  # pictures of the new noun for the file


def draw_lesson(
    new: NewNoun,
    shapes: Sequence[Shape],
    replayed: Mapping[str, PictureSet],
    size: LessonSize,
    seed: int,
    *,
    made: Sequence[Shape] = (),
) -> LessonPictures:
    """Draw the pictures of a lesson; the same seed gives the same pictures.

    Parameters
    ----------
    shapes : sequence of Shape
        At least one.
    replayed : mapping of str to PictureSet
        Pictures of nouns that were taught before.
    made : sequence of Shape
        New members that somebody made. With them, members are these and the shapes as they are, instead of jittered.
    """
    number = int(np.random.default_rng(seed).integers(len(shapes)))
    held = shapes[number] if len(shapes) >= _FEWEST_TO_HOLD_OUT else None
    seen = [shape for shape in shapes if shape is not held]
    pool = [*seen, *made]
    count = max(size.members, len(pool) if made else size.each * len(pool))
    ours = [_of_shape(pool[k % len(pool)], new, (seed, _NEW, k), size.grids, jitter=not made) for k in range(count)]
    tests = [held] if held is not None else seen
    held_new = [_of_shape(tests[k % len(tests)], new, (seed, _HELD, k), _HELD_GRIDS) for k in range(_HELD_MEMBERS)]
    shipped = shipped_pictures(new.words)
    old = [noun for noun in new.words.nouns if noun in shipped and noun != new.noun and noun not in replayed]
    replay = [shipped[noun].training for noun in old]
    held_old = [
        shipped[noun].held_out for number, noun in enumerate(old) if number * _HELD_NOUNS % len(old) < _HELD_NOUNS
    ]
    drawn = joined(ours)
    rows = torch.randperm(len(drawn), generator=torch.Generator().manual_seed(seed))[:KEPT_PICTURES]
    return LessonPictures(
        joined([drawn, *replay, *replayed.values()]),
        joined(held_new),
        joined(held_old),
        held.name if held is not None else "",
        taken(drawn, rows),
    )


def _of_shape(shape: Shape, new: NewNoun, seed: tuple[int, ...], grids: int, *, jitter: bool = True) -> PictureSet:
    rng = np.random.default_rng(seed)
    part, attributes = member(shape, rng, jitter=jitter)
    return _drawn(part, prompt_of(new.noun, attributes), new.words, rng, grids)


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


def replay_of(tensors: Mapping[str, PictureSet], new: NewNoun) -> dict[str, PictureSet]:
    """Return the kept pictures of nouns that were taught before and keep their meaning."""
    return {noun: kept for noun, kept in tensors.items() if noun in new.words.nouns and noun != new.noun}
