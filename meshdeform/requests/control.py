"""Declare what controls where an asset may deform: regions and handles. Torch-free."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, model_validator

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import RegionAction
from meshdeform.requests.selection import Number, Point, Selection
from meshdeform.requests.strict import StrictModel

if TYPE_CHECKING:
    from meshdeform.requests.document import ResolvedParams

__all__ = ["FALLOFF", "MAX_HANDLES", "Handle", "Region", "check_places"]

MAX_HANDLES = 64
MAX_REACH = 1_000_000
"""How far from an asset a point may be, in lengths of its bounding box."""
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


_Place = tuple[str, int, str, Sequence[float]]


def check_places(params: ResolvedParams, bounds: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """Refuse points of handles and landmarks that are absurdly far from the file in whose world they are.

    Parameters
    ----------
    params : ResolvedParams
    bounds : mapping
        The least and the greatest coordinates (2, 3) of the `asset` and the `target`, as far as they are known.

    Raises
    ------
    ParameterError
    """
    for part, places in (("asset", _places_on_asset(params)), ("target", _places_on_target(params))):
        if not bounds.get(part):
            continue
        low, high = bounds[part]
        size = max(end - begin for begin, end in zip(low, high, strict=True))
        for name, number, member, point in places:
            away = max(max(a - x, x - b) for a, x, b in zip(low, point, high, strict=True))
            if away > MAX_REACH * size:
                detail = f"params.{name}: the point is {away / size:.1g} times as far from the {part} as that is long."
                advice = f"Give a point within {MAX_REACH:,} lengths of the {part}."
                raise ParameterError.at(["params", name, number, member], detail, advice)


def _places_on_asset(params: ResolvedParams) -> Iterator[_Place]:
    for number, handle in enumerate(params.handles):
        if handle.position is not None:
            yield "handles", number, "position", handle.position
        yield "handles", number, "to", handle.to
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.source, int):
            yield "landmarks", number, "source", pair.source


def _places_on_target(params: ResolvedParams) -> Iterator[_Place]:
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.target, int):
            yield "landmarks", number, "target", pair.target
