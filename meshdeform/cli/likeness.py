"""Say in lines whether a result looks like its prompt, how much of the asset it kept, and whether to keep it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["kept_line", "likeness_line", "percent", "verdict_line"]


def likeness_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `likeness`."""
    noun, other = _named(found["noun"]), _named(found["next"]["noun"])
    share, others = percent(found["probability"]), percent(found["next"]["probability"])
    if found["matches"]:
        return f"Looks like: {noun} ({share} among the judge's {found['nouns']} nouns); next: {other} ({others})"
    place = f"{noun} ({share}) is number {found['rank']} of {found['nouns']}"
    return f"Does not look like its prompt: it looks more like {other} ({others}); {place}"


def kept_line(quality: Mapping[str, Any]) -> str:
    """Return the line for `kept_share` of the report's quality."""
    return f"Still your asset: {quality['kept_share']:.0%} of the surface kept its shape"


def verdict_line(verdict: Mapping[str, Any]) -> str:
    """Return the line for the report's `verdict`; empty if the result is not worse than its source."""
    reasons = " ".join(verdict["reasons"])
    return f"Verdict: keep your asset as it is ({verdict['value']}). {reasons}" if reasons else ""


def _named(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def percent(share: float) -> str:
    """Return a probability of a noun as it is printed."""
    return "under 1%" if share < 0.005 else f"{share:.0%}"
