"""Measure how close a mesh is to its target: distances between samples of each and the nearest points of the other."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.geometry.surface_samples import even_samples

_Floats = NDArray[np.float64]
_FIT_SAMPLES = 20_000
_NEAR = 0.01
_SPACING = 0.01


@dataclass(frozen=True)
class FitQuality:
    """Distances between a mesh and its target, as shares of the diagonal of the target's bounding box."""

    within: float  # share of the target's surface that is within 1 % of the mesh
    # Mean distance from the mesh to the target, and from the target to the mesh
    to_target: float
    from_target: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)


def measure_fit(mesh: TriangleMesh, target: TriangleMesh) -> FitQuality:
    """Compare a mesh with a target in the same frame."""
    there, back = distances_between(mesh, target), distances_between(target, mesh)
    corners = target.verts[np.unique(target.faces)]
    diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
    return FitQuality(
        float((back <= _NEAR * diagonal).mean()), float(there.mean()) / diagonal, float(back.mean()) / diagonal
    )


def distances_between(mesh: TriangleMesh, other: TriangleMesh) -> _Floats:
    """Return the distances of 20,000 samples that lie evenly on a mesh from the surface of another one."""
    rest, goal = RestMesh.of(mesh), RestMesh.of(other)
    face, shares = even_samples(rest.areas, _FIT_SAMPLES, 0)
    points = (rest.verts[rest.faces[face]] * shares[:, :, None]).sum(1)
    verts, faces = goal.verts, goal.faces
    spacing = _SPACING * float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0)))
    tree = SurfaceTree(verts, faces, goal.normals, spacing=spacing, opposite=0.0)
    nearest, weights = tree.find(points, np.zeros_like(points))
    return np.asarray(np.linalg.norm((verts[faces[nearest]] * weights[:, :, None]).sum(1) - points, axis=1))
