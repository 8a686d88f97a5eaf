"""Parts of the report: thinned losses, phases, versions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.runs.base import RunLog
from meshdeform.runs.facts import Held
from meshdeform.runs.text_report import measure_movement
from tests.cases import each_case
from tests.unit.runs.jobs import finished, started
from tests.unit.runs.test_text_deform import glb
from training.shapes import box


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


# A run that hardly moves says so, and what held it back.


REST = RestMesh.of(box(2))


def test_the_figure_is_a_share_of_the_diagonal() -> None:
    moved = measure_movement(REST, REST.verts + np.array([0.3, 0.0, 0.4]), Held())
    assert moved.rms == pytest.approx(0.5 / 3**0.5)
    assert moved.stalled_by is None
    assert moved.warnings == []


@each_case(
    ("held", "cause", "remedy"),
    [(0.8, "safeguard", "safeguard to flips"), (0.02, "guidance", "prompt")],
)
def test_what_held_it_back_is_named_with_its_remedy(held: float, cause: str, remedy: str) -> None:
    still = measure_movement(REST, REST.verts + 1e-4, Held(held, held))
    assert still.stalled_by == cause
    assert still.held_share == pytest.approx(held)
    (warning,) = still.warnings
    assert "hardly moved (0.0% of its size)" in warning
    assert remedy in warning


def test_what_is_held_back_in_the_end_is_told_though_the_rest_moved() -> None:
    shift = np.array([0.3, 0.0, 0.4])
    early, late = Held.of({5: 0.9, 10: 0.9, 15: 0.5, 20: 0.1}, 20), Held.of({20: 0.4}, 20)
    assert (early.at_end, late.at_end) == (0.1, 0.4)
    assert measure_movement(REST, REST.verts + shift, early).warnings == []
    (warning,) = measure_movement(REST, REST.verts + shift, late).warnings
    assert "held back 40% of the surface in the end" in warning


def test_the_report_of_a_run_has_it() -> None:
    for rate, stalled in ((1e-6, True), (0.03, False)):
        _, report = finished(started(glb(icosphere(2)), steps=12, learning_rate=rate))
        assert (report["movement"]["stalled_by"] == "guidance") is stalled
        assert bool(report["warnings"]) is stalled
        assert (report["movement"]["rms"] < 0.01) is stalled
