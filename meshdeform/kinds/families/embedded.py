"""Deform a part onto points by embedded deformation: affine maps at the nodes of a graph, blended over the surface.

Source: Sumner, Schmid and Pauly 2007, Embedded Deformation for Shape Manipulation, SIGGRAPH. Weights of the energies
are other: nodes are pulled to their points softly, since sampled points are noisy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_ROTATION, _SMOOTH, _STILL = 1.0, 10.0, 0.1
"""The last one draws each map to the identity: most of the way is done by the rough fit before."""
_INFLUENCES, _NEIGHBOURS = 4, 6
_ROUNDS, _DAMPING = 6, 1e-6
_FLAT = 0.03**2
"""Variance, in squared diagonals, below which an extent says little about a scale: the scale is drawn to 1."""


def axis_fit(source: _Floats, target: _Floats) -> tuple[_Floats, _Floats]:
    """Return the scales (3,) along x, y and z and the shift (3,) that take points (P, 3) best to others.

    Equal points give exactly ones and zeros.
    """
    a, b = source.mean(0), target.mean(0)
    covariance, variance = ((source - a) * (target - b)).mean(0), ((source - a) ** 2).mean(0)
    scale = np.clip((covariance + _FLAT) / (variance + _FLAT), 0.2, 5.0)
    return scale, b - scale * a


@dataclass(frozen=True)
class Pull:
    """Rows of surface points and where they are pulled."""

    points: _Floats  # (P, 3) float64: before the deformation
    targets: _Floats  # (P, 3) float64
    components: _Index  # (P,) int64: the piece of surface of each
    weight: float


class Embedding:
    """The deformation graph of one part, and its solution.

    Parameters
    ----------
    nodes : (J, 3) float64
        Places of the nodes.
    components : (J,) int64
        The piece of surface of each node. Nodes move points of their own piece; a piece without nodes follows all.
    """

    def __init__(self, nodes: _Floats, components: _Index) -> None:
        self._nodes, self._components = nodes, components
        self._maps = np.tile(np.eye(3), (len(nodes), 1, 1))
        self._shifts = np.zeros((len(nodes), 3))
        self._edges = self._graph()

    def _graph(self) -> _Index:
        """Return the edges (E, 2) in both directions between near nodes of one piece."""
        edges: list[_Index] = []
        for piece in np.unique(self._components):
            rows = np.flatnonzero(self._components == piece)
            if len(rows) < 2:
                continue
            near = cKDTree(self._nodes[rows]).query(self._nodes[rows], k=min(_NEIGHBOURS + 1, len(rows)))[1][:, 1:]
            pairs = np.stack([np.repeat(np.arange(len(rows)), near.shape[1]), near.reshape(-1)], 1)
            edges += [rows[pairs], rows[pairs[:, ::-1]]]
        return np.unique(np.concatenate(edges), axis=0) if edges else np.empty((0, 2), np.int64)

    def weights(self, points: _Floats, components: _Index) -> tuple[_Index, _Floats]:
        """Return the nodes (P, 4) that move each point, and their weights (P, 4), whose sum is 1.

        Source: eq. 5: (1 - distance / distance of the next node)^2.
        """
        index, weight = np.zeros((len(points), _INFLUENCES), np.int64), np.zeros((len(points), _INFLUENCES))
        for piece in np.unique(components):
            rows = np.flatnonzero(components == piece)
            own = np.flatnonzero(self._components == piece)
            own = own if len(own) else np.arange(len(self._nodes))
            count = min(_INFLUENCES + 1, len(own))
            distance, near = cKDTree(self._nodes[own]).query(points[rows], k=count)
            distance, near = distance.reshape(len(rows), -1), near.reshape(len(rows), -1)
            reach = distance[:, -1:] * (1.0 if count > _INFLUENCES else 1.5) + 1e-12
            share = (1 - distance / reach) ** 2 + 1e-9
            used = min(_INFLUENCES, count)
            weight[rows, :used] = share[:, :used] / share[:, :used].sum(1, keepdims=True)
            index[rows, :used] = own[near[:, :used]]
        return index, weight

    def solve(self, pulls: list[Pull]) -> None:
        """Minimise rotation, smoothness and the pulls by Gauss-Newton steps from where it stands.

        The unknowns of a node are its map, row by row, and its shift. If all pulls are where they are, nothing moves,
        to the last bit.
        """
        fixed = [self._pull_rows(pull) for pull in pulls]
        smooth, reach = self._smooth_rows()
        for _ in range(_ROUNDS):
            blocks, residuals = [smooth], [self._smooth_residual(reach)]
            for matrix, pull in fixed:
                blocks.append(matrix)
                offsets = pull.targets - pull.points
                moved = self.displacement(pull.points, pull.components)
                residuals.append(np.sqrt(pull.weight) * (moved - offsets).reshape(-1))
            matrix, residual = self._rotation_rows()
            still, held = self._still_rows()
            jacobian = sparse.vstack([*blocks, matrix, still]).tocsc()
            right = jacobian.T @ np.concatenate([*residuals, residual, held])
            if not np.any(right):
                return
            system = (jacobian.T @ jacobian + _DAMPING * sparse.eye(jacobian.shape[1])).tocsc()
            change = -splu(system).solve(right).reshape(-1, 12)
            self._maps += change[:, :9].reshape(-1, 3, 3)
            self._shifts += change[:, 9:]
            if float(np.abs(change).max()) < 1e-5:
                return

    def displacement(self, points: _Floats, components: _Index) -> _Floats:
        """Return how far the points (P, 3) move."""
        index, weight = self.weights(points, components)
        maps = self._maps[index] - np.eye(3)
        moved = np.einsum("pkij,pkj->pki", maps, points[:, None] - self._nodes[index]) + self._shifts[index]
        return np.asarray((weight[:, :, None] * moved).sum(1))

    def linear(self, points: _Floats, components: _Index) -> _Floats:
        """Return the blended linear map (P, 3, 3) at the points."""
        index, weight = self.weights(points, components)
        return np.asarray(np.eye(3) + (weight[:, :, None, None] * (self._maps[index] - np.eye(3))).sum(1))

    def _pull_rows(self, pull: Pull) -> tuple[sparse.csr_matrix, Pull]:
        index, weight = self.weights(pull.points, pull.components)
        offset = pull.points[:, None] - self._nodes[index]
        values = np.concatenate([offset, np.ones((*offset.shape[:2], 1))], 2) * weight[:, :, None]
        return self._rows(index, values, float(np.sqrt(pull.weight))), pull

    def _smooth_rows(self) -> tuple[sparse.csr_matrix, _Floats]:
        """Return the rows of eq. 8, A_j (g_k - g_j) + g_j + t_j - (g_k + t_k), and g_k - g_j."""
        j, k = self._edges.T
        reach = self._nodes[k] - self._nodes[j]
        values = np.zeros((len(j), 2, 4))
        values[:, 0, :3], values[:, 0, 3], values[:, 1, 3] = reach, 1.0, -1.0
        return self._rows(self._edges, values, float(np.sqrt(_SMOOTH))), reach

    def _smooth_residual(self, reach: _Floats) -> _Floats:
        j, k = self._edges.T
        bend = np.einsum("eij,ej->ei", self._maps[j] - np.eye(3), reach) + self._shifts[j] - self._shifts[k]
        return np.asarray(np.sqrt(_SMOOTH) * bend.reshape(-1))

    def _rows(self, index: _Index, values: _Floats, factor: float) -> sparse.csr_matrix:
        """Return the matrix of rows sum_k values_k . (row d of the map of node k, its shift d), for d = x, y, z."""
        count, per = index.shape
        d = np.arange(3)
        row = np.broadcast_to((3 * np.arange(count)[:, None, None] + d)[..., None], (count, 1, 3, 4))
        row = np.broadcast_to(row, (count, per, 3, 4))
        member = np.concatenate([3 * d[:, None] + np.arange(3), 9 + d[:, None]], 1)
        column = 12 * index[:, :, None, None] + member
        data = np.broadcast_to(factor * values[:, :, None, :], row.shape)
        shape = (3 * count, 12 * len(self._nodes))
        return sparse.csr_matrix((data.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=shape)

    def _still_rows(self) -> tuple[sparse.csr_matrix, _Floats]:
        """Return the rows and the residual of A = 1."""
        count = len(self._nodes)
        column = (12 * np.arange(count)[:, None] + np.arange(9)).reshape(-1)
        data = np.full(9 * count, np.sqrt(_STILL))
        matrix = sparse.csr_matrix((data, (np.arange(9 * count), column)), shape=(9 * count, 12 * count))
        return matrix, np.sqrt(_STILL) * (self._maps - np.eye(3)).reshape(-1)

    def _rotation_rows(self) -> tuple[sparse.csr_matrix, _Floats]:
        """Return the rows and the residual of eq. 4: A^T A = 1, its six different entries."""
        count, maps = len(self._nodes), self._maps
        jacobian, residual = np.zeros((count, 6, 3, 3)), np.zeros((count, 6))
        for at, (i, j) in enumerate(((0, 1), (0, 2), (1, 2), (0, 0), (1, 1), (2, 2))):
            jacobian[:, at, :, i] += maps[:, :, j]
            jacobian[:, at, :, j] += maps[:, :, i]
            residual[:, at] = (maps[:, :, i] * maps[:, :, j]).sum(1) - (i == j)
        row = np.broadcast_to(np.arange(6 * count).reshape(count, 6, 1), (count, 6, 9))
        column = np.broadcast_to(12 * np.arange(count)[:, None, None] + np.arange(9), (count, 6, 9))
        data = np.sqrt(_ROTATION) * jacobian.reshape(count, 6, 9)
        shape = (6 * count, 12 * count)
        matrix = sparse.csr_matrix((data.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=shape)
        return matrix, np.sqrt(_ROTATION) * residual.reshape(-1)
