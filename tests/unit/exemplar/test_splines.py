"""The splines: exact symmetry, known displacements, and the energy of bending."""

import numpy as np
import pytest

from meshdeform.exemplar.splines import SplineGrid

_LOW, _HIGH = np.array([-1.0, -0.5, -0.3]), np.array([1.0, 0.5, 0.3])


def _places(count: int = 200) -> np.ndarray:
    return np.random.default_rng(0).uniform(_LOW, _HIGH, (count, 3))


@pytest.mark.parametrize("spans", [3, 6, 7])
@pytest.mark.parametrize("planes", [(0,), (0, 2), (0, 1, 2)])
def test_displacements_commute_with_reflections_exactly(spans: int, planes: tuple[int, ...]) -> None:
    grid, places = SplineGrid(_LOW, _HIGH, spans, planes), _places()
    numbers = np.random.default_rng(1).normal(size=grid.count)
    moved = grid.displacements(places, numbers)
    for axis in planes:
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        assert np.array_equal(grid.displacements(places * mirror, numbers), moved * mirror)
        on_plane = np.where(np.arange(3) == axis, 0.0, places)
        assert not grid.displacements(on_plane, numbers)[:, axis].any()


@pytest.mark.parametrize("planes", [(), (0,), (1, 2)])
def test_gradients_are_the_derivatives_of_displacements(planes: tuple[int, ...]) -> None:
    grid, places = SplineGrid(_LOW, _HIGH, 6, planes), 0.9 * _places()
    numbers = np.random.default_rng(1).normal(size=grid.count)
    found = (grid.matrix(grid.gradients(places)) @ numbers).reshape(3, 3, -1)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        apart = grid.displacements(places + step, numbers) - grid.displacements(places - step, numbers)
        np.testing.assert_allclose(found[:, axis].T, apart / 2e-6, atol=1e-3)


def test_a_linear_displacement_is_in_the_span_and_does_not_bend() -> None:
    grid, places = SplineGrid(_LOW, _HIGH, 6, (0,)), _places(4000)
    linear = places * [0.3, -0.2, 0.1]
    rows = [grid.matrix(each).toarray() for each in grid.terms(places)]
    numbers = np.linalg.lstsq(np.concatenate(rows), linear.T.ravel())[0]
    assert grid.displacements(places, numbers) == pytest.approx(linear, abs=1e-9)
    assert numbers @ grid.bending() @ numbers == pytest.approx(0, abs=1e-12)


def test_the_bending_of_a_parabola_is_its_squared_second_derivative() -> None:
    grid, places = SplineGrid(_LOW, _HIGH, 6), _places(4000)
    rows = [grid.matrix(each).toarray() for each in grid.terms(places)]
    bent = np.stack([np.zeros(4000), places[:, 0] ** 2, places[:, 0] * places[:, 2]], 1)
    numbers = np.linalg.lstsq(np.concatenate(rows), bent.T.ravel())[0]
    assert numbers @ grid.bending() @ numbers == pytest.approx(2.0**2 + 2 * 1.0**2)
