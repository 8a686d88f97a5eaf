"""Where parts that a surface lacks sprout from it, and how their patches come to lie on them.

A limb is what is seen of a part of the goal: its root is where it leaves the others, and each of its points has a
height t, the distance from the root over the surface relative to the greatest, and an angle about its middle line, in
a frame that turns with the line as little as it can. Its patch is a disc of the surface about the root's point. The
two are laid on each other so that areas keep their ratio: a vertex inside whose distance r from the middle lies the
share s of the patch goes to the height beyond which lies the share s of the limb, at its own angle about the axis. So
two ears get two patches with a strip of head between them, and nothing is pulled out that would web them.

A patch has the share of its parent's area that the limb has of the goal's, up to 0.12 and 1.5 times the radius of the
root, so that it takes little of a face, but is no smaller than the root and has two dozen vertices if that lets it.
Between two patches a strip stays free, 0.28 of the way from one middle to the other: with d the distance from the plane
half way, h that of the middle, and R the radius, r is the greater of |x - middle| / R and (h - d) / (0.72 h).

Sources: Sheffer, Praun and Rose 2006, Mesh parameterization methods and their applications (area-preserving maps
between discs); Wang et al. 2008, Computation of rotation minimizing frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.geometry.mesh import edges_of, face_cross
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.cells import connected
from meshdeform.reading.samples import Samples

__all__ = ["GoalPart", "Ground", "Seat", "Sprout", "limb_of", "seat_of", "sprouted", "vertex_normals"]

_NEIGHBOURS = 8
_AT_ROOT, _FEWEST = 0.06, 30
_BINS = 10
_FREE = 0.28
"""Share of the way between two roots that no patch covers."""
_MOST, _WIDER, _ENOUGH = 0.12, 1.5, 24
"""Greatest share of its parent that a patch has; its greatest radius in those of the root, if that holds enough."""
_FACING = 0.1
"""Least cosine between the normal where a limb grows and the direction in which it does."""
_SEARCH, _SEARCH_MORE, _BESIDE, _STUCK_OUT = 2.0, 0.04, 0.06, 0.02
"""How far from its root, in its radii and in diagonals, and to its sides, a limb seeks what sticks out so far."""
_TURN = 0.6
"""Weight of angles beside heights where the nearest points of a limb are looked up."""


@dataclass(frozen=True)
class GoalPart:
    """What is seen of a part of the goal.

    `positions` (N, 3); `heights` (N,) from 0 at the root to 1; `turns` (N, 2): cosine and sine of the angle
    about the middle line. `root` (3,), `axis` (3,) unit: where and in which direction it leaves; `across` (2, 3): the
    directions of the angle 0 and of a right angle, there. `radius`: of the root. `area`: of all that is seen.
    """

    positions: Floats
    heights: Floats
    turns: Floats
    root: Floats
    axis: Floats
    across: Floats
    radius: float
    area: float

    def points_at(self, heights: Floats, turns: Floats) -> Floats:
        """Return points (P, 3) at heights (P,) and angles (P, 2)."""

        def key(height: Floats, turn: Floats) -> Floats:
            return np.column_stack([height, _TURN * turn])

        far, near = cKDTree(key(self.heights, self.turns)).query(key(heights, turns), k=4)
        weights = 1 / (far + 1e-3) ** 2
        weights /= weights.sum(1, keepdims=True)
        return np.asarray(np.einsum("pk,pkj->pj", weights, self.positions[near]))


def vertex_normals(verts: Floats, faces: Index) -> Floats:
    """Return unit normals (V, 3): the mean of the faces around each vertex, by area; zero where there are none."""
    normals = np.zeros_like(verts)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], face_cross(verts, faces))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))


def limb_of(samples: Samples, own: Flags, inside: Flags, area: float) -> GoalPart | None:
    """Return the limb of the samples `own` (N,) of a goal; None if too little of it is seen.

    `inside` (N,): samples that lie within another part; `area` of each sample.
    """
    seen = np.flatnonzero(own & ~inside)
    if len(seen) < _FEWEST:
        return None
    positions = samples.positions[seen]
    anchor = _anchors(samples, own, inside)
    to_anchor = cKDTree(anchor).query(positions)[0]
    at_root = np.argsort(to_anchor, kind="stable")[: max(6, int(_AT_ROOT * len(seen)))]
    heights = _distances(positions, at_root)
    heights /= max(float(heights.max()), 1e-9)
    root = positions[at_root].mean(0)
    centres, axes = _middle_line(positions, heights, root)
    turns, across = _angles_about_line(positions, heights, centres, axes)
    radius = float(np.linalg.norm(positions[at_root] - root, axis=1).mean())
    return GoalPart(positions, heights, turns, root, axes[0], across, radius, area * len(seen))


def _anchors(samples: Samples, own: Flags, inside: Flags) -> Floats:
    """Return the points at which a part hangs: what of it lies within others, or what of others is nearest."""
    hidden = own & inside
    if hidden.sum() >= 3:
        return samples.positions[hidden]
    others = samples.positions[~own & ~inside]
    near = np.argsort(cKDTree(samples.positions[own]).query(others)[0], kind="stable")[:6]
    return np.asarray(others[near])


def _distances(positions: Floats, start: Index) -> Floats:
    """Return the distances (N,) of points from some of them, over the nearest neighbours of each."""
    far, near = cKDTree(positions).query(positions, k=min(_NEIGHBOURS + 1, len(positions)))
    rows = np.repeat(np.arange(len(positions)), near.shape[1] - 1)
    graph = sparse.csr_matrix((far[:, 1:].ravel() + 1e-9, (rows, near[:, 1:].ravel())), (len(positions),) * 2)
    found = csgraph.dijkstra(graph, directed=False, indices=start, min_only=True)
    known = np.isfinite(found)
    # Islands of samples count by their distance in space.
    islands = cKDTree(positions[known]).query(positions[~known])
    found[~known] = found[known][islands[1]] + islands[0]
    return np.asarray(found)


def _middle_line(positions: Floats, heights: Floats, root: Floats) -> tuple[Floats, Floats]:
    """Return the centres (B, 3) of slices of a limb by height, from the root on, and the line's directions there."""
    edges = np.quantile(heights, np.linspace(0, 1, _BINS + 1))
    slices = np.clip(np.searchsorted(edges, heights, side="right") - 1, 0, _BINS - 1)
    count = np.maximum(np.bincount(slices, minlength=_BINS), 1)
    centres = np.stack([np.bincount(slices, positions[:, axis], _BINS) for axis in range(3)], 1) / count[:, None]
    line = np.concatenate([root[None], centres])
    for _ in range(2):
        line[1:-1] = 0.25 * line[:-2] + 0.5 * line[1:-1] + 0.25 * line[2:]
    ahead = np.gradient(line, axis=0)
    return line, ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)


