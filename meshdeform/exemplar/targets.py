"""Fit a surface to a given one whose parts nobody knows: place it, take the nearest of several, fit all to all.

**Placing.** Up stays up. The target is turned about +Y, scaled, and moved so that both surfaces have the same centre of
mass and the same spread about it, the root of the sum of the second moments, both of places spread by area; the
farthest twentieth counts in neither. A turn is graded by the distances of places to the nearest ones of the other
surface by (place, 0.1 normal) both ways, the nearer four fifths of them, plus those of the landmarks. 24 turns are
tried, then finer ones around the best; one must be better than none by 3 %, so that bodies of revolution stay as they
are.

**Fitting.** A smooth map (`smooth_fit`) takes the surface to its target roughly, a displacement that is smooth over the
surface (`surface_fit`) then closely. Where source and target are both their own mirror images, the map is symmetric,
and vertices that are mirror images of each other stay so.

Source: Rusinkiewicz and Levoy 2001, Efficient variants of the ICP algorithm (normals, rejection of the worst pairs).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.smooth_fit import LEVELS, smooth_fit
from meshdeform.exemplar.surface_fit import Manner, SurfaceGoal, surface_fit
from meshdeform.exemplar.symmetry import evened
from meshdeform.nouns.labels import Floats
from meshdeform.reading.samples import Samples, features, spread

__all__ = ["Placement", "fitted_to_target", "nearest_target", "placed"]

_SAMPLES = 1500
_KEPT_FOR_MOMENTS, _KEPT = 0.95, 0.8
_NORMALS = 0.1
_TURNS, _HALVINGS, _GAIN = 24, 6, 0.03
_LIMITS = (0.5, 0.05)
_MANNER = Manner(samples=10_000, rounds=16, stiffness=(10.0, 0.01), limits=(0.1, 0.02), sliding=(0.5, 0.02), held=1e-3)


@dataclass(frozen=True)
class Placement:
    """How a target is brought to a source: x goes to scale turn x + shift, `turn` (3, 3) about +Y, `shift` (3,).

    `distance`: mean distance between the two, as the turns were graded, a share of the source's diagonal.
    """

    turn: Floats
    scale: float
    shift: Floats
    distance: float

    def place(self, points: Floats) -> Floats:
        """Return points (N, 3) of the target beside the source."""
        return np.asarray(self.scale * points @ self.turn.T + self.shift)


def placed(source: Shape, target: Shape, landmarks: tuple[Floats, Floats] | None = None) -> Placement:
    """Return how a target is best brought to a source.

    `landmarks`: places (L, 3) of the source, and their goals on the target, in its own coordinates.
    """
    own, other = _Cloud(source), _Cloud(target)
    scale = own.size / max(other.size, 1e-300)
    marks, goals = (np.zeros((0, 3)), np.zeros((0, 3))) if landmarks is None else landmarks

    def at(turn: float) -> Placement:
        matrix = _about_up(turn)
        shift = own.centre - scale * matrix @ other.centre
        given = Placement(matrix, scale, shift, 0.0)
        apart = np.linalg.norm(given.place(goals) - marks, axis=1) / own.diagonal
        grade = own.distance(other, matrix) + (float(apart.mean()) if len(apart) else 0.0)
        return Placement(matrix, scale, shift, grade)

    best, angle, step = at(0.0), 0.0, 2 * math.pi / _TURNS
    least = best.distance * (1 - _GAIN)
    for number in range(1, _TURNS):
        tried = at(number * step)
        if tried.distance < least:
            best, angle, least = tried, number * step, tried.distance
    for _ in range(_HALVINGS):
        step /= 2
        for turn in (angle - step, angle + step):
            tried = at(turn)
            if tried.distance < least:
                best, angle, least = tried, turn, tried.distance
    return best


def nearest_target(
    source: Shape, targets: Sequence[Shape], landmarks: tuple[Floats, Floats] | None = None
) -> tuple[int, Placement]:
    """Return which of some targets is nearest to a source, and how it is brought there."""
    tried = [placed(source, target, landmarks) for target in targets]
    number = min(range(len(tried)), key=lambda each: tried[each].distance)
    return number, tried[number]


def fitted_to_target(
    source: Shape,
    target: Shape,
    *,
    planes: Collection[int] = (),
    landmarks: tuple[Floats, Floats] | None = None,
) -> Floats:
    """Return the vertices (V, 3) of a source fitted to a target that lies beside it already.

    Parameters
    ----------
    planes : collection of int
        Axes across whose middle both are their own mirror images.
    landmarks : pair of arrays (L, 3) float64, optional
        Places of the source and their goals.
    """
    codes, goal_codes = np.zeros(len(source.faces), np.int64), np.zeros(len(target.faces), np.int64)
    rough = smooth_fit(
        source.verts,
        source.faces,
        codes,
        target.verts,
        target.faces,
        goal_codes,
        planes=planes,
        levels=LEVELS,
        limits=_LIMITS,
        landmarks=landmarks,
    )
    count = _MANNER.samples
    samples = spread(target.verts, target.faces, count, 0)
    samples = samples._replace(places=samples.places + _to_planes(source, target, planes))
    goal = SurfaceGoal(samples, np.zeros(count, np.int64), np.full(count, 1 / count))
    close = surface_fit(rough, source.faces, codes, goal, _MANNER)
    return evened(source.verts, close, tuple(planes))


class _Cloud:
    """Places and normals of a shape about its centre, in units of its spread."""

    def __init__(self, shape: Shape) -> None:
        samples = spread(shape.verts, shape.faces, _SAMPLES, 0)
        used = shape.verts[np.unique(shape.faces)]
        self.diagonal = max(float(np.linalg.norm(np.ptp(used, axis=0))), 1e-300)
        self.centre, self.size = _moments(samples)
        self.places = (samples.places - self.centre) / self.size
        self.normals = samples.normals
        self._unit = _NORMALS * self.diagonal / self.size
        self._tree = cKDTree(features(self.places, self.normals, self._unit))

    def distance(self, other: _Cloud, turn: Floats) -> float:
        """Return the mean distance of the nearer places, both ways, with the other turned."""
        there = self._tree.query(features(other.places @ turn.T, other.normals @ turn.T, self._unit))[0]
        back = other._tree.query(features(self.places @ turn, self.normals @ turn, other._unit))[0]
        kept = int(_KEPT * _SAMPLES)
        means = [float(np.sort(each)[:kept].mean()) for each in (there, back)]
        return sum(means) / 2 * self.size / self.diagonal


def _moments(samples: Samples) -> tuple[Floats, float]:
    """Return the centre (3,) and the spread of places, without the farthest."""
    places = samples.places
    far = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    near = places[np.argsort(far, kind="stable")[: int(_KEPT_FOR_MOMENTS * len(places))]]
    centre = near.mean(0)
    return centre, max(float(np.sqrt(np.square(near - centre).sum(1).mean())), 1e-300)


def _about_up(turn: float) -> Floats:
    cosine, sine = math.cos(turn), math.sin(turn)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _to_planes(source: Shape, target: Shape, planes: Collection[int]) -> Floats:
    """Return the shift (3,) that brings the middle of the target to the source's mirror planes."""
    shift = np.zeros(3)
    for axis in planes:
        own, other = (each.verts[np.unique(each.faces)][:, axis] for each in (source, target))
        shift[axis] = (own.min() + own.max() - other.min() - other.max()) / 2
    return shift
