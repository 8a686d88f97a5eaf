"""Prompts know words of one's own within a block, nobody else does; their shapes are members like any noun's."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from meshdeform.errors import VocabularyError
from meshdeform.exemplar.kinds import is_built, is_living
from meshdeform.reading.banks import bank_of, candidate_member
from meshdeform.vocabulary.grammar import parse
from meshdeform.vocabulary.lookup import Attribute, noun_of
from meshdeform.vocabulary.solids import PART_NAMES
from meshdeform.words import WordShape, in_use, like_of, own_word, words_in_use
from tests.unit.words.words import BOX, WEDGE, box, word


def test_prompts_know_a_word_within_the_block_alone() -> None:
    with in_use([WEDGE, BOX]):
        assert str(parse("Tall wedges with a big head")) == "a tall wedge with a big head"
        assert parse("a doorstop").noun == "wedge"
        assert parse("a thin dragon box").noun == "dragon-box"
        assert parse("a fat dog").noun == "dog"
        with pytest.raises(VocabularyError, match="no ears"):
            parse("a wedge with long ears")
        with in_use([BOX]):
            assert noun_of("wedge") is None
        assert [each.noun for each in words_in_use()] == ["dragon-box", "wedge"]
    assert own_word("wedge") is None
    with pytest.raises(VocabularyError):
        parse("a wedge")


def test_another_thread_does_not_know_it() -> None:
    with in_use([WEDGE]), ThreadPoolExecutor(1) as pool:
        assert pool.submit(noun_of, "wedge").result() is None


def test_a_word_may_take_the_place_of_a_noun_of_ours_or_of_a_synonym() -> None:
    with in_use([word("dog", box()), word("hound", box(1, 2, 1))]):
        assert parse("a dog").noun == "dog"
        assert parse("a hound").noun == "hound"
        assert candidate_member("dog", 0, ()).faces.shape == (12, 3)
    assert parse("a hound").noun == "dog"


GONE = word("gone", box(), like="quux")  # which may have been a noun of ours when it was made


def test_a_word_is_what_the_noun_is_that_it_is_like() -> None:
    with in_use([word("guanaco", box(), like="sheep"), word("shed", box(), like="house"), BOX, GONE]):
        assert is_living("guanaco")
        assert not is_built("guanaco")
        assert is_built("shed")
        assert not is_living("shed")
        assert not is_built("dragon-box")
        assert like_of("dragon-box") == "dragon-box"
        assert like_of("gone") == "gone"


def test_its_shapes_are_its_members_in_turn() -> None:
    with in_use([WEDGE]):
        members = [candidate_member("wedge", number, ()) for number in range(3)]
        tall = candidate_member("wedge", 0, (Attribute("whole", "tall"),))
        assert len(bank_of("wedge")) == 2
    assert np.array_equal(members[0].verts, members[2].verts)
    assert not np.array_equal(members[0].verts, members[1].verts)
    first = members[0]
    assert first.parts == ("body", "head")
    assert {PART_NAMES[first.labels[face]] for face in range(12)} == {"body", "head"}
    for part in first.parts:  # no vertex is of two
        others = first.faces[first.labels != PART_NAMES.index(part)]
        assert not np.isin(first.faces[first.labels == PART_NAMES.index(part)], others).any()
    sides, taller = (np.ptp(each.verts, axis=0) for each in (first, tall))
    np.testing.assert_allclose(sides / sides[0], [1, 2, 3], rtol=1e-6)
    assert taller[1] / taller[0] > 2 * 1.3


def test_parts_change_their_size_and_stay_where_they_are_joined() -> None:
    stem, cap = box(1, 2, 1), box(2, 1, 2)
    verts = np.concatenate([stem.verts, cap.verts + [0, np.ptp(stem.verts[:, 1]) / 2 + np.ptp(cap.verts[:, 1]) / 2, 0]])
    faces = np.concatenate([stem.faces, cap.faces + len(stem.verts)])
    shape = WordShape(verts / 2, faces, np.repeat([0, 1], 12))

    def sides(prompt: str) -> tuple[np.ndarray, np.ndarray]:
        asked = parse(prompt)
        member = candidate_member("toadstool", 0, asked.attributes)
        own = [member.verts[member.solids == number] for number in (0, 1)]
        assert own[0][:, 1].max() == pytest.approx(own[1][:, 1].min())  # the cap is on the stem
        return np.ptp(own[0], axis=0), np.ptp(own[1], axis=0)

    with in_use([word("toadstool", shape, parts=("stem", "cap"))]):
        stem_sides, cap_sides = sides("a toadstool")
        beside, bigger = sides("a toadstool with a big cap")
        assert bigger[0] / beside[0] > 1.2 * cap_sides[0] / stem_sides[0]
        stems = {degree: sides(f"a toadstool with a {degree} stem") for degree in ("long", "short")}
    for degree, (stem_now, cap_now) in stems.items():
        ratio = (stem_now[1] / cap_now[1]) / (stem_sides[1] / cap_sides[1])
        assert ratio == pytest.approx({"long": 1.6, "short": 0.55}[degree], rel=1e-6)


def test_faces_of_no_known_part_are_of_the_body() -> None:
    with in_use([word("box", box(), parts=("rind", "head"))]):
        assert candidate_member("box", 0).parts == ("body", "head")
    with in_use([word("box", box(parts=0))]):
        assert candidate_member("box", 0).parts == ("body",)


def test_samples_are_kept_by_the_hash_of_the_word(tmp_path: Path) -> None:
    with in_use([word("box", box())]):
        one = bank_of("box", tmp_path)
    with in_use([word("box", box(1, 5, 1))]):
        other = bank_of("box", tmp_path)
    assert not np.array_equal(one.high, other.high)
    assert len(list(tmp_path.glob("own+*.npz"))) == 2
