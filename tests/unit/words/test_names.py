"""Two nouns are never one: ours, another word's, their plurals and synonyms are refused, each with what to do."""

from __future__ import annotations

import pytest

from meshdeform.errors import ParameterError
from meshdeform.words import check_names, read_name
from tests.cases import each_case
from tests.unit.words.words import WEDGE


@each_case("text, name", [("Dragon Fruit", "dragon-fruit"), (" okapi ", "okapi"), ("tea_pot-lid", "tea-pot-lid")])
def test_names_are_small_and_joined_by_hyphens(text: str, name: str) -> None:
    assert read_name(text) == name


@each_case("text", ["", "  ", "x2", "tall", "very", "big", "../x", "a" * 41, "größe"])
def test_what_is_no_name_of_a_thing_is_refused(text: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        read_name(text)
    assert refusal.value.extra["errors"][0]["loc"] == ["noun"]


@each_case(
    "noun, synonyms, place, reason",
    [
        ("dog", (), "noun", "noun of ours"),
        ("hounds", (), "noun", "our 'dog'"),
        ("okapi", ("horse",), "synonyms", "noun of ours"),
        ("wedge", (), "noun", "You have"),
        ("wedges", (), "noun", "would be one"),
        ("doorstop", (), "noun", "'doorstop' is read as both"),
        ("okapi", ("chocks",), "synonyms", "'chocks' is read as both"),
    ],
)
def test_names_that_are_taken_are_refused_where_they_are(
    noun: str, synonyms: tuple[str, ...], place: str, reason: str
) -> None:
    with pytest.raises(ParameterError, match=reason) as refusal:
        check_names(noun, synonyms, [WEDGE])
    assert refusal.value.extra["errors"][0]["loc"] == [place]


@each_case("noun", ["dog", "hound", "wedge"])
def test_a_noun_of_ours_and_ones_own_word_can_be_replaced(noun: str) -> None:
    check_names(noun, (), [WEDGE], replace=True)


def test_another_word_is_not_replaced() -> None:
    with pytest.raises(ParameterError, match="would be one"):
        check_names("chock", (), [WEDGE], replace=True)
