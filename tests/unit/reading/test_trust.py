"""A part is the less trusted the less sure it is, the less the fits agree on it, and the worse they fit."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.families.parts import ellipsoid
from meshdeform.nouns.labels import code
from meshdeform.reading.cells import cells_of
from meshdeform.reading.trust import LEAST, confidences, part_measures


def test_the_measures_of_a_part_are_its_mean_probability_and_how_far_the_fits_overlap() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=20)
    cells = cells_of(ball.verts, ball.faces)
    high, higher = cells.centres[:, 1] > 0, cells.centres[:, 1] > 0.15
    parts = np.array([code("body"), code("head")])

    def soft(top: np.ndarray, share: float) -> np.ndarray:
        return np.where(top[:, None], [1 - share, share], [share, 1 - share])

    measures = part_measures(soft(high, 0.8), [soft(high, 0.9), soft(higher, 0.7)], high.astype(int), cells, parts)
    share = cells.areas[higher].sum() / cells.areas[high].sum()
    assert measures["head"] == pytest.approx((0.8, (1 + share) / 2))
    assert measures.keys() == {"body", "head"}


def test_confidence_rises_with_both_and_falls_with_the_residual() -> None:
    good, unsure, alone = ((0.95, 1.0), (0.4, 1.0), (0.95, 0.1))
    near = confidences({"head": good, "ear": unsure, "tail": alone}, 0.02)
    far = confidences({"head": good, "ear": unsure, "tail": alone}, 0.08)
    assert near["head"] > 0.95
    assert near["head"] > near["ear"] > far["ear"]
    assert near["head"] > near["tail"] > far["tail"]
    assert confidences({"ear": (0.3, 0.3)}, 0.09)["ear"] < LEAST < far["head"]
