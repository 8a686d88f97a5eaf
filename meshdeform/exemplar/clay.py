"""Mould a lump without parts, such as a ball, a block or a capsule, into a member of a noun.

The outer surface of the member (`outer_surface.py`) is mapped to the sphere, one to one (`spherical.py`), and turned so
that directions and points agree best. A vertex of the lump goes to the sphere by its direction from a centre that sees
all of the lump, and from there to the member's surface. A mirrored member stays mirrored: its one half is mapped to
half of the sphere. What the faces of the lump are too large for is smoothed (`unfolding.py`).

Source of the turn: Kabsch 1976, A solution for the best rotation to relate two sets of vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from meshdeform.exemplar.outer_surface import OuterSurface, outer_surface
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.spherical import sphere_map
from meshdeform.exemplar.unfolding import unfolded
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import connected_components, edges_of, face_areas, face_cross
from meshdeform.nouns.labels import Floats, Index

__all__ = ["Mould", "is_clay", "mould_of", "moulded"]

_HULL_AREA = 0.04
"""By how much the area of clay and that of its convex hull may differ."""
_HULL_VOLUME = 0.9
"""Share of its hull that clay fills at least."""
_VERTICES = 6000
"""Of the member's surface on the sphere; of a mirrored one, half as many."""
_WELD = 1e-7
_STEPS = 2000


@dataclass(frozen=True)
class Mould:
    """A surface on the unit sphere: `directions` (V, 3), `faces` (F, 3), and `positions` (V, 3) in space.

    With a `plane`, one half, for x >= 0 on the sphere; the other is its mirror image in x = plane.
    """

    directions: Floats
    faces: Index
    positions: Floats
    plane: float | None

    def points_at(self, directions: Floats) -> Floats:
        """Return the points (N, 3) for unit directions (N, 3)."""
        asked = directions.copy()
        if self.plane is not None:
            asked[:, 0] = np.abs(asked[:, 0])
        corners = self.directions[self.faces]
        middles = corners.sum(1)
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        found = cKDTree(middles).query(asked)[1].astype(np.int64)
        weights = np.zeros((len(asked), 3))
        _locate(asked, self.directions, self.faces, _opposite_faces(self.faces), found, weights)
        positions = np.einsum("nk,nkj->nj", weights, self.positions[self.faces[found]])
        if self.plane is not None:
            left = directions[:, 0] < 0
            positions[left, 0] = 2 * self.plane - positions[left, 0]
        return np.asarray(positions)


def is_clay(source: Shape) -> bool:
    """Return whether a surface is one lump without parts: closed, and nearly its convex hull."""
    verts, faces, _ = _welded(source.verts, source.faces)
    if len(faces) < 4 or (edges_of(faces).counts != 2).any() or connected_components(faces, len(verts)).any():
        return False
    try:
        hull = ConvexHull(verts)
    except QhullError:
        return False
    a, b, c = verts[faces].transpose(1, 0, 2)
    area = float(face_areas(verts, faces).sum())
    volume = float((a * np.cross(b, c)).sum()) / 6
    return abs(area / float(hull.area) - 1) < _HULL_AREA and volume > _HULL_VOLUME * float(hull.volume)


def moulded(source: Shape, goal: Shape) -> Floats:
    """Return the vertices (V, 3) of clay as those of a member's surface.

    Parameters
    ----------
    source : Shape
        What `is_clay` holds for.
    goal : Shape
        The member, of closed solids that face outward, placed where it is to be.
    """
    verts, faces, number = _welded(source.verts, source.faces)
    used = verts[np.unique(faces)]
    directions = verts - (used.min(0) + used.max(0)) / 2
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300)
    positions = mould_of(goal.verts, goal.faces).points_at(directions)
    return unfolded(verts, positions, faces)[number]


def mould_of(verts: Floats, faces: Index) -> Mould:
    """Return the outer surface of closed solids on the sphere."""
    surface = outer_surface(verts, faces)
    half = surface.plane is not None
    mapped = sphere_map(surface.verts, surface.faces, _VERTICES // (1 + half), mirrored=half)
    directions = mapped.directions @ _turn(surface, mapped.origin, mapped.directions, mapped.faces).T
    if half:
        directions[:, 0] = np.maximum(directions[:, 0], 0)
    return Mould(directions, mapped.faces, surface.positions[mapped.origin], surface.plane)


def _turn(surface: OuterSurface, origin: Index, directions: Floats, faces: Index) -> Floats:
    """Return the rotation (3, 3) that takes directions nearest to the points; about x where there is a mirror."""
    positions = surface.verts[origin]
    areas = np.linalg.norm(face_cross(positions, faces), axis=1)
    share = np.bincount(faces.ravel(), np.repeat(areas / (3 * areas.sum()), 3), len(positions))
    from_middle = positions - share @ positions
    spread = (from_middle * share[:, None]).T @ (directions - share @ directions)
    if surface.plane is not None:
        spread[0], spread[:, 0] = 0, 0
        spread[0, 0] = np.abs(spread).max()
    left, _, right = np.linalg.svd(spread)
    return np.asarray(left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right)


def _welded(verts: Floats, faces: Index) -> tuple[Floats, Index, Index]:
    """Return a mesh with vertices that coincide as one, without faces that lose an edge, and the number of each."""
    keys = np.rint(verts / (_WELD * max(float(np.ptp(verts, axis=0).max()), 1e-300))).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    joined = number.ravel()[faces]
    whole = (joined != np.roll(joined, 1, axis=1)).all(1)
    return verts[first], np.asarray(joined[whole]), np.asarray(number.ravel())


def _opposite_faces(faces: Index) -> Index:
    """Return the face (F, 3) on the other side of the edge opposite each corner; -1 if there is none."""
    count = int(faces.max()) + 1
    one, other = np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()
    keys, opposite = one * count + other, other * count + one
    order = np.argsort(keys)
    at = np.minimum(np.searchsorted(keys[order], opposite), len(keys) - 1)
    found = np.where(keys[order][at] == opposite, order[at] // 3, -1)
    return np.asarray(found.reshape(-1, 3))


@kernel
def _locate(asked: Floats, directions: Floats, faces: Index, across: Index, found: Index, weights: Floats) -> None:
    """Walk from the faces given to those that have the directions, and set their shares (N, 3) of the corners."""
    share = np.zeros(3)
    for number in range(len(asked)):
        d, f = asked[number], found[number]
        best, kept = -np.inf, f
        for _ in range(_STEPS):
            for k in range(3):
                a, b = directions[faces[f, (k + 1) % 3]], directions[faces[f, (k + 2) % 3]]
                share[k] = (
                    d[0] * (a[1] * b[2] - a[2] * b[1])
                    + d[1] * (a[2] * b[0] - a[0] * b[2])
                    + d[2] * (a[0] * b[1] - a[1] * b[0])
                )
            total = max(abs(share[0]) + abs(share[1]) + abs(share[2]), 1e-300)
            least = min(share[0], share[1], share[2]) / total
            if least > best:
                best, kept = least, f
                for k in range(3):
                    weights[number, k] = max(share[k], 0.0)
            if least >= 0:
                break
            after, worst = -1, 0.0
            for k in range(3):
                if share[k] < worst and across[f, k] >= 0:
                    after, worst = across[f, k], share[k]
            if after < 0:
                break
            f = after
        found[number] = kept
        total = max(weights[number, 0] + weights[number, 1] + weights[number, 2], 1e-300)
        for k in range(3):
            weights[number, k] /= total
