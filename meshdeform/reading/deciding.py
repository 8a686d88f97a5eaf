"""Decide what an asset is and where it faces.

For each of the most probable nouns, the grade g of the nearest member (`choice`) over all fronts tells them apart
better than residuals of fits do, since a fit bends whatever is there to the asset. With the probability p that was
proposed, the probability of a noun is proportional to

    p^SHARE exp(-(g / least g - 1) / DECISIVE),

g of members whose form no other noun shares. What is held in a hand may also lie: its length is then the asset's
longest axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Floats
from meshdeform.priors.builtin.vocabulary import TURNED
from meshdeform.reading.choice import Frame, Surface, facing, nearness

__all__ = ["FRONTS", "Decision", "decide"]

FRONTS = (0.0, 90.0, 180.0, -90.0)
_SHARE = 1.0
_DECISIVE = 0.06
_CONVENTION = 0.03
"""By which share other fronts must be better than +Z, which is where assets face by glTF's convention."""
_HELD_NAMES = "axe banana bone bottle candle carrot corn dumbbell guitar hammer pan rocket shield sword torch umbrella"
_HELD = frozenset(_HELD_NAMES.split())
"""Nouns of things that may lie."""


@dataclass(frozen=True)
class Decision:
    """The noun, the probabilities of all that were proposed, the frame, and by how much the second front is worse."""

    noun: str
    probabilities: dict[str, float]
    frame: Frame
    margin: float | None


def decide(
    surface: Surface, nouns: Mapping[str, float], front_deg: float | None = None, folder: Path | None = None
) -> Decision:
    """Return what an asset is and where it faces; `front_deg` if that is known, `folder` as in `banks`."""
    frames = _Frames(surface, front_deg)
    if len(nouns) == 1 and len(frames.of(noun := next(iter(nouns)))) == 1:
        return Decision(noun, {noun: 1.0}, frames.of(noun)[0], None)
    graded = {noun: frames.graded(noun, folder) for noun in nouns}
    nearest = {noun: min(own for _, own, _ in fronts) for noun, fronts in graded.items()}
    least = min(nearest.values())
    likely = {noun: nouns[noun] ** _SHARE * np.exp(-(grade / least - 1) / _DECISIVE) for noun, grade in nearest.items()}
    total = sum(likely.values()) or 1.0
    probabilities = {noun: float(value / total) for noun, value in likely.items()}
    noun = max(probabilities, key=probabilities.__getitem__)
    best = graded[noun]
    return Decision(noun, probabilities, best[0][2], best[1][0] / best[0][0] - 1 if len(best) > 1 else None)


class _Frames:
    """The frames in which an asset may stand."""

    def __init__(self, surface: Surface, front_deg: float | None) -> None:
        self._given = front_deg is not None
        fronts = FRONTS if front_deg is None else (front_deg,)
        self._upright = [Frame(surface, facing(front)) for front in fronts]
        self._lying = [] if self._given else [Frame(surface, turn) for turn in _lying(surface)]

    def of(self, noun: str) -> list[Frame]:
        """Return those in which a noun may stand, as it would by convention first."""
        upright = self._upright[:1] if noun in TURNED else self._upright
        return upright + self._lying if noun in _HELD else upright

    def graded(self, noun: str, folder: Path | None) -> list[tuple[float, float, Frame]]:
        """Return both grades (`nearness`) in the best two frames, the best first."""
        frames = self.of(noun)
        dearer = [1.0 if frame is frames[0] else 1 + _CONVENTION for frame in frames]
        graded = nearness(frames, noun, dearer, folder)
        return sorted(((one * dearer[k], own * dearer[k], frames[k]) for k, one, own in graded), key=lambda at: at[0])


def _lying(surface: Surface) -> list[Floats]:
    """Return the turns that stand up an asset whose longest axis is level, either end up, to all four sides."""
    axis = int(np.ptp(surface.used, axis=0).argmax())
    if axis == 1:
        return []
    turns = []
    for sign in (1.0, -1.0):
        up = sign * np.eye(3)[axis]
        stand = np.stack([np.cross(up, [0.0, 1.0, 0.0]), up, [0.0, 1.0, 0.0]])
        turns += [facing(front) @ stand for front in FRONTS]
    return turns
