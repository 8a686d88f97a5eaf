"""Prompts in German and Spanish."""

from __future__ import annotations

import pytest

from meshdeform.errors import VocabularyError
from meshdeform.priors.builtin import grammar
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import ADJECTIVES
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from tests.cases import each_case


@each_case(
    ("prompt", "meaning"),
    [
        ("ein dicker Hund", "a fat dog"),
        ("Giraffen mit langem Hals", "a giraffe with a long neck"),
        ("ein hohes, schmales Haus", "a tall thin house"),
        ("ein Boot", "a boat"),  # in English a boot
        ("ein Vogel mit großen Flügeln", "a bird with big wings"),
        ("ein Kamel mit kleinen Höckern", "a camel with small humps"),
        ("un perro gordo", "a fat dog"),
        ("una jirafa con patas cortas y cuello largo", "a giraffe with short legs and a long neck"),
        ("un avion con alas grandes", "an airplane with big wings"),  # without its accent
        ("un árbol alto y delgado", "a tall thin tree"),
        ("un barco largo", "a long boat"),
        ("a pan", "a pan"),  # English first: bread in Spanish
        ("un pan", "a bread"),
        ("una corona", "a crown"),
    ],
)
def test_a_prompt_means_what_it_means_in_its_language(prompt: str, meaning: str) -> None:
    assert str(parse(prompt)) == meaning


@each_case(
    ("prompt", "unknown"),
    [
        ("a bank", ["bank"]),  # English has it
        ("a bote", ["bote"]),  # an English sentence
        ("the pato", ["pato"]),
        ("ein blauer Hund", ["ein", "blauer", "hund"]),  # no language understands it: as it was written
        ("eine Brücke", ["bridge"]),
    ],
)
def test_what_no_language_understands_is_refused_as_it_was_written(prompt: str, unknown: list[str]) -> None:
    with pytest.raises(VocabularyError) as refused:
        parse(prompt)
    assert refused.value.extra["unknown"] == unknown


def test_every_noun_adjective_and_part_has_a_translation() -> None:
    german, spanish = grammar._languages(grammar._TABLE)
    own = {*NOUNS, *ADJECTIVES, *PARTS} - {"gun"}
    assert own <= {*german.values()}
    assert own <= {*spanish.values()}
