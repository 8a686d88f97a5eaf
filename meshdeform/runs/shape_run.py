"""Give an asset a new shape, however it is found: by a change in plain words, by fits, or by an optimisation."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.reading import Reading
from meshdeform.requests.choices import RigMode
from meshdeform.runs.base import ArtifactData, JobRun, RunLog
from meshdeform.runs.delivery import GLB, NewShape
from meshdeform.runs.facts import AssetFacts, Held, Outcome
from meshdeform.runs.text_report import rig_warnings

__all__ = ["ShapeRun"]


class ShapeRun(JobRun):
    """A run of kind `text_deform` in progress.

    A subclass says where the vertices are after each step, and what the report has of how they came there.
    """

    _facts: AssetFacts

    def __init__(self, facts: AssetFacts, total_steps: int, first_step: int, log: RunLog) -> None:
        super().__init__(total_steps, first_step, log)
        self._facts = facts

    @property
    def reading(self) -> Reading | None:
        """What the asset was read as; None if nobody asked, or it cannot be read."""
        return None

    @property
    def members(self) -> list[dict[str, Any]]:
        """What the asset was fitted to, by prompt, as far as that is done."""
        return []

    @property
    def is_draft(self) -> bool:
        """Whether a simplified surface is fitted in place of the asset's."""
        return False

    @property
    def warnings(self) -> list[str]:
        """Sentences about words that were read otherwise, and about what is other than was asked for."""
        return rig_warnings(self._facts.asset, self._rig_mode)

    def snapshot(self) -> ArtifactData:
        """Return the asset with its current shape, in the form of `result.glb`."""
        return ArtifactData(self._new_shape().written(), GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return `result.glb`, `report.json` and `preview.png`, and `morph.glb` if requested."""
        with self.log.phase("write"):
            shape = self._new_shape()
        return shape.delivered(self._report, self.log, self._held)

    @abstractmethod
    def verts(self) -> NDArray[np.float64]:
        """Return the current welded vertices (V, 3) float64, in world space."""

    @abstractmethod
    def _report(self, outcome: Outcome) -> bytes:
        """Return `report.json` of what was written."""

    @property
    def _held(self) -> Held:
        """What a safeguard held back: nothing, unless a subclass has one."""
        return Held()

    @property
    def _rig_mode(self) -> RigMode:
        return self._facts.request.output.rig

    def _new_shape(self) -> NewShape:
        return NewShape.of(self._facts, self.verts(), self.step)
