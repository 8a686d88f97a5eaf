from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.priors.builtin import grammar
from meshdeform.priors.builtin.vocabulary import NOUNS
from release import nouns
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


def test_what_is_no_thing_has_no_neighbour() -> None:
    assert grammar.nearest("democracy", NOUNS) == []
    assert not grammar.is_noun("qwertz")
    assert grammar.is_noun("kettle")


def test_nouns_that_are_taught_later_are_found_too() -> None:
    assert grammar.nearest("jaguar", [*NOUNS, "leopard"])[0] == "leopard"
    assert grammar.nearest("jaguar", [*NOUNS, "turnip"])[0] == "lion"
    assert grammar.nearest("antelope", ["no-such-noun"]) == []


_DATA = """\
  1 licence
00000001 03 n 01 thing 0 000 | what is
00000002 05 n 02 animal 0 beast 0 001 @ 00000001 n 0000 | lives; eats
00000003 05 n 02 dog 0 Canis_familiaris 0 001 @ 00000002 n 0000 | barks
00000004 05 n 01 Rex 0 001 @ 00000003 n 0000 | a name: no word
00000005 04 n 01 barking 0 000 | an act: no thing
00000006 06 n 01 dog 0 001 @ 00000001 n 0000 | the tool, which the prior does not draw
00000007 06 n 02 crane 0 derrick 0 001 @ 00000001 n 0000 | lifts
00000008 05 n 01 jackal 0 001 @ 00000002 n 0000 | howls
"""
_INDEX = """\
  1 licence
thing n 1 0 1 1 00000001
beast n 1 1 @ 1 0 00000002
barking n 1 1 @ 1 0 00000005
crane n 2 1 @ 2 0 00000003 00000007
dog n 2 1 @ 2 0 00000003 00000006
jackal n 1 1 @ 1 0 00000008
rex n 1 1 @ 1 0 00000004
"""


@pytest.fixture
def things(tmp_path: Path) -> nouns.Things:
    (tmp_path / "data.noun").write_text(_DATA)
    (tmp_path / "index.noun").write_text(_INDEX)
    return nouns.Things.read(tmp_path)


def test_words_and_their_senses_come_from_wordnets_files(things: nouns.Things) -> None:
    assert sorted(things.senses) == ["beast", "crane", "dog", "jackal", "thing"]
    assert things.senses["dog"] == ["00000003"]
    assert things.glosses["00000002"] == "lives"
    assert things.sizes["00000002"] == 4


def test_nouns_are_near_by_their_sentences_and_by_kin(things: nouns.Things) -> None:
    def encode(sentences: Sequence[str]) -> NDArray[np.float32]:
        likely = ["hammer" if "crane" in each or "lifts" in each else each for each in sentences]
        return np.array([[1.0, 0.0] if "hammer" in each else [0.0, 1.0] for each in likely], np.float32)

    near = nouns.nearest(things, ["dog", "hammer"], encode)
    assert near["jackal"] == ["dog"]
    assert near["crane"][0] == "hammer"
    assert near["dog"] == []
