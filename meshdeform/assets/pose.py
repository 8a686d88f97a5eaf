"""A moment of an animation, as users name it: `CLIP@SECONDS`. Pure Python."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from meshdeform.errors import ParameterError


@dataclass(frozen=True)
class Pose:
    """A moment of a clip, which is named by its name, or by its number from 0."""

    clip: str
    seconds: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `CLIP@SECONDS`; the last `@` counts. `ParameterError`: it has another form."""
        clip, at, seconds = text.rpartition("@")
        try:
            moment = float(seconds)
        except ValueError:
            moment = math.nan
        if not at or not clip or not math.isfinite(moment):
            detail = f"{text!r} is no pose: it is CLIP@SECONDS, such as Run@0.5 or 0@0.5."
            raise ParameterError(detail, advice="Name the clip, or give its number from 0, and a time in seconds.")
        return cls(clip, moment)

    def __str__(self) -> str:
        return f"{self.clip}@{self.seconds:g}"
