"""Measure the quality of a result's mesh and its distance from the source.

The figures of `meshdeform.geometry.quality`, which every job's report has, and additionally:

::

    displacement               sqrt(sum_v a_v |v - v0|^2 / sum_v a_v) / d     a_v: a third of the faces' areas at rest
    neighbour_offset           mean change of the offsets between neighbouring components over d (`neighbours.py`)
    texture_stretch            p95 and share above 2 of the stretch of textures (`geometry/quality.py`)
    chamfer                    (mean_p min_q |p - q| + mean_q min_p |p - q|) / 2 d    p, q: points on either surface

with d the diagonal of the source's bounding box, so all are dimensionless. The first follows every vertex,
the last compares only the surfaces and ignores vertices that slide on them.

Source of the Chamfer distance: Fan et al. 2017, A Point Set Generation Network, eq. 2, here with distances instead of
their squares and halved.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure, measure_texture_stretch
from training.evaluation.neighbours import neighbour_offsets

POINTS = 10_000
"""Points on each surface for the Chamfer distance."""

_Floats = NDArray[np.float64]


def measures(rest: TriangleMesh, deformed: TriangleMesh, texels: _Floats | None = None) -> dict[str, float | None]:
    """Compute all figures of a deformation, by name.

    Parameters
    ----------
    rest, deformed : TriangleMesh
        Meshes with the same faces, in the same unit.
    texels : (F, 3, 2), optional
        Corners of the faces in their textures; without, there is no texture stretch.

    Returns
    -------
    dict
        The fields of `meshdeform.geometry.quality.MeshQuality`, and those above.

    Raises
    ------
    ShapeError
        The meshes have different faces.
    NumericalError
        A position is not finite.
    """
    before, after, faces = rest.verts.numpy(), deformed.verts.numpy(), rest.faces.numpy()
    if not np.array_equal(faces, deformed.faces.numpy()) or before.shape != after.shape:
        raise ShapeError("the deformed mesh must have the faces of the rest mesh")
    if not np.isfinite(after).all():
        raise NumericalError("The deformed mesh is not finite.")
    diagonal = float(np.linalg.norm(np.ptp(before, axis=0)))
    stretch = None if texels is None else measure_texture_stretch(texels, before[faces], after[faces])
    textured = {} if stretch is None else {"p95": stretch.p95, "above_2": stretch.above_2}
    return {
        **measure(before, faces, after).to_dict(),
        **{f"texture_stretch_{name}": value for name, value in textured.items()},
        "displacement": displacement(before, faces, after) / diagonal,
        "neighbour_offset": neighbour_offsets(rest, deformed.verts).mean,
        "chamfer": chamfer_distance(before, after, faces) / diagonal,
    }


def displacement(before: _Floats, faces: NDArray[np.int64], after: _Floats) -> float:
    """Return the root mean squared displacement of the vertices, weighted by area, in the meshes' unit."""
    weights = np.bincount(faces.ravel(), np.repeat(_areas(before, faces), 3), len(before))
    return float(np.sqrt((weights * ((after - before) ** 2).sum(1)).sum() / weights.sum()))


def chamfer_distance(before: _Floats, after: _Floats, faces: NDArray[np.int64], seed: int = 0) -> float:
    """Estimate the mean distance between two surfaces with `POINTS` points on each, in the meshes' unit.

    Both are sampled with the same random numbers, so the distance of a surface from itself is zero.
    """
    one, other = surface_points(before, faces, POINTS, seed), surface_points(after, faces, POINTS, seed)
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float((there.mean() + back.mean()) / 2)


def surface_points(verts: _Floats, faces: NDArray[np.int64], count: int, seed: int) -> _Floats:
    """Draw points (count, 3) uniformly by area on a surface (Osada et al. 2002, Shape Distributions, eq. 1)."""
    rng = np.random.default_rng(seed)
    share = np.cumsum(_areas(verts, faces))
    face = np.searchsorted(share, rng.random(count) * share[-1], side="right").clip(max=len(faces) - 1)
    root, second = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = verts[faces[face]].transpose(1, 0, 2)
    return np.asarray((1 - root) * a + root * (1 - second) * b + root * second * c)


def _areas(verts: _Floats, faces: NDArray[np.int64]) -> _Floats:
    a, b, c = verts[faces].transpose(1, 0, 2)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
