"""Several seeds, of which the best goes on: successive halving.

Score distillation finds one of many shapes, and which one is decided early, by cameras and noise. So a run may begin
with N candidates that differ in their seed alone. After every `candidate_steps` steps of each they are graded by the
guidance (`Guidance.grade`: the same cameras and noise for all), and the worse half is given up, until one is left that
goes on to the end. It is then, to the bit, what a run of one candidate with its seed would have given.

All share one mesh, factorisation and guidance; a candidate that waits is a checkpoint in memory.

Source: Jamieson and Talwalkar 2016, Non-stochastic best arm identification and hyperparameter optimization, algorithm 1
(with rounds of equal length).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.loop import Deformation, Step
from meshdeform.errors import CheckpointError

__all__ = ["CandidateRun"]

_PREFIX = "candidates."
_SEEDS = 2**63


class CandidateRun:
    """A run of one or several candidates; of one, it is the deformation and nothing else.

    Parameters
    ----------
    deformation : Deformation
        At its first step; its parameters say how many candidates there are.
    checkpoint : Checkpoint, optional
        A state of the same run to go on from.

    Attributes
    ----------
    deformation : Deformation
        The candidate whose turn it is.
    step : int
        Steps done, those of all candidates counted.

    Raises
    ------
    CheckpointError
        The checkpoint belongs to another run.
    """

    def __init__(self, deformation: Deformation, checkpoint: Checkpoint | None = None) -> None:
        self.deformation = deformation
        self.step = 0
        params = deformation.params
        self._rungs, self._round_steps = params.rungs, params.candidate_steps
        self._seeds = [(params.seed + k) % _SEEDS for k in range(params.candidates)]
        self._grades: list[list[float]] = [[] for _ in self._seeds]
        self._alive = list(range(len(self._seeds)))
        self._rung, self._current = 0, 0
        self._waiting: dict[int, Checkpoint] = {}
        if self._rungs:
            start = deformation.checkpoint()
            for k, seed in enumerate(self._seeds[1:], 1):
                state = torch.Generator().manual_seed(seed).get_state()
                self._waiting[k] = Checkpoint(start.step, {**start.tensors, "generator": state})
        if checkpoint is not None:
            self._restore(checkpoint)

    @property
    def done(self) -> bool:
        """Whether no step is left."""
        return self._rung == len(self._rungs) and self.deformation.done

    @property
    def total_steps(self) -> int:
        """Steps of all candidates in all: an upper bound, until the run has settled before its last step."""
        return self.step if self.done else self.deformation.params.total_steps

    def __iter__(self) -> Iterator[Step]:
        """Run the steps that are left; see `Deformation`. Steps count on over the candidates.

        Raises
        ------
        NumericalError
            A loss or a gradient is not finite.
        """
        self._choose()
        while not self.done:
            losses = next(iter(self.deformation)).losses
            self.step += 1
            if self._rungs:
                losses = {**losses, "candidate": float(self._current)}
            self._choose()
            yield Step(self.step, losses)

    def verts(self) -> Tensor:
        """Positions (V, 3) float64 of the candidate whose turn it is."""
        return self.deformation.verts()

    def checkpoint(self) -> Checkpoint:
        """Everything that the rest of the run depends on, copied: all candidates that are left.

        Raises
        ------
        CheckpointError
            The optimiser itself failed in the midst of a step.
        """
        own = self.deformation.checkpoint()
        if not self._rungs:
            return own
        tensors = dict(own.tensors)
        for k, state in self._waiting.items():
            tensors |= {f"{_PREFIX}{k}.{name}": tensor.clone() for name, tensor in state.tensors.items()}
            tensors[f"{_PREFIX}{k}.step"] = torch.tensor(state.step)
        table = torch.full((len(self._seeds), len(self._rungs)), math.nan, dtype=torch.float64)
        for k, grades in enumerate(self._grades):
            table[k, : len(grades)] = torch.tensor(grades, dtype=torch.float64)
        tensors[f"{_PREFIX}grades"] = table
        tensors[f"{_PREFIX}alive"] = torch.tensor(self._alive)
        tensors[f"{_PREFIX}at"] = torch.tensor([self._rung, self._current, own.step])
        return Checkpoint(self.step, tensors)

    def to_report(self) -> list[dict[str, Any]]:
        """Of each candidate its seed, its grades (smaller is better) after each round, and whether it was chosen."""
        rounds = [(n + 1) * self._round_steps for n in range(len(self._rungs))]
        return [
            {
                "seed": seed,
                "grades": [{"step": step, "grade": grade} for step, grade in zip(rounds, grades, strict=False)],
                "chosen": self._alive == [k],
            }
            for k, (seed, grades) in enumerate(zip(self._seeds, self._grades, strict=True))
        ]

    def _choose(self) -> None:
        """Where the candidate is at the end of its round: grade it, and turn to the next or to the next round."""
        while self._rung < len(self._rungs) and self._at_end_of_round():
            self._grades[self._current].append(self.deformation.grade())
            last = [k for k in self._alive if k > self._current]
            if last:
                self._turn_to(last[0])
                continue
            keep = (len(self._alive) + 1) // 2
            ranked = sorted(self._alive, key=lambda k: (self._grades[k][-1], k))
            self._rung += 1
            self._waiting[self._current] = self.deformation.checkpoint()
            self._alive = sorted(ranked[:keep])
            self._waiting = {k: self._waiting[k] for k in self._alive}
            self._current = self._alive[0]
            self.deformation.restore(self._waiting.pop(self._current))

    def _at_end_of_round(self) -> bool:
        return self.deformation.done or self.deformation.step >= (self._rung + 1) * self._round_steps

    def _turn_to(self, number: int) -> None:
        self._waiting[self._current] = self.deformation.checkpoint()
        self._current = number
        self.deformation.restore(self._waiting.pop(number))

    def _restore(self, checkpoint: Checkpoint) -> None:
        self.step = checkpoint.step
        if not self._rungs:
            self.deformation.restore(checkpoint)
            return
        own = {name: t for name, t in checkpoint.tensors.items() if not name.startswith(_PREFIX)}
        other = {name.removeprefix(_PREFIX): t for name, t in checkpoint.tensors.items() if name.startswith(_PREFIX)}
        if "at" not in other:
            raise CheckpointError("The checkpoint is of a run of one candidate.")
        self._rung, self._current, step = other["at"].tolist()
        self._alive = other["alive"].tolist()
        self._grades = [row[~row.isnan()].tolist() for row in other["grades"]]
        self.deformation.restore(Checkpoint(step, own))
        self._waiting = {}
        for k in self._alive:
            state = {n.removeprefix(f"{k}."): t for n, t in other.items() if n.startswith(f"{k}.")}
            if k != self._current:
                self._waiting[k] = Checkpoint(int(state.pop("step")), state)
