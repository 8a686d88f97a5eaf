"""Tell across which planes through the middle a surface is its own mirror image.

What counts is the mean distance of the mirrored surface to itself (`distances`), each at most 0.05 of the diagonal.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.distances import one_way_distance
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import spread

__all__ = ["asymmetry", "evened", "is_even", "quarter_asymmetry", "symmetry_axes"]

_SAMPLES = 3000
_MOST, _LIMIT = 0.05, 0.01
_IMAGE = 0.001
"""Distance up to which a vertex is the mirror image of another."""


def asymmetry(verts: Floats, faces: Index, axis: int) -> float:
    """Return how far a surface is from its mirror image across the plane through the origin, normal to an axis."""
    return _distance_to_image(verts, faces, np.diag(np.where(np.arange(3) == axis, -1.0, 1.0)))


def quarter_asymmetry(verts: Floats, faces: Index) -> float:
    """Return how far a surface is from itself after a quarter turn about the upright axis."""
    return _distance_to_image(verts, faces, np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))


def _distance_to_image(verts: Floats, faces: Index, turn: Floats) -> float:
    samples = spread(verts, faces, _SAMPLES, 6)
    image = samples._replace(positions=samples.positions @ turn.T, normals=samples.normals @ turn.T)
    return one_way_distance(image, samples, float(np.sqrt(face_areas(verts, faces).sum() / _SAMPLES)), _MOST)


def is_even(verts: Floats, faces: Index, axis: int) -> bool:
    """Return whether a surface is its own mirror image across the plane through the origin, normal to an axis."""
    return asymmetry(verts, faces, axis) <= _LIMIT


def symmetry_axes(source: tuple[Floats, Index], goal: tuple[Floats, Index]) -> tuple[int, ...]:
    """Return the axes across which a source stays its own mirror image when it becomes a goal.

    Both are vertices (V, 3) and faces (F, 3). Left and right stay alike if they are; front and back only if those of
    the goal are, too.
    """
    return tuple(axis for axis in (0, 2) if is_even(*source, axis) and (axis == 0 or is_even(*goal, axis)))


def evened(rest: Floats, moved: Floats, axes: tuple[int, ...]) -> Floats:
    """Return moved vertices (V, 3) of which those that were mirror images across the axes are again.

    Both of a pair take the mean of their displacements, one of them mirrored.
    """
    positions = moved.copy()
    for axis in axes:
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        away, image = cKDTree(rest).query(rest * mirror)
        rows = np.flatnonzero((away < _IMAGE) & (image[image] == np.arange(len(rest))))
        step = positions - rest
        positions[rows] = rest[rows] + (step[rows] + step[image[rows]] * mirror) / 2
    return positions
