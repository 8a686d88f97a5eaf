"""Sentences and what they ask for, known beforehand."""

from __future__ import annotations

import pytest

from meshdeform.errors import PromptError
from meshdeform.plain.words import read_changes
from meshdeform.vocabulary.lookup import noun_of
from tests.cases import each_case


@each_case(
    "text, wanted",
    [
        ("taller", ["tall whole 1.4"]),
        ("tall and thin", ["tall whole 1.4", "fat whole 0.67"]),
        ("longer legs and a bigger head", ["long leg 1.4", "big head 1.45"]),
        ("longer and thicker legs", ["long leg 1.4", "fat leg 1.5"]),
        ("longer legs and arms", ["long leg 1.4", "long arm 1.4"]),
        ("legs and arms longer", ["long leg 1.4", "long arm 1.4"]),
        ("make the legs longer and thicker", ["long leg 1.4", "fat leg 1.5"]),
        ("tall with longer legs", ["tall whole 1.4", "long leg 1.4"]),
        ("taller and longer legs", ["tall whole 1.4", "long leg 1.4"]),
        ("twice as tall", ["tall whole 2.0"]),
        ("half as tall", ["tall whole 0.5"]),
        ("1.5 times as tall", ["tall whole 1.5"]),
        ("one and a half times as long", ["long whole 1.5"]),
        ("20 % taller", ["tall whole 1.2"]),
        ("20% shorter", ["tall whole 0.8"]),
        ("to 80 % of the height", ["tall whole 0.8"]),
        ("half the height", ["tall whole 0.5"]),
        ("double the width", ["wide whole 2.0"]),
        ("taller by a third", ["tall whole 1.33"]),
        ("legs longer by 30 %", ["long leg 1.3"]),
        ("slightly wider", ["wide whole 1.14"]),
        ("a little taller", ["tall whole 1.16"]),
        ("much thinner", ["fat whole 0.53"]),
        ("less fat", ["fat whole 0.67"]),
        ("more slender", ["fat whole 0.67"]),
        ("flatter", ["tall whole 0.71"]),
        ("shorten the legs", ["long leg 0.71"]),
        ("shrink the head by half", ["big head 0.5"]),
        ("a bigger head and twice as long a tail", ["big head 1.45", "long tail 2.0"]),
        ("widen the seat", ["wide seat 1.35"]),
        ("bigger antenna", ["big antenna 1.45"]),
        ("bigger front left wheel", ["big front left wheel 1.45"]),
        ("much more twisted", ["twisted whole 1.8"]),
        ("a fat dog", ["fat whole 1.6"]),
        ("a dog with long legs", ["long leg 1.4"]),
        ("make the dog's legs twice as long", ["long leg 2.0"]),
        ("longer left arm", ["long left arm 1.4"]),
        ("thicker back legs", ["fat rear leg 1.5"]),
        ("a thicker back", ["fat back 1.5"]),
        ("thicker lower legs", ["fat lower leg 1.5"]),
        ("lower the seat", ["high seat 0.71"]),
        ("seat higher by 20 %", ["high seat 1.2"]),
        ("lower", ["tall whole 0.71"]),
        ("thinner wheels", ["wide wheel 0.67"]),
        ("a lower back", ["tall back 0.71"]),
        ("steeper roof", ["tall roof 1.4"]),
        ("bigger belly", ["fat belly 1.45"]),
        ("twice as deep", ["deep whole 2.0"]),
        ("legs 1.2x", ["long leg 1.2"]),
        ("the legs are too short", ["long leg 1.4"]),
        ("too fat", ["fat whole 0.67"]),
        ("make her legs longer", ["long leg 1.4"]),
        ("longer legs but not the arms", ["long leg 1.4"]),
        ("taller but not wider", ["tall whole 1.4"]),
        ("increase the height by 20 %", ["tall whole 1.2"]),
        ("reduce the width by a third", ["wide whole 0.67"]),
        ("lenger legs", ["long leg 1.4"]),
        ("längere Beine", ["long leg 1.4"]),
        ("größerer Kopf", ["big head 1.45"]),
        ("doppelt so hoch", ["tall whole 2.0"]),
        ("das linke Bein um 20 % kürzer", ["long left leg 0.8"]),
        ("más alto", ["tall whole 1.4"]),
        ("piernas más largas", ["long leg 1.4"]),
        ("la mitad de alto", ["tall whole 0.5"]),
        ("haz la cabeza un poco más grande", ["big head 1.18"]),
    ],
)
def test_a_sentence_asks_for_its_changes(text: str, wanted: list[str]) -> None:
    found = read_changes(text, noun_of)
    assert found is not None
    assert [f"{each.operation} {each.name} {round(each.factor, 2)}" for each in found.changes] == wanted


@each_case("text", ["", "a chair", "big antenna", "a dog and a taller cat", "the legs", "twice"])
def test_what_is_not_understood_is_no_change(text: str) -> None:
    assert read_changes(text, noun_of) is None


@each_case(
    "text, noun, compared",
    [
        ("taller", None, True),
        ("tall and thin", None, False),
        ("a fat dog", "dog", False),
        ("a fatter dog", "dog", True),
        ("twice as tall a vase", "vase", True),
    ],
)
def test_a_comparison_is_told_from_a_description(text: str, noun: str | None, compared: bool) -> None:
    found = read_changes(text, noun_of)
    assert found is not None
    assert (found.noun, found.compared) == (noun, compared)


@each_case(
    "text, length",
    [
        ("5 m tall", (5.0, False)),
        ("30 cm wider", (0.3, True)),
        ("50 cm lower", (-0.5, True)),
        ("lower the seat to 40 cm", (0.4, False)),
        ("2,5 m lang", (2.5, False)),
    ],
)
def test_a_length_is_in_metres_and_is_added_by_what_compares(text: str, length: tuple[float, bool]) -> None:
    found = read_changes(text, noun_of)
    assert found is not None
    (change,) = found.changes
    assert (change.metres, change.added) == (pytest.approx(length[0]), length[1])


@each_case(
    "text, says",
    [
        ("longer wheels", "cannot be longer or shorter. It can be bigger or wider."),
        ("raise the tail", "cannot be higher or lower. It can be longer, bigger or thicker."),
        ("bigger but not taller", "Say only what is to change"),
        ("bigger but not the head", "a change of the whole changes it as well"),
        ("raise the table", "Name a part, such as the seat"),
    ],
)
def test_what_the_table_lacks_is_refused_with_what_is_possible(text: str, says: str) -> None:
    with pytest.raises(PromptError) as refused:
        read_changes(text, noun_of)
    assert says in f"{refused.value.detail} {refused.value.advice_text}"


def test_a_misspelt_word_is_told_and_a_name_is_none() -> None:
    found, named = read_changes("lenger legs"), read_changes("a longer tower")
    assert found is not None
    assert named is not None
    assert (found.notes, named.notes) == (("'lenger' was read as 'longer'.",), ())


@each_case("text", ["tall and short", "10 times taller", "200 % shorter", "longer legs and shorter legs"])
def test_contradictions_and_extremes_are_refused(text: str) -> None:
    with pytest.raises(PromptError):
        read_changes(text)
