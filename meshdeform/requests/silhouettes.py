"""Declare pictures as targets: silhouettes, each with the direction from which it shows the asset. Torch-free."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from meshdeform.requests.declaration import of_preset
from meshdeform.requests.strict import StrictModel

__all__ = ["MAX_SILHOUETTES", "SILHOUETTES", "SILHOUETTE_PARTS", "SILHOUETTE_WEIGHT", "Silhouette"]

MAX_SILHOUETTES = 4
SILHOUETTE_PARTS = tuple(f"silhouette_{number}" for number in range(1, MAX_SILHOUETTES + 1))
"""The names of the parts with the pictures."""


class Silhouette(StrictModel):
    """The direction from which a picture shows what the asset should become."""

    azimuth: float = Field(
        ge=-360.0,
        le=360.0,
        description="Azimuth in degrees: 0 sees the asset from +Z, 90 from +X, its left side.",
        examples=[90.0],
    )
    elevation: float = Field(
        0.0,
        ge=-90.0,
        le=90.0,
        description="Elevation in degrees: 0 sees it from the side, 90 from above.",
        examples=[0.0],
    )
    fov: float = Field(
        20.0,
        ge=1.0,
        le=90.0,
        description="Vertical field of view in degrees of a camera that just sees the whole object: small for a "
        "drawing or a photograph from afar, 40 for one from nearby.",
        examples=[20.0],
    )


SILHOUETTES: Any = Field(
    (),
    max_length=MAX_SILHOUETTES,
    description="Pictures whose silhouettes the result should have: the first entry describes the part `silhouette_1`, "
    "the second `silhouette_2`, and so on. With `guidance` = `silhouettes` they guide alone, with `sds` beside the "
    "prompt ([Control](control.md#pictures-as-targets)).",
    examples=[[{"azimuth": 0.0}, {"azimuth": 90.0}]],
)
SILHOUETTE_WEIGHT: Any = of_preset(
    10.0,
    "Weight of the difference between the silhouettes of `silhouettes` and those of the asset.",
    ge=0.0,
    le=1e6,
    examples=[10.0],
)
