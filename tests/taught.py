"""A builtin prior that is small enough to be taught within a test."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, Words
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork, pack_weights
from meshdeform.priors.builtin.taught import metadata_of
from meshdeform.priors.builtin.teaching import pictures, sheet
from meshdeform.priors.builtin.teaching.pictures import LessonSize, draw_lesson
from meshdeform.runs import prior_teach

__all__ = ["SMALL", "THREE_NOUNS", "shorten_lessons", "write_small_weights"]

SMALL = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)
_NOUNS = ("bowl", "heart", "vase")
THREE_NOUNS = Words(
    {noun: BUILTIN_WORDS.nouns[noun] for noun in _NOUNS},
    {word: noun for word, noun in BUILTIN_WORDS.synonyms.items() if noun in _NOUNS},
    tuple(token for token in BUILTIN_WORDS.tokens if token not in BUILTIN_WORDS.nouns or token in _NOUNS),
)


def write_small_weights(path: Path, words: Words = THREE_NOUNS) -> Path:
    """Write untrained weights of a small network, which knows three nouns by default."""
    torch.manual_seed(0)
    network = PriorNetwork(SMALL, words=len(words.tokens))
    provenance = {"steps": "0", "seed": "0"}
    path.write_bytes(pack_weights(network.state_dict(), SMALL, provenance, metadata_of(words, [])))
    return path


def shorten_lessons(patch: pytest.MonkeyPatch) -> None:
    """Let lessons draw and measure as few pictures as they can."""

    def short(new: object, shapes: object, replayed: object, _size: LessonSize, seed: int, **more: object) -> object:
        return draw_lesson(new, shapes, replayed, LessonSize(members=2, members_each=2, each=1, grids=1), seed, **more)  # type: ignore[arg-type]

    patch.setattr(prior_teach, "draw_lesson", short)
    patch.setattr(pictures, "_HELD_MEMBERS", 1)
    patch.setattr(pictures, "_HELD_MEMBERS_EACH", 1)
    patch.setattr(sheet, "_STEPS", 2)
