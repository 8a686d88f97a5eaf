"""Long work ends when nobody waits for it, and goes on where nobody asked that it be stopped."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from meshdeform.exemplar.mending import mended
from meshdeform.exemplar.relaxing import relaxed
from meshdeform.exemplar.smooth_fit import CodedSurface, smooth_fit
from meshdeform.geometry.shapes import icosphere
from meshdeform.support.giving_way import give_way, stopped_by
from tests.cases import each_case

BALL = icosphere(2)
TALL = BALL.verts * [1.0, 1.3, 1.0]


class GoneError(Exception):
    """Nobody waits any more."""


def fold() -> None:
    broken = TALL.copy()
    broken[BALL.faces[0, 0]] *= -1
    mended(BALL.verts, broken, BALL.faces)


WORK: dict[str, Callable[[], object]] = {
    "fitting": lambda: smooth_fit(CodedSurface.alike(BALL.verts, BALL.faces), CodedSurface.alike(TALL, BALL.faces)),
    "sliding": lambda: relaxed(BALL.verts, TALL, BALL.faces, TALL, BALL.faces),
    "mending": fold,
}


@each_case("work", WORK)
def test_work_stops_within_a_few_rounds(work: str) -> None:
    asked = []

    def gone() -> None:
        asked.append(work)
        if len(asked) == 2:
            raise GoneError

    with pytest.raises(GoneError), stopped_by(gone):
        WORK[work]()
    assert len(asked) == 2
    give_way()  # outside of the block nothing asks
    assert len(asked) == 2
