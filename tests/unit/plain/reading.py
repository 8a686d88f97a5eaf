"""Bodies whose noun is known, read as the product reads them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from meshdeform.assets import load_asset
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.evidence import read_body
from meshdeform.plain.reader import Reader


def read_as(body: Body, noun: str, front_azimuth_deg: float | None = None) -> Body:
    """A body that is read, when its parts are asked for, as a noun."""
    return replace(body, reader=Reader(lambda: read_body(body, {noun: 1.0}, front_azimuth_deg)))


@lru_cache(maxsize=32)
def body_of(file: bytes, noun: str = "", name: str = "a.glb", front_azimuth_deg: float | None = None) -> Body:
    """The body of a file, which is read as a noun if one is given."""
    body = loose_body(load_asset(file, name))
    return read_as(body, noun, front_azimuth_deg) if noun else body
