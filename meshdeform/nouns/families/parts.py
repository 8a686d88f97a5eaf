"""Build closed solids, the parts of all families, and join them.

A part is a closed triangle mesh whose faces are counter-clockwise seen from outside. Parts of one object may overlap:
the renderer shows only the outermost surface, as for a watertight union. Everything is +Y up and faces +Z; lengths are
in the family's own unit until `normalised`.

Source of the tube's frames: Bishop 1975, There is more than one way to frame a curve (parallel transport).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshdeform.nouns.deformed import Part as Part
from meshdeform.nouns.deformed import normalised as normalised
from meshdeform.vocabulary.solids import PART_NAMES, pieces_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SEGMENTS = 28
"""Corners per full turn, enough for flat shading to look round in a view of 64 pixels."""


def _loft(rings: Array, *, flip: bool) -> Part:
    """Join rings (R, S, 3) into a closed surface; the first and the last ring must be one point each."""
    verts = np.concatenate([rings[0, :1], rings[1:-1].reshape(-1, 3), rings[-1, :1]])
    faces = _faces_between(*rings.shape[:2])
    return Part(verts, faces[:, ::-1].copy() if flip else faces.copy())


@lru_cache(maxsize=256)
def _faces_between(rings: int, segments: int) -> Index:
    """Return the faces between rings, of which the first and the last are one vertex each."""
    side = np.arange(segments)
    after = np.roll(side, -1)
    faces = [np.stack([np.zeros_like(side), 1 + side, 1 + after], 1)]
    for ring in range(rings - 3):
        low, high = 1 + ring * segments, 1 + (ring + 1) * segments
        faces.append(np.stack([low + side, high + side, high + after], 1))
        faces.append(np.stack([low + side, high + after, low + after], 1))
    last = 1 + (rings - 3) * segments
    faces.append(np.stack([last + side, np.full_like(side, last + segments), last + after], 1))
    return np.concatenate(faces).astype(np.int64)


def ellipsoid(centre: ArrayLike, radii: ArrayLike, *, rings: int = 14) -> Part:
    """Return an axis-aligned ellipsoid; `radii` is one number or three."""
    polar = np.linspace(0.0, np.pi, rings + 1)
    profile = np.stack([np.sin(polar), -np.cos(polar)], 1)
    unit = lathe(profile)
    return Part(unit.verts * np.asarray(radii, float) + np.asarray(centre, float), unit.faces)


def lathe(profile: ArrayLike, *, segments: int = SEGMENTS) -> Part:
    """Return the surface of revolution about +Y of a profile (N, 2) of (radius, height), from bottom to top.

    The profile is closed to the axis at both ends, so an open cup consists of outer wall, rim and inner wall.
    """
    points = np.asarray(profile, float)
    ends = [np.array([[0.0, points[0, 1]]])] if points[0, 0] > 0 else []
    tail = [np.array([[0.0, points[-1, 1]]])] if points[-1, 0] > 0 else []
    points = np.concatenate([*ends, points, *tail])
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    circle = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], 1)
    rings = points[:, :1, None] * circle[None]
    rings[..., 1] = points[:, 1:2]
    return _loft(rings, flip=True)


def disc(radius: float, bottom: float, top: float, *, edge: float = 0.04) -> Part:
    """Return an upright cylinder from height `bottom` to `top` whose two rims are cut off by `edge`."""
    return lathe([(radius - edge, bottom), (radius, bottom + edge), (radius, top - edge), (radius - edge, top)])


def limb(path: ArrayLike | Sequence[object], radii: ArrayLike, *, segments: int = 16, samples: int = 5) -> Part:
    """Return a tube with round ends along a polyline `path` (N, 3) with a radius at each point.

    The points may be lists and arrays side by side. Radii may be (N,) for a round tube or (N, 2) for an elliptic one:
    (across, along the bend's normal).
    """
    points = np.asarray(path, float)
    widths = np.asarray(radii, float)
    if widths.ndim == 1:
        widths = np.stack([widths, widths], 1)
    at = np.linspace(0.0, len(points) - 1.0, (len(points) - 1) * samples + 1)
    knots = np.arange(len(points))
    centre = np.stack([np.interp(at, knots, points[:, axis]) for axis in range(3)], 1)
    width = np.stack([np.interp(at, knots, widths[:, axis]) for axis in range(2)], 1)
    tangent = np.gradient(centre, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # The two round ends: quarter circles beyond the first and the last point.
    quarter = np.linspace(0.0, np.pi / 2, 5)
    head = [(centre[0] - tangent[0] * width[0].mean() * np.cos(q), width[0] * np.sin(q), tangent[0]) for q in quarter]
    tail = [
        (centre[-1] + tangent[-1] * width[-1].mean() * np.sin(q), width[-1] * np.cos(q), tangent[-1]) for q in quarter
    ]
    body = list(zip(centre[1:-1], width[1:-1], tangent[1:-1], strict=True))
    stations = head + body + tail
    frames = _carried_along([direction for _, _, direction in stations])
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)[None, :, None]
    places, sizes = (np.stack([station[k] for station in stations])[:, None] for k in (0, 1))
    across, other = (np.stack([frame[k] for frame in frames])[:, None] for k in (0, 1))
    rings = places + np.cos(angle) * across * sizes[..., :1] + np.sin(angle) * other * sizes[..., 1:]
    return _loft(rings, flip=True)


def _carried_along(directions: Sequence[Array]) -> list[tuple[Array, Array]]:
    """Return two axes across each direction of a path, with the least turn about it from one to the next."""
    first = directions[0]
    across = _cross(first, np.array([0.0, 0.0, 1.0] if abs(first[2]) < 0.9 else [1.0, 0.0, 0.0]))
    frames = []
    for direction in directions:
        across = across - direction * (across @ direction)
        across = across / math.sqrt(across @ across)
        frames.append((across, _cross(direction, across)))
    return frames


def _cross(one: Array, other: Array) -> Array:
    """Return the cross product of two vectors (3,), in a tenth of the time of `np.cross`."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def curved(knots: ArrayLike, *, samples: int = 4) -> Array:
    """Return points of the Catmull-Rom curve through `knots` (N, D), `samples` a piece, with both ends.

    The columns may hold more than a place: a radius beside each point becomes as smooth as the path. Source: Catmull
    and Rom 1974, A class of local interpolating splines.
    """
    through = np.asarray(knots, float)
    control_points = np.concatenate([2 * through[:1] - through[1:2], through, 2 * through[-1:] - through[-2:-1]])
    a, b, c, d = (control_points[k : len(control_points) - 3 + k, None] for k in range(4))
    t = np.linspace(0.0, 1.0, samples, endpoint=False)[:, None]
    curve = b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
    return np.concatenate([curve.reshape(-1, through.shape[1]), through[-1:]])


def box(centre: ArrayLike, size: ArrayLike, *, round_by: float = 0.25, cells: int = 6) -> Part:
    """Return a box of full side lengths `size` with edges rounded by `round_by` times its shortest side."""
    side = np.asarray(size, float)
    radius = round_by * side.min()
    line = np.linspace(-1.0, 1.0, cells + 1)
    # More samples near the edges, where the rounding is.
    line = np.sign(line) * (1 - (1 - np.abs(line)) ** 1.6)
    u, v = np.meshgrid(line, line, indexing="ij")
    corner = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    quad = np.stack([corner, corner + cells + 1, corner + cells + 2, corner + 1], 1)
    verts: list[Array] = []
    faces: list[Index] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            sheet = np.empty((u.size, 3))
            sheet[:, axis] = sign
            sheet[:, (axis + 1) % 3] = u.ravel()
            sheet[:, (axis + 2) % 3] = v.ravel()
            facing = quad if sign > 0 else quad[:, ::-1]
            faces.append(np.concatenate([facing[:, [0, 1, 2]], facing[:, [0, 2, 3]]]) + len(verts) * u.size)
            verts.append(sheet)
    full = np.concatenate(verts) * side / 2
    inner = np.clip(full, radius - side / 2, side / 2 - radius)
    outward = full - inner
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    surface = inner + np.divide(outward, length, out=np.zeros_like(outward), where=length > 0) * radius
    # Merge the vertices where the six sheets meet, so that the surface is closed.
    first, number = _different(surface.round(9))
    joined = number[np.concatenate(faces)]
    return Part(surface[first] + np.asarray(centre, float), joined)


def _different(rows: Array) -> tuple[Index, Index]:
    """Return the first of each of the different rows (N, 3), in their order, and each row's number among them.

    It is `np.unique(axis=0)` in a third of the time.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    begins = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(1)])
    number = np.empty(len(rows), np.int64)
    number[order] = np.cumsum(begins) - 1
    return order[begins], number


def extrude(outline: ArrayLike, thickness: float, *, bevel: float = 0.3, puff: float = 0.0) -> Part:
    """Return a plate in the XY plane with a star-shaped counter-clockwise `outline` (N, 2), `thickness` along Z.

    The rim is rounded by `bevel` times the thickness; the middle is raised by `puff` times the thickness, like a
    cushion.
    """
    rim = np.asarray(outline, float)
    middle = rim.mean(0)
    half = thickness / 2
    levels = [
        (0.0, -half * (1 + 2 * puff)),
        (0.45, -half * (1 + 1.6 * puff)),
        (0.78, -half * (1 + 0.8 * puff)),
        (0.94, -half),
        (1.0, -half * (1 - 2 * bevel)),
        (1.0, half * (1 - 2 * bevel)),
        (0.94, half),
        (0.78, half * (1 + 0.8 * puff)),
        (0.45, half * (1 + 1.6 * puff)),
        (0.0, half * (1 + 2 * puff)),
    ]
    rings = np.stack(
        [np.column_stack([middle + (rim - middle) * scale, np.full(len(rim), depth)]) for scale, depth in levels]
    )
    return _loft(rings, flip=True)


def plate(outline: ArrayLike, thickness: float, *, across: str, puff: float = 0.0) -> Part:
    """Return a flat blade, such as a fin or a wing, whose thickness lies along the axis `across`.

    Parameters
    ----------
    outline : (N, 2)
        Corners of a star-shaped outline in either sense: (z, y) across x, (x, z) across y, (x, y) across z.
    thickness, puff
        As in `extrude`.
    across : str
        "x", "y" or "z".
    """
    rim = np.asarray(outline, float)
    after = np.roll(rim, -1, axis=0)
    if float((rim[:, 0] * after[:, 1] - rim[:, 1] * after[:, 0]).sum()) < 0:
        rim = rim[::-1]
    flat = extrude(rim, thickness, puff=puff)
    return {"x": turned(flat, -90, "y"), "y": turned(flat, 90, "x"), "z": flat}[across]


def turned(part: Part, degrees: float, axis: str) -> Part:
    """Rotate a part about a coordinate axis through the origin, counter-clockwise seen from the axis's tip."""
    angle = np.radians(degrees)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    verts = part.verts.copy()
    verts[:, first] = np.cos(angle) * part.verts[:, first] - np.sin(angle) * part.verts[:, second]
    verts[:, second] = np.sin(angle) * part.verts[:, first] + np.cos(angle) * part.verts[:, second]
    return part._replace(verts=verts)


def moved(part: Part, by: ArrayLike) -> Part:
    """Translate a part."""
    return part._replace(verts=part.verts + np.asarray(by, float))


def mirrored(part: Part) -> Part:
    """Reflect a part in the plane x = 0, keeping it oriented outward."""
    return part._replace(verts=part.verts * np.array([-1.0, 1.0, 1.0]), faces=part.faces[:, ::-1].copy())


def stretched(part: Part, x: float, y: float, z: float) -> Part:
    """Scale a part about the origin by positive factors."""
    return part._replace(verts=part.verts * np.array([x, y, z]))


def pair(part: Part) -> list[Part]:
    """Return a part and its mirror image: the left and the right one."""
    return [part, mirrored(part)]


def join(parts: Sequence[Part]) -> Part:
    """Join all parts into one mesh; it has labels if all of them have."""
    offsets = np.cumsum([0, *(len(part.verts) for part in parts[:-1])])
    labels = [part.labels for part in parts if part.labels is not None]
    return Part(
        np.concatenate([part.verts for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]),
        np.concatenate(labels) if len(labels) == len(parts) else None,
    )


def named(**solids: Part | Sequence[Part]) -> Part:
    """Join solids under the names of their parts: `named(seat=box(...), leg=pair(limb(...)))`.

    A solid that has labels already (`divided`) keeps them. Raises ValueError if a name is not in `solids.PART_NAMES`.
    """
    joined = []
    for name, several in solids.items():
        for part in [several] if isinstance(several, Part) else several:
            own = np.full(len(part.faces), PART_NAMES.index(name)) if part.labels is None else part.labels
            joined.append(part._replace(labels=own))
    return join(joined)


def divided(part: Part, pieces: str) -> Part:
    """Name the faces of a solid of rings (`lathe`, `limb`): `base/4/stem` is a base, then a stem from ring 4 on."""
    labels = np.zeros(len(part.faces), np.int64)
    for ring, name in pieces_of(pieces):
        labels[rings_of(part.faces) >= ring] = PART_NAMES.index(name)
    return part._replace(labels=labels)


def rings_of(faces: Index) -> Index:
    """Return the ring (F,) of each face of a solid that consists of rings between two poles."""
    first = int(faces.min())
    around = int((faces == first).any(1).sum())
    ring = np.where(faces == first, 0, (faces - first - 1) // around + 1)
    return np.asarray(ring.min(1))
