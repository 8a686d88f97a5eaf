"""Sums and tables of records that are made up, so that every number is known."""

from __future__ import annotations

import math
from typing import Any

import pytest

from meshdeform.errors import ParameterError, WorkerLostError
from tests.cases import each_case
from tests.unit.evaluation.arithmetic import broken, squares
from training.evaluation.pool import each
from training.evaluation.retrieval import load_judge, ranked, wilson
from training.evaluation.summary import states_of, summarise
from training.evaluation.tables import table

QUALITY = {
    "flipped_faces": 0,
    "collapsed_faces": 0,
    "self_intersections_added": 0,
    "min_angle_p1_deg_after": 20.0,
    "symmetric_dirichlet_mean": 2.0,
    "symmetric_dirichlet_p99": 4.0,
    "area_ratio_spread": 0.5,
    "volume_ratio": 1.0,
    "displacement": 0.1,
    "chamfer": 0.05,
}


def record(prompt: str, *, hit: bool | None, steps: tuple[int, ...] = (10,), **quality: float) -> dict[str, Any]:
    judged = None if hit is None else {"hit": hit, "noun_hit": True, "probability": 0.75, "rank": 1 if hit else 3}
    state = {"quality": QUALITY | quality, "judge": judged, "clip": None}
    return {
        "source": "sphere",
        "prompt": prompt,
        "seed": 0,
        "failed": None,
        "states": [{"steps": n, **state} for n in steps],
    }


def test_shares_and_means_are_those_of_the_records() -> None:
    records = [
        record("a fish", hit=True, flipped_faces=4, volume_ratio=3.0),
        record("a table", hit=False),
        record("a tree", hit=False, self_intersections_added=2),
        record("a chair", hit=False, symmetric_dirichlet_p99=1e6),
    ]
    row = summarise(states_of(records, 10))
    assert row["count"] == 4
    assert row["retrieval"] == {"hits": 1, "count": 4, "share": 0.25, "low": pytest.approx(0.0456, abs=1e-4),
                                "high": pytest.approx(0.6994, abs=1e-4)}  # fmt: skip
    assert row["noun_retrieval"]["share"] == 1.0
    assert row["clip_retrieval"] is None
    assert (row["flipped_faces_mean"], row["flipped_share"]) == (1.0, 0.25)
    assert (row["self_intersections_added_mean"], row["self_intersections_share"]) == (0.5, 0.25)
    assert row["volume_ratio_mean"] == 1.5
    assert row["rank_mean"] == 2.5
    assert row["symmetric_dirichlet_p99_median"] == 4.0


def test_nothing_done_and_nothing_judged_have_rows_as_well() -> None:
    assert summarise([]) == {"count": 0}
    row = summarise(states_of([record("a fish", hit=None)], 10))
    assert row["retrieval"] is row["probability_mean"] is None
    text = table("prompt", [("a fish", row), ("a tree", summarise([]))], "By prompt")
    assert text.startswith("## By prompt\n\n| prompt")
    assert [line.count("|") for line in text.splitlines()[2:]] == [22] * 4


# Ranks, intervals and judges.


NEWCOMBE = [
    (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718), (0, 0, 0, 1)
]  # fmt: skip


@each_case(("hits", "count", "low", "high"), NEWCOMBE)
def test_wilsons_interval_is_the_published_one(hits: int, count: int, low: float, high: float) -> None:
    assert wilson(hits, count) == pytest.approx((low, high), abs=5e-5)


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


# Items over processes.


def test_every_item_is_done_once_and_a_process_that_dies_costs_its_item_alone() -> None:
    for jobs in (1, 3):
        assert dict(each(range(8), squares, jobs)) == {number: number**2 for number in range(8)}
    results = dict(each([1, 13, 2, 3], squares, 2))
    lost = results.pop(13)
    assert isinstance(lost, WorkerLostError)
    assert "exit code 7" in lost.detail
    assert results == {1: 1, 2: 4, 3: 9}
    with pytest.raises(WorkerLostError, match="no such model"):
        list(each([1, 2], broken, 2))
