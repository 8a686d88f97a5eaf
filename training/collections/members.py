"""Draw members of nouns from the shapes that `scan` found: jittered, roughened, with an attribute of the whole."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from meshdeform.nouns.deformed import Part, deformed, normalised
from meshdeform.vocabulary.lookup import Attribute

_SCALE, _SHEAR, _WAVE = 0.15, 0.04, 0.03
"""Jitter: range of the scale of each axis, deviation of the shears, greatest height of smooth waves."""


class RealShapes:
    """The shapes of some splits, by noun."""

    def __init__(self, folder: Path, *splits: str) -> None:
        self._folder = folder
        self._members = defaultdict[str, list[tuple[str, int]]](list)
        for member in json.loads((folder / "members.json").read_text())["members"]:
            if member["split"] in splits:
                self._members[member["noun"]].append((member["shape"], member["front_deg"]))

    def __contains__(self, noun: object) -> bool:
        return noun in self._members

    def count(self, noun: str) -> int:
        """Return how many shapes of a noun there are."""
        return len(self._members.get(noun, ()))

    def digest(self, noun: str) -> str:
        """Return a hash of what members of a noun are drawn from."""
        return hashlib.sha256(repr((self._members.get(noun), _SCALE, _SHEAR, _WAVE)).encode()).hexdigest()

    def draw(self, noun: str, attributes: Iterable[Attribute], rng: np.random.Generator) -> Part:
        """Draw a member, +Y up, facing +Z, centred, farthest vertex at distance 1.

        Attributes are of the whole. Jitter is smaller than what an attribute changes.
        """
        name, front_deg = self._members[noun][int(rng.integers(len(self._members[noun])))]
        with np.load(self._folder / "shapes" / f"{name}.npz") as stored:
            verts, faces = stored["verts"].astype(np.float64), stored["faces"].astype(np.int64)
        turn = np.radians(-front_deg)
        about_y = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]])
        jitter = np.diag(rng.uniform(1 - _SCALE, 1 + _SCALE, 3)) + rng.normal(0.0, _SHEAR, (3, 3)) * (1 - np.eye(3))
        part = normalised(Part(verts @ about_y.T @ jitter.T, faces))
        return deformed(_waved(part, rng), tuple(attributes), rng)


def _waved(part: Part, rng: np.random.Generator) -> Part:
    """Move every vertex by three plane waves about as long as the shape."""
    wave = rng.normal(0.0, 1.0, (3, 3))
    wave *= (2 * np.pi / rng.uniform(1.0, 2.5, 3) / np.linalg.norm(wave, axis=1))[:, None]
    height = rng.uniform(0.0, _WAVE) * rng.normal(0.0, 1.0, (3, 3))
    return Part(part.verts + np.sin(part.verts @ wave.T + rng.uniform(0, 2 * np.pi, 3)) @ height, part.faces)
