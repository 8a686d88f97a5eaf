"""The noun: given, named in the file, or decided between proposals; probabilities leave room for none of them."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.labels import labelled_member
from meshdeform.reading.choice import AssetMesh, facing
from meshdeform.reading.deciding import PROPOSED, decide


@pytest.fixture(scope="module")
def mug() -> AssetMesh:
    member = labelled_member("mug", (), np.random.default_rng(4321))
    return AssetMesh(member.verts @ facing(-90.0).T, member.faces)


def test_a_single_noun_is_what_it_is(mug: AssetMesh) -> None:
    decision = decide(mug, {"bowl": 0.01}, named=["mug"])
    assert (decision.noun, decision.probabilities) == ("bowl", {"bowl": 1.0})


def test_the_shape_and_the_proposal_decide_together() -> None:
    member = labelled_member("teapot", (), np.random.default_rng(4321))
    teapot = AssetMesh(member.verts @ facing(-90.0).T, member.faces)
    even = decide(teapot, {"can": 0.4, "mug": 0.4})
    assert even.noun == "mug"
    assert list(even.probabilities) == ["mug", "can"]
    assert decide(teapot, {"can": 0.99, "mug": 0.0001}).noun == "can"
    surer = decide(teapot, {"mug": 0.99, "can": 0.01})
    assert even.probabilities["mug"] < 0.8 < surer.probabilities["mug"]
    assert sum(even.probabilities.values()) < 0.8
    assert sum(surer.probabilities.values()) > 0.95


def test_what_the_file_names_comes_first_also_where_nobody_proposes_it(mug: AssetMesh) -> None:
    decision = decide(mug, {"can": 0.97, "bowl": 0.02}, named=["mug"])
    assert decision.noun == "mug"
    assert decision.probabilities["mug"] > 0.9
    both = decide(mug, {"can": 0.5, "bowl": 0.3}, named=["mug", "can"])
    assert max(both.probabilities.values()) < 0.9


def test_only_the_most_probable_nouns_count(mug: AssetMesh) -> None:
    nouns = {noun: 0.1 - 0.01 * place for place, noun in enumerate(["can", "bowl", "plate", "jar", "vase", "mug"])}
    assert set(decide(mug, nouns).probabilities) == set(list(nouns)[:PROPOSED])


def test_what_a_word_in_the_file_is_near_to_comes_into_question(mug: AssetMesh) -> None:
    alone = decide(mug, {"can": 0.5, "bowl": 0.3}).probabilities
    near = decide(mug, {"can": 0.5, "bowl": 0.3}, near=["mug"]).probabilities
    assert "mug" not in alone
    assert near["can"] < near["mug"] < decide(mug, {"can": 0.5, "bowl": 0.3}, named=["mug"]).probabilities["mug"]


def test_what_is_held_may_stand_on_its_head() -> None:
    member = labelled_member("hammer", (), np.random.default_rng(77))
    upright = decide(AssetMesh(member.verts, member.faces), {"hammer": 1.0})
    assert upright.frame.turn[1] @ [0, 1, 0] == pytest.approx(1)
    turned = decide(AssetMesh(member.verts * [1, -1, -1], member.faces), {"hammer": 1.0})
    assert turned.frame.turn[1] @ [0, -1, 0] == pytest.approx(1)
    assert np.linalg.det(turned.frame.turn) == pytest.approx(1)
