"""A fit that only stretches: each noun by factors of its own, along the asset's axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from meshdeform.exemplar.outlook import FitOutlook
from meshdeform.exemplar.shapes import ExemplarResult, Wish, frame_of
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading import Reading
from meshdeform.runs import exemplar

FACTORS = {"giraffe": (0.8, 1.5, 0.9), "snake": (0.7, 0.6, 1.6), "": (1.2, 1.0, 1.0)}


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs make fits of this kind, and expect nothing of them."""
    monkeypatch.setattr(exemplar, "ExemplarFit", FakeFit)
    monkeypatch.setattr(exemplar, "outlook", lambda *_args, **_more: FitOutlook(False, 0.0))


@dataclass(frozen=True)
class FakeStage:
    """A stage of a fit."""

    name: str
    share: float
    verts: Floats | None


class FakeFit:
    """Stands in for `meshdeform.exemplar.engine.ExemplarFit`; `made` has all that were made."""

    made: ClassVar[list[FakeFit]] = []

    def __init__(
        self,
        verts: Floats,
        faces: Index,
        reading: Reading | None,
        wish: Wish,
        *,
        labels: Index | None = None,
        cache: Path | None = None,
        mends: bool = True,
    ) -> None:
        self.verts, self.faces, self.reading, self.wish, self.labels = verts, faces, reading, wish, labels
        self.cache, self.mends = cache, mends
        self.frame = frame_of(verts, faces, reading)
        self.made.append(self)

    def __iter__(self) -> Iterator[FakeStage]:
        rest = self.frame.enter(self.verts)
        goal = rest * np.power(FACTORS[self.wish.noun], 1 + 0.01 * self.wish.seed)
        moves = self.wish.strength * (goal - rest)
        yield FakeStage("choose", 0.26, None)
        yield FakeStage("fit", 0.8, self.frame.leave(rest + moves / 2))
        yield FakeStage("mend", 1.0, self.frame.leave(rest + moves))
        member = {"target": 0} if self.wish.targets else {"noun": self.wish.noun, "form": "standing", "number": 7}
        self.result = ExemplarResult(
            rest + moves, member, 0.05, 0.01, [("leg", "leg")], ["tail"], ["horn"], kept=0.9, stretch=0.2
        )
