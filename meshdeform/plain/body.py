"""The asset as it stands: its welded vertices, what moves with which joint, its names, and where its sides are.

Up is +Y. Names that say left, right, front or rear tell the front; else the lateral axis is the normal of the mirror
plane, found on points spread over the surface with their normals, and the front axis is the third. Where both planes
are alike, the body's reading decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.assets import Asset
from meshdeform.geometry.coincidence import WELD_TOLERANCE, coincident
from meshdeform.geometry.folds import FaceNeighbours
from meshdeform.geometry.mesh import face_cross
from meshdeform.plain.names import sides_of, tokens
from meshdeform.plain.reader import Reader
from meshdeform.reading.cells import connected
from meshdeform.reading.result import UP_TURNS

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

UP = 1
_SAMPLES = 2500
_MOST_NAMES = 400
_MIRRORED = 0.004
"""Distance, as a share of the diagonal, up to which a vertex has a mirror image."""
_CLEARLY = 0.8
"""Share of the asymmetry about the middle of the box, below which another plane is better."""
_NEARLY, _MOST_PIECES = 0.02, 64
"""Distance, likewise, up to which pieces are nearly in touch; how many are compared vertex by vertex."""
_APART = 0.05
"""Distance, likewise, from which the middles of what names call front and rear, or left and right, tell them apart."""
_ALIKE = 1.15
"""Ratio of the asymmetries about two planes up to which neither is clearly the mirror plane."""


def step(t: Floats) -> Floats:
    """Return a smooth step from 0 at 0 to 1 at 1."""
    t = np.clip(t, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def ease(t: Floats, soft: float = 0.25) -> Floats:
    """Return 0 to 1 with a constant slope between two soft ends."""
    t, most = np.clip(t, 0, 1), 1 / (1 - soft)
    rising, falling = most * t * t / (2 * soft), 1 - most * (1 - t) ** 2 / (2 * soft)
    return np.where(t < soft, rising, np.where(t > 1 - soft, falling, most * (t - soft / 2)))


@dataclass(frozen=True)
class Joint:
    """A joint: its name, and the index of the joint above it in the list, or -1."""

    name: str
    parent: int


@dataclass(frozen=True)
class Body:
    """A welded surface as viewers show it."""

    points: Floats  # (V, 3) float64: +Y up
    faces: Index  # (F, 3) int64
    names: Mapping[str, Flags]  # mapping of str to (V,) bool: the vertices of each node and material that has a name
    joints: Sequence[Joint]
    weights: sparse.csr_matrix  # sparse (V, J) float64: how much each vertex follows each joint
    vertex_map: Index  # (N,) int64: the vertex of each row of the asset's surface, or -1
    rows: Index  # (V,) int64: a row of each vertex
    unit: float | None = None  # metres of its unit of length; None if its format has none
    up: str | None = "y"  # the axis that points up, `y` or `z`; None if its format leaves that open
    reader: Reader = field(default_factory=Reader)  # finds its noun, its front and its parts
    painted: Mapping[str, Flags] = field(default_factory=dict)
    """Mapping of str to (F,) bool: the faces that somebody said belong to a part."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """The name that somebody gave to a part which was found under another one; two may get the same."""
    turn: Floats | None = None  # (3, 3) float64: the rotation that stood it up; None if it stands as in its file

    def moved(self, points: Floats) -> Body:
        """Return the body with its vertices elsewhere."""
        return replace(self, points=points)

    def upright(self) -> Body:
        """Return the body with +Y up, if it has +Z up, or was read to have it where its format leaves that open."""
        up = self.up
        if up is None and self.reader.reading is not None:
            up = "z" if self.reader.reading.up == "+Z" else "y"
        if self.turn is not None or up != "z":
            return self
        turn = UP_TURNS["+Z"]
        return replace(self, points=self.points @ turn.T, turn=turn)

    def without_joints(self) -> Body:
        """Return the body as if it had no skeleton."""
        return replace(self, joints=[], weights=sparse.csr_matrix((len(self.points), 0)))

    @cached_property
    def low(self) -> Floats:
        """Its least coordinates, (3,)."""
        return np.asarray(self.points.min(0))

    @cached_property
    def size(self) -> Floats:
        """The sides of its box, (3,)."""
        return np.asarray(np.ptp(self.points, axis=0))

    @property
    def ground(self) -> float:
        """Height of its lowest point."""
        return float(self.low[UP])

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of its box."""
        return float(np.linalg.norm(self.size))

    @cached_property
    def corners(self) -> Floats:
        """The corners of its faces, (F, 3, 3)."""
        return np.asarray(self.points[self.faces])

    @cached_property
    def crosses(self) -> Floats:
        """The normals of its faces with twice their area as length, (F, 3)."""
        return face_cross(self.points, self.faces)

    def flipped(self, points: Floats) -> Flags:
        """Return which faces (F,) with an area turn over if the vertices are at other points (V, 3)."""
        thick = np.linalg.norm(self.crosses, axis=1) > 1e-9 * self.diagonal**2
        return np.asarray(thick & (np.einsum("fi,fi->f", face_cross(points, self.faces), self.crosses) < 0))

    @cached_property
    def neighbours(self) -> FaceNeighbours:
        """The neighbours of its faces, which tell folds."""
        return FaceNeighbours(self.faces, self.points)

    @cached_property
    def edges(self) -> sparse.csr_matrix:
        """Which vertices are neighbours, (V, V) of 0 and 1."""
        ends = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]])
        both = np.concatenate([ends, ends[:, ::-1]])
        graph = sparse.csr_matrix((np.ones(len(both)), tuple(both.T)), shape=(len(self.points),) * 2)
        graph.data[:] = 1
        return graph

    @cached_property
    def components(self) -> Index:
        """The connected component of each vertex, (V,)."""
        return np.asarray(csgraph.connected_components(self.edges, directed=False)[1], np.int64)

    def groups(self, flags: Flags) -> list[Index]:
        """Return the rows of the connected pieces of some vertices; pieces that are nearly in touch count as one."""
        key = np.packbits(flags).tobytes()
        if key not in self._groups:
            self._groups[key] = self._find_groups(np.flatnonzero(flags))
        return self._groups[key]

    @cached_property
    def _groups(self) -> dict[bytes, list[Index]]:
        return {}

    def _find_groups(self, rows: Index) -> list[Index]:
        _, labels = csgraph.connected_components(self.edges[rows][:, rows], directed=False)
        pieces = [rows[labels == k] for k in range(labels.max() + 1)] if len(rows) else []
        if len(pieces) <= 1:
            return pieces
        if len(pieces) > _MOST_PIECES:
            return self._joined(rows, labels)
        trees, reach = [cKDTree(self.points[piece]) for piece in pieces], _NEARLY * self.diagonal
        low, high = (np.array([bound(self.points[piece], axis=0) for piece in pieces]) for bound in (np.min, np.max))
        near = np.tril((low[:, None] <= high + reach).all(2) & (low <= high[:, None] + reach).all(2), -1)
        for i, j in np.argwhere(near):
            near[i, j] = trees[i].query(self.points[pieces[j]], distance_upper_bound=reach)[0].min() < reach
        _, owner = csgraph.connected_components(near, directed=False)
        return [
            np.concatenate([piece for piece, k in zip(pieces, owner, strict=True) if k == group])
            for group in range(owner.max() + 1)
        ]

    def _joined(self, rows: Index, labels: Index) -> list[Index]:
        """Return vertices with the numbers of many pieces by groups of pieces of which a vertex of each is near."""
        reach = _NEARLY * self.diagonal
        cells = np.floor((self.points[rows] - self.low) / (reach / 2)).astype(np.int64)
        first = np.unique(np.column_stack([cells, labels]), axis=0, return_index=True)[1]
        pairs = labels[first][cKDTree(self.points[rows[first]]).query_pairs(reach, output_type="ndarray")]
        count = int(labels.max()) + 1
        owner = connected(count, pairs)[labels]
        return [rows[owner == group] for group in range(int(owner.max()) + 1)]

    def nearest(self, pieces: list[Index]) -> Index:
        """Return the number of the piece nearest to each vertex, (V,)."""
        if not pieces:
            return np.zeros(len(self.points), np.int64)
        owner = cKDTree(np.concatenate([self.points[piece] for piece in pieces])).query(self.points)[1]
        return np.asarray(np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])[owner])

    def samples(self, count: int) -> tuple[Floats, Floats]:
        """Return points (count, 3) spread over the surface by area, and their unit normals; always the same."""
        positions, normals, _ = self.sampled(count)
        return positions, normals

    def sampled(self, count: int) -> tuple[Floats, Floats, Index]:
        """Return points (count, 3) spread over the surface by area, their unit normals, and their faces (count,)."""
        areas = np.linalg.norm(self.crosses, axis=1)
        ends = np.cumsum(areas)
        at = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1]).clip(0, len(areas) - 1)
        u = np.random.default_rng(0).random((count, 2))
        u = np.where(u.sum(1, keepdims=True) > 1, 1 - u, u)
        shares = np.column_stack([1 - u.sum(1), u])
        normals = self.crosses[at] / np.maximum(areas[at, None], 1e-300)
        return (self.corners[at] * shares[:, :, None]).sum(1), normals, at

    @cached_property
    def _mirrors(self) -> dict[int, tuple[float, float]]:
        """How far the surface is from its mirror image across both upright planes, and where these are on their axes.

        As a share of the diagonal. The planes are in the middle of the box, or, if that is clearly better, of the
        surface: an animal may turn its head.
        """
        positions, normals = self.samples(_SAMPLES)
        reach = 0.1 * self.diagonal
        tree = cKDTree(np.hstack([positions, reach * normals]))
        mirrors = {}
        for axis in (0, 2):
            found = []
            middle = float(self.low[axis] + self.size[axis] / 2)
            for at in (middle, float(positions[:, axis].mean()), float(np.median(positions[:, axis]))):
                images, across = positions.copy(), normals.copy()
                images[:, axis] = 2 * at - images[:, axis]
                across[:, axis] *= -1
                distance = tree.query(np.hstack([images, reach * across]))[0]
                found.append((float(np.median(distance) + distance.mean()) / self.diagonal, at))
            mirrors[axis] = min(found) if min(found)[0] < _CLEARLY * found[0][0] else found[0]
        return mirrors

    @cached_property
    def lateral(self) -> int:
        """The axis from side to side."""
        if self.named_front is not None:
            return 2 - self.named_front[0]
        sideways, along = self._mirrors[0][0], self._mirrors[2][0]
        if max(sideways, along) <= _ALIKE * min(sideways, along) and self.read_front is not None:
            return 2 - self.read_front[0]
        return 0 if sideways <= _ALIKE * along else 2

    @cached_property
    def read_front(self) -> tuple[int, int] | None:
        """The axis and the sign of the front that the body's reading found; None if it is not sure of it."""
        reading = self.reader.reading
        if reading is None or not reading.front_sure:
            return None
        forward = reading.turn[2] if self.turn is None else self.turn @ reading.turn[2]
        level = forward * [1, 0, 1]
        axis = int(np.argmax(np.abs(level)))
        return axis, int(np.sign(level[axis]))

    @cached_property
    def named_front(self) -> tuple[int, int] | None:
        """The axis and the sign of the front, if names of nodes, materials or joints say where it is."""
        masses: dict[str, Floats] = {}
        shares = self.weights.tocsc()
        named = [(joint.name, shares[:, [number]].toarray().ravel()) for number, joint in enumerate(self.joints)]
        named += [(name, flags.astype(float)) for name, flags in self.names.items() if not flags.all()]
        for name, mass in named:
            for side in sides_of(name):
                masses[side] = np.asarray(masses.get(side, np.zeros(len(self.points))) + mass)
        positions = {side: mass @ self.points / mass.sum() for side, mass in masses.items() if mass.sum() > 0}
        middle = self.low + self.size / 2
        forward = positions.get("front", middle) - positions.get("rear", middle)
        leftward = positions["left"] - positions["right"] if {"left", "right"} <= set(positions) else np.zeros(3)
        # What is left of something that looks along +Z is at +X.
        for vector in (forward, np.array([-leftward[2], 0.0, leftward[0]])):
            level = vector * [1, 0, 1]
            axis = int(np.argmax(np.abs(level)))
            if abs(level[axis]) > _APART * self.diagonal:
                return axis, int(np.sign(level[axis]))
        return None

    @property
    def front(self) -> int:
        """The axis from front to back."""
        return 2 - self.lateral

    @cached_property
    def middle(self) -> float:
        """Where the mirror plane is on the lateral axis."""
        return self._mirrors[self.lateral][1]

    @cached_property
    def partners(self) -> Index | None:
        """The mirror image of each vertex, (V,), -1 where there is none; None if the whole is not symmetric."""
        images = self.points.copy()
        images[:, self.lateral] = 2 * self.middle - images[:, self.lateral]
        distance, partner = cKDTree(self.points).query(images)
        if np.median(distance) + distance.mean() > 0.01 * self.diagonal:
            return None
        return np.where(distance < _MIRRORED * self.diagonal, partner, -1).astype(np.int64)

    def symmetric(self, moved: Floats) -> Floats:
        """Return displacements (V, 3) averaged with those of the mirror images."""
        if self.partners is None:
            return moved
        paired, images = self.partners >= 0, moved.copy()
        images[paired] = moved[self.partners[paired]]
        images[paired, self.lateral] *= -1
        return np.asarray((moved + images) / 2)

    def smooth(self, values: Floats, rounds: int) -> Floats:
        """Return values (V,) averaged with their neighbours so many times."""
        degree = np.asarray(self.edges.sum(1)).ravel()
        for _ in range(rounds):
            values = np.where(degree > 0, 0.5 * values + 0.5 * (self.edges @ values) / np.maximum(degree, 1), values)
        return values


