"""Compare an unfolded field with the surface that it was fitted to.

Distances are shares of the diagonal of the surface's bounding box. Eigenvalues and geodesics of both are computed on
their intrinsic Delaunay triangulations; those that are zero, one for each part, are left out of the mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.geometry.folds import area_vectors
from meshdeform.kinds.surface_fit.cleaning import CleanMesh
from meshdeform.kinds.surface_fit.collapse import collapsed
from meshdeform.kinds.surface_fit.gluing import glue, topology
from meshdeform.kinds.surface_fit.intrinsic import HeatGeodesics, IntrinsicMesh, delaunay, spectrum
from meshdeform.kinds.surface_fit.patches import divided
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface, SourceSurface

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
EIGENVALUES = 20
_SAMPLES = 20_000
_SOURCES = 4
_MOST_FACES = 40_000
"""Larger inputs are simplified to as many faces for eigenvalues and geodesics."""
_FEWEST_FACES = 10_000
"""Smaller ones are divided to as many: on a coarse triangulation both are off by more than the field is."""


def distances(surface: SourceSurface, verts: _Floats, faces: _Index) -> dict[str, Any]:
    """Return distances both ways, as shares of the diagonal, the angle of normals in degrees, and what is reversed.

    Parameters
    ----------
    verts : (V, 3) float64
        Of the field, in world coordinates.
    faces : (F, 3) int64
    """
    reference = surface.reference
    diagonal = float(np.linalg.norm(np.ptp(reference.verts, axis=0)))
    twin = glue(verts, faces)
    ours = MeshSurface(CleanMesh(verts, faces, twin, topology(faces, twin), {}))
    to, angle = _one_way(ours, surface)
    back, _ = _one_way(surface, ours)
    cross = area_vectors(verts, faces)
    area = np.linalg.norm(cross, axis=1)
    own = cross / np.maximum(area, 1e-300)[:, None]
    turned = (surface.project(verts[faces].mean(1), own)[1] * own).sum(1) < 0
    return {
        "to_input": _figures(to / diagonal),
        "from_input": _figures(back / diagonal),
        "mean": float((to.mean() + back.mean()) / 2 / diagonal),
        "normals_deg": float(angle.mean()),
        "reversed": float(area[turned].sum() / area.sum()),
        "reversed_faces": int(turned.sum()),
    }


def _one_way(one: SourceSurface, other: SourceSurface) -> tuple[_Floats, _Floats]:
    """Return distances and angles of normals at samples of a surface to their projections on another."""
    points, normals = one.samples(_SAMPLES)
    place, facing = other.project(points, normals)
    angle = np.degrees(np.arccos(np.clip((normals * facing).sum(1), -1, 1)))
    return np.linalg.norm(points - place, axis=1), angle


def _figures(values: _Floats) -> dict[str, float]:
    return {"mean": float(values.mean()), "p99": float(np.quantile(values, 0.99)), "max": float(values.max())}


class Reference:
    """The spectrum and geodesics of the input, computed once."""

    def __init__(self, surface: SourceSurface) -> None:
        mesh = surface.reference
        verts, faces = mesh.verts, mesh.faces
        if len(faces) > _MOST_FACES:
            verts, faces = collapsed(mesh, _MOST_FACES)
        verts, faces = divided(verts, faces, _FEWEST_FACES)
        self._verts = verts
        mesh_now = delaunay(verts, faces)
        self.components = mesh.topology.components
        self.eigenvalues, _ = spectrum(mesh_now, EIGENVALUES)
        solver = HeatGeodesics(mesh_now)
        self._sources = spread(verts, _SOURCES)
        self._distances = [solver.distances([source]) for source in self._sources]

    def compare(self, mesh: IntrinsicMesh, verts: _Floats) -> dict[str, Any]:
        """Return eigenvalues of both and their relative errors, and the relative error of geodesic distances.

        None stands for an error of nothing: of more parts than eigenvalues, or where parts of both that touch differ.
        """
        values, _ = spectrum(mesh, EIGENVALUES)
        count = min(len(values), len(self.eigenvalues))
        reference, measured = self.eigenvalues[self.components : count], values[self.components : count]
        errors = np.abs(measured - reference) / np.maximum(reference, 1e-300)
        near = cKDTree(self._verts).query(verts)[1]
        solver, ours = HeatGeodesics(mesh), cKDTree(verts)
        shares = []
        for source, far in zip(self._sources, self._distances, strict=True):
            own = solver.distances([int(ours.query(self._verts[source])[1])])
            there = far[near]
            finite = np.isfinite(own) & np.isfinite(there)
            own, there = own[finite], there[finite]
            if there.any():
                shares.append(float(np.abs(own - there).mean() / there.mean()))
        return {
            "eigenvalues": {
                "input": [float(x) for x in self.eigenvalues],
                "field": [float(x) for x in values],
                "mean_relative_error": float(errors.mean()) if len(errors) else None,
            },
            "geodesics": {"mean_relative_error": float(np.mean(shares)) if shares else None},
        }


def spread(verts: _Floats, count: int) -> list[int]:
    """Return vertices that are far from each other, by farthest-point sampling."""
    chosen = [int(np.linalg.norm(verts - verts.mean(0), axis=1).argmax())]
    far = np.linalg.norm(verts - verts[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(verts - verts[chosen[-1]], axis=1))
    return chosen
