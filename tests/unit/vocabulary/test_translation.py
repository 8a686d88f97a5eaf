"""Prompts in German and Spanish."""

from __future__ import annotations

import pytest

from meshdeform.errors import VocabularyError
from meshdeform.vocabulary import translation
from meshdeform.vocabulary.grammar import ParsedPrompt, parse
from meshdeform.vocabulary.looks import LOOKS
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.vocabulary.words import ADJECTIVES
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
        ("ein Comic-Hund", "a dog with a big head and short legs"),
        ("ein eckiges Auto", "a boxy car"),
        ("un coche deportivo", "a short long car with big wheels"),
        ("un perro con orejas de conejo", "a dog with a rabbit's ears"),
        ("ein Hund mit den Ohren eines Hasen", "a dog with a rabbit's ears"),
        ("un oso de peluche", "a teddy"),  # words that belong together
        ("eine Schere", "scissors"),  # a noun, and then a part
        ("eine Krabbe mit kleinen Scheren", "a crab with small claws"),
        ("ein Loewe mit grosser Maehne", "a lion with a big mane"),
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
        ("ein fröhlicher Hund", ["fröhlicher"]),
        ("un perro azul", ["blue"]),
        ("dos perros", ["two"]),
    ],
)
def test_what_a_language_lacks_is_refused(prompt: str, unknown: list[str]) -> None:
    with pytest.raises(VocabularyError) as refused:
        parse(prompt)
    assert refused.value.extra["unknown"] == unknown


def test_every_noun_adjective_look_and_part_has_a_translation_and_no_two_nouns_share_one() -> None:
    for language in translation._languages(translation._TABLE):
        meant = {word for meanings in language.values() for word in meanings}
        assert meant >= {*NOUNS, *ADJECTIVES, *LOOKS, *PARTS}
        shared = {word: nouns for word, each in language.items() if len(nouns := [*NOUNS.keys() & {*each}]) > 1}
        assert not shared


def test_english_prompts_mean_the_same_whatever_words_other_languages_have() -> None:
    for noun in NOUNS:
        assert str(parse(f"the {noun}")) == str(parse(noun)) == str(ParsedPrompt(noun))
