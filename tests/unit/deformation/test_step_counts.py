"""A step does not grow unnoticed: counted work against the counts on file (`bench/step_counts.py`), without a clock."""

from __future__ import annotations

import json

from bench.step_counts import EXPECTED, count_step

_AGAIN = "If that is meant: python -m bench.step_counts --write"


def test_a_step_does_no_more_work_than_on_file() -> None:
    expected, found = json.loads(EXPECTED.read_text()), count_step()
    for part, counts in found.items():
        for name, value in counts.items():
            on_file = expected[part][name]
            # A gain belongs on file too, or it could be lost again unnoticed.
            assert 0.9 * on_file <= value <= 1.1 * on_file, f"{name} of {part}: {value}, on file {on_file}. {_AGAIN}"
