"""What is measured of results that were manufactured, and which of them are doubtful."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.geometry.shapes import join
from meshdeform.plain.body import Body, Flags, Floats, loose_body
from meshdeform.plain.change import apply_changes
from meshdeform.plain.effect import measure
from meshdeform.plain.moved import MeasuredPiece, Moved
from meshdeform.plain.words import Change
from meshdeform.runs.worth import verdict_of_change
from tests.cases import each_case
from tests.unit.plain.shapes import _box, plain_glb

_UPWARD = (False, True, False)


def slab_and_post() -> tuple[Body, Flags]:
    """A slab 2 wide, a post 1 high on it, and which vertices (V,) are the post's."""
    mesh = join(_box((-1, 0, -1), (1, 0.2, 1)), _box((-0.1, 0.2, -0.1), (0.1, 1.2, 0.1)))
    body = loose_body(load_asset(plain_glb(mesh)))
    return body, (np.abs(body.points[:, [0, 2]]) < 0.11).all(1) & (body.points[:, 1] > 0.19)


def made(body: Body, post: Flags, by: tuple[float, float, float], rest: float = 0.0) -> tuple[Moved, Floats]:
    """The post grown from its foot, and a corner of the slab moved."""
    points = body.points.copy()
    points[post] = (points[post] - [0, 0.2, 0]) * by + [0, 0.2, 0]
    points[np.argmin(points.sum(1))] -= [rest, 0, 0]
    pieces = [MeasuredPiece(np.flatnonzero(post), np.eye(3), _UPWARD)]
    return Moved(points, post.astype(float), lambda _: 1.0, measured=pieces), points


@each_case(
    "by, rest, asked, says",
    [
        ((1, 1.4, 1), 0.0, 1.4, []),
        ((1.1, 1.4, 1), 0.0, 1.4, []),
        ((1, 1.1, 1), 0.0, 1.4, ["The post became 1.10 times as tall; 1.40 was asked for."]),
        ((1, 0.9, 1), 0.0, 0.5, ["The post became 0.90 times as tall; 0.50 was asked for."]),
        ((1, 0.8, 1), 0.0, 1.4, ["The post became 0.80 times as tall; 1.40 was asked for."]),
        ((1.6, 1.3, 1), 0.0, 1.4, ["Another direction of the post changed more: it became 1.60 times as large."]),
        ((1, 1.4, 1), 0.2, 1.4, ["What does not belong to the post moved by up to 6.5% of the diagonal."]),
    ],
)
def test_what_is_less_or_more_than_was_asked_for_is_told_in_figures(
    by: tuple[float, float, float], rest: float, asked: float, says: list[str]
) -> None:
    body, post = slab_and_post()
    moved, points = made(body, post, by, rest)
    doubts = measure(body, moved, points).doubts("post", asked, "tall")
    assert doubts == says
    assert verdict_of_change({}, doubts)["value"] == ("doubtful" if says else "good")


def test_a_shift_that_the_change_asks_for_is_none_of_the_rest() -> None:
    body, post = slab_and_post()
    slab = MeasuredPiece(np.flatnonzero(~post), np.eye(3), _UPWARD)
    points = body.points.copy()
    points[~post, 1] *= 2
    points[post, 1] += 0.2
    shift = np.zeros_like(points)
    shift[post, 1] = 0.2
    moved = Moved(points, (~post).astype(float), lambda _: 1.0, measured=[slab], shift=shift)
    found = measure(body, moved, points)
    assert (found.grown, found.other, found.rest) == (pytest.approx(2.0), pytest.approx(1.0), pytest.approx(0.0))
    points[post, 0] += 0.5 * (points[post, 1] > 1)
    assert measure(body, moved, points).rest > 0.1


def test_a_change_that_was_halved_is_told_and_doubtful() -> None:
    body, post = slab_and_post()
    _, (done,) = apply_changes(replace(body, names={"Post": post}), [Change("big", "post", 1.45)])
    assert (done.doubts, done.effect.grown) == ([], pytest.approx(1.45, abs=0.05))
    held = replace(done, factor=1.1, effect=replace(done.effect, grown=1.1))
    assert held.warnings == ["The post: 1.10 times as large, not 1.45, which would flip faces."]
    assert held.doubts == ["The post became 1.10 times as large; 1.45 was asked for."]
    same = replace(done, factor=1.4501)
    assert same.warnings == []
