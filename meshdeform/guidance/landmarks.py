"""Pull points of the deformed mesh to given places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.geometry.mesh import RestMesh, TriangleMesh, sparse_product
from meshdeform.geometry.places import SurfaceTree, blend_matrix

_WEIGHT = 10.0
_UNIT = 0.01


@dataclass(frozen=True)
class Landmark:
    """A point (3,) float64 of the mesh at rest, and the place (3,) float64 to which it goes."""

    source: NDArray[np.float64]
    target: NDArray[np.float64]


class LandmarkTerm:
    """Ten times the mean over the landmarks of ``2 (sqrt(1 + |d|^2 / u^2) - 1)``, with u a hundredth of the diagonal.

    Parameters
    ----------
    landmarks : sequence of Landmark
        At least one.
    diagonal : float
        Of the target.
    """

    def __init__(self, landmarks: Sequence[Landmark], diagonal: float) -> None:
        self._sources = np.array([each.source for each in landmarks])
        self._goals = torch.from_numpy(np.array([each.target for each in landmarks]))
        self._unit = _UNIT * diagonal

    def begin(self, mesh: TriangleMesh) -> None:
        """Bind the landmarks to the nearest places on the mesh at rest."""
        rest = RestMesh.of(mesh)
        verts, faces = rest.verts.numpy(), rest.faces.numpy()
        spacing = 0.02 * float(np.linalg.norm(np.ptp(verts, axis=0)))
        tree = SurfaceTree(verts, faces, rest.normals.numpy(), spacing=spacing, opposite=0.0)
        face, weights = tree.find(self._sources, np.zeros_like(self._sources))
        self._blend = blend_matrix(faces[face], weights, len(verts))

    def distances(self, verts: Tensor) -> NDArray[np.float64]:
        """Return the distance (L,) of each landmark of a shape (V, 3) from its place."""
        return np.asarray((sparse_product(self._blend, verts) - self._goals).norm(dim=1).numpy())

    def loss(self, verts: Tensor, offset: Tensor) -> Tensor:
        """Return the loss as a scalar, differentiable in the vertices (V, 3)."""
        apart = (sparse_product(self._blend, verts) + offset - self._goals) / self._unit
        mean: Tensor = 2 * _WEIGHT * ((1 + apart.square().sum(1)).sqrt() - 1).mean()
        return mean
