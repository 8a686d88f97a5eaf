from meshdeform.priors.builtin import grammar
from meshdeform.vocabulary.nouns import NOUNS
from tests.cases import each_case


@each_case(
    ("word", "noun"),
    [
        ("lorry", "truck"), ("wineskin", "bottle"), ("ottoman", "stool"), ("leopard", "lion"), ("hyena", "dog"),
        ("zebra", "horse"), ("alligator", "crocodile"), ("flamingo", "swan"), ("porpoise", "whale"),
        ("tuna", "fish"), ("banjo", "guitar"), ("beret", "hat"), ("lantern", "lamp"), ("grapefruit", "pear"),
        ("turnip", "carrot"), ("tankard", "mug"),
    ],
)  # fmt: skip
def test_nouns_of_similar_meaning_are_found(word: str, noun: str) -> None:
    assert noun in grammar.nearest(word, NOUNS)


def test_what_is_no_thing_has_no_neighbour_and_nouns_that_are_not_builtin_are_found_too() -> None:
    assert grammar.nearest("democracy", NOUNS) == grammar.nearest("antelope", ["no-such-noun"]) == []
    assert (grammar.is_noun("qwertz"), grammar.is_noun("kettle")) == (False, True)
    assert grammar.nearest("jaguar", [*NOUNS, "leopard"])[0] == "leopard"
    assert grammar.nearest("jaguar", [*NOUNS, "turnip"])[0] == "lion"
