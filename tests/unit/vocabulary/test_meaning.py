from meshdeform.vocabulary import near_words
from meshdeform.vocabulary.nouns import NOUNS
from tests.cases import each_case


@each_case(
    ("word", "noun"),
    [
        ("palace", "house"), ("javelin", "spear"), ("tambourine", "drum"), ("hyena", "dog"), ("zebra", "horse"),
        ("pheasant", "turkey"), ("flamingo", "swan"), ("porpoise", "dolphin"), ("mackerel", "shark"),
        ("banjo", "guitar"), ("bonnet", "hat"), ("harpoon", "spear"), ("nectarine", "pear"), ("turnip", "carrot"),
        ("tankard", "mug"), ("sparrow", "bird"), ("sheriff", "person"), ("galleon", "ship"),
    ],
)  # fmt: skip
def test_nouns_of_similar_meaning_are_found(word: str, noun: str) -> None:
    assert noun in near_words.nearest(word, NOUNS)


def test_what_is_no_thing_has_no_neighbour_and_nouns_that_are_not_builtin_are_found_too() -> None:
    assert near_words.nearest("democracy", NOUNS) == near_words.nearest("antelope", ["no-such-noun"]) == []
    assert (near_words.is_noun("qwertz"), near_words.is_noun("kettle")) == (False, True)
    assert near_words.nearest("grapefruit", [*NOUNS, "mandarin"])[0] == "mandarin"
    assert near_words.nearest("grapefruit", [*NOUNS, "zebu"])[0] == "lemon"
