"""Sums and tables of rows that are made up, so that every number is known; ranks, intervals and judges."""

from __future__ import annotations

import math
from typing import Any

import pytest

from meshdeform.errors import ParameterError
from tests.cases import each_case
from training.evaluation.report import interval, summarise, table
from training.evaluation.retrieval import load_judge, ranked

pytestmark = pytest.mark.training

QUALITY = {
    "flipped_faces": 0,
    "self_intersections_added": 0,
    "symmetric_dirichlet_mean": 2.0,
    "symmetric_dirichlet_p99": 4.0,
    "kept_share": 0.5,
}


def row(*, hit: bool | None, verdict: str = "good", **quality: float | None) -> dict[str, Any]:
    judged = None if hit is None else {"hit": hit, "noun_hit": True}
    return {"state": "succeeded", "verdict": verdict, "quality": QUALITY | quality, "judge": judged, "clip": None}


def test_shares_and_means_are_those_of_the_rows() -> None:
    rows = [
        row(hit=True, flipped_faces=4, kept_share=0.1),
        row(hit=False, verdict="keep_source"),
        row(hit=False, verdict="doubtful", self_intersections_added=2),
        row(hit=False, symmetric_dirichlet_p99=1e6, self_intersections_added=None),
        {"state": "failed"},
        {"state": "pending"},
    ]
    found = summarise(rows)
    assert (found["count"], found["failed"]) == (4, 1)
    assert found["retrieval"] == {"hits": 1, "count": 4, "share": 0.25, "low": pytest.approx(0.0456, abs=1e-4),
                                  "high": pytest.approx(0.6994, abs=1e-4)}  # fmt: skip
    assert found["noun"]["share"] == 1.0
    assert found["clip"] is None
    assert (found["good"], found["keep_source"]) == (0.5, 0.25)
    assert found["any_flipped"] == 0.25
    assert found["any_cut"] == pytest.approx(1 / 3)
    assert found["symmetric_dirichlet_p99"] == 4.0
    assert found["kept_share"] == pytest.approx(0.4)


def test_nothing_done_and_nothing_judged_have_rows_as_well() -> None:
    text = table("prompt", {"a fish": summarise([row(hit=None)]), "a tree": summarise([])})
    assert text.startswith("| prompt")
    assert [line.count("|") for line in text.splitlines()] == [13] * 4


NEWCOMBE = [
    (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718), (0, 0, 0, 1)
]  # fmt: skip


@each_case(("hits", "count", "low", "high"), NEWCOMBE)
def test_wilsons_interval_is_the_published_one(hits: int, count: int, low: float, high: float) -> None:
    assert interval(hits, count) == pytest.approx((low, high), abs=5e-5)


def test_the_best_is_rank_one_with_the_softmax_as_probability_and_a_tie_is_no_hit() -> None:
    scores = {"a": math.log(1), "b": math.log(3), "c": math.log(4)}
    assert ranked(scores, "c") == {"rank": 1, "hit": True, "probability": pytest.approx(0.5), "retrieved": "c"}
    assert ranked(scores, "a") == {"rank": 3, "hit": False, "probability": pytest.approx(0.125), "retrieved": "c"}
    assert ranked({"a": 1.0, "b": 1.0}, "b")["rank"] == 2
    assert ranked({"a": -1e5, "b": -2e5}, "b")["probability"] == 0.0


@each_case("name", ["nonsense", "no.such.module:Judge", "tests.unit.evaluation.stand_ins:Nobody"])
def test_judges_that_are_not_there_are_refused(name: str) -> None:
    with pytest.raises(ParameterError, match="There is no judge"):
        load_judge(name)
