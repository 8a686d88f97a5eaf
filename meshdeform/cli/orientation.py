"""Say what an asset was taken for, which side became its front, and what was kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["orientation_line", "source_line"]


def orientation_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `orientation`; empty if the front was not to be chosen."""
    if found["source"] == "found":
        return (
            f"Front: the side at {found['turn_deg']:g} degrees (0 is +Z, 90 is +X); "
            f"it fits what the asset is {found['margin']:.0%} better than the next one"
        )
    if found["source"] == "undecided":
        return f"Front: the side at {found['turn_deg']:g} degrees (0 is +Z, 90 is +X); no side is clearly better"
    return f"Front: +Z. {found['notice']}" if found["notice"] else ""


def source_line(report: Mapping[str, Any]) -> str:
    """Return the line for the report's `source_noun` and `carrier`; empty if neither says anything."""
    parts = []
    noun, carrier = report["source_noun"], report["carrier"]
    if noun is not None and noun["recognised"]:
        parts.append(f"Taken for: {noun['noun']} ({noun['probability']:.0%}; --set source_noun=NOUN corrects it)")
    kept = [f"mirror symmetry across {carrier['mirror']}"] if carrier.get("mirror") else []
    kept += ["level and upright"] if carrier.get("level") else []
    if kept:
        parts.append(f"Kept: {', '.join(kept)}")
    return ". ".join(parts)
