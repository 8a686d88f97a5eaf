"""What the words of a sketch mean, and that kinds are sound; sketches of nouns are tested with all families."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.nouns.families import FAMILIES, KINDS, Part, Traits
from meshdeform.nouns.families.sketches import SKETCHES, read
from meshdeform.nouns.forms import drawn
from meshdeform.nouns.labels import LabelledMember, labelled, solids_of
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.solids import parts_of
from tests.cases import each_case
from tests.unit.nouns.test_families import border_edges, volume, volumes

BLOCK = """
# A block whose height is twice its width; two feet, then a row of three of them.
block: w 2 2, a=handle 1 1; body box 0 w 0, w 2w .5w, .1; foot drum .4w 0 0, .1 .05 | pair; handle rod 0 2w 0 .1,
  0 2w+a 0; leg ball 0 0 1, .1 | row 3 0 0 .5
block/cube: w 1 1; body box 0 0 0, w w w
"""
CUBE = "box 0 0 0, 1 1 1, 0"


def _drawn(text: str, seed: int = 0, attributes: tuple[Attribute, ...] = ()) -> LabelledMember:
    (sketch,) = read(text).values()
    return labelled("car", sketch(np.random.default_rng(seed), Traits(attributes)))


def _extents(solids: str) -> list[NDArray[np.float64]]:
    """Return the extents of each solid, (2, 3): its least and its greatest corner."""
    member = _drawn(f"a:; {solids}")
    return [
        np.stack([own.min(0), own.max(0)])
        for own in (member.verts[member.solids == number] for number in range(member.solids.max() + 1))
    ]


def _places(solids: str) -> list[list[float]]:
    return sorted((each.mean(0).round(6) + 0.0).tolist() for each in _extents(solids))


def test_a_sketch_is_drawn_as_its_words_say() -> None:
    sketches = read(BLOCK)
    assert list(sketches) == ["block", "block/cube"]
    block = sketches["block"](np.random.default_rng(0), Traits())
    assert np.ptp(block.verts, axis=0)[0] == pytest.approx(2.0)
    assert block.verts[:, 1].max() == pytest.approx(2 * 2 + 1 + 0.1)  # the handle's end is round
    assert block.verts[:, 2].max() == pytest.approx(2.1, abs=0.01)  # the third leg stands at 2
    long = sketches["block"](np.random.default_rng(0), Traits([Attribute("handle", "long")]))
    assert long.verts[:, 1].max() > 2 * 2 + 1.7
    np.testing.assert_allclose(np.ptp(sketches["block/cube"](np.random.default_rng(0), Traits()).verts, axis=0), 1.0)


def test_sizes_are_drawn_and_build_on_one_another() -> None:
    text = "a: w .2 .3, n whole 2 4, h 2w+.5ww-.1; body box 0 h 0, w .2 .4 | row n 1 0 0"
    counts = set()
    for seed in range(12):
        member = _drawn(text, seed)
        width = np.ptp(member.verts[member.solids == 0, 0])
        assert 0.2 <= width <= 0.3
        assert (member.verts[:, 1].min() + member.verts[:, 1].max()) / 2 == pytest.approx(
            2 * width + width**2 / 2 - 0.1
        )
        counts.add(member.solids.max() + 1)
    assert counts == {2, 3, 4}


def test_places_and_copies() -> None:
    assert _places(f"body {CUBE} | at 2 0 0, 5 0 0 | pair") == [[x, 0, 0] for x in (-5, -2, 2, 5)]
    assert _places(f"body {CUBE} | row 5, 0 2 -4, 0 2 4") == [[0, 2, z] for z in (-4, -2, 0, 2, 4)]
    ring = [[-3, 0, 0], [0, 0, -3], [0, 0, 3], [3, 0, 0]]
    assert _places(f"body {CUBE} | at 0 0 3 | around 4") == ring
    assert _places(f"body {CUBE} | at 0 0 3 | aroundx 2 | y 90") == [ring[0], ring[3]]


def test_what_is_done_with_a_solid_is_done_in_order() -> None:
    (turned,) = _extents("body box 0 0 1, .2 .4 .2 | x 90 | at 0 1 0 | by 1 2 1")
    assert turned.mean(0) == pytest.approx([0, 0, 0])
    assert turned[1] - turned[0] == pytest.approx([0.2, 0.4, 0.4])
    for word, axis in (("taper", 1), ("taperz", 2)):
        narrow = _drawn(f"a:; body {CUBE} | {word} .5").verts
        assert np.abs(narrow[narrow[:, axis] > 0.49, 0]).max() == pytest.approx(0.25)


def test_an_outline_has_arcs_and_may_go_round_either_way() -> None:
    for corners in ("-1 0, 0 0 1 180 0, 1 0", "1 0, 0 0 1 0 180, -1 0"):
        (dome,) = _extents(f"body side .5, {corners}")
        np.testing.assert_allclose(dome, [[-0.25, 0, -1], [0.25, 1, 1]], atol=1e-9)
        assert volume(_part(_drawn(f"a:; body side .5, {corners}"))) > 0


def _part(member: LabelledMember) -> Part:
    return Part(member.verts, member.faces)


def test_a_condition_leaves_solids_out_and_a_base_is_drawn_first() -> None:
    text = "*wheeled: r .1, n chance .5; wheel wheel .5 r 0, r .05 | pair\n"
    text += f"a < *wheeled: r .2; body {CUBE} | if n; lamp {CUBE} | unless n"
    members = [_drawn(text, seed) for seed in range(12)]
    assert {member.parts for member in members} == {("body", "wheel"), ("lamp", "wheel")}
    for member in members:
        assert member.verts[member.solids == 0, 1].max() == pytest.approx(0.4, abs=0.01)


@each_case("text", ["a:; body box 0 0 0, 1 q 1", "a:; body box 0 0 0, 1 $ 1", "a:; body ring 0 0 0", "a: w 2%"])
def test_a_text_that_means_nothing_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^a: "):
        _drawn(text)


def test_every_sketch_is_a_noun_or_a_kind_of_one() -> None:
    for title, sketch in SKETCHES.items():
        noun, _, kind = title.partition("/")
        assert (KINDS[noun][kind] if kind else FAMILIES[noun]) is sketch


@each_case("title", [title for title in SKETCHES if "/" in title])
def test_a_kind_is_closed_and_has_parts_of_its_noun(title: str) -> None:
    noun, kind = title.split("/")
    for seed in range(2):
        member = drawn(kind, (), np.random.default_rng(seed))
        assert parts_of(noun).intersection(member.parts)
        assert 200 < len(member.faces) < 5000
        shape = _part(member)
        assert (np.bincount(solids_of(shape)[shape.faces[:, 0]], volumes(shape)) > 0).all()
    assert border_edges(shape) == 0
