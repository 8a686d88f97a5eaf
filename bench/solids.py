"""Make the solids of which parametric families consist. The number and order of vertices never depends on the sizes.

So a place on one member (a solid, a triangle and barycentric coordinates) has an exact counterpart on every other
member that has a solid of that name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Solid:
    """A closed surface: vertices (V, 3) and triangles (F, 3), counter-clockwise from outside.

    A body around a path has its `spine` (N, 3), which a hand may draw in its place.
    """

    verts: Floats
    faces: NDArray[np.int64]
    spine: Floats | None = None


@cache
def _grid(rows: int, columns: int, *, around: bool = False) -> NDArray[np.int64]:
    """Return the triangles of a grid of vertices, row by row; `around` closes each row."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if around else columns - 1), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    return np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], 2).reshape(-1, 3)


def hexahedron(corners: Sequence[Sequence[float]], cuts: int = 4) -> Solid:
    """Return a body of eight corners: the four of the bottom, counter-clockwise from above, then those of the top."""
    c = np.asarray(corners, float)
    sides = ((3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
    u, v = np.meshgrid(np.linspace(0, 1, cuts + 1), np.linspace(0, 1, cuts + 1))
    verts, faces = [], []
    for number, side in enumerate(sides):
        p, q, r, s = c[list(side)]
        u_, v_ = u.reshape(-1, 1), v.reshape(-1, 1)
        verts.append((1 - v_) * ((1 - u_) * p + u_ * q) + v_ * ((1 - u_) * s + u_ * r))
        faces.append(_grid(cuts + 1, cuts + 1) + number * (cuts + 1) ** 2)
    return Solid(np.concatenate(verts), np.concatenate(faces))


def box(low: Sequence[float], high: Sequence[float], cuts: int = 4) -> Solid:
    """Return an upright box (+Y up) between two corners."""
    (x, y, z), (a, b, c) = low, high
    return hexahedron([(x, y, c), (a, y, c), (a, y, z), (x, y, z), (x, b, c), (a, b, c), (a, b, z), (x, b, z)], cuts)


def tube(path: Sequence[Sequence[float]], radii: Sequence[Sequence[float]], sides: int = 8, rows: int = 9) -> Solid:
    """Return a body around a path, closed at both ends.

    Parameters
    ----------
    path : (N, 3) floats
    radii : (N, 2) floats
        Half axes of the elliptic section at each point: across the path horizontally, and perpendicular to that.
    sides, rows : int
        Number of vertices of a section, and of sections, which are spread evenly over the path.
    """
    points, sizes = np.asarray(path, float), np.asarray(radii, float)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, along[-1], rows)
    middle = np.stack([np.interp(at, along, points[:, d]) for d in range(3)], 1)
    size = np.stack([np.interp(at, along, sizes[:, d]) for d in range(2)], 1)
    ahead = np.gradient(middle, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    up = np.where(np.abs(ahead[:, 1:2]) > 0.95, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(up, ahead)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(ahead, across)
    angle = np.arange(sides) * 2 * np.pi / sides
    verts = (
        middle[:, None]
        + np.cos(angle)[None, :, None] * (across * size[:, :1])[:, None]
        + np.sin(angle)[None, :, None] * (other * size[:, 1:])[:, None]
    ).reshape(-1, 3)
    faces = [_grid(rows, sides, around=True)]
    j = np.arange(sides)
    start, end = rows * sides, rows * sides + 1
    faces.append(np.stack([np.full(sides, start), (j + 1) % sides, j], 1))
    last = (rows - 1) * sides
    faces.append(np.stack([np.full(sides, end), last + j, last + (j + 1) % sides], 1))
    return Solid(np.concatenate([verts, middle[:1], middle[-1:]]), np.concatenate(faces), middle)


def ring(centre: Sequence[float], radius: float, thickness: float, width: float, cuts: int = 20) -> Solid:
    """Return a wheel in the plane z = constant: a ring of half height `thickness` and half width `width`."""
    a, b = np.meshgrid(np.arange(cuts) * 2 * np.pi / cuts, np.arange(6) * 2 * np.pi / 6, indexing="ij")
    out = radius + thickness * np.cos(b)
    verts = np.stack([out * np.cos(a), out * np.sin(a), width * np.sin(b)], -1).reshape(-1, 3) + np.asarray(centre)
    grid = _grid(cuts + 1, 6, around=True) % (cuts * 6)
    return Solid(verts, grid[:, ::-1])


def lathe(profile: Sequence[Sequence[float]], sides: int = 32) -> Solid:
    """Turn a profile around +Y; the body is closed.

    Parameters
    ----------
    profile : (N, 2) floats
        Radius and height of each point, from the lower end of the axis outwards, upwards and back to the axis. The
        first and the last radius are 0, the others are greater.
    sides : int
        Number of vertices around the axis.
    """
    points = np.asarray(profile, float)
    angle = np.arange(sides) * 2 * np.pi / sides
    around = np.stack([np.sin(angle), np.cos(angle)], 1)
    inner = points[1:-1]
    circles = np.stack(
        [
            inner[:, None, 0] * around[None, :, 0],
            np.broadcast_to(inner[:, None, 1], (len(inner), sides)),
            inner[:, None, 0] * around[None, :, 1],
        ],
        -1,
    )
    ends = np.array([[0.0, points[0, 1], 0.0], [0.0, points[-1, 1], 0.0]])
    rows = len(inner)
    j = np.arange(sides)
    after = (j + 1) % sides
    start, end, last = rows * sides, rows * sides + 1, (rows - 1) * sides
    faces = [
        _grid(rows, sides, around=True),
        np.stack([np.full(sides, start), after, j], 1),
        np.stack([np.full(sides, end), last + j, last + after], 1),
    ]
    return Solid(np.concatenate([circles.reshape(-1, 3), ends]), np.concatenate(faces))


def plate(root: Sequence[float], tip: Sequence[float], chord: float, end: float, thickness: float) -> Solid:
    """Return a wing or fin between two leading edges; it reaches backwards (-Z).

    Parameters
    ----------
    root, tip : (3,) floats
        Leading edge at the body and at the tip.
    chord, end : float
        Length of the section at the body and at the tip.
    thickness : float
        Half thickness at the body; the tip has half of it.
    """
    a, b = np.array(root, float), np.array(tip, float)
    back = np.array([0.0, 0.0, -1.0])
    flat = np.cross(back, b - a)
    flat *= thickness / np.linalg.norm(flat)
    inner = [a - flat, a + flat, a + flat * 0.3 + chord * back, a - flat * 0.3 + chord * back]
    outer = [b - flat * 0.5, b + flat * 0.5, b + flat * 0.2 + end * back, b - flat * 0.2 + end * back]
    solid = hexahedron(np.array([*inner, *outer]).tolist(), 5)
    corners = solid.verts[solid.faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return solid if volume > 0 else Solid(solid.verts, solid.faces[:, ::-1])
