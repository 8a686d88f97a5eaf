"""Carry out a prompt that is a change in plain words: no model, no steps."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshdeform.plain.body import Body
from meshdeform.plain.change import Done, affine_of, apply_changes, meant
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.words import Sentence
from meshdeform.reading import Reading
from meshdeform.requests.choices import RigMode
from meshdeform.runs.base import RunLog
from meshdeform.runs.changes import check_change, is_change, part_names, part_not_found
from meshdeform.runs.delivery import NewShape
from meshdeform.runs.facts import AssetFacts, Outcome
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.reading import ReadingSource, reshaped, welded_body
from meshdeform.runs.shape_run import ShapeRun
from meshdeform.runs.surfaces import DeformedSurface, affine_surface, deformed_surface, vertex_jacobians
from meshdeform.runs.text_report import change_report

__all__ = ["PlainChangeRun", "source_body", "start_change"]


def source_body(facts: AssetFacts, readings: Readings, verts: NDArray[np.float64] | None = None) -> Body:
    """Return the source of a run, which can be read.

    `readings`: where that is kept; `verts` (V, 3): where the welded vertices are, if not at rest.
    """
    source = ReadingSource(facts.file.digest, facts.file.filename, facts.subdivision is not None, readings)
    body = welded_body(facts.asset, facts.welded, facts.params, source)
    return body if verts is None else reshaped(body, verts, facts.params, source)


def start_change(facts: AssetFacts, body: Body, sentence: Sentence, log: RunLog) -> PlainChangeRun:
    """Make the changes of a sentence, which may describe what the source is.

    `body`: the source. `PartNotFoundError`: a part is missing. No guidance makes up for it: it knows no parts, and
    spoils the others.
    """
    check_change(facts.params)
    with log.phase("change"):
        try:
            changed, done = apply_changes(body, meant(body, sentence))
        except PartMissingError as missing:
            reading = body.reader.made if facts.params.source_noun is None else None
            taken_for = "" if reading is None else reading.noun
            raise part_not_found(str(missing), part_names(body, facts.params), taken_for) from missing
        verts = facts.welded.mesh.verts + (changed.points - body.points)
    return PlainChangeRun(facts, verts, done, body.reader.made, sentence, log)


class PlainChangeRun(ShapeRun):
    """A change that was made, created by `start_change`; it has no steps."""

    def __init__(
        self,
        facts: AssetFacts,
        verts: NDArray[np.float64],
        done: list[Done],
        reading: Reading | None,
        sentence: Sentence,
        log: RunLog,
    ) -> None:
        super().__init__(facts, 0, 0, log)
        self._done, self._reading, self._sentence = done, reading, sentence
        self._affine = affine_of(done)
        # Of an affine change, the file's own vertices are moved, not those that were welded.
        self._moved = verts if self._affine is None else facts.welded.gather(self._surface.positions).verts

    @property
    def reading(self) -> Reading | None:
        """What the asset was read as; None if nobody asked."""
        return self._reading

    @property
    def warnings(self) -> list[str]:
        """Sentences about words that were read otherwise, and about what is other than was asked for."""
        said = [text for each in self._done for text in (*each.warnings, *(() if each.held_back else each.doubts))]
        return [*self._sentence.notes, *said, *super().warnings]

    def _steps(self) -> Iterator[dict[str, float]]:
        return iter(())

    def checkpoint(self) -> bytes:
        """Return nothing: a run without steps has no state."""
        return b""

    def verts(self) -> NDArray[np.float64]:
        """Return the current welded vertices (V, 3) float64, in world space."""
        return self._moved

    def _report(self, outcome: Outcome) -> bytes:
        return change_report(
            self._facts,
            self._done,
            self._sentence.notes,
            self._reading,
            described=not is_change(self._sentence),
            mode=self._rig_mode,
            outcome=outcome,
            log=self.log,
        )

    def _new_shape(self) -> NewShape:
        return self._shape

    @cached_property
    def _shape(self) -> NewShape:
        jacobians = None
        if self._follows and self._affine is not None:
            _, jacobians = self._moved_as_one
        elif self._follows:
            jacobians = vertex_jacobians(self._facts.welded, self._moved)
        return NewShape(self._facts, self._moved, self._surface, jacobians, 0)

    @cached_property
    def _surface(self) -> DeformedSurface:
        if self._affine is not None:
            return self._moved_as_one[0]
        return deformed_surface(self._facts.asset.surface, self._facts.welded, self._moved)

    @cached_property
    def _moved_as_one(self) -> tuple[DeformedSurface, NDArray[np.float64]]:
        assert self._affine is not None
        return affine_surface(self._facts.asset.surface, self._facts.welded, self._affine)

    @property
    def _rig_mode(self) -> RigMode:
        return RigMode.FOLLOW if self._follows else RigMode.KEEP

    @property
    def _follows(self) -> bool:
        """Whether joints and morph targets follow: a change is of the asset with its rig, unless it is to be kept."""
        output = self._facts.request.output
        return output.rig is RigMode.FOLLOW or "rig" not in output.model_fields_set
