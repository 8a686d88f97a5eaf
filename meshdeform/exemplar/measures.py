"""Measure what a fit did to a surface, for its report: faces broken, stretch, and how much of a displacement is left.

The stretches of a face are the singular values s1, s2 of its map from rest, here of the first fundamental forms I and
II of the face before and after: s1^2 + s2^2 = trace(I^-1 II), (s1 s2)^2 = det II / det I. The stretch of a surface is
the mean by area of (|log s1 / s| + |log s2 / s|) / 2 with log s the mean of all log s1 and log s2, so that a similarity
has 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.exemplar.faults import Faults
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.folds import area_vectors, longest_squared
from meshdeform.nouns.labels import Floats, Index

__all__ = ["Measures", "kept_share", "measures", "surface_stretch", "vertex_areas"]

_LEAST = 1e-6
"""Of the mean stretch; what is less counts as this much."""


@dataclass(frozen=True)
class Measures:
    """What a fit did: faces newly folded, faces newly cutting others, and the stretch of the surface."""

    flipped: int
    cut: int
    stretch: float


def measures(rest: Floats, verts: Floats, faces: Index) -> Measures:
    """Compare vertices (V, 3) float64 of faces (F, 3) int64 with those at rest."""
    found = Faults(rest, faces).find(verts)
    return Measures(int(found.folded.sum()), int(found.cutting.sum()), surface_stretch(rest, verts, faces))


def kept_share(rest: Floats, goal: Floats, verts: Floats, faces: Index) -> float:
    """Return the share of the displacement from `rest` to `goal` that is left at `verts`, by area; 1 if there is none.

    All are (V, 3) float64. It is negative where vertices are farther from the goal than at rest.
    """
    areas = vertex_areas(rest, faces)
    whole = float(areas @ np.linalg.norm(goal - rest, axis=1))
    return 1 - float(areas @ np.linalg.norm(goal - verts, axis=1)) / whole if whole > 0 else 1.0


def vertex_areas(rest: Floats, faces: Index) -> Floats:
    """Return the area (V,) around each vertex, a third of its faces; of those without any, next to nothing."""
    areas = np.linalg.norm(area_vectors(np.ascontiguousarray(rest), faces), axis=1) / 6
    total = np.bincount(faces.ravel(), np.repeat(areas, 3), len(rest)).astype(np.float64)
    return np.asarray(np.maximum(total, 1e-9 * total.max(initial=0.0) + 1e-300))


def surface_stretch(rest: Floats, verts: Floats, faces: Index) -> float:
    """Return the stretch of a surface; faces without an area at rest do not count."""
    areas = np.linalg.norm(area_vectors(np.ascontiguousarray(rest), faces), axis=1)
    solid = areas > 2 * COLLAPSED_SHAPE * longest_squared(rest, faces)
    if not solid.any():
        return 0.0
    faces, areas = faces[solid], areas[solid]
    e, m, g = _form(rest, faces)
    e2, m2, g2 = _form(verts, faces)
    determinant = e * g - m * m
    middle = (g * e2 - 2 * m * m2 + e * g2) / (2 * determinant)
    product = np.maximum(e2 * g2 - m2 * m2, 0) / determinant
    largest = middle + np.sqrt(np.maximum(middle**2 - product, 0))
    squares = np.stack([largest, product / np.maximum(largest, 1e-300)])
    logs = np.log(np.maximum(squares, _LEAST**2 * max(float(middle.mean()), 1e-300))) / 2
    logs -= (logs @ areas).mean() / areas.sum()
    return float((np.abs(logs) @ areas).mean() / areas.sum())


def _form(verts: Floats, faces: Index) -> tuple[Floats, Floats, Floats]:
    """Return the entries (F,) of the first fundamental form of each face."""
    u, v = verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]]
    return (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
