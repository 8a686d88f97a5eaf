"""Find which side of the source a prior conditioned on the azimuth should see as its front.

The builtin prior draws different pictures of a giraffe from the front and from behind. An asset that faces backwards
would grow its neck from the tail, so before the first step the cameras are turned about the up axis. For a picture x of
the untouched source, every turn is a class of azimuths, of which the best predicts x most closely::

    grade(turn) = mean over draws of ||x0_hat(z_t; prompt, azimuth of x - turn) - x0||^2

Picture, timestep and noise of a draw are the same for all turns, so only differences by the azimuth remain. The
azimuths of the draws are spread evenly, so that for a symmetric source all turns have the same grade. t is high: the
noisy picture contains little of the shape, and the prediction depends mostly on prompt and azimuth.

A first pass grades turns all around: all in its first draw, only none and the best of them in the others. If
one is better than none, a second pass with new draws compares it and its neighbours with none; since these draws did
not choose the turn, the margin is not biased by that choice.

Source: Li et al. 2023, Your diffusion model is secretly a zero-shot classifier, eq. 9 and section 3.2 (shared noise).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from meshdeform.rendering.cameras import Cameras

_TURNS = 12
_FINE_DEG = 15.0
_FIRST_DEG = (0.0, 120.0, 240.0)
_SECOND_DEG = (0.0, 105.0, 210.0, 315.0, 60.0, 165.0)
"""Azimuths of the draws, from a random one. Modulo a quarter turn they are evenly spaced at a divisor of the turns'
spacing: the four views of a symmetric source are then the same for every turn, only in another order."""
_EIGHT_DEG = (0.0, 45.0, 100.0, 145.0, 190.0, 235.0, 290.0, 335.0)
_SIDES = {0: (0.0, 180.0), 2: (90.0, -90.0)}
"""The two sides that lie in the mirror plane perpendicular to an axis."""
_FRACTION = 0.94
"""The timestep, as a fraction of T. At 0.88 T, the background and the noise of a draw outweigh the azimuth."""
_KEPT = 4
"""How many turns, besides none, stay after the first draw."""
_MIN_MARGIN = 0.03
_MIN_ERRORS = 3.0
"""Least gain of the best turn over none: relative to the grade, and in standard errors of the paired difference."""
_MIN_BACK = 0.12
"""Least gain of the back over the front, of two sides: most assets face +Z."""

Draw = Callable[[float, torch.Generator], tuple[Tensor, Cameras]]


class OrientationSource(StrEnum):
    """Where a turn comes from."""

    KEPT = "kept"
    GIVEN = "given"
    FOUND = "found"
    UNDECIDED = "undecided"
    UNCONDITIONED = "unconditioned"
    CONTINUED = "continued"
    UNRECOGNISED = "unrecognised"


_FOUND, _UNDECIDED = OrientationSource.FOUND, OrientationSource.UNDECIDED
_NOTICES = {
    OrientationSource.UNDECIDED: "No side of the asset is clearly its front. Set params.guidance.orientation to the "
    "azimuth of another side if the result faces the wrong way.",
    OrientationSource.UNRECOGNISED: "The asset was not recognised, so +Z counts as its front. Set "
    "params.guidance.source_noun to what it is, or params.guidance.orientation to the azimuth of its front.",
    OrientationSource.UNCONDITIONED: "The model is not conditioned on the azimuth: it sees four sides at once with one "
    "text, so no side is the front, and params.guidance.orientation changes nothing about it.",
}


@runtime_checkable
class Grader(Protocol):
    """A guidance that can grade azimuths (`guidance.sds.ScoreDistillation.grades`)."""

    def grades(self, image: Tensor, poses: Sequence[Cameras], fraction: float, generator: torch.Generator) -> Tensor:
        """Return the grade (P,) of each of P azimuths of the same picture; the smallest is the best."""


class Mixture:
    """The mean of several graders by their weights, for a source that may be several things. Implements `Grader`."""

    def __init__(self, graders: Sequence[tuple[Grader, float]]) -> None:
        self._graders = graders

    def grades(self, image: Tensor, poses: Sequence[Cameras], fraction: float, generator: torch.Generator) -> Tensor:
        """Return the mean grades (P,) of P azimuths; all graders see the same noise."""
        state, total = generator.get_state(), torch.zeros(len(poses), dtype=torch.float64)
        for grader, weight in self._graders:
            generator.set_state(state)
            total += weight * grader.grades(image, poses, fraction, generator)
        return total


@dataclass(frozen=True)
class Front:
    """Knowledge of a source before its front is searched."""

    grader: Grader | None
    """A guidance towards what the source is; None if that is not known, so that nobody is asked for the front."""
    built: bool = False  # whether it is known to be something that people build
    grown: bool = False  # whether it is to become something that nobody builds, such as an animal or a plant
    crooked: bool = False  # whether it is to be twisted, leaning or bent
    turned: bool = False  # whether it is to become something that is alike from all sides, such as a vase
    known: Orientation | None = None  # the answer, if the same was asked before


@dataclass(frozen=True)
class Orientation:
    """The turn of the cameras, and how it was chosen."""

    turn_deg: float = 0.0
    """Azimuth of the source that the guidance sees as the front, in -180 (exclusive) .. 180."""
    source: OrientationSource = OrientationSource.KEPT
    """`undecided`: no turn is clearly better than the first. `unrecognised`: nobody knows what the source may be.
    `unconditioned`: the grades do not depend on the azimuth."""
    margin: float = 0.0  # relative gain of the best turn that the search found over none; 0 without a search
    grades: tuple[float, ...] = ()
    """The grades of the first pass, of turns spaced evenly from 0; empty without such a search. Turns that only its
    first draw graded have that grade, changed by what the other draws changed on average."""

    def to_tensor(self) -> Tensor:
        """Return the members as float64, for checkpoints."""
        number = list(OrientationSource).index(self.source)
        return torch.tensor([self.turn_deg, number, self.margin, *self.grades], dtype=torch.float64)

    @classmethod
    def from_tensor(cls, values: Tensor) -> Orientation:
        """Return the orientation that `to_tensor` stored."""
        turn, number, margin, *grades = values.tolist()
        return cls(turn, list(OrientationSource)[int(number)], margin, tuple(grades))

    def to_dict(self) -> dict[str, Any]:
        """Return the member `orientation` of the report."""
        searched = len(self.grades)
        return {
            "turn_deg": self.turn_deg,
            "source": self.source.value,
            "margin": round(self.margin, 4) if self.source in (_FOUND, _UNDECIDED) else None,
            "grades": [[360 * k / searched, round(grade, 5)] for k, grade in enumerate(self.grades)],
            "notice": _NOTICES.get(self.source),
        }


def find_orientation(draw: Draw, guidance: Grader, seed: int, planes: Sequence[int] = ()) -> Orientation:
    """Search the best turn of a source.

    `draw`: renders the source for the guidance from cameras at this azimuth, with a background and light from the
    generator. Returns the picture and its cameras. `guidance`: asked for what the source is: the front of a dog is
    found by "a dog", not by what it should become; `seed`: seed of the search's own generator. `planes`: axes to which
    the source's mirror planes are perpendicular. With one, the front is one of two sides in it. Returns Orientation:
    `found`; or, with turn 0, `undecided`, for example for a symmetric source, or `unconditioned`.
    """
    search = _Search(draw, guidance, torch.Generator().manual_seed(seed))
    front, side = search.grades((0.0,), (0.0, 90.0))[0].tolist()
    if math.isclose(front, side, rel_tol=1e-5):
        return Orientation(source=OrientationSource.UNCONDITIONED)
    if len(planes) == 1:
        return _of_two(search, _SIDES[planes[0]])
    turns = [360.0 * k / _TURNS for k in range(_TURNS)]
    first = search.narrowed(_FIRST_DEG, turns)
    grades = tuple(first.tolist())
    best = turns[int(first.argmin())]
    hope = 1 - float(first.min() / first[0])
    if hope < _MIN_MARGIN:
        return Orientation(source=OrientationSource.UNDECIDED, margin=hope, grades=grades)
    candidates = [0.0, best - _FINE_DEG, best, best + _FINE_DEG]
    second = search.grades(_SECOND_DEG, candidates)
    chosen = 1 + int(second.mean(0)[1:].argmin())
    gain = (second[:, 0] - second[:, chosen]) / second[:, 0].mean()
    margin, error = float(gain.mean()), float(gain.std()) / math.sqrt(len(gain))
    if margin < _MIN_MARGIN or margin < _MIN_ERRORS * error:
        return Orientation(0.0, OrientationSource.UNDECIDED, margin, grades)
    return Orientation(_principal(candidates[chosen]), OrientationSource.FOUND, margin, grades)


def _of_two(search: _Search, sides: tuple[float, float]) -> Orientation:
    """Return the better of two sides; the first one if neither is clearly better."""
    grades = search.grades(_EIGHT_DEG, sides)
    gain = (grades[:, 0] - grades[:, 1]) / grades.mean()
    margin, error = float(gain.mean()), float(gain.std()) / math.sqrt(len(gain))
    if abs(margin) < _MIN_ERRORS * error or (sides[0] == 0.0 and 0 < margin < _MIN_BACK):
        return Orientation(sides[0], OrientationSource.UNDECIDED, margin)
    return Orientation(sides[int(margin > 0)], OrientationSource.FOUND, abs(margin))


class _Search:
    def __init__(self, draw: Draw, guidance: Grader, generator: torch.Generator) -> None:
        self._draw = draw
        self._guidance = guidance
        self._generator = generator

    @torch.no_grad()
    def grades(self, azimuths_deg: Sequence[float], turns_deg: Sequence[float]) -> Tensor:
        """Return the grades (draws, turns) of new draws at these azimuths from a random one."""
        begin = self._azimuth()
        return torch.stack([self._graded(begin + azimuth, turns_deg) for azimuth in azimuths_deg])

    @torch.no_grad()
    def narrowed(self, azimuths_deg: Sequence[float], turns_deg: Sequence[float]) -> Tensor:
        """Return the mean grades (turns,) of new draws, of which those after the first grade the best turns only."""
        begin = self._azimuth()
        once = self._graded(begin + azimuths_deg[0], turns_deg)
        kept = sorted({0, *once.argsort(stable=True)[:_KEPT].tolist()})
        again = [self._graded(begin + azimuth, [turns_deg[k] for k in kept]) for azimuth in azimuths_deg[1:]]
        mean = torch.stack([once[kept], *again]).mean(0)
        result = once + (mean - once[kept]).mean()
        result[kept] = mean
        return result

    def _azimuth(self) -> float:
        return 360 * float(torch.rand((), generator=self._generator, dtype=torch.float64))

    def _graded(self, azimuth_deg: float, turns_deg: Sequence[float]) -> Tensor:
        image, cameras = self._draw(azimuth_deg, self._generator)
        poses = [replace(cameras, azimuths_deg=tuple(a - turn for a in cameras.azimuths_deg)) for turn in turns_deg]
        return self._guidance.grades(image, poses, _FRACTION, self._generator)


def _principal(angle_deg: float) -> float:
    """Return the same angle in -180 (exclusive) .. 180."""
    return 180 - (180 - angle_deg) % 360
