"""A mended fit has no folds and few cuts, whatever it was, and is the fit where nothing is broken."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar import faults
from meshdeform.exemplar.faults import Faults
from meshdeform.exemplar.mending import mended
from meshdeform.geometry.intersections import newly_cutting_pairs
from meshdeform.nouns.labels import Floats, Index


def sheet(count: int) -> tuple[Floats, Index]:
    """A square of side 1 in the plane z = 0 with so many squares along a side."""
    grid = np.arange((count + 1) ** 2).reshape(count + 1, -1)
    a, b, c, d = grid[:-1, :-1].ravel(), grid[1:, :-1].ravel(), grid[1:, 1:].ravel(), grid[:-1, 1:].ravel()
    x, y = np.meshgrid(np.linspace(0, 1, count + 1), np.linspace(0, 1, count + 1), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1), np.concatenate(
        [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    )


def box(size: tuple[float, float, float], middle: tuple[float, float, float]) -> tuple[Floats, Index]:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return corners * size + np.array(middle), faces


def joined(*bodies: tuple[Floats, Index]) -> tuple[Floats, Index]:
    starts = np.cumsum([0, *(len(verts) for verts, _ in bodies[:-1])])
    faces = np.concatenate([faces + start for (_, faces), start in zip(bodies, starts, strict=True)])
    return np.concatenate([verts for verts, _ in bodies]), faces


def promise_kept(rest: Floats, goal: Floats, faces: Index) -> float:
    result = mended(rest, goal, faces)
    found = Faults(rest, faces).find(result.verts)
    assert np.isfinite(result.verts).all()
    assert (result.flipped, result.cut) == (0, int(found.cutting.sum()))
    assert not found.folded.any()
    assert found.is_clean
    return result.kept


def test_what_is_not_broken_is_left_as_it_is() -> None:
    rest, faces = sheet(12)
    goal = rest + 0.1 * np.sin(3 * rest[:, [1, 2, 0]])
    result = mended(rest, goal, faces)
    assert np.array_equal(result.verts, goal)
    assert (result.kept, result.flipped, result.cut) == (1.0, 0, 0)


def test_a_fold_is_mended_where_it_is_and_the_rest_is_the_fit() -> None:
    rest, faces = sheet(30)
    goal = rest + [0.0, 0.0, 0.3]
    middle = np.linalg.norm(rest[:, :2] - 0.5, axis=1) < 0.08
    goal[middle, 0] -= 0.25
    assert Faults(rest, faces).find(goal).folded.any()
    assert promise_kept(rest, goal, faces) > 0.9
    far = np.linalg.norm(rest[:, :2] - 0.5, axis=1) > 0.45
    assert np.abs(mended(rest, goal, faces).verts - goal)[far].max() < 1e-9


def test_boxes_that_went_through_each_other_stay_apart() -> None:
    rest, faces = joined(box((1, 1, 1), (0, 0, 0)), box((0.2, 0.2, 0.2), (0, 0.8, 0)))
    goal = rest.copy()
    goal[8:, 1] -= 0.3
    assert promise_kept(rest, goal, faces) > 0.3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_is_mended(seed: int) -> None:
    rest, faces = sheet(10)
    promise_kept(rest, rest + np.random.default_rng(seed).normal(size=rest.shape), faces)


@pytest.mark.parametrize("goal", [0.0, -1.0, 1e-9, 1e9])
def test_a_shape_that_is_flattened_turned_inside_out_or_blown_up(goal: float) -> None:
    rest, faces = box((1, 1, 1), (0, 0, 0))
    promise_kept(rest, rest * [goal, 1, 1], faces)
    promise_kept(rest, rest * goal, faces)


def test_copies_in_one_place_sheets_with_two_sides_and_needles() -> None:
    one = box((1, 1, 1), (0, 0, 0))
    rest, faces = joined(one, one, (one[0], one[1][:, ::-1]), sheet(3))
    faces = np.concatenate([faces, faces[:2, [0, 0, 1]], [[0, 0, 0]]])
    goal = rest + 0.4 * np.random.default_rng(3).normal(size=rest.shape)
    promise_kept(rest, goal, faces)
    promise_kept(rest, rest + goal[::-1], faces)


def test_one_triangle_and_nothing() -> None:
    rest = np.eye(3)
    promise_kept(rest, np.zeros((3, 3)), np.array([[0, 1, 2]]))
    promise_kept(rest, rest[::-1].copy(), np.zeros((0, 3), np.int64))
    promise_kept(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.int64))


def test_the_same_bytes_each_time() -> None:
    rest, faces = sheet(10)
    goal = rest + 0.2 * np.random.default_rng(0).normal(size=rest.shape)
    assert mended(rest, goal, faces).verts.tobytes() == mended(rest, goal, faces).verts.tobytes()


def test_what_is_remembered_of_pairs_changes_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    rest, faces = joined(box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (1, 0, 0)), box((1, 1, 1), (3, 0, 0)))
    known, random = Faults(rest, faces), np.random.default_rng(0)
    shapes = [rest + random.normal(0, 0.6, rest.shape) for _ in range(6)]
    for most in (faults._KNOWN, 3):  # so that it also forgets
        monkeypatch.setattr(faults, "_KNOWN", most)
        for verts in [*shapes, *shapes]:
            expected = newly_cutting_pairs(rest, verts, faces)
            assert len(expected) > 3
            np.testing.assert_array_equal(known.find(verts).pairs, expected)
