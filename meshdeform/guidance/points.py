"""Pull a surface to a target surface and back: distances from samples of each to the nearest points on the other.

With s_i samples of the deformed mesh, q_i the nearest points on the target, n_i the normals there, t_j samples of the
target, x_j the nearest points on the deformed mesh, m_j the normals there, and D the diagonal of the target::

    loss = mean_i g_i h(s_i - q_i; n_i) + mean_j g_j h(t_j - x_j; m_j)
    h(d; n) = 2 (sqrt(1 + e / u^2) - 1),     e = 0.9 (n . d)^2 + 0.1 |d|^2,     u = D / 100

so that surfaces slide along each other, and few far pairs do not outweigh the rest. The pairs are fixed for ten steps.
A pair counts (g = 1) if the normals differ by at most 60 degrees, the distance is at most a limit that falls from 10 %
to 2 % of D over the run, and the nearest point is not on an open border: there, something is missing.

Sources: Amberg et al. 2007, Optimal Step Nonrigid ICP Algorithms for Surface Registration (gates); Rusinkiewicz and
Levoy 2001, Efficient Variants of the ICP Algorithm (distances to planes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_normals
from meshdeform.geometry.nearest_points import SurfaceTree, blend_matrix
from meshdeform.geometry.surface_samples import even_samples
from meshdeform.geometry.tensors import sparse_product
from meshdeform.guidance.landmarks import LIMITS, Landmark, bound, diagonal_of

SAMPLES = 20_000
EVERY_STEPS = 10
"""Steps between two searches for pairs."""
_WEIGHT = 10.0
"""Of landmarks."""

_LEAST_COSINE = 0.5
_UNIT = 0.01
_ALONG = 0.1
_INSIDE = 1e-6
_LEAST_RESISTANCE = 0.05
_MOST_SHIFT = 0.02
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class _Pairs:
    """Rows of the samples that count, with what they are compared with."""

    from_mesh: sparse.csr_matrix
    to_target: Tensor
    normals: Tensor
    weight: float


class PointTerm:
    """The distances between a mesh and its target in both directions.

    `target`: in the frame of the deformed mesh; `seed`: of the samples. `samples`: on each of the two surfaces.
    Default: `SAMPLES`.
    """

    def __init__(self, target: TriangleMesh, *, seed: int = 0, samples: int | None = None) -> None:
        samples = SAMPLES if samples is None else samples
        self._target = goal = RestMesh.of(target)
        self._seed, self._samples = seed, samples
        self._diagonal = diagonal_of(goal)
        self._tree = _tree_of(goal.verts, goal, self._diagonal)
        self._border = _border_of(goal)
        face, weights = even_samples(goal.areas, samples, seed)
        self._points = (goal.verts[goal.faces[face]] * weights[:, :, None]).sum(1)
        self._normals = goal.normals[face]

    def begin(self, mesh: TriangleMesh) -> None:
        """Place the samples on the mesh at rest that is deformed."""
        self._mesh = rest = RestMesh.of(mesh)
        self._mesh_border = _border_of(rest)
        self._face, weights = even_samples(rest.areas, self._samples, self._seed + 1)
        self._sampler = blend_matrix(rest.faces[self._face], weights, len(rest.verts))

    def pair(self, verts: Tensor, offset: Tensor, fraction: float) -> Tensor:
        """Find the pairs for a shape.

        Parameters
        ----------
        verts : (V, 3) float64
        offset : (3,) float64
            Translation of the mesh towards the target.
        fraction : float
            Progress of the run, which determines the greatest distance.

        Returns
        -------
        The translation (3,) float64 that brings the pairs that count together best.
        """
        moved = (verts + offset).numpy()
        normals = face_normals(verts.numpy(), self._mesh.faces)
        limit = self._diagonal * (LIMITS[0] + (LIMITS[1] - LIMITS[0]) * fraction)
        goal, faces = self._target, self._mesh.faces
        samples = self._sampler @ moved
        face, weights = self._tree.find(samples, normals[self._face])
        near = (goal.verts[goal.faces[face]] * weights[:, :, None]).sum(1)
        there = goal.normals[face]
        counts = (there * normals[self._face]).sum(1) >= _LEAST_COSINE
        counts &= np.linalg.norm(near - samples, axis=1) <= limit
        counts &= ~on_border(self._border, goal.faces[face], weights)
        forward = self._counted(self._sampler, near, there, counts)
        apart, across = [(near - samples)[counts]], [there[counts]]
        face, weights = _tree_of(moved, self._mesh, self._diagonal, normals).find(self._points, self._normals)
        blend = blend_matrix(faces[face], weights, len(moved))
        missing = self._points - blend @ moved
        counts = (self._normals * normals[face]).sum(1) >= _LEAST_COSINE
        counts &= np.linalg.norm(missing, axis=1) <= limit
        counts &= ~on_border(self._mesh_border, faces[face], weights)
        self._pairs = [forward, self._counted(blend, self._points, normals[face], counts)]
        apart.append(missing[counts])
        across.append(normals[face][counts])
        return torch.from_numpy(self._translation(np.concatenate(apart), np.concatenate(across)))

    def _translation(self, apart: _Floats, normals: _Floats) -> _Floats:
        """Return the translation (3,) that brings planes together best; zero along directions in which none resists."""
        total = normals.T @ (normals * apart).sum(1)
        translation = np.linalg.pinv(normals.T @ normals, rcond=_LEAST_RESISTANCE, hermitian=True) @ total
        length = float(np.linalg.norm(translation))
        most = _MOST_SHIFT * self._diagonal
        return np.asarray(translation if length <= most else translation * (most / length))

    def _counted(self, blend: sparse.csr_matrix, points: _Floats, normals: _Floats, counts: _Flags) -> _Pairs:
        share = float(counts.mean())
        return _Pairs(blend[counts], torch.from_numpy(points[counts]), torch.from_numpy(normals[counts]), share)

    def loss(self, verts: Tensor, offset: Tensor) -> tuple[Tensor, float]:
        """Return the loss, differentiable in the vertices (V, 3), and the share of the samples that count."""
        unit = _UNIT * self._diagonal
        total = verts.sum() * 0.0
        for pairs in self._pairs:
            if pairs.weight:
                apart = (sparse_product(pairs.from_mesh, verts) + offset - pairs.to_target) / unit
                across = (apart * pairs.normals).sum(1).square()
                energy = (1 - _ALONG) * across + _ALONG * apart.square().sum(1)
                total = total + pairs.weight * 2 * ((1 + energy).sqrt() - 1).mean()
        return total, float(np.mean([pairs.weight for pairs in self._pairs]))


def on_border(border: _Flags, corners: _Index, weights: _Floats) -> _Flags:
    """Return flags (P,) of the points on an open border.

    `border`, (V,) bool: the vertices on borders; `corners` is (P, 3) int64; `weights`, (P, 3) float64: barycentric
    coordinates.
    """
    reached = weights > _INSIDE
    return np.asarray((border[corners] | ~reached).all(1) & ~reached.all(1))


def _border_of(mesh: RestMesh) -> _Flags:
    flags = np.zeros(len(mesh.verts), bool)
    flags[mesh.edges.edges[mesh.edges.counts == 1].ravel()] = True
    return flags


def _tree_of(verts: _Floats, mesh: RestMesh, diagonal: float, normals: _Floats | None = None) -> SurfaceTree:
    normals = mesh.normals if normals is None else normals
    spacing, opposite = 0.02 * diagonal, 0.1 * diagonal
    return SurfaceTree(verts, mesh.faces, normals, spacing=spacing, opposite=opposite, slack=0.2)


class LandmarkTerm:
    """Ten times the mean over the landmarks of ``2 (sqrt(1 + |d|^2 / u^2) - 1)``, with u a hundredth of the diagonal.

    `landmarks`: at least one; `diagonal`: of the target.
    """

    def __init__(self, landmarks: Sequence[Landmark], diagonal: float) -> None:
        self._landmarks = landmarks
        self._goals = torch.from_numpy(np.array([each.target for each in landmarks]))
        self._unit = _UNIT * diagonal

    def begin(self, mesh: TriangleMesh) -> None:
        """Bind the landmarks to the nearest points on the mesh at rest."""
        self._blend = bound(self._landmarks, mesh)

    def loss(self, verts: Tensor, offset: Tensor) -> Tensor:
        """Return the loss as a scalar, differentiable in the vertices (V, 3)."""
        apart = (sparse_product(self._blend, verts) + offset - self._goals) / self._unit
        mean: Tensor = 2 * _WEIGHT * ((1 + apart.square().sum(1)).sqrt() - 1).mean()
        return mean
