"""Measure how much of the displacement of a fit is left, by the area around each vertex."""

from __future__ import annotations

import numpy as np

from meshdeform.geometry.folds import area_vectors
from meshdeform.nouns.labels import Floats, Index

__all__ = ["kept_share", "vertex_areas"]


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
