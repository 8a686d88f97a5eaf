"""Assets that others made: where each is from, and what one sees on it. The suite's are in `assets.json`.

`noun` is one of the builtin prior's, `also` others that are as right; `front` is where it faces, in degrees from +Z
toward +X once `up` points up (null: nowhere in particular); `parts` are those that one sees on it and would want to
change, written before anything had read it, whether the noun's family has them or not; its main body is none of them.
`near` and `far` are what `bench.keep` asks for.
`tuned`: the reading may be tuned on it. `last`: it is read once, when nothing is tuned any more.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_LIST = Path(__file__).with_name("assets.json")
_PUBLIC = ("CC0", "CC-BY")
_FACING_DEG = 30.0
"""How far a front may be off: what is found is one of four sides, or a little turned from it."""
_UPRIGHT = {"+Y": np.eye(3), "+Z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}


@dataclass(frozen=True)
class Listed:
    """An asset of a list."""

    name: str
    split: str
    noun: str
    front: float | None
    author: str
    licence: str
    repository: str
    path: str
    commit: str
    sha256: str
    also: Sequence[str] = ()
    up: str = "+Y"
    parts: Sequence[str] = ()
    near: str = ""
    far: str = ""

    @property
    def public(self) -> bool:
        """Whether pictures of it may be published."""
        return self.licence.startswith(_PUBLIC)

    @property
    def upright(self) -> NDArray[np.float64]:
        """The rotation (3, 3) after which its up axis is +Y."""
        return _UPRIGHT[self.up]

    @property
    def turn(self) -> NDArray[np.float64]:
        """The rotation (3, 3) after which it stands on +Y and faces +Z."""
        sine, cosine = np.sin(np.radians(self.front or 0.0)), np.cos(np.radians(self.front or 0.0))
        return np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]]) @ self.upright

    def is_noun(self, noun: str) -> bool:
        """Return whether a noun is right."""
        return noun == self.noun or noun in self.also

    def faces(self, turn: NDArray[np.float64]) -> bool | None:
        """Return whether a rotation (3, 3) that was found turns its front to +Z; None if it has none."""
        if self.front is None:
            return None
        toward = np.asarray(turn @ self.turn.T)[2, 2]
        return bool(toward > np.cos(np.radians(_FACING_DEG)))

    def stands(self, turn: NDArray[np.float64]) -> bool:
        """Return whether a rotation (3, 3) that was found turns its up axis to +Y."""
        return bool((turn @ self.turn.T)[1, 1] > np.cos(np.radians(_FACING_DEG)))


def listed(split: str | None = None, names: Collection[str] = (), path: Path = _LIST) -> list[Listed]:
    """Return the assets of one split of a list, or all; `names`: only these."""
    every = [Listed(**each) for each in json.loads(path.read_text(encoding="utf-8"))]
    return [each for each in every if split in (None, each.split) and (not names or each.name in names)]


def files(folder: Path) -> dict[str, Path]:
    """Return the files of a folder by their SHA-256 in hexadecimal."""
    return {hashlib.sha256(each.read_bytes()).hexdigest(): each for each in sorted(folder.iterdir()) if each.is_file()}
