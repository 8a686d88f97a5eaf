"""A step does not grow unnoticed: counted work against the counts on file (`bench/step_counts.py`), without a clock."""

from __future__ import annotations

import json

import pytest
import torch

from bench.step_counts import EXPECTED, count_step, counted

_AGAIN = "If that is meant: python -m bench.step_counts --write"


def test_a_step_does_no_more_work_than_on_file() -> None:
    expected, found = json.loads(EXPECTED.read_text()), count_step()
    for part, counts in found.items():
        for name, value in counts.items():
            ratio = value / expected[part][name]
            # A gain belongs on file too, or it could be lost again unnoticed.
            assert 0.9 < ratio < 1.1, f"{name} of {part}: {ratio:.2f} times those on file. {_AGAIN}"


def test_the_counters_see_operations_bytes_flops_and_calls() -> None:
    left, right = torch.ones(300, 20), torch.ones(20, 500)

    def work() -> None:
        (left @ right).t().add_(1)

    found = counted(work, lambda: [abs(-1) for _ in range(7)])
    # A product, a view and a change in place; only the product makes something.
    assert found["operations"] == 3
    assert found["megabytes"] == pytest.approx(300 * 500 * 4 / 1e6)
    assert found["megaflops"] == pytest.approx(2 * 300 * 20 * 500 / 1e6)
    assert found["calls"] >= 7
