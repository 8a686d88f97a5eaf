"""Say in one line what a run did to the surface that it should not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["defects_line"]

_DEFECTS = {
    "flipped_faces": "flipped",
    "self_intersections_added": "newly cutting others",
    "collapsed_faces": "without area",
}


def defects_line(quality: Mapping[str, Any], faces: int) -> str:
    """Return the line for the report's `quality` of a mesh with so many faces; empty if there is no defect."""
    # The cuts are null where they could not be counted; a warning says so.
    told = [f"{quality[name]:,} {words}" for name, words in _DEFECTS.items() if quality[name]]
    return f"Damaged faces, of {faces:,}: {', '.join(told)}" if told else ""
