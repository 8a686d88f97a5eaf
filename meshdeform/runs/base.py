"""What every kind of job gives its worker: steps while it runs, artifacts when it is done. Torch-free."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

__all__ = ["ArtifactData", "JobRun", "StepReport"]


@dataclass(frozen=True)
class ArtifactData:
    """A result as bytes with its media type."""

    data: bytes
    content_type: str


@dataclass(frozen=True)
class StepReport:
    """Where a run stands after a step.

    Attributes
    ----------
    step : int
        Steps done, from 1.
    total_steps : int
        Steps in all.
    phase : str
        `optimizing`.
    losses : dict of name to value
    """

    step: int
    total_steps: int
    phase: str
    losses: dict[str, float]


class JobRun(Protocol):
    """A run that a worker drives: it decides when to store, publish and stop."""

    @property
    def total_steps(self) -> int:
        """Steps in all."""

    @property
    def step(self) -> int:
        """Steps done."""

    def __iter__(self) -> Iterator[StepReport]:
        """Run the steps that are left."""

    def checkpoint(self) -> bytes:
        """Everything that the rest of the run depends on; valid between two steps."""

    def snapshot(self) -> ArtifactData:
        """Write the asset as it stands now; valid between two steps."""

    def finish(self) -> dict[str, ArtifactData]:
        """Write the results, by artifact name."""