def _angles_about_line(positions: Floats, heights: Floats, centres: Floats, axes: Floats) -> tuple[Floats, Floats]:
    """Return cosine and sine (N, 2) of the points' angles about the line, and the frame (2, 3) at its start."""
    first = np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))])
    frames = [np.stack([first, np.cross(axes[0], first)]) / np.linalg.norm(first)]
    for before, after in pairwise(axes):
        frames.append(frames[-1] @ _least_turn(before, after).T)
    middles = np.concatenate([[0.0], np.quantile(heights, (np.arange(len(centres) - 1) + 0.5) / (len(centres) - 1))])
    at = np.interp(heights, middles, np.arange(len(centres)))
    below = np.minimum(at.astype(np.int64), len(centres) - 2)
    share = (at - below)[:, None]
    offset = positions - ((1 - share) * centres[below] + share * centres[below + 1])
    nearest = np.stack(frames)[np.minimum(np.rint(at).astype(np.int64), len(centres) - 1)]
    turned = np.einsum("nkj,nj->nk", nearest, offset)
    return turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12), frames[0]


def _least_turn(one: Floats, two: Floats) -> Floats:
    """Return the least rotation (3, 3) that takes a unit vector to another."""
    across, cosine = np.cross(one, two), float(one @ two)
    cross = np.array([[0, -across[2], across[1]], [across[2], 0, -across[0]], [-across[1], across[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / max(1 + cosine, 1e-6))


@dataclass(frozen=True)
class Sprout:
    """The patch of a limb: its vertices (P,) int64, and where they start (P, 3)."""

    verts: Index
    start: Floats


@dataclass(frozen=True)
class Ground:
    """The surface on which limbs grow: vertices (V, 3), unit normals, areas (V,) about them, edges (E, 2)."""

    verts: Floats
    normals: Floats
    areas: Floats
    edges: Index

    @classmethod
    def of(cls, verts: Floats, faces: Index) -> Ground:
        """Return the ground that faces (F, 3) make."""
        areas = np.zeros(len(verts))
        for corner in range(3):
            np.add.at(areas, faces[:, corner], np.linalg.norm(face_cross(verts, faces), axis=1) / 6)
        return cls(verts, vertex_normals(verts, faces), areas, edges_of(faces).edges)


@dataclass(frozen=True)
class Seat:
    """Where a limb sprouts: its middle vertex, the least radius of its patch, and the shift (3,) of the limb."""

    middle: int
    radius: float
    shift: Floats


def seat_of(limb: GoalPart, ground: Ground, before: Ground, parent: Index) -> Seat | None:
    """Return where a limb sprouts from a parent, vertices (C,); None where nothing faces its way.

    `ground` is fitted to the goal without the limb, `before` is the same surface as it was. What stuck out there, near
    the root and along the limb, and has been flattened, is what it grows from: an ear that nobody had named.
    """
    facing = parent[ground.normals[parent] @ limb.axis > _FACING]
    if not len(facing):
        return None
    apart = np.linalg.norm(ground.verts - limb.root, axis=1)
    flattened = (before.verts - ground.verts) @ limb.axis
    flattened -= np.median(flattened[parent])
    beside = np.abs(before.verts[parent, 0] - limb.root[0])
    near = parent[(apart[parent] < _SEARCH * limb.radius + _SEARCH_MORE) & (beside < _BESIDE)]
    if len(near):
        middle = int(near[(flattened[near] - 0.5 * apart[near]).argmax()])
        if flattened[middle] > max(_STUCK_OUT, 0.5 * apart[middle]):
            return Seat(middle, max(limb.radius, 1.2 * float(flattened[middle])), np.zeros(3))
    middle = int(facing[apart[facing].argmin()])
    normal = ground.normals[middle]
    return Seat(middle, limb.radius, normal * float((ground.verts[middle] - limb.root) @ normal))


def sprouted(limb: GoalPart, seat: Seat, before: Ground, parent: Index, share: float, rivals: Floats) -> Sprout:
    """Lay the patch of a limb on it.

    Parameters
    ----------
    seat : Seat
    before : Ground
        The surface on which the patch is measured.
    parent : array (C,) int64
        Vertices of the part on which the limb grows.
    share : float
        Area of the patch relative to that of the parent.
    rivals : array (R, 3) float64
        Middles of the patches of other limbs.
    """
    centre = before.verts[seat.middle]
    apart = before.verts[parent] - centre
    toward = rivals - centre
    halves = np.linalg.norm(toward, axis=1) / 2
    gone = apart @ (toward / np.maximum(2 * halves, 1e-12)[:, None]).T
    sideward = (gone / np.maximum((1 - _FREE) * halves, 1e-12)).max(1, initial=0.0)
    far = np.linalg.norm(apart, axis=1)
    order = np.argsort(np.where(sideward < 1, far, np.inf), kind="stable")
    covered = np.cumsum(before.areas[parent][order])
    wanted = float(far[order][min(int(np.searchsorted(covered, min(share, _MOST) * covered[-1])), len(order) - 1)])
    enough = float(far[order][min(_ENOUGH, len(order) - 1)])
    radius = max(min(wanted, max(_WIDER * seat.radius, enough)), seat.radius)
    outward = np.maximum(far / radius, sideward)
    patch = _piece(parent[outward < 1], seat.middle, before.edges, len(before.verts))
    distance = np.full(len(before.verts), np.inf)
    distance[parent] = outward
    order = np.argsort(distance[patch], kind="stable")
    beyond = np.empty(len(patch))
    whole = np.cumsum(before.areas[patch][order])
    beyond[order] = (whole - before.areas[patch][order]) / max(float(whole[-1]), 1e-30)
    turned = (before.verts[patch] - centre) @ limb.across.T
    turns = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
    return Sprout(patch, limb.points_at(np.quantile(limb.heights, 1 - beyond), turns) + seat.shift)


def _piece(patch: Index, middle: int, edges: Index, count: int) -> Index:
    """Return the vertices of a patch that hang together with its middle one."""
    within = np.zeros(count, bool)
    within[patch] = True
    within[middle] = True
    piece = connected(count, edges[within[edges].all(1)])
    return np.flatnonzero(within & (piece == piece[middle]))
