"""Ranks, intervals and judges."""

from __future__ import annotations

import math

import pytest

from meshdeform.errors import ParameterError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from tests.cases import each_case
from tests.unit.evaluation.stand_ins import HeightJudge
from training.evaluation.relaxed import geodesic_sphere
from training.evaluation.retrieval import judgement, load_judge, ranked, wilson

# Newcombe 1998, Two-sided confidence intervals for the single proportion, table I, method 3 (score, no correction).
NEWCOMBE = [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]


@each_case(("hits", "count", "low", "high"), NEWCOMBE)
def test_wilsons_interval_is_the_published_one(hits: int, count: int, low: float, high: float) -> None:
    assert wilson(hits, count) == pytest.approx((low, high), abs=5e-5)


def test_an_interval_of_nothing_says_nothing_and_all_hits_reach_one() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(20, 20) == pytest.approx((1 - 0.1611, 1.0), abs=5e-5)


def test_the_best_is_rank_one_with_the_softmax_as_probability() -> None:
    scores = {"a": math.log(1), "b": math.log(3), "c": math.log(4)}
    assert ranked(scores, "c") == {"rank": 1, "hit": True, "probability": pytest.approx(0.5), "retrieved": "c"}
    assert ranked(scores, "a") == {"rank": 3, "hit": False, "probability": pytest.approx(0.125), "retrieved": "c"}


def test_a_tie_is_no_hit() -> None:
    assert ranked({"a": 1.0, "b": 1.0}, "b")["rank"] == 2


def test_very_unlikely_prompts_overflow_nothing() -> None:
    assert ranked({"a": -1e5, "b": -2e5}, "b")["probability"] == 0.0


def test_a_judgement_ranks_prompts_and_nouns() -> None:
    prompts = ("a fish", "a mushroom")
    sphere = geodesic_sphere(2)
    tall = TriangleMesh(sphere.verts * sphere.verts.new_tensor([1, 1.5, 1]), sphere.faces)
    found = judgement(HeightJudge(), tall, prompts, "a mushroom")
    assert (found["rank"], found["retrieved"], found["noun_rank"]) == (1, "a mushroom", 1)
    assert found["log_likelihoods"]["a mushroom"] == pytest.approx(0, abs=1e-3)
    missed = judgement(HeightJudge(), tall, prompts, "a fish")
    assert (missed["hit"], missed["retrieved"], missed["noun_hit"]) == (False, "a mushroom", False)


def test_a_prompt_that_the_judge_does_not_know_is_an_error() -> None:
    with pytest.raises(VocabularyError):
        judgement(HeightJudge(), geodesic_sphere(1), ("a gnome",), "a gnome")


def test_judges_are_found_by_name() -> None:
    assert load_judge("none") is None
    judge = load_judge("tests.unit.evaluation.stand_ins:HeightJudge")
    assert judge is not None
    assert judge.identity["id"] == "height"


@each_case("name", ["nonsense", "no.such.module:Judge", "tests.unit.evaluation.stand_ins:Nobody"])
def test_judges_that_are_not_there_are_refused(name: str) -> None:
    with pytest.raises(ParameterError, match="There is no judge"):
        load_judge(name)
