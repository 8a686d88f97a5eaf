"""Say in one line how well a result fits its target mesh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["fit_line"]


def fit_line(fit: Mapping[str, Any]) -> str:
    """Return the line for `fit` of a run's summary."""
    quality = fit["quality"]
    return (
        f"Fit        {fit['within']:.0%} of the target within 1 %; mean distance {fit['to_target']:.2%} to it and "
        f"{fit['from_target']:.2%} from it; silhouettes {fit['silhouettes']:.0%}; distortion "
        f"{quality['symmetric_dirichlet_mean']:.2f}; {quality['flipped_faces']} flipped faces"
    )
