"""Decide what an asset is and where it faces.

Of the proposed nouns the `PROPOSED` most probable ones count, with probabilities p, and those that names in the file
tell. With the grade g of the nearest member (`choice`), of those whose form no other noun shares, over all fronts, the
probability of a noun is w over the sum of all w and that of none of them,

    w = (p + 0.0001)^0.66 exp(-7 (g - least g) / max(least g, 0.05)),    w of none = 0.5 (1 - largest p),

and what is named has 300 (p + 0.01)^0.66 in place of its first factor, what is near to a name 8 (p + 0.01)^0.66, and
either 1.9 in place of 7: its shape counts less. The
three constants of w were fitted to 296 public assets (the packs and half of the authors of `bench/nouns`, half of
`bench/recognition`). Of names that tell a noun, 95 % are right.
Of a word of somebody's own no judge says anything: its p is 1 where its nearest shape has a grade up to 0.05, and falls
to 0.02 at 0.085. Of 20 public assets and 11 words, each of one of them, an asset has up to 0.05 with its own word, and
at least 0.085 with any other.
What is held in a hand may also lie, its length then being the asset's longest axis, or stand on its head.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Floats
from meshdeform.reading.choice import AssetMesh, FrontFrame, facing, nearness
from meshdeform.vocabulary.nouns import HELD, ROUND
from meshdeform.words.in_use import like_of, own_word

__all__ = ["FRONTS", "PROPOSED", "Decision", "decide", "lying"]

FRONTS = (0.0, 90.0, 180.0, -90.0)
PROPOSED = 6
_SHARE, _FAR_GRADE, _FAR_TOLD, _NEAR_GRADE, _NONE = 0.66, 7.0, 1.9, 0.05, 0.5
_STANDING = 5.0
_LEAST, _LEAST_NAMED, _NAMED, _NEAR = 1e-4, 0.01, 300.0, 8.0
_OWN_GRADES, _OWN_LEAST = (0.05, 0.085), 0.02
_CONVENTION = 0.03
"""By which share other fronts must be better than +Z, which is where assets face by glTF's convention."""


@dataclass(frozen=True)
class Decision:
    """The noun, the probabilities of all that were proposed, the frame, and by how much the second front is worse.

    `merit` tells how well an asset stands that may stand otherwise: the largest p^0.6 times what names give, by the
    fifth power of the grade, as a logarithm.
    """

    noun: str
    probabilities: dict[str, float]
    frame: FrontFrame
    margin: float | None
    merit: float


def decide(
    surface: AssetMesh,
    nouns: Mapping[str, float],
    named: Iterable[str] = (),
    near: Iterable[str] = (),
    front_deg: float | None = None,
    folder: Path | None = None,
) -> Decision:
    """Return what an asset is and where it faces.

    `nouns`: what it may be, with probabilities; a single one is what it is, and words of somebody's own all count.
    `named`: nouns that its file tells, `near`: those near to words in it; `front_deg`: the azimuth of its front if that
    is known; `folder` as in `banks`.
    """
    frames = _Frames(surface, front_deg)
    told = {**dict.fromkeys(near, _NEAR), **dict.fromkeys(named, _NAMED)} if len(nouns) > 1 else {}
    ours = [noun for noun in nouns if own_word(noun) is None]
    first = sorted(ours, key=lambda noun: -nouns[noun])[:PROPOSED] + [noun for noun in nouns if own_word(noun)]
    graded = {noun: frames.graded(noun, folder) for noun in dict.fromkeys([*first, *told])}
    grades = {noun: min(own for _, own, _ in fronts) for noun, fronts in graded.items()}
    shares = {noun: nouns.get(noun, 0.0) if own_word(noun) is None else _own_share(grades[noun]) for noun in graded}
    factors = {noun: _factor(shares[noun], told.get(noun)) for noun in graded}
    none = _NONE * (1 - min(max([*nouns.values(), *shares.values()]), 1.0))
    probabilities = _probabilities(grades, factors, told, none)
    if len(nouns) == 1:
        probabilities = dict.fromkeys(nouns, 1.0)
    noun = max(probabilities, key=probabilities.__getitem__)
    best = graded[noun]
    margin = best[1][0] / best[0][0] - 1 if len(best) > 1 else None
    merit = max(np.log(factors[noun]) - _STANDING * np.log(max(grade, _NEAR_GRADE)) for noun, grade in grades.items())
    return Decision(noun, probabilities, best[0][2], margin, float(merit))


def _own_share(grade: float) -> float:
    """Return the p of a word of somebody's own by the grade of its nearest shape."""
    near, far = _OWN_GRADES
    return _OWN_LEAST + (1 - _OWN_LEAST) * float(np.clip((far - grade) / (far - near), 0, 1))


def _factor(proposed: float, told: float | None) -> float:
    """Return what a noun weighs before its shape counts."""
    return float((proposed + _LEAST) ** _SHARE if told is None else told * (proposed + _LEAST_NAMED) ** _SHARE)


def _probabilities(
    grades: Mapping[str, float], factors: Mapping[str, float], told: Collection[str], none: float
) -> dict[str, float]:
    """Return the probability of each graded noun, by the equation at the head; `none`: the weight of none of them."""
    least, weights = min(grades.values()), dict[str, float]()
    for noun, grade in grades.items():
        far = _FAR_TOLD if noun in told else _FAR_GRADE
        weights[noun] = factors[noun] * float(np.exp(-far * (grade - least) / max(least, _NEAR_GRADE)))
    total = sum(weights.values()) + none
    return {noun: weight / total for noun, weight in sorted(weights.items(), key=lambda item: -item[1])}


class _Frames:
    """The frames in which an asset may stand."""

    def __init__(self, surface: AssetMesh, front_deg: float | None) -> None:
        self._given = front_deg is not None
        fronts = FRONTS if front_deg is None else (front_deg,)
        self._upright = [FrontFrame(surface, facing(front)) for front in fronts]
        self._lying = [] if self._given else [FrontFrame(surface, turn) for turn in lying(surface)]

    def of(self, noun: str) -> list[FrontFrame]:
        """Return those in which a noun may stand, as it would by convention first."""
        upright = self._upright[:1] if like_of(noun) in ROUND else self._upright
        return upright + self._lying if like_of(noun) in HELD else upright

    def graded(self, noun: str, folder: Path | None) -> list[tuple[float, float, FrontFrame]]:
        """Return both grades (`nearness`) in the best two frames, the best first."""
        frames = self.of(noun)
        dearer = [1.0 if frame is frames[0] else 1 + _CONVENTION for frame in frames]
        graded = nearness(frames, noun, dearer, folder)
        return sorted(((one * dearer[k], own * dearer[k], frames[k]) for k, one, own in graded), key=lambda at: at[0])


def lying(surface: AssetMesh) -> list[Floats]:
    """Return the turns that stand up an asset whose longest axis is level, either end up, to all four sides.

    One whose longest axis is upright is stood on its head.
    """
    axis = int(np.ptp(surface.used, axis=0).argmax())
    turns = []
    for sign in (-1.0,) if axis == 1 else (1.0, -1.0):
        up, front = sign * np.eye(3)[axis], np.array([0.0, 0.0, 1.0]) if axis == 1 else np.array([0.0, 1.0, 0.0])
        stand = np.stack([np.cross(up, front), up, front])
        turns += [facing(azimuth) @ stand for azimuth in FRONTS]
    return turns
