"""Linear least squares of G affine maps at once: what articulated fits have in common.

A point x of group g goes to A_g h, h = ((x - c_g) / r_g, 1), where c_g is the group's centre and r_g its size. The
twelve numbers of each map, row by row, follow each other in the system. Terms:

    sum w [ (n . (A_g h - y))^2 + p |A_g h - y|^2 ]       pairs of points with y, where the surface's normal is n
    sum w (A_g - L_g)^2                                   goals for the numbers themselves
    w |A_i h_i(c) - A_j h_j(c)|^2                         ties at points c where groups touch
    w |A_i - M A_j M'|^2                                  mirror images alike, M = diag(-1, 1, 1), M' with a 1 more
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from meshdeform.nouns.labels import Floats, Index

__all__ = ["HOMOGENEOUS_MIRROR", "MIRROR", "AffineSystem", "mapped", "mirror_matrix", "tie_matrix", "turned_normals"]

MIRROR, HOMOGENEOUS_MIRROR = np.diag([-1.0, 1, 1]), np.diag([-1.0, 1, 1, 1])
_MIRRORED_MAP = np.kron(MIRROR, HOMOGENEOUS_MIRROR)
"""Takes the twelve numbers of a map A, row by row, to those of M A M'."""


def mapped(maps: Floats, groups: Index, h: Floats) -> Floats:
    """Return where maps (G, 3, 4) take points h (N, 4) of groups (N,): (N, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", maps[groups], h))


def turned_normals(maps: Floats, groups: Index, normals: Floats) -> Floats:
    """Return the unit normals (N, 3) of the surface of groups (N,) after maps (G, 3, 4)."""
    a, b, c = maps[:, :, :3].transpose(1, 0, 2)
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
    turned = np.einsum("nij,nj->ni", cofactors[groups], normals)
    return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12))


class AffineSystem:
    """The normal equations of so many maps: `matrix` (12 G, 12 G) and `right` (12 G,)."""

    def __init__(self, count: int) -> None:
        self.matrix, self.right = np.zeros((12 * count, 12 * count)), np.zeros(12 * count)

    def add_pairs(
        self, groups: Index, h: Floats, target: Floats, normal: Floats, weight: Floats, pointwise: float
    ) -> None:
        """Add pairs of points h (N, 4) with targets and normals (N, 3), sorted by their groups `groups` (N,)."""
        rows = (normal[:, :, None] * h[:, None, :]).reshape(-1, 12)
        along = weight * (normal * target).sum(1)
        for rows_of in np.split(np.arange(len(groups)), np.flatnonzero(np.diff(groups)) + 1):
            if not len(rows_of):
                continue
            block = slice(12 * groups[rows_of[0]], 12 * groups[rows_of[0]] + 12)
            weighed = weight[rows_of, None] * rows[rows_of]
            self.matrix[block, block] += rows[rows_of].T @ weighed
            self.right[block] += rows[rows_of].T @ along[rows_of]
            near = pointwise * weight[rows_of, None] * h[rows_of]
            square = h[rows_of].T @ near
            for axis in range(12 * groups[rows_of[0]], 12 * groups[rows_of[0]] + 12, 4):
                self.matrix[axis : axis + 4, axis : axis + 4] += square
            self.right[block] += (near.T @ target[rows_of]).T.ravel()

    def add_goals(self, weights: Floats, goals: Floats) -> None:
        """Add goals (G, 3, 4) of the maps' numbers with weights (G, 3, 4)."""
        self.matrix[np.diag_indices(len(self.matrix))] += weights.ravel()
        self.right += (weights * goals).ravel()

    def solve(self, least: float) -> Floats:
        """Return the maps (G, 3, 4); `least` is added to the diagonal."""
        self.matrix[np.diag_indices(len(self.matrix))] += least
        return np.asarray(np.linalg.solve(self.matrix, self.right), np.float64).reshape(-1, 3, 4)


def tie_matrix(count: int, ties: Iterable[tuple[int, int, Floats, Floats, float]]) -> Floats:
    """Return the matrix of ties between two groups: their points h (4,) in either, and a weight."""
    matrix = np.zeros((12 * count, 12 * count))
    for i, j, one, other, weight in ties:
        both = np.stack([one, other]) * [[1.0], [-1.0]]
        block = weight * np.outer(both.ravel(), both.ravel())
        for axis in range(3):
            at = np.r_[12 * i + 4 * axis + np.arange(4), 12 * j + 4 * axis + np.arange(4)]
            matrix[np.ix_(at, at)] += block
    return matrix


def mirror_matrix(count: int, pairs: Iterable[tuple[int, int]], weights: Floats) -> Floats:
    """Return the matrix that makes mirror images alike; a group may be its own. `weights` (G,) are of the groups."""
    matrix = np.zeros((12 * count, 12 * count))
    for i, j in pairs:
        strength = min(weights[i], weights[j])
        one, two = slice(12 * i, 12 * i + 12), slice(12 * j, 12 * j + 12)
        if i == j:
            lack = np.eye(12) - _MIRRORED_MAP
            matrix[one, one] += strength * lack.T @ lack
        else:
            matrix[one, one] += strength * np.eye(12)
            matrix[two, two] += strength * np.eye(12)
            matrix[one, two] -= strength * _MIRRORED_MAP
            matrix[two, one] -= strength * _MIRRORED_MAP.T
    return matrix
