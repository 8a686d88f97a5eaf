"""Declare landmarks: points of the asset that go to places on the target mesh. Torch-free."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictInt

from meshdeform.requests.selection import Point
from meshdeform.requests.strict import StrictModel

__all__ = ["MAX_LANDMARKS", "LandmarkPair", "Place"]

MAX_LANDMARKS = 256

Place = Annotated[StrictInt, Field(ge=0)] | Point


class LandmarkPair(StrictModel):
    """A point of the asset, and the place on the target to which it goes."""

    source: Place = Field(
        description="A point of the asset: the index of a vertex, counted through the file as `meshdeform inspect` "
        "counts vertices, or a position [x, y, z] in the file's world, for which the nearest point of the surface is "
        "taken.",
        examples=[[0.0, 1.2, 0.4]],
    )
    target: Place = Field(
        description="Its place on the target: the index of a vertex, or a position in the target file's own world.",
        examples=[[0.1, 0.9, 0.5]],
    )
