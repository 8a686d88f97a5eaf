"""A part of another noun: where it goes, what comes along, and what it is refused for."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.errors import VocabularyError
from meshdeform.exemplar.borrowing import with_part_of
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.shapes import Shape, Wish
from meshdeform.nouns.families import Part
from meshdeform.nouns.labels import Floats, code, labelled_member
from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, Borrowed, parse
from meshdeform.reading import read_asset


def _member(noun: str, seed: int = 3) -> Shape:
    member = labelled_member(noun, (), np.random.default_rng(seed))
    return Shape(noun, member.verts / 2, member.faces, member.labels, member.solid_of_face)


def _places(shape: Shape, part: str) -> Floats:
    return np.asarray(shape.verts[np.unique(shape.faces[shape.labels == code(part)])])


def test_ears_sit_where_the_own_ones_were_and_all_else_stays() -> None:
    dog, rabbit = _member("dog"), _member("rabbit")
    both = with_part_of(dog, rabbit, "ear")
    others = dog.labels != code("ear")
    assert np.array_equal(both.verts[both.faces[both.labels != code("ear")]], dog.verts[dog.faces[others]])
    assert (both.labels == code("ear")).sum() == (rabbit.labels == code("ear")).sum()
    own, lent = _places(dog, "ear"), _places(both, "ear")
    assert lent[:, 1].max() > own[:, 1].max() + 0.05  # a rabbit's stand up
    assert np.allclose(lent[:, 0].min(), -lent[:, 0].max(), atol=1e-6)  # still a pair
    root = lent[lent[:, 1] < np.quantile(lent[:, 1], 0.1)]
    assert np.abs(root[:, 2].mean() - own[:, 2].mean()) < 0.06


def test_what_a_part_carries_comes_along() -> None:
    both = with_part_of(_member("robot"), _member("person"), "arm")
    person = _member("person")
    assert (both.labels == code("hand")).sum() == (person.labels == code("hand")).sum()


def test_a_part_that_nobody_has_changes_nothing() -> None:
    dog = _member("dog")
    assert with_part_of(dog, _member("vase"), "spout") is dog


def test_an_asset_that_is_the_noun_gets_the_part_and_keeps_the_rest() -> None:
    cow = labelled_member("cow", (), np.random.default_rng(1))
    reading = read_asset(Part(cow.verts, cow.faces), {"cow": 1.0}, front_azimuth_deg=0.0)
    asked = parse("a cow with a deer's horns")
    fit = ExemplarFit(cow.verts, cow.faces, reading, Wish(asked.noun, borrowed=asked.borrowed))
    moved = np.linalg.norm([stage.verts for stage in fit][-1] - cow.verts, axis=1)  # type: ignore[operator]
    horns, legs = (np.unique(cow.faces[cow.labels == code(part)]) for part in ("horn", "leg"))
    assert moved[horns].max() > 0.2
    assert moved[legs].max() < 0.05
    assert fit.result.member["form"] == "the asset itself"


@pytest.mark.parametrize(
    "prompt",
    [
        "a dog with a rabbit's ears",
        "a dog with rabbit ears",
        "a dog with the ears of a rabbit",
        "ein Hund mit Hasen Ohren",
    ],
)
def test_a_part_of_another_noun_may_be_asked_for_in_several_ways(prompt: str) -> None:
    assert parse(prompt).borrowed == (Borrowed("ears", "rabbit"),)
    assert parse(str(parse(prompt))) == parse(prompt)


def test_a_borrowed_part_may_have_a_size_and_stand_beside_attributes() -> None:
    asked = parse("a fat cow with a deer\u2019s long horns and long legs")
    assert str(asked) == "a fat cow with long legs and a deer's long horns"
    assert asked.borrowed == (Borrowed("horns", "deer", "long"),)


@pytest.mark.parametrize(
    ("prompt", "says"),
    [
        ("a vase with a rabbit's ears", "The vase has no ears"),
        ("a dog with a swan's beak", "The dog has no beak"),
        ("a giraffe with a swan's neck", "carries more"),
    ],
)
def test_what_cannot_be_borrowed_is_refused(prompt: str, says: str) -> None:
    with pytest.raises(VocabularyError, match=says):
        parse(prompt)


def test_the_prior_knows_no_parts_of_others() -> None:
    with pytest.raises(VocabularyError, match="knows no ears of a rabbit"):
        parse("a dog with a rabbit's ears", BUILTIN_WORDS)
