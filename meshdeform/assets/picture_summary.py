"""Describe what a picture with a silhouette shows. Pure Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self


@dataclass(frozen=True)
class PictureSummary:
    """What a picture shows."""

    format: str  # `png`, `jpeg` or `webp`
    # Pixels
    width: int
    height: int
    box: tuple[float, float, float, float]
    """Left, top, right and bottom of the silhouette as shares of the width and height."""
    share: float  # share of the picture that the silhouette covers

    @classmethod
    def read(cls, found: Mapping[str, Any]) -> Self:
        """Return a summary from its JSON."""
        return cls(**{**found, "box": tuple(found["box"])})
