"""Declare what controls where an asset may deform: regions and handles. Torch-free."""

from __future__ import annotations

from typing import Any, Self

from pydantic import Field, model_validator

from meshdeform.requests.choices import RegionAction
from meshdeform.requests.selection import Number, Point, Selection
from meshdeform.requests.strict import StrictModel

__all__ = ["FALLOFF", "MAX_HANDLES", "Handle", "Region"]

MAX_HANDLES = 64
FALLOFF: Any = Field(
    0.1,
    ge=0.0,
    le=1.0,
    description="Distance along the surface over which it joins what `regions` keep, and over which a prompt's pull "
    "begins within its regions, as a share of the diagonal of the asset's bounding box.",
    examples=[0.1],
)


class Region(Selection):
    """A part of the surface and what happens to it; exactly one of the members that say where is set."""

    action: RegionAction = Field(
        RegionAction.KEEP,
        description="`keep`: its vertices do not move at all; `only`: nothing else moves. With several regions, what "
        "moves is in one with `only`, if there are any, and in none with `keep`.",
        examples=["keep"],
    )


class Handle(StrictModel):
    """A point of the surface that goes to a place; exactly one of `vertex` and `position` is set."""

    vertex: Number | None = Field(
        None,
        description="A vertex by its number: that in the file if it has one mesh, otherwise counted through all mesh "
        "instances.",
        examples=[12],
    )
    position: Point | None = Field(
        None, description="The point of the surface that is nearest to this place.", examples=[[0.0, 1.0, 0.0]]
    )
    to: Point = Field(description="Where the point goes.", examples=[[0.0, 1.5, 0.0]])
    weight: float = Field(
        1.0,
        gt=0.0,
        le=1.0,
        description="1: the point is exactly there. Less: a soft handle, which goes this share of the way from where "
        "the surface would be without it.",
        examples=[1.0],
    )

    @model_validator(mode="after")
    def _one_point(self) -> Self:
        if (self.vertex is None) == (self.position is None):
            raise ValueError("exactly one of vertex and position is required")
        return self
