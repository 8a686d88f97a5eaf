"""Items over processes."""

from __future__ import annotations

import pytest

from meshdeform.errors import WorkerLostError
from tests.cases import each_case
from tests.unit.evaluation.arithmetic import broken, squares
from training.evaluation.pool import each


@each_case("jobs", [1, 3])
def test_every_item_is_done_once(jobs: int) -> None:
    assert dict(each(range(8), squares, jobs)) == {number: number**2 for number in range(8)}


def test_nothing_to_do_starts_nothing() -> None:
    assert list(each([], squares, 2)) == []


def test_a_process_that_dies_costs_its_item_alone() -> None:
    results = dict(each([1, 13, 2, 3], squares, 2))
    lost = results.pop(13)
    assert isinstance(lost, WorkerLostError)
    assert "exit code 7" in lost.detail
    assert results == {1: 1, 2: 4, 3: 9}


def test_all_processes_dying_still_ends() -> None:
    assert all(isinstance(result, WorkerLostError) for _, result in each([13, 13, 13], squares, 2))


def test_work_that_cannot_start_is_an_error_that_says_why() -> None:
    with pytest.raises(WorkerLostError, match="no such model"):
        list(each([1, 2], broken, 2))
