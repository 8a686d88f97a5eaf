"""Let a surface slide along its goal until it is distorted less: the last stage of a fit.

With s_1, s_2 the stretches of a face over the scale of the whole, a its share of the area at rest, J its Jacobian over
that scale, p samples of the surface and y the nearest points of the goal, and the other way round, n the normals of the
goal there, r = y - p, D the diagonal, d the displacements of the nodes of `surface_fit` since the start, and L, e, V as
there, each round takes a step that lowers

    k mean a [(s_1^2 + s_2^2 + s_1^-2 + s_2^-2) / 4 + |n . J|^2]
    + mean w (n . r)^2 / D^2  +  b (D / e)^2 / (400 V) |L^2 d|^2 / D^2

    + 0.1 mean over pairs |d_i - d_j|^2 / D^2 of vertices on open borders that are near at rest

w = 1 / sqrt(1 + (2 |r| / l)^2) where normals have a product above 0.1 and |r| < l. For the step, the stretches are
replaced by squares with the same slope: with u_i the directions in which a face is stretched, R the nearest isometry
and f the energy, sum_i f'(s_i) / (2 (s_i - 1)) (u_i . (J - R))^2.

Sources: Smith and Schaefer 2015, Bijective parameterization with free boundaries (the energy); Rabinovich et al. 2017,
Scalable locally injective mappings (the squares); Chen and Medioni 1992 (sliding).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.exemplar.conjugate_gradients import conjugate_gradients
from meshdeform.exemplar.smooth_fit import in_ratio
from meshdeform.exemplar.surface_fit import laplacian_of, nodes_of
from meshdeform.geometry.folds import area_vectors
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.nearest_points import SurfaceTree, blend_matrix
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import spread
from meshdeform.support.giving_way import give_way

__all__ = ["relaxed"]

_SAMPLES, _ROUNDS = 5000, 8
_MOST_FACES = 60_000
_DISTORTION, _STIFFNESS, _LIMITS = 3e-5, 1 / 400, (0.05, 0.02)
_COSINE, _ALONG, _ACROSS = 0.1, 0.001, 0.2
_LEAST = 0.05
_RIM, _RIMS = 0.012, 0.1
"""Distance of vertices on open borders that stay together, a share of the diagonal, and how much that counts."""
_STEPS, _ENOUGH, _SHORTEST = 60, 1e-4, 0.1
_FLAT = 1e-6
_TINY = 1e-30


def relaxed(
    rest: Floats, start: Floats, faces: Index, goal_verts: Floats, goal_faces: Index, *, stiffness: float = 1.0
) -> Floats:
    """Return the vertices (V, 3) of a surface that lies on its goal, with less distortion.

    Parameters
    ----------
    rest, start : arrays (V, 3) float64
        The surface before its fit, and after it.
    faces : array (F, 3) int64
    goal_verts, goal_faces : arrays (W, 3) float64 and (G, 3) int64
        The goal, in the same frame.
    stiffness : float
        How stiffly the displacement bends, b.

    A surface of very many faces is returned as it starts: sliding would cost more than all of the fit before it.
    """
    if len(faces) > _MOST_FACES:
        return start
    relaxing = _Relaxing(rest, start, faces, _Goal(goal_verts, goal_faces), stiffness)
    now = start
    for number in range(_ROUNDS):
        give_way()
        now = relaxing.step(now, number)
    return now


class _Goal:
    """A goal: samples and a tree of its points."""

    def __init__(self, verts: Floats, faces: Index) -> None:
        self.verts, self.faces, self.normals = verts, faces, _normals(verts, faces)
        self.samples = spread(verts, faces, _SAMPLES, 0)
        self.tree = _tree(verts, faces, self.normals)

    def nearest(self, positions: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """Return the nearest points (N, 3) and the normals there."""
        face, shares = self.tree.find(positions, normals)
        return np.einsum("nk,nkj->nj", shares, self.verts[self.faces[face]]), self.normals[face]


class _Ties(NamedTuple):
    """What holds a surface at its goal.

    `rows` (N, V) take the vertices to samples; `weights` (N,); `normals` and `apart` (N, 3). `facing` (F, 3): the
    goal's normals for the faces, 0 for those that are far.
    """

    rows: sparse.csr_matrix
    weights: Floats
    normals: Floats
    apart: Floats
    facing: Floats


class _Relaxing:
    """A surface between rest and goal, which each round moves nearer to the goal."""

    def __init__(self, rest: Floats, start: Floats, faces: Index, goal: _Goal, stiffness: float) -> None:
        self._start, self._all, self._goal = start, faces, goal
        self._diagonal = max(float(np.linalg.norm(np.ptp(start[np.unique(faces)], axis=0))), _TINY)
        self._flat(rest, faces)
        nodes = nodes_of(start, faces)
        positions = nodes.mean @ start
        laplacian = laplacian_of(positions, nodes, self._diagonal)
        bending = laplacian.T @ laplacian * (stiffness * _STIFFNESS / len(positions) / self._diagonal**2)
        # Of vertices that are nodes themselves, nothing is to be spread.
        self._is_spread = len(positions) < len(start)
        across = _across_rims(rest, faces) @ nodes.weights
        bending += across.T @ across * (_RIMS / max(across.shape[0], 1) / self._diagonal**2)
        self._spread = sparse.kron(nodes.weights, sparse.identity(3), format="csr")
        self._smooth = sparse.kron(bending, sparse.identity(3), format="csr")
        self._gone = np.zeros(3 * len(positions))

    def _flat(self, rest: Floats, faces: Index) -> None:
        """Lay faces that have an area in planes of their own: `_slopes` (F, 3, 2) of the shares of their corners."""
        a, b, c = rest[faces].transpose(1, 0, 2)
        first, second = b - a, c - a
        length = np.linalg.norm(first, axis=1)
        along = (first * second).sum(1) / np.maximum(length, _TINY)
        across = np.linalg.norm(np.cross(first, second), axis=1) / np.maximum(length, _TINY)
        solid = across * length > _FLAT * np.maximum(length, np.linalg.norm(second, axis=1)) ** 2
        self._faces, length, along, across = faces[solid], length[solid], along[solid], across[solid]
        self._areas = length * across / (length * across).sum()
        slant = along / (length * across)
        zero = np.zeros_like(slant)
        of_a, of_b, of_c = (-1 / length, slant - 1 / across), (1 / length, -slant), (zero, 1 / across)
        self._slopes = np.stack([np.stack(each, 1) for each in (of_a, of_b, of_c)], 1)

    def _stretched(self, verts: Floats) -> tuple[float, Floats, Floats, Floats]:
        """Return the scale of the whole, the Jacobians (F, 3, 2) over it, stretches (F, 2) and their directions."""
        maps = np.einsum("fci,fck->fik", verts[self._faces], self._slopes)
        squares, right = np.linalg.eigh(np.einsum("fik,fil->fkl", maps, maps))
        stretches = np.sqrt(np.maximum(squares, _TINY))
        scale = max(float(np.sqrt(self._areas @ stretches.prod(1))), _TINY)
        return scale, maps / scale, stretches / scale, right

    def _energy(self, verts: Floats, step: Floats, ties: _Ties) -> float:
        _, maps, stretches, _ = self._stretched(verts + step)
        squares = np.maximum(stretches, _LEAST) ** 2
        tilt = np.einsum("fj,fjk->fk", ties.facing, maps)
        faces = (squares + 1 / squares).sum(1) / 4 + np.square(tilt).sum(1)
        off = (ties.normals * (ties.rows @ step - ties.apart)).sum(1) / self._diagonal
        return float(_DISTORTION * (self._areas @ faces) + ties.weights @ off**2)

    def step(self, now: Floats, number: int) -> Floats:
        """Return the vertices (V, 3) after one more round."""
        ties = self._tied(now, number)
        rows, goals = self._squares(now, ties)
        loose = ties.rows.T @ sparse.diags(ties.weights * (_ALONG / self._diagonal**2)) @ ties.rows
        loose = sparse.kron(loose, sparse.identity(3), format="csr")
        if self._is_spread:
            rows, loose = rows @ self._spread, self._spread.T @ loose @ self._spread
        matrix = (rows.T @ rows + loose + self._smooth).tocsr()
        change = _solved(matrix, rows.T @ goals - self._smooth @ self._gone)
        length, before = 1.0, self._energy(now, np.zeros_like(now), ties) + self._bent(self._gone)
        while length > _SHORTEST:
            gone = self._gone + length * change
            step = np.asarray(self._spread @ (length * change)).reshape(-1, 3)
            if self._energy(now, step, ties) + self._bent(gone) < before:
                self._gone = gone
                return np.asarray(now + step)
            length *= 0.5
        return now

    def _bent(self, gone: Floats) -> float:
        return float(gone @ (self._smooth @ gone))

    def _tied(self, now: Floats, number: int) -> _Ties:
        limit = in_ratio(_LIMITS, number / (_ROUNDS - 1)) * self._diagonal
        goal, own, normals = self._goal, spread(now, self._all, _SAMPLES, number), _normals(now, self._all)
        there, facing = goal.nearest(own.positions, own.normals)
        face, shares = _tree(now, self._all, normals).find(goal.samples.positions, goal.samples.normals)
        corners = np.concatenate([self._all[own.faces], self._all[face]])
        rows = blend_matrix(corners, np.concatenate([own.shares, shares]), len(now))
        apart = np.concatenate([there, goal.samples.positions]) - rows @ now
        theirs = np.concatenate([facing, goal.samples.normals])
        lengths = np.linalg.norm(apart, axis=1)
        alike = ((theirs * np.concatenate([own.normals, normals[face]])).sum(1) > _COSINE) & (lengths < limit)
        weights = alike / np.sqrt(1 + (2 * lengths / limit) ** 2) / _SAMPLES
        middles, normals = now[self._faces].mean(1), _normals(now, self._faces)
        near, facing = goal.nearest(middles, normals)
        far = ((facing * normals).sum(1) < _COSINE) | (np.linalg.norm(near - middles, axis=1) > limit)
        facing[far] = 0
        return _Ties(rows, weights, theirs, apart, facing)

    def _squares(self, now: Floats, ties: _Ties) -> tuple[sparse.csr_matrix, Floats]:
        """Return rows (R, 3 V) and goals (R,) of the squares that stand for the energy, as of the step."""
        scale, maps, stretches, right = self._stretched(now)
        held = np.maximum(stretches, _LEAST)
        left = np.einsum("fik,fkl->fil", maps, right) / held[:, None]
        aside = np.cross(left[:, :, 0], left[:, :, 1])
        bends = (held + 1) * (held**2 + 1) / held**3 / 4
        weights = np.concatenate([bends, np.full((len(held), 1), _ACROSS / 2), np.ones((len(held), 1))], 1)
        axes = np.concatenate([left, aside[:, :, None], ties.facing[:, :, None]], 2)
        missing = np.einsum("fil,fkl->fik", left, right) - maps
        goals = np.einsum("fji,fjk->fik", axes, missing)
        goals[:, 3] = -np.einsum("fj,fjk->fk", ties.facing, maps)
        root = np.sqrt(weights * (_DISTORTION * self._areas)[:, None])
        values = np.einsum("fi,fji,fck->fikcj", root, axes, self._slopes / scale)
        columns = 3 * self._faces[:, None, None, :, None] + np.arange(3)
        columns = np.broadcast_to(columns, values.shape)
        distorted = sparse.csr_matrix(
            (values.ravel(), columns.ravel(), np.arange(goals.size + 1) * 9), (goals.size, now.size)
        )
        pull = np.sqrt(ties.weights) / self._diagonal
        values = ties.rows.data.reshape(-1, 3, 1) * (pull[:, None] * ties.normals)[:, None]
        columns = 3 * ties.rows.indices.reshape(-1, 3, 1) + np.arange(3)
        tied = sparse.csr_matrix((values.ravel(), columns.ravel(), np.arange(len(pull) + 1) * 9), (len(pull), now.size))
        gaps = pull * (ties.normals * ties.apart).sum(1)
        return sparse.vstack([distorted, tied], format="csr"), np.concatenate(
            [(root[:, :, None] * goals).ravel(), gaps]
        )


def _across_rims(rest: Floats, faces: Index) -> sparse.csr_matrix:
    """Return rows (P, V) that take vertices to the differences of those on open borders that are near at rest."""
    edges = edges_of(faces)
    rims = np.unique(edges.edges[edges.counts == 1])
    reach = _RIM * float(np.linalg.norm(np.ptp(rest[np.unique(faces)], axis=0)))
    pairs = rims[cKDTree(rest[rims]).query_pairs(reach, output_type="ndarray")].reshape(-1, 2)
    number = np.repeat(np.arange(len(pairs)), 2)
    signs = np.tile([1.0, -1.0], len(pairs))
    return sparse.csr_matrix((signs, (number, pairs.ravel())), (len(pairs), len(rest)))


def _solved(matrix: sparse.csr_matrix, right: Floats) -> Floats:
    """Return about the solution (N,) of a positive definite system, by conjugate gradients."""
    diagonal = matrix.diagonal()
    diagonal = np.maximum(diagonal, 1e-9 * diagonal.max())
    found = conjugate_gradients(matrix.__matmul__, diagonal, right, steps=_STEPS, enough=_ENOUGH)
    return np.asarray(found, np.float64)


def _normals(verts: Floats, faces: Index) -> Floats:
    normals = area_vectors(verts, faces)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), _TINY))


def _tree(verts: Floats, faces: Index, normals: Floats) -> SurfaceTree:
    diagonal = max(float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0))), _TINY)
    return SurfaceTree(verts, faces, normals, spacing=0.02 * diagonal, opposite=0.1 * diagonal)
