"""Say in one line how much further a result stretches its texture."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["stretch_line"]


def stretch_line(found: Mapping[str, float]) -> str:
    """Return the line for the report's `texture_stretch`."""
    line = f"Texture stretch: {found['p50']:.2f} at the median, {found['p95']:.2f} at the 95th percentile"
    return f"{line}; {found['above_2']:.0%} of the textured surface above 2"
