"""Assets of formats that leave open what is up: read, changed and given back as they lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.change import affine_of, apply_changes, missing_part
from meshdeform.plain.evidence import read_body
from meshdeform.plain.naming import find_parts
from meshdeform.plain.reader import Reader
from meshdeform.plain.words import read_changes
from meshdeform.reading.result import UP_TURNS
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.plain.reading import body_of
from tests.unit.plain.shapes import chair, plain_glb

UPRIGHT = replace(body_of(plain_glb(chair()), "chair"), unit=None, up=None)
"""The chair as a format without a unit has it."""


def lying() -> Body:
    """The chair with +Z up, read as the product reads such a file."""
    bare = replace(body_of(plain_glb(chair())), unit=None, up=None)
    body = replace(bare, points=bare.points @ UP_TURNS["+Z"])
    read = Reader(lambda: read_body(body, {"chair": 1.0}, z_up={"chair": 1.0}, z_share=0.5))
    return replace(body, reader=read)


LYING = lying()


@each_case("text", ["longer legs", "a taller back", "twice as tall", "lower the seat", "wider"])
def test_a_change_is_that_of_the_asset_that_stands(text: str) -> None:
    sentence = read_changes(text)
    assert sentence is not None
    assert missing_part(LYING, sentence) is None
    (standing, done), (turned, same) = (apply_changes(each, sentence.changes) for each in (UPRIGHT, LYING))
    np.testing.assert_allclose(turned.points @ UP_TURNS["+Z"].T, standing.points, atol=1e-6)
    assert [each.got for each in same] == pytest.approx([each.got for each in done], abs=1e-6)
    affine = affine_of(same)
    if affine is not None:
        np.testing.assert_allclose(LYING.points @ affine[:, :3].T + affine[:, 3], turned.points, atol=1e-12)


def test_the_same_parts_are_listed() -> None:
    standing, turned = (
        {part.name: part.inside for part in find_parts(each, read_changes)} for each in (UPRIGHT, LYING)
    )
    assert set(standing) == set(turned) == {"legs", "seat", "back"}
    for name, inside in standing.items():
        np.testing.assert_array_equal(turned[name], inside)


@each_case(
    ("name", "data", "unit"),
    [("chair.glb", plain_glb(chair()), 1.0), ("chair.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", None)],
)
def test_a_zip_has_the_unit_of_what_is_in_it(name: str, data: bytes, unit: float | None) -> None:
    assert loose_body(load_asset(data, name)).unit == unit
    assert loose_body(load_asset(packed({name: data}))).unit == unit


def test_what_stands_is_not_turned() -> None:
    assert UPRIGHT.upright() is UPRIGHT
    standing = LYING.upright()
    np.testing.assert_allclose(standing.points, UPRIGHT.points, atol=1e-12)
    assert standing.upright() is standing
