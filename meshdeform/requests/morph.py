"""Define how `morph.glb` goes from the source to the result. Torch-free."""

from __future__ import annotations

import math

from pydantic import Field

from meshdeform.requests.choices import Easing
from meshdeform.requests.strict import StrictModel

__all__ = ["MAX_FRAMES", "MorphPath"]

MAX_FRAMES = 64


class MorphPath(StrictModel):
    """The frames and the timing of a morph."""

    frames: int = Field(
        8,
        ge=1,
        le=MAX_FRAMES,
        description="Number of morph targets from the source, exclusive, to the result, inclusive. More are closer to "
        "the path and take more space; 1 moves every vertex on a straight line.",
        examples=[8],
    )
    easing: Easing = Field(
        Easing.LINEAR,
        description="`linear`: at constant speed. `smooth`: slowly away from the source and slowly into the result.",
        examples=["smooth"],
    )
    ping_pong: bool = Field(False, description="Also animate the way back.", examples=[True])
    seconds: float = Field(1.0, ge=0.1, le=60.0, description="Duration of one way, in seconds.", examples=[2.0])

    def shares(self) -> list[float]:
        """Return the shares of the way at which there is a frame, from above 0 to 1."""
        return [k / self.frames for k in range(1, self.frames + 1)]

    def times(self) -> list[float]:
        """Return the times in seconds at which the source and the frames are shown, and those on the way back."""
        forth = [0.0, *(self._eased(share) * self.seconds for share in self.shares())]
        back = [2 * self.seconds - time for time in reversed(forth[:-1])] if self.ping_pong else []
        return [*forth, *back]

    def weights(self) -> list[list[float]]:
        """Return the weights of the frames at these times: one frame at a time, or none for the source."""
        rows = [[float(frame == shown) for frame in range(self.frames)] for shown in range(-1, self.frames)]
        return [*rows, *(reversed(rows[:-1]) if self.ping_pong else [])]

    def _eased(self, share: float) -> float:
        """Return the share of the time at which a share of the way is done: the inverse of 3 u^2 - 2 u^3."""
        if self.easing is Easing.LINEAR or share in (0.0, 1.0):
            return share
        return 0.5 - math.sin(math.asin(1 - 2 * share) / 3)
