"""Fit a surface to another one by a displacement of its vertices that is smooth over the surface: the finest level.

Smooth maps of space cannot part what lies close, or give what is small much more surface; displacements can. With
samples p of the surface, B their shares of the corners, paired both ways with samples y of the goal that have the
same code, n the goal's normal, on the way back the surface's, r the length of a pair and l the limit, each round
solves for new displacements d

    sum w |B (v + d) - p - (n n' + t (1 - n n')) (y - p)|^2  +  k (D / e)^2 / (400 V) |L^2 d|^2  +  h / V |d|^2

w = 1 / sqrt(1 + (2 r / l)^2) where the normals have a product above 0.1 and r < l. The surface slides: only the share
t of what lies along it is gone. L is the graph Laplacian with weights of one over the edges' lengths, e the mean edge,
D the diagonal, V the number of vertices. The displacement is smooth, not the position, so that what the surface shows
stays; so are those of different components where they nearly touch.

Of more than 12,000 vertices, displacements are those of some 6,000 nodes, middles of what lies in one cell and faces
alike; a vertex takes the mean of the nearest six by weights (1 - r / r_7)^2.

Sources: Botsch and Kobbelt 2004, An intuitive framework for real-time freeform modeling (the bilaplacian of the
displacement); Chen and Medioni 1992, Object modelling by registration of multiple range images (sliding); Sumner,
Schmid and Pauly 2007, Embedded deformation for shape manipulation (nodes, and their weights).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from meshdeform.exemplar.smooth_fit import in_ratio
from meshdeform.exemplar.sprouts import vertex_normals
from meshdeform.geometry.mesh import connected_components, edges_of, face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import Samples, spread

__all__ = ["FitSchedule", "SurfaceGoal", "laplacian_of", "nodes_of", "surface_fit"]

_SCALE = 1 / 400
_NORMAL, _COSINE, _APART = 0.1, 0.1, 4.0
_BACK = 1.5
_EDGE = (0.2, 5.0)
"""Least and greatest weight of an edge."""
_MOST_VERTICES, _NODES, _NEAREST = 12_000, 6000, 6
_RINGS = 2
"""Of faces around those that are fitted, which stay, so that the displacements end smoothly there."""
_TOUCHING, _TOUCHED = 0.012, 12
_TINY = 1e-12


@dataclass(frozen=True)
class FitSchedule:
    """How a surface is fitted: what has two values goes from the first to the second in equal ratios.

    `samples` of the surface, and `rounds`; `stiffness` k, `limits` l as a share of the diagonal, `sliding` t, and
    `held` h of the equation.
    """

    samples: int
    rounds: int
    stiffness: tuple[float, float]
    limits: tuple[float, float]
    sliding: tuple[float, float]
    held: float


class SurfaceGoal(NamedTuple):
    """Samples of a goal with their codes (N,) int64 and how much each counts (N,) float64; all of it counts 1."""

    samples: Samples
    codes: Index
    importance: Floats


def surface_fit(
    verts: Floats, faces: Index, codes: Index, goal: SurfaceGoal, manner: FitSchedule, *, start: Floats | None = None
) -> Floats:
    """Return the vertices (V, 3) of a surface fitted to a goal; those that no face uses stay where they are.

    Parameters
    ----------
    verts, faces, codes : arrays (V, 3) float64, (F, 3) and (F,) int64
        The surface and a code for each face; faces with a code below 0 are not fitted, and what they alone use stays.
    goal : SurfaceGoal
    manner : Manner
    start : array (V, 3) float64, optional
        Where the vertices are at first, from which the displacements do not count.
    """
    if not (codes >= 0).any() or not len(goal.codes):
        return verts.copy()
    near = np.zeros(len(verts), bool)
    near[faces[codes >= 0]] = True
    for _ in range(_RINGS):
        near[faces[near[faces].any(1)]] = True
    inner = near[faces].all(1)
    row_of = np.cumsum(near) - 1
    whole = float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0))), float(face_areas(verts, faces).sum())
    fit = _SurfaceFit(verts[near], row_of[faces[inner]], codes[inner], goal, manner, *whole)
    moved = verts.copy()
    moved[near] = fit.run((verts if start is None else start)[near])
    return moved


class _SurfaceFit:
    """The nodes that may move, the smoothness of their displacements, and the samples of what they become."""

    def __init__(
        self,
        verts: Floats,
        faces: Index,
        codes: Index,
        goal: SurfaceGoal,
        manner: FitSchedule,
        diagonal: float,
        area: float,
    ) -> None:
        """Take what is fitted and what is around it, and the diagonal and area of the whole surface."""
        self._rest, self._manner, self._diagonal = verts, manner, max(diagonal, _TINY)
        fitted = codes >= 0
        self._faces, self._codes = faces[fitted], codes[fitted]
        nodes = nodes_of(verts, faces)
        positions = nodes.mean @ verts
        free = np.zeros(len(verts), bool)
        free[self._faces] = True
        moving = np.unique(nodes.mean[:, free].nonzero()[0])
        self._spread = (sparse.diags(free.astype(float)) @ nodes.weights[:, moving]).tocsr()
        # As many as there would be on the whole surface.
        self._count = len(positions) * area / max(float(face_areas(verts, faces).sum()), _TINY)
        laplacian = laplacian_of(positions, nodes, self._diagonal)[:, moving]
        self._smooth = (laplacian.T @ laplacian * (_SCALE / self._count)).tocsc()
        self._goal = goal
        self._features = self._described(goal.samples.positions, goal.samples.normals, goal.codes)
        self._tree = cKDTree(self._features)

    def _described(self, positions: Floats, normals: Floats, codes: Index) -> Floats:
        return np.hstack([positions / self._diagonal, _NORMAL * normals, _APART * codes[:, None]])

    def run(self, start: Floats) -> Floats:
        """Return the vertices (V, 3) after all rounds."""
        now, manner = start.copy(), self._manner
        numbers = np.zeros((self._spread.shape[1], 3))
        for number in range(manner.rounds):
            share = number / max(manner.rounds - 1, 1)
            pulled, right = self._pulled(now, share, number)
            keep = in_ratio(manner.stiffness, share) * self._smooth
            keep = keep + manner.held / self._count * sparse.identity(len(numbers))
            factor = splu((pulled + keep).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            # Displacements count from the vertices at rest; the start is where pairs are sought at first.
            numbers = factor.solve(right)
            now = self._rest + np.asarray(self._spread @ numbers)
        return now

    def _pulled(self, now: Floats, share: float, seed: int) -> tuple[sparse.csr_matrix, Floats]:
        """Return the matrix and the right side (M, 3) of all pairs."""
        manner = self._manner
        own = spread(now, self._faces, manner.samples, seed)
        source, target, weights = self._paired(own, in_ratio(manner.limits, share) * self._diagonal)
        apart = self._goal.samples.positions[target] - own.positions[source]
        normals = self._goal.samples.normals[target].copy()
        normals[manner.samples :] = own.normals[source[manner.samples :]]
        across = (apart * normals).sum(1, keepdims=True) * normals
        goals = own.positions[source] + across + in_ratio(manner.sliding, share) * (apart - across)
        shares = _corner_shares(self._faces, own, len(now))[source]
        goals -= shares @ self._rest
        rows = (shares @ self._spread).tocsr()
        weighed = rows.T.multiply(weights).tocsr()
        return weighed @ rows, np.asarray(weighed @ goals)

    def _paired(self, own: Samples, limit: float) -> tuple[Index, Index, Floats]:
        """Return samples of the surface, those of the goal, and the weights of their pairs, first there, then back."""
        codes, count, goal = self._codes[own.faces], len(own.faces), self._goal
        described = self._described(own.positions, own.normals, codes)
        there, back = self._tree.query(described)[1], cKDTree(described).query(self._features)[1]
        source = np.concatenate([np.arange(count), back])
        target = np.concatenate([there, np.arange(len(goal.codes))])
        lengths = np.linalg.norm(goal.samples.positions[target] - own.positions[source], axis=1)
        alike = (goal.codes[target] == codes[source]) & (lengths < limit)
        alike &= (goal.samples.normals[target] * own.normals[source]).sum(1) > _COSINE
        weights = alike / np.sqrt(1 + (2 * lengths / limit) ** 2) * goal.importance[target]
        weights[:count] *= len(goal.codes) / count
        weights[count:] *= _BACK
        return source, target, weights


class _Nodes(NamedTuple):
    """What displaces the vertices.

    `weights` (V, M) of the nodes for each vertex, `mean` (M, V): vertices whose mean a node is, `edges` (E, 2) between
    nodes, `components` (M,): the connected component of each.
    """

    weights: sparse.csr_matrix
    mean: sparse.csr_matrix
    edges: Index
    components: Index


def nodes_of(verts: Floats, faces: Index) -> _Nodes:
    """Return the vertices as nodes, or fewer nodes for many."""
    count = len(verts)
    edges = edges_of(faces).edges
    components = connected_components(faces, count)
    if count <= _MOST_VERTICES:
        return _Nodes(sparse.identity(count, format="csr"), sparse.identity(count, format="csr"), edges, components)
    normals = vertex_normals(verts, faces)
    side = 1.1 * np.sqrt(face_areas(verts, faces).sum() / _NODES)
    keys = np.column_stack([components, np.floor((verts - verts.min(0)) / side), normals > 0]).astype(np.int64)
    number = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    mean = sparse.csr_matrix((np.ones(count), (number, np.arange(count))))
    mean = (sparse.diags(1 / np.asarray(mean.sum(1)).ravel()) @ mean).tocsr()
    own = np.zeros(mean.shape[0], np.int64)
    own[number] = components
    positions, facing = mean @ verts, mean @ normals
    described = np.hstack([positions, 0.5 * side * facing, 1e3 * own[:, None] * side])
    wanted = np.hstack([verts, 0.5 * side * normals, 1e3 * components[:, None] * side])
    nearest = min(_NEAREST + 1, len(positions))
    far, near = cKDTree(described).query(wanted, k=nearest)
    last = np.minimum(far[:, -1:], 100 * side)
    weights = np.maximum(1 - far / np.maximum(last, _TINY), 0) ** 2
    weights[:, 0] += _TINY
    weights /= weights.sum(1, keepdims=True)
    rows = np.repeat(np.arange(count), nearest)
    joined = np.unique(np.sort(number[edges], 1), axis=0)
    return _Nodes(
        sparse.csr_matrix((weights.ravel(), (rows, near.ravel())), (count, len(positions))),
        mean,
        joined[joined[:, 0] != joined[:, 1]],
        own,
    )


def laplacian_of(positions: Floats, nodes: _Nodes, diagonal: float) -> sparse.csc_matrix:
    """Return the Laplacian (M, M) of the displacements of the nodes, times the diagonal over the mean edge."""
    count = len(positions)
    edges = np.concatenate([nodes.edges, _touching(positions, nodes.components, diagonal)])
    lengths = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    mean = max(float(lengths[: len(nodes.edges)].mean()), _TINY)
    weights = np.clip(mean / np.maximum(lengths, _TINY), *_EDGE)
    graph = sparse.csr_matrix((weights, (edges[:, 0], edges[:, 1])), (count, count))
    graph = graph + graph.T
    degree = np.maximum(np.asarray(graph.sum(1)).ravel(), _TINY)
    laplacian = sparse.identity(count) - sparse.diags(1 / degree) @ graph
    return (diagonal / mean * laplacian).tocsc()


def _touching(positions: Floats, components: Index, diagonal: float) -> Index:
    """Return pairs (N, 2) of nodes of different components that nearly touch."""
    if not len(components) or components.max() == components.min():
        return np.zeros((0, 2), np.int64)
    far, near = cKDTree(positions).query(
        positions, k=min(_TOUCHED, len(positions)), distance_upper_bound=_TOUCHING * diagonal
    )
    rows = np.repeat(np.arange(len(positions)), near.shape[1])
    found = np.isfinite(far.ravel())
    pairs = np.column_stack([rows[found], near.ravel()[found]])
    pairs = np.unique(np.sort(pairs[components[pairs[:, 0]] != components[pairs[:, 1]]], 1), axis=0)
    return np.asarray(pairs, np.int64)


def _corner_shares(faces: Index, samples: Samples, count: int) -> sparse.csr_matrix:
    """Return what takes vertices (V, 3) to samples, (N, V)."""
    rows = np.repeat(np.arange(len(samples.faces)), 3)
    columns = faces[samples.faces].ravel()
    return sparse.csr_matrix((samples.shares.ravel(), (rows, columns)), (len(samples.faces), count))
