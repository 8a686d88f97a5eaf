"""Parts of the report: thinned losses, phases, versions."""

from __future__ import annotations

from itertools import pairwise

from meshdeform.runs.base import RunLog, sha256_hex, versions


def test_short_histories_are_kept_whole() -> None:
    history = RunLog()
    for step in range(1, 51):
        history.add(step, {"total": 1 / step})
    assert [entry["step"] for entry in history.losses()] == list(range(1, 51))


def test_long_histories_keep_the_first_the_last_and_at_most_two_hundred() -> None:
    history = RunLog()
    for step in range(1, 5004):
        history.add(step, {"total": float(step)})
    steps = [entry["step"] for entry in history.losses()]
    assert steps[0] == 1
    assert steps[-1] == 5003
    assert 100 <= len(steps) <= 202
    gaps = {b - a for a, b in pairwise(steps[:-1])}
    assert len(gaps) == 1


def test_phases_add_up() -> None:
    clock = RunLog()
    for _ in range(2):
        with clock.phase("a"):
            pass
    assert set(clock.seconds) == {"a"}
    assert clock.seconds["a"] >= 0


def test_versions_and_hashes() -> None:
    assert {"meshdeform", "python", "torch", "numpy"} <= set(versions())
    assert sha256_hex(b"") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
