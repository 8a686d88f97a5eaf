"""Let a fit obey constraints: vertices that stay, points that go to their places, bodies that keep their shape.

With rest x, fit y and weights w in 0..1, how much each vertex may move, the displacement is d = w (y - x). Where w is 0
a vertex keeps its place to the last bit. Then corrections e are added that are 0 there::

    bodies    their vertices move as the nearest rigid motion R x + t of d says (or similarity s R x + t); around them
              (L + M / l^2) e = 0
    handles   e = G C^T (C G C^T)^-1 r,   G = S M S,   S = (L + M / l^2)^-1 where neither body nor 0

with L the cotangent Laplacian of the surface at rest, M its masses, C the rows of the handles and r what they still
have to go. So a body's surroundings and those of a handle, as a thin plate, follow along the surface over a length l,
0.08 of the diagonal, or longer where they must go far. Components that nearly touch hang together. Without constraints
the result is the fit.

Sources: Kabsch 1976 and Umeyama 1991 (rotations and similarities); Botsch and Kobbelt 2004, An Intuitive Framework for
Real-Time Freeform Modeling (thin plates with handles).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from meshdeform.deformation.settings import Rigidity
from meshdeform.exemplar.measures import vertex_areas
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["Follower", "held_displacement"]

_LENGTH = 0.08
_LENGTH_OF_WAY = 0.7
"""Lengths along which a surface follows: of the diagonal, and of the longest way that a correction goes."""
_STEADINESS, _LEAST_SCALE = 1e-6, 1e-3
_NEAR = 0.006
_COTANGENTS = (1e-3, 1e3)


def held_displacement(
    rest: Floats,
    goal: Floats,
    faces: Index,
    *,
    weight: Floats,
    handles: tuple[Index, Floats] | None = None,
    bodies: Sequence[tuple[Index, Rigidity]] = (),
) -> Floats:
    """Return the fit with constraints kept, (V, 3) float64.

    Parameters
    ----------
    rest, goal : (V, 3) float64
        Vertices before and after a fit.
    faces : (F, 3) int64
    weight : (V,) float64
        0: a vertex stays; 1: it may go all its way.
    handles : optional
        Vertices (H,) int64, each once, and their places (H, 3) float64. One that stays, or is of a body, has none.
    bodies : sequence
        Vertices (B,) int64 of each body, no two of which share one, and how it keeps its shape. A body with a vertex
        that stays does so as a whole.
    """
    share = weight[:, None]
    verts = np.where(share == 1, goal, np.where(share == 0, rest, rest + share * (goal - rest)))
    masses = vertex_areas(rest, faces)
    fixed, aims = weight == 0, verts.copy()
    for rows, mode in bodies:
        stays = bool((weight[rows] == 0).any())
        fixed[rows] = True
        aims[rows] = rest[rows] if stays else _moved(rest[rows], verts[rows], masses[rows], mode)
    held, places = _reachable(handles, fixed)
    ways = np.concatenate([aims - verts, places - verts[held]])
    longest = float(np.linalg.norm(ways, axis=1).max(initial=0.0))
    if longest == 0:
        return verts
    follower = Follower(rest, faces, fixed, longest)
    moved = verts + follower.followed(aims - verts)
    if len(held):
        moved += follower.pulled(held, places - moved[held])
        moved[held] = places
    moved[fixed] = aims[fixed]
    return moved


def _reachable(handles: tuple[Index, Floats] | None, fixed: Flags) -> tuple[Index, Floats]:
    """Return the vertices of the handles that may move, ascending, and their places."""
    if handles is None:
        return np.zeros(0, np.int64), np.zeros((0, 3))
    order = np.argsort(handles[0], kind="stable")
    order = order[~fixed[handles[0][order]]]
    return handles[0][order], handles[1][order]


def _moved(points: Floats, goals: Floats, masses: Floats, mode: Rigidity) -> Floats:
    """Return points (N, 3) moved rigidly, or by a similarity, to be near their goals."""
    masses = masses / masses.sum()
    a, b = masses @ points, masses @ goals
    centred = points - a
    product = (masses[:, None] * centred).T @ (goals - b)
    spread = float(masses @ (centred**2).sum(1))
    # Points on a line do not turn about it.
    u, stretches, v = np.linalg.svd(product + _STEADINESS * spread * np.eye(3))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    resized = mode is Rigidity.SIMILARITY and spread > 0
    scale = max(float(stretches @ signs) / spread, _LEAST_SCALE) if resized else 1.0
    return np.asarray(scale * centred @ ((u * signs) @ v) + b)


class Follower:
    """How a surface at rest (V, 3) follows what is moved on it by at most `longest`.

    Vertices that are `fixed` (V,) bool do not follow, but have ways of their own.
    """

    def __init__(self, rest: Floats, faces: Index, fixed: Flags, longest: float) -> None:
        diagonal = float(np.linalg.norm(np.ptp(rest, axis=0)))
        length = max(_LENGTH * diagonal, _LENGTH_OF_WAY * longest)
        self._masses = vertex_areas(rest, faces)
        self._system = (_stiffness(rest, faces) + sparse.diags(self._masses / length**2)).tocsc()
        self._free = np.flatnonzero(~fixed)
        inside = self._system[self._free][:, self._free]
        options = {"SymmetricMode": True}
        self._factor = splu(inside, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def followed(self, ways: Floats) -> Floats:
        """Return ways (V, 3) of all, for those of the fixed vertices."""
        out = ways.copy()
        if ways.any():
            out[self._free] = -self._factor.solve(np.asarray((self._system @ ways)[self._free]))
        return out

    def pulled(self, held: Index, missing: Floats) -> Floats:
        """Return the ways (V, 3) of all that move free vertices (H,) by what is missing (H, 3)."""
        place = np.searchsorted(self._free, held)
        forces = np.zeros((len(self._free), len(held)))
        forces[place, np.arange(len(held))] = 1
        plate = self._factor.solve(self._masses[self._free, None] * self._factor.solve(forces))
        out = np.zeros((len(self._masses), 3))
        out[self._free] = plate @ np.linalg.solve(plate[place], missing)
        return out


def _stiffness(rest: Floats, faces: Index) -> sparse.csr_matrix:
    """Return the Laplacian (V, V) of a surface, with components that nearly touch joined."""
    ends, weights = [], []
    for k in range(3):
        i, j, other = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        a, b = rest[i] - rest[other], rest[j] - rest[other]
        sine = np.linalg.norm(np.cross(a, b), axis=1)
        cosine = (a * b).sum(1)
        ends.append(np.stack([i, j], 1))
        weights.append(np.clip(cosine / np.maximum(2 * sine, 1e-300), *_COTANGENTS))
    near = _near_components(rest, faces)
    pairs = np.concatenate([*ends, near])
    values = np.concatenate([*weights, np.full(len(near), 0.5)])
    graph = sparse.coo_matrix((values, tuple(pairs.T)), shape=(len(rest),) * 2).tocsr()
    graph = graph + graph.T
    return (sparse.diags(np.asarray(graph.sum(1)).ravel()) - graph).tocsr()


def _near_components(rest: Floats, faces: Index) -> Index:
    """Return pairs (N, 2) of vertices of different components that nearly touch: for each the nearest other one."""
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = sparse.coo_matrix((np.ones(len(edges), bool), tuple(edges.T)), shape=(len(rest),) * 2)
    count, component = csgraph.connected_components(graph, directed=False)
    if count == 1 or not len(faces):
        return np.zeros((0, 2), np.int64)
    reach = _NEAR * float(np.linalg.norm(np.ptp(rest, axis=0)))
    distance, near = cKDTree(rest).query(rest, k=min(8, len(rest)), distance_upper_bound=reach)
    other = np.isfinite(distance) & (component[near.clip(max=len(rest) - 1)] != component[:, None])
    rows = np.flatnonzero(other.any(1))
    return np.stack([rows, near[rows, other[rows].argmax(1)]], 1).astype(np.int64)
