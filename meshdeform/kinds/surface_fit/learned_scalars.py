"""Learn the scalars of a file along a field's surface, and say how far off they are where they were not learned."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.kinds.surface_fit.base_places import places_of
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import NeuralField
from meshdeform.kinds.surface_fit.scalar_fields import STEPS, ScalarField, learn_scalars
from meshdeform.kinds.surface_fit.scalar_files import SampledScalars

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_LEVEL = 2
_KEPT_BACK = 10
_LOOKED_AT = 2000
_FAR = 0.05
"""Share of the diagonal by which samples may be off the surface on average."""


def learned_scalars(
    field: NeuralField,
    samples: SampledScalars,
    *,
    seed: int = 0,
    steps: int = STEPS,
    on_step: Callable[[], None] = lambda: None,
) -> tuple[list[ScalarField], list[dict[str, Any]]]:
    """Learn all scalars of a file from nine tenths of its points; return them, and for the report how far off they are.

    Parameters
    ----------
    on_step : callable
        Called after each step.
    """
    corners, weights = places_on(field, samples.points, samples.normals)
    order = np.random.default_rng(seed).permutation(len(corners))
    other, known = np.split(order, [math.ceil(len(order) / _KEPT_BACK)])
    fields, facts = [], []
    for name, values, labels in _tasks(samples):
        learned = learn_scalars(
            field.verts, corners[known], weights[known], values[known],
            name=name, labels=labels, steps=steps, seed=seed, on_step=on_step,
        )  # fmt: skip
        learned_values = learned.values(corners[other], weights[other])
        if labels:
            error = float((learned_values.argmax(1) != values[other].argmax(1)).mean())
            fact: dict[str, Any] = {"name": name, "pieces": len(labels), "share_wrong": error}
        else:
            off = np.sqrt(((learned_values - values[other]) ** 2).mean(0)) / learned.scale
            fact = {"name": name, "scalars": values.shape[1], "relative_error": float(off.mean())}
        fields.append(learned)
        facts.append(fact)
    return fields, facts


def _tasks(samples: SampledScalars) -> list[tuple[str, _Floats, list[int]]]:
    """Return names, wanted values (P, C), and the numbers of pieces."""
    tasks: list[tuple[str, _Floats, list[int]]] = [(name, values, []) for name, values in samples.values.items()]
    for name, owner in samples.labels.items():
        labels = np.unique(owner)
        tasks.append((name, (owner[:, None] == labels).astype(np.float64), labels.tolist()))
    return tasks


def check_places(verts: _Floats, faces: _Index, samples: SampledScalars) -> None:
    """Refuse samples that lie elsewhere than a mesh (V, 3), (F, 3).

    Raises
    ------
    AssetError
        A twentieth of the diagonal or more away on average.
    """
    some = slice(None, None, max(len(samples.points) // _LOOKED_AT, 1))
    points = samples.points[some]
    face, shares = SurfaceTree.of(verts, faces).find(points, samples.normals[some])
    apart = np.linalg.norm(np.einsum("pk,pkc->pc", shares, verts[faces[face]]) - points, axis=1)
    if apart.mean() > _FAR * np.linalg.norm(np.ptp(verts, axis=0)):
        raise AssetError(
            "The points of the scalars lie elsewhere than the surface.",
            advice="Give them in the coordinates of the asset's file.",
        )


def places_on(field: NeuralField, points: _Floats, normals: _Floats) -> tuple[_Index, _Floats]:
    """Return the places of the base whose images are nearest to points (P, 3).

    Parameters
    ----------
    points, normals : (P, 3) float64
        In the world; normals are unit normals, or zero where unknown.

    Returns
    -------
    corners : (P, 3) int64
    weights : (P, 3) float64
    """
    level = level_of(field.faces, len(field.verts), _LEVEL)
    verts = field.evaluate(level.corners, level.weights)
    return places_of(field.faces, level, verts, points, normals)
