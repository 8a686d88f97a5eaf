"""Fit a surface to a given one that lies beside it, and whose parts nobody knows: all to all.

A smooth map (`smooth_fit`) takes the surface to its target roughly, a displacement that is smooth over the surface
(`surface_fit`) then closely, and last it slides along the target until it is distorted less (`relaxing`). If half of
both surfaces is level or upright, as of what people build, all is stiffer, so that it stays straight. Where source and
target are both their own mirror images, the map is symmetric, and vertices that are mirror images of each other stay
so.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from meshdeform.exemplar.relaxing import relaxed
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.smooth_fit import CodedSurface, pulls_to, smooth_fit
from meshdeform.exemplar.surface_fit import FitSchedule, SurfaceGoal, surface_fit
from meshdeform.exemplar.symmetry import evened
from meshdeform.geometry.folds import area_vectors
from meshdeform.nouns.labels import Floats
from meshdeform.reading.samples import spread

__all__ = ["fitted_to_target"]

_LIMITS = (0.5, 0.05)
_MANNER = FitSchedule(
    samples=10_000, rounds=16, stiffness=(10.0, 0.01), limits=(0.2, 0.02), sliding=(0.5, 0.02), held=1e-3
)
_RELAXED = {False: 1.0, True: 300.0}
_BUILT, _UPRIGHT, _LEVEL = 0.5, 0.05, 0.95


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
    target = target.moved(target.verts + _to_planes(source, target, planes))
    built = _is_built(source) and _is_built(target)
    now = smooth_fit(
        CodedSurface.alike(source.verts, source.faces),
        CodedSurface.alike(target.verts, target.faces),
        planes=planes,
        built=built,
        limits=_LIMITS,
        pulls=pulls_to(landmarks),
    )
    if not built:
        count = _MANNER.samples
        goal = SurfaceGoal(
            spread(target.verts, target.faces, count, 0), goal_codes[:1].repeat(count), np.full(count, 1 / count)
        )
        now = surface_fit(now, source.faces, codes, goal, _MANNER)
    now = relaxed(source.verts, now, source.faces, target.verts, target.faces, stiffness=_RELAXED[built])
    return evened(source.verts, now, tuple(planes))


def _is_built(shape: Shape) -> bool:
    """Return whether at least half of a surface is level or upright."""
    normals = area_vectors(shape.verts, shape.faces)
    areas = np.linalg.norm(normals, axis=1)
    upward = np.abs(normals[:, 1])
    straight = (upward > _LEVEL * areas) | (upward < _UPRIGHT * areas)
    return float(areas[straight].sum()) >= _BUILT * float(areas.sum())


def _to_planes(source: Shape, target: Shape, planes: Collection[int]) -> Floats:
    """Return the shift (3,) that brings the middle of the target to the source's mirror planes."""
    shift = np.zeros(3)
    for axis in planes:
        own, other = (each.verts[np.unique(each.faces)][:, axis] for each in (source, target))
        shift[axis] = (own.min() + own.max() - other.min() - other.max()) / 2
    return shift
