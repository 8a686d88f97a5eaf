"""Hold one member of a family as a supplier of parts: its surface in the frame, its parts, and where they touch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.assets import Asset
from meshdeform.geometry.copies import first_alike
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.geometry.surface_samples import even_samples, samples_of
from meshdeform.kinds.families.boundary import components, welded
from meshdeform.kinds.families.family_file import FamilyFile

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_TOUCH = 0.02
"""Distance, in diagonals, within which parts of a member touch."""
_SPACING = 0.02
_SITE = 0.06
_PER_SITE, _CELL = 24, 0.008
_GROUND = 0.01
_OPPOSITE = 0.2
ONE_SIDE, _ASIDE = 0.8, 0.005
"""Length of a mean of normals above which a place has one side, and how far aside of it counts, in diagonals."""
_TIED, _DENSE = 0.008, 20_000
"""Pieces of one part move together if samples of them are no farther apart than this, in diagonals; most samples."""


def turned(vectors: _Floats, angle: float) -> _Floats:
    """Turn vectors (N, 3) around +Y, as `families.collection.rotated` does."""
    if angle == 0:
        return vectors
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = vectors.T
    return np.stack([cos * x + sin * z, y, cos * z - sin * x], 1)


@dataclass(frozen=True)
class Contact:
    """One place where a part touches another one."""

    points: _Floats  # (P, 3) float64: on the part, in the frame
    patches: _Index  # (P,) int64: the patch of the part of each
    offsets: _Floats  # (P, 3) float64: from the nearest place on the other part to the point
    normals: _Floats  # (P, 3) float64: of the other part there
    depth: float  # how far the part goes beyond the other's surface (`depth_beyond`)


class PlacedSurface:
    """A surface (V, 3), (F, 3) in its place, to find the nearest places on it.

    `sided`: whether normals tell its sides apart; a search that does not know them takes far longer if they do.
    """

    def __init__(self, verts: _Floats, faces: _Index, *, sided: bool = True) -> None:
        cross = np.cross(verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]])
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        solid = length[:, 0] > 1e-15
        self.verts, self.faces = verts, faces[solid]
        self.normals = cross[solid] / length[solid]
        opposite = _OPPOSITE if sided else 0.0
        self._tree = SurfaceTree(verts, self.faces, self.normals, spacing=_SPACING, opposite=opposite)

    def nearest(self, points: _Floats, normals: _Floats) -> tuple[_Index, _Floats, _Floats]:
        """Return the nearest face (P,), its weights (P, 3) and the place (P, 3); `normals` tell sides apart."""
        face, weights = self._tree.find(points, normals)
        return face, weights, np.einsum("pc,pcd->pd", weights, self.verts[self.faces[face]])


@dataclass(frozen=True)
class MemberPart:
    """One part of a member."""

    triangles: NDArray[np.bool_]  # (F,) bool: which triangles of the member it has
    rows: _Index  # (V,) int64: the vertices that it uses
    verts: _Floats  # (V, 3) float64: in the frame
    faces: _Index  # (G, 3) int64
    patches: _Index  # (V,) int64: connected patch of each vertex
    area: float

    def beside(self, points: _Floats, patches: _Index, verts: _Floats | None = None) -> tuple[_Floats, _Floats]:
        """Return points on one patch, and the vertices of that patch, where they are or moved to others (V, 3)."""
        return points, (self.verts if verts is None else verts)[self.patches == patches[0]]


class MemberShape:
    """One member of a family."""

    def __init__(self, family: FamilyFile, number: int, asset: Asset) -> None:
        self.asset, self.number = asset, number
        self.turn, self.diagonal = float(family.turns[number]), float(family.diagonals[number])
        self.centre, self.segments = family.centres[number], family.segments[number]
        self.frame = turned((asset.surface.positions - self.centre) / self.diagonal, self.turn)
        self._corners = welded(asset.surface.positions, asset.surface.triangles)
        self._parts: dict[int, MemberPart] = {}
        self._contacts: dict[tuple[int, int], list[Contact]] = {}
        self._feet: dict[int, list[Contact]] = {}

    @cached_property
    def present(self) -> list[int]:
        """The numbers of its parts."""
        return [int(part) for part in np.unique(self.segments)]

    def part(self, number: int) -> MemberPart:
        """Return one of its parts."""
        if number not in self._parts:
            chosen = self.segments == number
            rows, faces = np.unique(self.asset.surface.triangles[chosen], return_inverse=True)
            faces = faces.reshape(-1, 3)
            corners = np.unique(self._corners[chosen], return_inverse=True)[1].reshape(-1, 3)
            verts = self.frame[rows]
            pieces = components(int(corners.max()) + 1, np.concatenate([corners[:, :2], corners[:, 1:]]))
            pieces = _tied(verts, faces, pieces[corners[:, 0]])[pieces]
            patches = np.zeros(len(rows), np.int64)
            patches[faces] = pieces[corners]
            cross = np.cross(verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]])
            area = float(np.linalg.norm(cross, axis=1).sum() / 2)
            self._parts[number] = MemberPart(chosen, rows, verts, faces, patches, area)
        return self._parts[number]

    def contacts(self, part: int, other: int) -> list[Contact]:
        """Return where a part touches another one of this member, each connected place by itself."""
        if (part, other) not in self._contacts:
            both = part in self.present and other in self.present
            self._contacts[part, other] = self._touching(part, other) if both else []
        return self._contacts[part, other]

    def feet(self, part: int) -> list[Contact]:
        """Return where a part stands on the ground of this member, each connected place by itself."""
        if part not in self._feet:
            own, ground = self.part(part), float(self.frame[:, 1].min())
            near = np.flatnonzero(own.verts[:, 1] < ground + _GROUND)
            offsets, normals = np.zeros((len(near), 3)), np.tile([0.0, 1.0, 0.0], (len(near), 1))
            offsets[:, 1] = own.verts[near, 1] - ground
            self._feet[part] = [
                Contact(own.verts[rows], own.patches[rows], offsets[at], normals[at], 0.0)
                for at in _places(own.verts[near], own.patches[near])
                for rows in (near[at],)
            ]
        return self._feet[part]

    def of_one_piece(self, part: int, other: int) -> bool:
        """Return whether two parts are of one piece of the mesh, cut apart along its edges."""
        return bool(np.intersect1d(*(self._corners[self.segments == each] for each in (part, other))).size)

    def _touching(self, part: int, other: int) -> list[Contact]:
        own, of_other = self.part(part), self.part(other)
        if own.area <= 0 or of_other.area <= 0:
            return []
        points, faces = samples_of(own.verts, own.faces, _SPACING)
        points, patches = (
            np.concatenate([points, own.verts]),
            np.concatenate([own.patches[own.faces[faces, 0]], own.patches]),
        )
        low, high = of_other.verts.min(0) - _TOUCH, of_other.verts.max(0) + _TOUCH
        inside = ((points > low) & (points < high)).all(1)
        points, patches = points[inside], patches[inside]
        if not len(points):
            return []
        surface = PlacedSurface(of_other.verts, of_other.faces, sided=False)
        face, _, place = surface.nearest(points, np.zeros_like(points))
        near = np.flatnonzero(np.linalg.norm(points - place, axis=1) < _TOUCH)
        if not len(near):
            return []
        touching = []
        for at in _places(points[near], patches[near]):
            rows = near[at]
            offsets, normals = points[rows] - place[rows], surface.normals[face[rows]]
            depth = depth_beyond(surface, own.beside(points[rows], patches[rows]), normals)
            touching.append(Contact(points[rows], patches[rows], offsets, normals, depth))
        return touching


def _places(points: _Floats, patches: _Index) -> list[_Index]:
    """Return the rows of at most `_PER_SITE` points of each connected place, on one patch; one point a cell counts."""
    if not len(points):
        return []
    rows = first_alike(np.column_stack([np.floor(points / _CELL).astype(np.int64), patches]))
    pairs = cKDTree(points[rows]).query_pairs(_SITE, output_type="ndarray")
    pairs = pairs[patches[rows[pairs[:, 0]]] == patches[rows[pairs[:, 1]]]]
    site = components(len(rows), pairs)
    every = (rows[site == each] for each in range(int(site.max()) + 1))
    return [each[:: max(1, len(each) // _PER_SITE)] for each in every]


def depth_beyond(surface: PlacedSurface, points: tuple[_Floats, _Floats], normals: _Floats) -> float:
    """Return how far a part goes beyond a surface where the two touch; 0 where no side of the surface is the other.

    Parameters
    ----------
    points : ((P, 3), (Q, 3)) float64
        Those that touch, and those of the part around them, which count where they are no farther aside.
    normals : (P, 3) float64
        Of the surface.
    """
    touching, around = points
    normal = normals.mean(0)
    if np.linalg.norm(normal) < ONE_SIDE:
        return 0.0
    normal /= np.linalg.norm(normal)
    place = surface.nearest(touching, normals)[2].mean(0)
    away = around - touching.mean(0)
    near = around[np.linalg.norm(away - (away @ normal)[:, None] * normal, axis=1) <= reach_aside(touching, normal)]
    return float(((place - np.concatenate([touching, near])) @ normal).max())


def reach_aside(points: _Floats, normal: _Floats) -> float:
    """Return how far aside of the mean of points (P, 3), on the plane of a unit normal, parts count as beside them."""
    away = points - points.mean(0)
    return float(np.linalg.norm(away - (away @ normal)[:, None] * normal, axis=1).max()) + _ASIDE


def _tied(verts: _Floats, faces: _Index, pieces: _Index) -> _Index:
    """Return for each piece of a part, by number, the group of pieces that touch; `pieces` (F,) are those of faces."""
    count = int(pieces.max()) + 1
    if count == 1:
        return np.zeros(1, np.int64)
    corners = verts[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2 + 1e-12
    owners, weights = even_samples(areas, int(min(4 * areas.sum() / _TIED**2, _DENSE)) + 1, 0)
    of_verts = np.zeros(len(verts), np.int64)
    of_verts[faces] = np.arange(len(faces))[:, None]
    points = np.concatenate([np.einsum("pc,pcd->pd", weights, corners[owners]), verts])
    owners = np.concatenate([owners, of_verts])
    once = first_alike(np.column_stack([np.floor(points / (_TIED / 2)).astype(np.int64), pieces[owners]]))
    pairs = pieces[owners[once[cKDTree(points[once]).query_pairs(_TIED, output_type="ndarray")]]]
    return components(count, pairs[pairs[:, 0] != pairs[:, 1]])
