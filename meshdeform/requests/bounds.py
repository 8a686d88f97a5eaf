"""Compare the lower bounds of a request with its upper bounds. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["contradiction"]

_ORDERED = (
    ("timestep_min", "timestep_max"),
    ("timestep_min", "timestep_max_end"),
    ("framing", "framing_max"),
    ("elevation_min_deg", "elevation_max_deg"),
    ("fov_min_deg", "fov_max_deg"),
)
"""Pairs of parameters of which the first must not be greater than the second."""


def contradiction(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the names of a lower bound that is greater than its upper bound, and of that; None if there is none."""
    for low, high in _ORDERED:
        if low in values and high in values and values[low] > values[high]:
            return low, high
    return None
