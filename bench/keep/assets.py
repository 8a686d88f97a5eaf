"""The assets of the suite, `assets.json`: where each is from, what it is, and what is asked of it.

`near` asks for the same kind of thing, a change of one of its parts, or a noun close to it; `far` for another kind that
somebody may still ask for. Both were written before any result was seen. `noun` and `front` (degrees from +Z toward +X;
null: none in particular) are for the person who grades and for the pictures; a run is not told them.
`tuned`: engines may be tuned on it. `last` and `fresh`: by authors that nothing here was made with, run when nothing is
tuned any more, each for one comparison. Both prompts of a `fresh` asset ask for nouns of its own group.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

SPLITS = ("tuned", "last", "fresh")
DISTANCES = ("near", "far")
_LIST = Path(__file__).with_name("assets.json")


@dataclass(frozen=True)
class Listed:
    """An asset of the suite."""

    name: str
    split: str  # one of `SPLITS`
    noun: str
    front: float | None
    near: str
    far: str
    author: str
    licence: str
    repository: str
    path: str
    commit: str
    sha256: str


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
    every = [Listed(**each) for each in json.loads(_LIST.read_text(encoding="utf-8"))]
    return [each for each in every if split in (None, each.split) and (not names or each.name in names)]


def pairs(split: str | None = None, names: Collection[str] = ()) -> list[Pair]:
    """Return every asset with each of its prompts, those of the latest split first."""
    chosen = sorted(listed(split, names), key=lambda each: -SPLITS.index(each.split))
    return [Pair(each, distance) for each in chosen for distance in DISTANCES]
