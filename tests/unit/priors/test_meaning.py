import gzip
from pathlib import Path

from meshdeform.priors.builtin import grammar
from meshdeform.priors.builtin.vocabulary import NOUNS
from release import nouns as cut
from tests.cases import each_case


@each_case(
    ("word", "noun"),
    [
        ("lorry", "truck"),
        ("wineskin", "bottle"),
        ("ottoman", "stool"),
        ("leopard", "lion"),
        ("hyena", "dog"),
        ("zebra", "horse"),
        ("alligator", "crocodile"),
        ("flamingo", "swan"),
        ("porpoise", "dolphin"),
        ("tuna", "fish"),
        ("banjo", "guitar"),
        ("beret", "hat"),
        ("lantern", "lamp"),
        ("grapefruit", "apple"),
        ("turnip", "carrot"),
        ("tankard", "bowl"),
    ],
)
def test_nouns_of_similar_meaning_are_found(word: str, noun: str) -> None:
    assert noun in grammar.nearest(word, NOUNS)


def test_what_is_no_thing_has_no_neighbour() -> None:
    assert grammar.nearest("democracy", NOUNS) == []
    assert not grammar.is_noun("qwertz")
    assert grammar.is_noun("kettle")


def test_nouns_that_are_taught_later_are_found_too() -> None:
    assert grammar.nearest("gnu", [*NOUNS, "antelope"])[0] == "antelope"
    assert grammar.nearest("antelope", ["no-such-noun"]) == []


def test_the_table_states_its_licence_and_is_small() -> None:
    packed = (Path(grammar.__file__).parent / "nouns.txt.gz").read_bytes()
    text = gzip.decompress(packed).decode()
    assert "WordNet 3.0 Copyright 2006 by Princeton University" in text
    assert len(packed) < 200_000


def test_the_table_is_cut_from_wordnets_files(tmp_path: Path) -> None:
    data = [
        "  1 licence",
        "00000001 03 n 01 thing 0 000 | what is",
        "00000002 05 n 02 animal 0 beast 0 001 @ 00000001 n 0000 | lives",
        "00000003 05 n 02 dog 0 Canis_familiaris 0 001 @ 00000002 n 0000 | barks",
        "00000004 05 n 01 Rex 0 001 @ 00000003 n 0000 | a name: no word",
        "00000005 04 n 01 barking 0 000 | an act: no thing",
        "00000006 06 n 01 dog 0 001 @ 00000001 n 0000 | the tool, which the prior does not draw",
        "00000007 06 n 02 crane 0 derrick 0 001 @ 00000001 n 0000 | lifts",
    ]
    index = ["  1 licence", "thing n 1 0 1 1 00000001", "beast n 1 1 @ 1 0 00000002"]
    index += ["crane n 2 1 @ 2 0 00000003 00000007"]
    index += ["dog n 2 1 @ 2 0 00000003 00000006", "rex n 1 1 @ 1 0 00000004", "derrick n 1 1 @ 1 0 00000007"]
    (tmp_path / "data.noun").write_text("\n".join(data))
    (tmp_path / "index.noun").write_text("\n".join(index))
    assert cut.tree(tmp_path) == [(0, ["thing"]), (1, ["beast"]), (2, ["dog"]), (1, ["crane:2", "derrick"])]
