"""Say which side of the source the guidance sees as its front, and how that was chosen.

A prior conditioned on the azimuth draws different pictures of a giraffe from the front and from behind. An asset that
faces backwards would grow its neck from the tail, so the cameras are turned about the up axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class OrientationSource(StrEnum):
    """Where a turn comes from. Checkpoints hold the number of a member."""

    KEPT = "kept"
    GIVEN = "given"
    FOUND = "found"
    UNDECIDED = "undecided"
    UNCONDITIONED = "unconditioned"
    CONTINUED = "continued"
    UNRECOGNISED = "unrecognised"


_NOTICES = {
    OrientationSource.UNDECIDED: "No side of the asset is clearly its front. Set params.guidance.orientation to the "
    "azimuth of another side if the result faces the wrong way.",
    OrientationSource.UNRECOGNISED: "The asset was not recognised, so +Z counts as its front. Set "
    "params.guidance.source_noun to what it is, or params.guidance.orientation to the azimuth of its front.",
    OrientationSource.UNCONDITIONED: "The model is not conditioned on the azimuth: it sees four sides at once with one "
    "text, so no side is the front, and params.guidance.orientation changes nothing about it.",
}


@dataclass(frozen=True)
class Orientation:
    """The turn of the cameras, and how it was chosen."""

    turn_deg: float = 0.0
    """Azimuth of the source that the guidance sees as the front, in -180 (exclusive) .. 180."""
    source: OrientationSource = OrientationSource.KEPT
    """`found`: as the asset was read; `undecided`: likewise, but another side may be the front. `unrecognised`: nobody
    knows what the source may be. `unconditioned`: the model does not see the azimuth."""

    def to_array(self) -> NDArray[np.float64]:
        """Return the members as float64, for checkpoints."""
        return np.array([self.turn_deg, list(OrientationSource).index(self.source)], np.float64)

    @classmethod
    def from_array(cls, values: NDArray[np.float64]) -> Orientation:
        """Return the orientation that `to_array` stored; older checkpoints hold more, which says nothing here."""
        turn, number, *_ = values.tolist()
        return cls(turn, list(OrientationSource)[int(number)])

    def to_dict(self) -> dict[str, Any]:
        """Return the member `orientation` of the report."""
        return {"turn_deg": self.turn_deg, "source": self.source.value, "notice": _NOTICES.get(self.source)}


AHEAD = Orientation()