def body_of(asset: Asset, vertex_map: Index, rows: Index, faces: Index) -> Body:
    """Return the body of an asset whose vertices were welded.

    `vertex_map`, (N,) int64: the welded vertex of each row of the surface, or -1; `rows`, (V,) int64: a row of each
    welded vertex; `faces`, (F, 3) int64: of welded vertices.
    """
    parts, count = asset.pieces(), len(rows)
    at, nodes, shares = asset.joint_shares()
    numbers = {joint["index"]: number for number, joint in enumerate(parts.joints)}
    known = np.isin(nodes, list(numbers))
    at, nodes, shares = at[known], nodes[known], shares[known]
    # Of vertices that are one, the first row counts, as for their positions.
    chosen = (vertex_map[at] >= 0) & (rows[vertex_map[at]] == at)
    columns = np.array([numbers[int(node)] for node in nodes[chosen]], np.int64)
    weights = sparse.csr_matrix((shares[chosen], (vertex_map[at[chosen]], columns)), shape=(count, len(numbers)))
    total = np.asarray(weights.sum(1)).ravel()
    weights = sparse.diags(1 / np.where(total > 0, total, 1)) @ weights
    parents = {child: node for node, children in parts.children.items() for child in children}
    joints = [Joint(each["name"], _joint_above(each["index"], parents, numbers)) for each in parts.joints]
    return Body(
        asset.surface.positions[rows],
        faces,
        _names(asset, vertex_map, count),
        joints,
        weights.tocsr(),
        vertex_map,
        rows,
        asset.unit,
        asset.up,
    )


