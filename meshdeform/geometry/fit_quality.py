"""Measure how well a mesh fits a target, by distances between samples of each and the nearest places on the other."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.nearest_places import SurfaceTree
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.samples import even_samples

__all__ = ["FitQuality", "distances_between", "measure_fit"]

_SAMPLES = 20_000
_NEAR = 0.01
_SPACING = 0.01

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FitQuality:
    """Distances between a mesh and its target, as shares of the diagonal of the target's bounding box.

    Attributes
    ----------
    within : float
        Share of the target's surface that is within 1 % of the mesh.
    to_target, from_target : float
        Mean distance from the mesh to the target, and from the target to the mesh.
    """

    within: float
    to_target: float
    from_target: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)


def measure_fit(mesh: TriangleMesh, target: TriangleMesh) -> FitQuality:
    """Compare a mesh with a target in the same frame."""
    there, back = distances_between(mesh, target), distances_between(target, mesh)
    corners = target.verts.numpy()[np.unique(target.faces.numpy())]
    diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
    return FitQuality(
        float((back <= _NEAR * diagonal).mean()), float(there.mean()) / diagonal, float(back.mean()) / diagonal
    )


def distances_between(mesh: TriangleMesh, other: TriangleMesh) -> _Floats:
    """Return the distances of 20,000 samples that lie evenly on a mesh from the surface of another one."""
    rest, goal = RestMesh.of(mesh), RestMesh.of(other)
    face, weights = even_samples(rest.areas, _SAMPLES, 0)
    points = (rest.verts.numpy()[rest.faces.numpy()[face]] * weights[:, :, None]).sum(1)
    verts, faces = goal.verts.numpy(), goal.faces.numpy()
    spacing = _SPACING * float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0)))
    tree = SurfaceTree(verts, faces, goal.normals.numpy(), spacing=spacing, opposite=0.0)
    found, places = tree.find(points, np.zeros_like(points))
    return np.asarray(np.linalg.norm((verts[faces[found]] * places[:, :, None]).sum(1) - points, axis=1))
