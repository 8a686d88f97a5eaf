"""The assets of the suite, `assets.json`: where each is from, what it is, and what is asked of it.

`near` asks for the same kind of thing, a change of one of its parts, or a noun close to it; `far` for another kind that
somebody may still ask for. Both were written before any result was seen. `noun` and `front` (degrees from +Z toward +X;
null: none in particular) are for the person who grades and for the pictures; a run is not told them.
`tuned`: engines may be tuned on it. `last` and `fresh`: by authors that nothing here was made with, run when nothing is
tuned any more, each for one comparison. Both prompts of a `fresh` asset ask for nouns of its own group.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from bench.parts import assets
from bench.parts.assets import Listed
from meshdeform.priors.builtin.grammar import parse
from meshdeform.vocabulary.nouns import NOUN_GROUPS

SPLITS = ("tuned", "last", "fresh")
DISTANCES = ("near", "far")
_LIST = Path(__file__).with_name("assets.json")
_GROUPS = {noun: name for name, nouns in NOUN_GROUPS.items() for noun in nouns}


@dataclass(frozen=True)
class Pair:
    """An asset and one of its prompts."""

    asset: Listed
    distance: str  # one of `DISTANCES`

    @property
    def name(self) -> str:
        """Name of its folder in a run."""
        return f"{self.asset.name}-{self.distance}"

    @property
    def prompt(self) -> str:
        """What is asked for."""
        return self.asset.near if self.distance == "near" else self.asset.far


def listed(split: str | None = None, names: Collection[str] = ()) -> list[Listed]:
    """Return the assets of one split, or all; `names`: only these."""
    return assets.listed(split, names, _LIST)


def pairs(split: str | None = None, names: Collection[str] = (), groups: Collection[str] = ()) -> list[Pair]:
    """Return every asset with each of its prompts, or those of some groups, those of the latest split first."""
    chosen = sorted(listed(split, names), key=lambda each: -SPLITS.index(each.split))
    every = [Pair(each, distance) for each in chosen for distance in DISTANCES]
    return [pair for pair in every if not groups or group_of(pair.prompt) in groups]


def group_of(prompt: str) -> str:
    """Return the group (`NOUN_GROUPS`) of the noun that a prompt asks for."""
    return _GROUPS[parse(prompt).noun]
