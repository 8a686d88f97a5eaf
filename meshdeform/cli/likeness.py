"""Say in one line whether a result looks like its prompt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["likeness_line", "percent"]


def likeness_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `likeness`."""
    noun, other = _named(found["noun"]), _named(found["next"]["noun"])
    share, others = percent(found["probability"]), percent(found["next"]["probability"])
    if found["matches"]:
        return f"Looks like: {noun} ({share}); next: {other} ({others})"
    place = f"{noun} ({share}) is number {found['rank']} of {found['nouns']}"
    return f"Does not look like its prompt: it looks more like {other} ({others}); {place}"


def _named(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def percent(share: float) -> str:
    """Return a probability of a noun as it is printed."""
    return "under 1%" if share < 0.005 else f"{share:.0%}"
