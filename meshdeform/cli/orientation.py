"""Say in one line which side of an asset became the front."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["orientation_line"]


def orientation_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `orientation`; empty if the front was not to be chosen."""
    if found["source"] == "found":
        return (
            f"Front: the side at {found['turn_deg']:g} degrees (0 is +Z, 90 is +X); "
            f"it fits the prompt {found['margin']:.0%} better than +Z"
        )
    if found["source"] == "undecided":
        return "Front: +Z; no side of the asset fits the prompt clearly better"
    return f"Front: +Z. {found['notice']}" if found["notice"] else ""
