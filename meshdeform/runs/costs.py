"""Model the cost of jobs by mesh, steps and guidance: the basis of estimates. Torch-free.

The seconds are those of one thread on the machine where `python -m bench.estimates` measured them. Estimates scale them
by what the newest jobs of a deployment took, so that only their proportions matter once a job has succeeded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from meshdeform.requests.choices import Safeguard
from meshdeform.requests.kind_folders import kind_table

END_SHARE = 0.75
"""How much of a job's time outside its steps comes after the last one."""

_USUAL_FACES = 5_000
"""Of a mesh whose size is not known."""

_LARGE, _DEFORMED_FACES = 12_000, 8_000
"""Faces above which a simplified mesh is deformed, and the faces of that (`deformation/stand_in.py`)."""


@dataclass(frozen=True)
class Seconds:
    """The seconds of a job's start and end together, and of each of its steps; or, as a pace, multiples of them."""

    once: float
    step: float

    def of(self, steps: int) -> float:
        """Return the seconds of a whole job."""
        return self.once + steps * self.step

    def times(self, pace: Seconds) -> Seconds:
        """Return the seconds at a pace."""
        return Seconds(self.once * pace.once, self.step * pace.step)


@dataclass(frozen=True)
class Costs:
    """Cost of the jobs of one kind and guidance."""

    # Seconds of start and end, and those that each 100,000 faces add
    once: float = 1.0
    faces: float = 0.0
    # Seconds of a step; those that a safeguard adds on 10,000 faces, by the root of their number; and those that it
    # adds if the asset has several meshes
    step: float = 1.0
    guard: float = 0.0
    several: float = 0.0

    def seconds(self, faces: int | None, meshes: int | None, safeguard: str | None) -> Seconds:
        """Return the cost of a job with a mesh of so many faces, of so many meshes, None where unknown."""
        large, guarded, several = features(faces, meshes, safeguard)
        of_step = self.step + guarded * self.guard + several * self.several
        return Seconds(self.once + large * self.faces, of_step)


def features(faces: int | None, meshes: int | None, safeguard: str | None) -> tuple[float, float, float]:
    """Return the factors of `Costs.faces`, `guard` and `several`."""
    count = _USUAL_FACES if faces is None else faces
    guarded = safeguard not in (None, Safeguard.NONE)
    deformed = _DEFORMED_FACES if count > _LARGE else count
    return count / 1e5, guarded * math.sqrt(deformed / 1e4), float(guarded and (meshes or 1) > 1)


MEASURED: dict[str, Costs] = {
    "text_deform/sds": Costs(0.906, 5.35, 0.0328, 0.0193, 0.0103),
    "text_deform/target": Costs(1.25, 2.72, 0.0404, 0.0167, 0.0386),
    "text_deform/silhouettes": Costs(0.655, 3.3, 0.0044, 0.0193, 0.0126),
    "text_deform/exemplar": Costs(5.6, 3.0, 0.18),
}
"""By kind and guidance; those of `sds` are with the builtin prior, 1.42 times a step in 8-bit integers, as measured."""


def costs_of(workload: str) -> Costs:
    """Return the costs of a workload; of kinds that were not measured, a second for each step and one for the rest."""
    name = "/".join(workload.split("/")[:2])
    found: Costs = MEASURED.get(name) or kind_table("description", "COSTS").get(name, Costs())
    return found


def pace_of(jobs: Sequence[tuple[Seconds, Seconds]]) -> Seconds:
    """Return how many times the expected seconds jobs took, by the median.

    `jobs` has for each what it was expected to take, and what it took.
    """
    return Seconds(
        median(took.once / expected.once for expected, took in jobs),
        median(took.step / expected.step for expected, took in jobs),
    )
