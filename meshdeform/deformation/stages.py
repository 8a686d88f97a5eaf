"""Run several optimisations of one mesh in a row, each from the shape in which the last one ended.

Every stage has its own guidance, its own moments and its own schedule of `steps` steps. The regularisers stay relative
to the mesh at rest, so that a result is judged against the asset and not against the stage before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import torch
from torch import Tensor

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.loop import Deformation, Step

__all__ = ["BeginStage", "StagedDeformation"]

_ENDS = "stages.verts"


class BeginStage(Protocol):
    """Creates the optimisation of a stage."""

    def __call__(self, *, checkpoint: Checkpoint | None, initial: Mapping[str, Tensor] | None) -> Deformation:
        """Return it at the state of its own checkpoint, or at step 0 with the shape of `initial`, or at rest."""


class StagedDeformation:
    """One or several optimisations in a row.

    Parameters
    ----------
    stages : sequence of BeginStage
        At least one. A stage is created when it begins.
    checkpoint : Checkpoint, optional
        A state of the same stages from which to continue.
    initial : mapping of name to Tensor, optional
        The tensors of a checkpoint with whose shape the first stage starts.

    Attributes
    ----------
    current : Deformation
        The stage that runs.
    ends : list of (V, 3) float64
        The shapes in which the stages before it ended.
    """

    def __init__(
        self,
        stages: Sequence[BeginStage],
        *,
        checkpoint: Checkpoint | None = None,
        initial: Mapping[str, Tensor] | None = None,
    ) -> None:
        self._stages = stages
        self.ends: list[Tensor] = []
        if checkpoint is None:
            self.current = stages[0](checkpoint=None, initial=initial)
            self._before = 0
            return
        tensors = dict(checkpoint.tensors)
        self.ends = list(tensors.pop(_ENDS, torch.empty(0)))
        # The number of steps of a stage is known once one is created, which restores no step yet.
        begin = stages[len(self.ends)]
        self.current = begin(checkpoint=replace(checkpoint, tensors=tensors), initial=None)
        self._before = len(self.ends) * self.current.params.steps
        self.current.step = checkpoint.step - self._before

    @property
    def step(self) -> int:
        """Number of completed steps of all stages."""
        return self._before + self.current.step

    def __iter__(self) -> Iterator[Step]:
        """Run the remaining steps of all stages.

        Raises
        ------
        NumericalError
            A loss or a gradient is not finite.
        """
        while True:
            for step in self.current:
                yield Step(self._before + step.step, step.losses)
            if len(self.ends) + 1 == len(self._stages):
                return
            self._begin_next()

    def verts(self) -> Tensor:
        """Return the deformed positions (V, 3) float64 in the rest mesh's frame."""
        return self.current.verts()

    def checkpoint(self) -> Checkpoint:
        """Copy the state from which the run can continue.

        Raises
        ------
        CheckpointError
            A step failed while it updated the variables, so the state is not consistent.
        """
        found = self.current.checkpoint()
        ends = {_ENDS: torch.stack(self.ends)} if self.ends else {}
        return Checkpoint(self.step, {**found.tensors, **ends})

    def _begin_next(self) -> None:
        ended = self.current
        shape = ended.checkpoint().tensors
        self.ends.append(ended.verts())
        self._before += ended.step
        self.current = self._stages[len(self.ends)](checkpoint=None, initial=shape)
