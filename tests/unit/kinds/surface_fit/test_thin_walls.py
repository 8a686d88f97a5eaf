"""Walls of a distance grid that are thinner than a few of its cells are told."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np

from meshdeform.kinds.surface_fit.surface_files import read_surface_file, summary_of, thin_warnings
from tests.cases import each_case

CELL = 2 / 39
AT = np.stack(np.meshgrid(*[np.linspace(-1, 1, 40)] * 3, indexing="ij"), -1)


def ring(minor: float) -> np.ndarray:
    return np.hypot(np.hypot(AT[..., 0], AT[..., 1]) - 0.7, AT[..., 2]) - minor


def told(values: np.ndarray) -> tuple[str, ...]:
    return thin_warnings(values, np.full(3, CELL))


def test_what_is_thinner_than_a_few_cells_is_told() -> None:
    for cells in (1.5, 2.5):
        for values in (ring(cells / 2 * CELL), np.clip(ring(cells / 2 * CELL), -3 * CELL, 3 * CELL)):
            (sentence,) = told(values)
            assert "four are needed" in sentence
            assert "finer grid" in sentence
    # A plate is told though all within it is alike.
    assert told(np.maximum(np.abs(AT[..., :2]).max(-1) - 0.7, np.abs(AT[..., 2]) - CELL))
    file = io.BytesIO()
    np.savez(file, sdf=ring(0.6 * CELL), origin=[-1.0] * 3, spacing=CELL)
    found = read_surface_file(file.getvalue(), "thin.npz")
    assert found is not None
    assert len(summary_of(found, "thin.npz").warnings) == 1


@each_case(
    "values",
    [
        lambda: ring(2.1 * CELL),
        lambda: np.linalg.norm(AT, axis=-1) - 0.7,
        lambda: np.abs(AT).max(-1) - 0.7,
        lambda: np.linalg.norm(AT, axis=-1) - 0.7 + np.random.default_rng(0).normal(size=(40,) * 3) * 0.2 * CELL,
    ],
    ids=["tube", "ball", "box", "noise"],
)
def test_what_is_thick_enough_is_not_told(values: Callable[[], np.ndarray]) -> None:
    assert told(values()) == ()


def test_of_a_large_grid_the_values_that_are_looked_at_count() -> None:
    x, y = np.meshgrid(np.arange(200), np.arange(24), indexing="ij")
    rod = np.maximum(np.hypot(y - 11.6, 0) - 2.2, np.abs(x - 99.6) - 90)[..., None]
    z = np.abs(np.arange(24) - 11.6) - 2.2
    values = np.maximum(rod, z[None, None])
    (sentence,) = thin_warnings(values, np.ones(3))
    assert "A cell here is 2 of the grid's" in sentence
    assert thin_warnings(values[8:-8], np.ones(3)) == ()
