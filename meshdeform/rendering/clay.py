"""Draw clay with antialiased silhouettes, for what looks at shapes: the same picture as `shading`'s, without gradients.

A silhouette edge is one of the front or the back of a surface alone. Where it crosses the line between two pixel
centres, the pixel that is partly covered across the edge takes a share of the other's colour; of several edges between
two pixels, the nearest counts. The share depends on the position of the crossing (Laine et al. 2020, Modular
Primitives, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.mesh import MeshEdges, edges_of
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.visibility import FacePlanes, interpolated, nearest_faces

AMBIENT = 0.25
LIGHT = (-0.4, 0.6, 0.7)  # in the camera's frame: from the upper left behind the viewer
DEPTH_BIAS = 1e-4
"""By how much an edge must be nearer than the surface beyond it."""

_CANCELLED = 1e-5
"""Length of a sum of normals, relative to all their lengths, below which it has no direction."""
_EDGE_ON = 1e-5
"""Height of the eye above a face, relative to a length, below which its side is not sure."""
_ROUNDING = 2e-7
"""Twice an area below which it may be none."""
_FAR = 1048576.0
"""Clamp of pixel coordinates, far off the picture."""
_Floats = NDArray[np.float64]
_Singles = NDArray[np.float32]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


class ClayRenderer:
    """Renders states of one mesh; `faces` is (F, 3) int64."""

    def __init__(self, faces: _Index, size: int, supersample: int) -> None:
        self._faces, self._edges = faces, edges_of(faces)
        self._size, self._factor = size, supersample

    def render(self, verts: NDArray[np.floating], cameras: Cameras) -> _Singles:
        """Draw the mesh on a black background.

        Parameters
        ----------
        verts : (V, 3) floating
            Positions in the cameras' frame.

        Returns
        -------
        (B, size, size) float32 in [0, 1]: a quarter in shade, 1 where the surface faces the light.
        """
        verts, side = verts.astype(np.float32), self._size * self._factor
        clip = cameras.project(verts)
        found, depth = nearest_faces(clip, self._faces, side, side)
        surface = _Surface.of(verts, self._faces)
        heights = surface.planes.heights(cameras.eye)
        front = heights >= 0
        outlines = _silhouettes(self._edges, front, np.abs(heights) <= _EDGE_ON * surface.sizes + _ROUNDING)
        views = np.zeros((len(clip), side * side), np.float32)
        for b, picture in enumerate(views):
            pixels = np.flatnonzero(found[b].ravel() >= 0)
            face = found[b].ravel()[pixels]
            picture[pixels] = self._brightness(surface, clip[b], pixels, face, front[b], cameras.view[b, :3, :3])
            _blend(picture, *_shares(_crossings(clip[b], self._edges, outlines[b], side), depth[b]))
        square = (len(clip), self._size, self._factor, self._size, self._factor)
        return np.asarray(views.reshape(square).mean((2, 4)))

    def _brightness(
        self, surface: _Surface, clip: _Singles, pixels: _Index, face: _Index, front: _Flags, axes: _Singles
    ) -> _Singles:
        """Return the light (P,) on faces (P,) that are seen at pixels (P,)."""
        side = self._size * self._factor
        kept, which = np.unique(face, return_inverse=True)
        faces = self._faces[kept]
        normal = interpolated(clip, surface.normals, faces, pixels, which, side, side)
        thin = np.flatnonzero(surface.thin(faces)[which])
        normal[:, thin] = surface.normals[:, faces[which[thin]]].mean(-1)
        normal /= np.maximum(np.sqrt((normal**2).sum(0)), np.float32(1e-12))
        towards = (np.array(LIGHT) / np.linalg.norm(LIGHT) @ axes).astype(np.float32)
        cosine = (towards @ normal) * np.where(front[face], np.float32(1), np.float32(-1))
        return np.asarray(AMBIENT + (1 - AMBIENT) * np.maximum(cosine, 0), np.float32)


@dataclass(frozen=True)
class _Surface:
    """Vertices (V, 3), their unit normals (3, V), the planes of the faces, and about their areas (F,)."""

    verts: _Singles
    normals: _Singles
    planes: FacePlanes
    sizes: _Singles

    @classmethod
    def of(cls, verts: _Singles, faces: _Index) -> _Surface:
        """Return the surface with vertices (V, 3) and faces (F, 3)."""
        planes = FacePlanes.of(verts, faces)
        sizes = np.abs(planes.normals).sum(0)
        normals, most = np.zeros((3, len(verts))), np.zeros(len(verts))
        for corner in faces.T:
            most += np.bincount(corner, sizes, len(verts))
            for total, component in zip(normals, planes.normals, strict=True):
                total += np.bincount(corner, component, len(verts))
        length = np.linalg.norm(normals, axis=0)
        # Where faces and their backs cancel out, what is left is rounding.
        normals *= np.divide(1, length, out=np.zeros_like(length), where=length > _CANCELLED * most)
        return cls(verts, normals.astype(np.float32), planes, sizes)

    def thin(self, faces: _Index) -> _Flags:
        """Return which of faces (F, 3) have so little area that they count as none."""
        corners = self.verts[faces]
        edges = np.roll(corners, -1, 1) - corners
        longest = (edges**2).sum(2).max(1)
        return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= 2 * COLLAPSED_SHAPE * longest)


def _silhouettes(edges: MeshEdges, front: _Flags, edge_on: _Flags) -> list[_Index]:
    """Return the edges between a front and a back in each of B views, of faces seen edge-on, and the open ones.

    `front` and `edge_on` are (B, F). `_crossings` looks more closely.
    """
    found = []
    for fronts, unsure in zip(np.packbits(front, axis=0), np.packbits(edge_on, axis=0), strict=True):
        one, two = (fronts.take(each) for each in edges.faces.T)
        differ = one ^ two
        differ[~edges.consistent] ^= 255
        if unsure.any():
            differ |= unsure.take(edges.faces[:, 0]) | unsure.take(edges.faces[:, 1])
        differ[edges.faces[:, 1] < 0] = 255
        found += [np.flatnonzero(differ & (128 >> view)) for view in range(8)]
    return found[: len(front)]


@dataclass(frozen=True)
class _Crossings:
    """Where outlines cross lines of pixel centres: rows if they are steep, otherwise columns.

    `line` is the row or column, `along` how far along it, in pixels, and `depth` that of the edge; `plus`: whether the
    surface is on the side of the greater positions.
    """

    by_row: _Flags
    line: _Index
    along: _Floats
    depth: _Floats
    plus: _Flags


def _crossings(clip: _Singles, edges: MeshEdges, some: _Index, side: int) -> _Crossings:
    """Return the crossings of some edges, if both their faces are on one side of them in the picture."""
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.where(clip[:, 3] > 1e-6, clip[:, 3], np.float32(np.nan))
        x, y, z = ((clip[:, axis] / w).astype(np.float64) for axis in range(3))
        x, y = (x + 1) * (side * 0.5), (1 - y) * (side * 0.5)
        i, j = edges.edges[some].T
        x_i, x_j, y_i, y_j = x.take(i), x.take(j), y.take(i), y.take(j)
        dx, dy = x_j - x_i, y_j - y_i
        by_row = np.abs(dy) >= np.abs(dx)
        # u runs along the pixel pair, v along the walk.
        u, v = (np.where(by_row, one, other) for one, other in (((x_i, x_j), (y_i, y_j)), ((y_i, y_j), (x_i, x_j))))
        begin = np.nan_to_num(np.clip(np.ceil(np.minimum(*v) - 0.5), 0, _FAR), nan=_FAR)
        end = np.clip(np.ceil(np.maximum(*v) - 0.5), -1, side)
    crossed = np.flatnonzero(end > begin)
    third, fourth = edges.opposite[some[crossed]].T
    x_i, y_i, dx, dy = x_i[crossed], y_i[crossed], dx[crossed], dy[crossed]
    first, second = (dx * (y.take(k) - y_i) - dy * (x.take(k) - x_i) for k in (third, fourth))
    second = np.where(fourth < 0, first, second)
    outline = np.flatnonzero(first * second > 0)
    crossed = crossed[outline]
    plus = np.where(by_row[crossed], -dy[outline], dx[outline]) * first[outline] > 0
    begin, counts = begin[crossed].astype(np.int64), (end - begin)[crossed].astype(np.int64)
    within = np.repeat(np.arange(len(crossed)), counts)
    item = crossed[within]
    line = np.arange(len(item)) - (np.cumsum(counts) - counts - begin)[within]
    t = (line + 0.5 - v[0, item]) / (v[1, item] - v[0, item])
    along, depth = (a + t * (b - a) for a, b in ((u[0, item], u[1, item]), (z[i[item]], z[j[item]])))
    return _Crossings(by_row[item], line, along, depth, plus[within])


def _shares(crossings: _Crossings, depth: _Singles) -> tuple[_Index, _Index, _Floats]:
    """Return the pixels (C,) that take a share of others' colour at visible crossings, these others, and the shares.

    Of several crossings between two pixels, the nearest counts. `depth` (S, S) is that of the surface.
    """
    c, side = crossings, len(depth)
    left = np.floor(np.clip(c.along - 0.5, -2, _FAR)).astype(np.int64)
    on_screen = (left >= 0) & (left + 1 < side)
    base = np.where(on_screen, np.where(c.by_row, c.line * side + left, left * side + c.line), 0)
    stride = np.where(on_screen, np.where(c.by_row, 1, side), 0)
    inside, outside = base + stride * c.plus, base + stride * ~c.plus
    shown = np.flatnonzero(on_screen & (depth.ravel()[outside] > c.depth + DEPTH_BIAS))
    pair = base[shown] * 2 + c.by_row[shown]
    order = np.lexsort((c.depth[shown], pair))
    shown = shown[order[np.diff(pair[order], prepend=-1) > 0]]
    inside, outside, plus = inside[shown], outside[shown], c.plus[shown]
    share = (c.along[shown] - (left[shown] + plus + 0.5)) * np.where(plus, -1.0, 1.0) - 0.5
    spills = share > 0
    return np.where(spills, outside, inside), np.where(spills, inside, outside), np.abs(share)


def _blend(picture: _Singles, target: _Index, source: _Index, share: _Floats) -> None:
    """Give pixels of a picture (H * W) shares of others' colours."""
    picture += np.bincount(target, share * (picture[source] - picture[target]), len(picture)).astype(np.float32)