def loose_body(asset: Asset, *, backdrop: bool = False) -> Body:
    """Return the body of an asset as a job would weld it, without torch; `backdrop`: with one that it has."""
    surface = asset.surface
    visible = np.ones(len(surface.triangles), bool)
    if asset.backdrop is not None and asset.backdrop.left and not backdrop:
        visible = ~asset.backdrop.triangles
    used = np.unique(surface.triangles[visible])
    points = surface.positions[used]
    first = coincident(points, WELD_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0))))
    kept, numbers = np.unique(first, return_inverse=True)
    vertex_map = np.full(len(surface.positions), -1, np.int64)
    vertex_map[used] = numbers
    corners = vertex_map[surface.triangles[visible]]
    solid = (corners != np.roll(corners, 1, axis=1)).all(1)
    return body_of(asset, vertex_map, used[kept], corners[solid])


def _joint_above(node: int, parents: Mapping[int, int], numbers: Mapping[int, int]) -> int:
    """Return the number of the next joint above a node, or -1."""
    while node in parents:
        node = parents[node]
        if node in numbers:
            return numbers[node]
    return -1


def _names(asset: Asset, vertex_map: Index, count: int) -> dict[str, Flags]:
    """Return the welded vertices of named nodes and materials, those of one name together."""
    parts, corners = asset.pieces(), vertex_map[asset.surface.triangles]
    named = [(each, parts.in_node) for each in parts.nodes] + [(each, parts.of_material) for each in parts.materials]
    names: dict[str, Flags] = {}
    for each, triangles_of in named[:_MOST_NAMES]:
        if not tokens(each["name"]):
            continue
        flags = names.setdefault(each["name"], np.zeros(count, bool))
        own = corners[triangles_of(each["index"])].ravel()
        flags[own[own >= 0]] = True
    return names
