"""Report what the model saw of the asset's colours."""

from __future__ import annotations

from typing import Any

from meshdeform.deformation.loop import Deformation
from meshdeform.requests.choices import AppearanceMode
from meshdeform.requests.document import GuidanceKind, ResolvedParams

__all__ = ["appearance_report", "sees_colours"]

_NO_COLOURS = "The asset has no colours, so the model saw it as clay."
_COLOURED = (AppearanceMode.TEXTURED, AppearanceMode.MIXED)


def sees_colours(params: ResolvedParams) -> bool:
    """Return whether the guidance is to see the asset's colours."""
    return params.guidance is GuidanceKind.SDS and params.appearance in _COLOURED


def appearance_report(params: ResolvedParams, deformation: Deformation) -> dict[str, Any]:
    """Return the report's `appearance`: what was `drawn`, where the `colours` come from, and a `notice`.

    `colours` is `asset`; `stand_in` if a simplified mesh was drawn with vertex colours sampled from the asset; or None.
    """
    wanted = sees_colours(params)
    coloured = wanted and deformation.shading != "lambert"
    return {
        "drawn": (AppearanceMode.CLAY if wanted and not coloured else params.appearance).value,
        "colours": ("stand_in" if deformation.simplified else "asset") if coloured else None,
        "notice": _NO_COLOURS if wanted and not coloured else "",
    }
