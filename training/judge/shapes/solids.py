"""Describe solids by signed distances and turn their union into a mesh.

A shape is a list of `Solid`s: balls, rods, drums, blocks, plates and hoops, of which some are carved out of the others.
`surfaced` samples their union, blended where they meet, on a grid and meshes it smoothly or as voxels. The prior's
families instead join separate meshes, so the two have no surface in common.

Sources: Quilez 2013, Smooth minimum (the quadratic polynomial), and 2008 to 2020, Distance functions; Gibson 1998,
Constrained elastic surface nets (the vertex of a cell is the mean of the crossings on its edges, without relaxation).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from meshdeform.nouns.families.parts import Part

Floats = NDArray[np.float64]
_Axes = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}


@dataclass(frozen=True)
class Solid:
    """A signed distance, negative inside, and the box (`low`, `high`) that contains the solid.

    `field` maps places (N, 3) to distances (N,), which need to be right only near the surface. A `hole` is taken away
    from the solids before it in the list.
    """

    field: Callable[[Floats], Floats]
    low: Floats
    high: Floats
    hole: bool = False


def _rotation(turn: Sequence[float]) -> Floats:
    """Return the rotation by Euler angles in degrees, about x first, then y, then z."""
    matrix = np.eye(3)
    for axis, degrees in enumerate(turn):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[i, i], step[i, j], step[j, i], step[j, j] = c, -s, s, c
        matrix = step @ matrix
    return matrix


def _placed(local: Callable[[Floats], Floats], centre: ArrayLike, half: Floats, turn: Sequence[float]) -> Solid:
    """Put a field about the origin, contained in a box of half sides `half`, at `centre`."""
    middle, matrix = np.asarray(centre, float), _rotation(turn)
    reach = np.abs(matrix) @ half
    return Solid(lambda p: local((p - middle) @ matrix), middle - reach, middle + reach)


def ball(centre: ArrayLike, radii: ArrayLike, turn: Sequence[float] = (0, 0, 0)) -> Solid:
    """Return an ellipsoid; `radii` is one number or three, `turn` Euler angles in degrees."""
    r = np.broadcast_to(np.asarray(radii, float), 3).copy()

    def field(p: Floats) -> Floats:
        near = np.linalg.norm(p / r, axis=1)
        steep = np.linalg.norm(p / r**2, axis=1)
        return np.asarray(near * (near - 1.0) / np.maximum(steep, 1e-9))

    return _placed(field, centre, r, turn)


def block(centre: ArrayLike, size: ArrayLike, edge: float = 0.1, turn: Sequence[float] = (0, 0, 0)) -> Solid:
    """Return a box of full sides `size` whose edges are rounded by `edge` times its shortest half side."""
    half = np.asarray(size, float) / 2
    radius = edge * half.min()

    def field(p: Floats) -> Floats:
        out = np.abs(p) - (half - radius)
        return np.asarray(np.linalg.norm(np.maximum(out, 0.0), axis=1) + np.minimum(out.max(1), 0.0) - radius)

    return _placed(field, centre, half, turn)


def rod(start: ArrayLike, end: ArrayLike, radius: float, last: float | None = None) -> Solid:
    """Return a rod with round ends; its radius changes evenly from `radius` to `last`."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    last = radius if last is None else last
    along = b - a
    square = max(float(along @ along), 1e-12)

    def field(p: Floats) -> Floats:
        share = np.clip((p - a) @ along / square, 0.0, 1.0)
        return np.asarray(np.linalg.norm(p - a - share[:, None] * along, axis=1) - radius - (last - radius) * share)

    wide = max(radius, last)
    return Solid(field, np.minimum(a, b) - wide, np.maximum(a, b) + wide)


def rods(path: Sequence[ArrayLike], radii: Sequence[float]) -> list[Solid]:
    """Return a chain of rods through the places of `path` with a radius at each."""
    return [rod(path[k], path[k + 1], radii[k], radii[k + 1]) for k in range(len(path) - 1)]


def arc(centre: ArrayLike, radius: float, thick: ArrayLike, start: float, stop: float) -> list[Solid]:
    """Return a bent rod across z, its angles in degrees from +x; two values of `thick` are its radii at the ends."""
    angles = np.radians(np.linspace(start, stop, max(3, int(abs(stop - start) / 20) + 2)))
    first, last = np.broadcast_to(np.asarray(thick, float), 2)
    radii = np.linspace(first, last, len(angles))
    middle = np.asarray(centre, float)
    return rods([middle + radius * np.array([np.cos(a), np.sin(a), 0.0]) for a in angles], radii.tolist())


def drum(start: ArrayLike, end: ArrayLike, radius: float, last: float | None = None, sides: int = 0) -> Solid:
    """Return a cylinder or the stump of a cone between two flat ends; with `sides`, a prism or pyramid stump."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    last = radius if last is None else last
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length
    first = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    # Facets are half a side off, so that a square prism stands parallel to the axes.
    corners = (np.arange(max(sides, 1)) + 0.5) * 2 * np.pi / max(sides, 1) + np.pi / max(sides, 1) * (sides != 4)

    def field(p: Floats) -> Floats:
        at = (p - a) @ axis
        u, v = (p - a) @ first, (p - a) @ second
        if sides:
            shift = np.pi / 4 if sides == 4 else 0.0
            out = np.max([u * np.cos(c + shift) + v * np.sin(c + shift) for c in corners], axis=0)
        else:
            out = np.hypot(u, v)
        side = (out - radius - (last - radius) * at / length) / np.hypot(1.0, (last - radius) / length)
        return np.asarray(np.maximum(side, np.maximum(-at, at - length)))

    wide = max(radius, last) * (1.5 if sides else 1.0)
    reach = wide * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
    return Solid(field, np.minimum(a, b) - reach, np.maximum(a, b) + reach)


def spun(profile: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> Solid:
    """Return the solid of revolution about +Y of a polygon (N, 2) of (radius, height); it need not touch the axis."""
    points = np.asarray(profile, float)
    wide, low, high = points[:, 0].max(), points[:, 1].min(), points[:, 1].max()
    middle = np.asarray(centre, float)

    # Distances in the half plane are tabulated once: a grid of places asks for the same ones again and again.
    pad = 0.15 * max(wide, high - low)
    lines = (np.linspace(0.0, wide + pad, 97), np.linspace(low - pad, high + pad, 129))
    # The part of the polygon's rim on the axis is inside the solid: mirror it away.
    u, v = np.meshgrid(*lines, indexing="ij")
    table = _polygon(np.column_stack([u.ravel(), v.ravel()]), _mirrored(points)).reshape(u.shape)
    step = np.array([lines[0][1] - lines[0][0], lines[1][1] - lines[1][0]])

    def field(p: Floats) -> Floats:
        q = p - middle
        at = np.stack([np.hypot(q[:, 0], q[:, 2]), q[:, 1] - (low - pad)]) / step[:, None]
        return np.asarray(ndimage.map_coordinates(table, at, order=1, mode="nearest"))

    return Solid(field, middle + [-wide, low, -wide], middle + [wide, high, wide])


def _mirrored(points: Floats) -> Floats:
    """Complete an outline that begins and ends on the axis by its mirror image; leave any other as it is."""
    if points[0, 0] > 1e-9 or points[-1, 0] > 1e-9:
        return points
    return np.concatenate([points, points[-2:0:-1] * [-1.0, 1.0]])


def plate(
    outline: ArrayLike, thick: float, centre: ArrayLike = (0, 0, 0), axis: str = "z", turn: Sequence[float] = (0, 0, 0)
) -> Solid:
    """Return a polygon (N, 2), convex or not, of full thickness `thick` along `axis`.

    The outline's first coordinate is x and its second y for axis "z"; y and z for "x"; z and x for "y".
    """
    points = np.asarray(outline, float)
    u, v, w = _Axes[axis]
    half = np.empty(3)
    half[u], half[v], half[w] = np.abs(points[:, 0]).max(), np.abs(points[:, 1]).max(), thick / 2

    def field(p: Floats) -> Floats:
        return np.asarray(np.maximum(_polygon(p[:, [u, v]], points), np.abs(p[:, w]) - thick / 2))

    return _placed(field, centre, half, turn)


def _polygon(p: Floats, points: Floats) -> Floats:
    """Return the signed distance (N,) of places (N, 2) to a polygon."""
    best = np.full(len(p), np.inf)
    inside = np.zeros(len(p), bool)
    for k in range(len(points)):
        a, b = points[k - 1], points[k]
        along, w = b - a, p - a
        share = np.clip(w @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        off = w - share[:, None] * along
        best = np.minimum(best, (off**2).sum(1))
        crosses = (a[1] > p[:, 1]) != (b[1] > p[:, 1])
        left = along[0] * w[:, 1] - along[1] * w[:, 0] > 0
        inside ^= crosses & (left == (b[1] > a[1]))
    distance = np.sqrt(best)
    return np.asarray(np.where(inside, -distance, distance))


def hoop(centre: ArrayLike, radius: float, thick: float, turn: Sequence[float] = (0, 0, 0)) -> Solid:
    """Return a ring about the axis z, before `turn`; `thick` is the radius of its section."""

    def field(p: Floats) -> Floats:
        return np.asarray(np.hypot(np.hypot(p[:, 0], p[:, 1]) - radius, p[:, 2]) - thick)

    return _placed(field, centre, np.array([radius + thick, radius + thick, thick]), turn)


def both(solids: Solid | Iterable[Solid]) -> list[Solid]:
    """Return solids and their mirror images in the plane x = 0."""
    made = [solids] if isinstance(solids, Solid) else list(solids)
    return made + [_mirror_image(solid) for solid in made]


def _mirror_image(solid: Solid) -> Solid:
    flip = np.array([-1.0, 1.0, 1.0])
    low, high = solid.low.copy(), solid.high.copy()
    low[0], high[0] = -solid.high[0], -solid.low[0]
    return Solid(lambda p: solid.field(p * flip), low, high, solid.hole)


def carved(solid: Solid) -> Solid:
    """Return the solid as a hole."""
    return replace(solid, hole=True)


def moved(solid: Solid, *, at: ArrayLike = (0, 0, 0), turn: Sequence[float] = (0, 0, 0), size: ArrayLike = 1) -> Solid:
    """Scale a solid (negative: mirror it), turn it by Euler angles in degrees, and shift it."""
    shift, matrix = np.asarray(at, float), _rotation(turn)
    scale = np.broadcast_to(np.asarray(size, float), 3)
    middle = matrix @ (scale * (solid.low + solid.high) / 2) + shift
    reach = np.abs(matrix) @ (np.abs(scale) * (solid.high - solid.low) / 2)

    def field(p: Floats) -> Floats:
        return solid.field((p - shift) @ matrix / scale) * float(np.abs(scale).min())

    return Solid(field, middle - reach, middle + reach, solid.hole)


def around(count: int, turn: float = 0.0) -> list[tuple[Floats, float]]:
    """Return horizontal directions evenly around +Y, with their angles in degrees."""
    angles = turn + 2 * np.pi * np.arange(count) / count
    return [(np.array([np.sin(a), 0.0, np.cos(a)]), float(np.degrees(a))) for a in angles]


def petal(root: Floats, way: Floats, degrees: float, size: tuple[float, float, float], tilt: float) -> Solid:
    """Return a flat leaf of half sides (across, thick, along) that leaves `root` along `way`, `tilt` degrees upward."""
    rise = np.radians(tilt)
    middle = root + size[2] * (np.cos(rise) * way + [0, np.sin(rise), 0])
    return ball(middle, size, (-tilt, degrees, 0))


def half_ball(centre: tuple[float, float, float], radii: tuple[float, float, float]) -> list[Solid]:
    """Return the upper half of a ball; what lies below must come after it in the list."""
    return [ball(centre, radii), carved(block((centre[0], centre[1] - 2, centre[2]), (8, 4, 8), 0))]


def surfaced(solids: Sequence[Solid], cells: int, blend: float, *, voxels: bool = False) -> Part:
    """Mesh the union of solids without its holes.

    Parameters
    ----------
    solids : sequence of Solid
    cells : int
        Cells of the grid along the longest side of the shape.
    blend : float
        Width of the fillets between solids, as a share of the longest side; 0 leaves creases.
    voxels : bool
        Return the outer faces of all cells whose middle is inside.

    Returns
    -------
    Part
        Closed, oriented outward, in the unit and at the place of the solids.
    """
    shown = [solid for solid in solids if not solid.hole]
    low, high = np.min([s.low for s in shown], 0), np.max([s.high for s in shown], 0)
    longest = float((high - low).max())
    cell, width = longest / cells, blend * longest
    # Coarse grids would lose what is thinner than a cell.
    swell = 0.3 * cell if cells < 30 else 0.0
    low, high = low - 2.5 * cell, high + 2.5 * cell
    count = np.ceil((high - low) / cell).astype(int) + 1
    values = np.full(tuple(count), longest)
    margin = width + 2.0 * cell + swell
    for solid in solids:
        start = np.clip(np.floor((solid.low - margin - low) / cell).astype(int), 0, count)
        stop = np.clip(np.ceil((solid.high + margin - low) / cell).astype(int) + 1, 0, count)
        if (stop <= start).any():
            continue
        lines = [low[d] + cell * np.arange(start[d], stop[d]) for d in range(3)]
        places = np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 3)
        at = tuple(slice(a, b) for a, b in zip(start, stop, strict=True))
        distance = solid.field(places).reshape(values[at].shape)
        if solid.hole:
            values[at] = np.maximum(values[at], -distance)
        else:
            values_here, distance = values[at], distance - swell
            near = np.maximum(width - np.abs(values_here - distance), 0.0) if width else 0.0
            values[at] = np.minimum(values_here, distance) - (near * near / (4.0 * width) if width else 0.0)
    return _cubes(values, low, cell) if voxels else _nets(values, low, cell)


_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _nets(values: Floats, low: Floats, cell: float) -> Part:
    """Mesh the zero set of values on a grid by surface nets."""
    inside = values < 0
    x, y, z = values.shape
    number = sum(inside[i : x - 1 + i, j : y - 1 + j, k : z - 1 + k].astype(np.int8) for i, j, k in _CORNERS)
    mixed = np.argwhere((np.asarray(number) > 0) & (np.asarray(number) < 8))
    index = np.full((x - 1, y - 1, z - 1), -1)
    index[tuple(mixed.T)] = np.arange(len(mixed))
    total, crossings = np.zeros((len(mixed), 3)), np.zeros((len(mixed), 1))
    for a in _CORNERS:
        for b in _CORNERS:
            if (b - a).sum() != 1 or (b < a).any():
                continue
            one, two = values[tuple((mixed + a).T)], values[tuple((mixed + b).T)]
            cut = (one < 0) != (two < 0)
            share = np.where(cut, one / np.where(cut, one - two, 1.0), 0.0)
            total += np.where(cut[:, None], a + share[:, None] * (b - a), 0.0)
            crossings += cut[:, None]
    verts = low + cell * (mixed + total / crossings)
    return Part(verts, _quads(inside, index))


def _cubes(values: Floats, low: Floats, cell: float) -> Part:
    """Mesh the values' negative cells as cubes."""
    # A grid of corners around the cells: corner (i, j, k) lies before cell (i, j, k).
    inside = values < 0
    x, y, z = values.shape
    index = np.arange((x - 1) * (y - 1) * (z - 1)).reshape(x - 1, y - 1, z - 1)
    faces = _quads(inside, index)
    used, renumbered = np.unique(faces, return_inverse=True)
    places = np.stack(np.unravel_index(used, index.shape), 1)
    return Part(low + cell * (places + 0.5), renumbered.reshape(-1, 3).astype(np.int64))


def _quads(inside: NDArray[np.bool_], index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return two triangles for each pair of neighbours on the grid of which one is inside.

    `index` numbers the vertices of the cells between eight neighbours.
    """
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        before = np.take(inside, range(inside.shape[axis] - 1), axis)
        after = np.take(inside, range(1, inside.shape[axis]), axis)
        at = np.argwhere(before != after)
        goes_in = before[tuple(at.T)]
        rings = []
        for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
            place = at.copy()
            place[:, u] += du - 1
            place[:, v] += dv - 1
            rings.append(index[tuple(place.T)])
        quad = np.stack(rings, 1)
        quad[~goes_in] = quad[~goes_in][:, ::-1]
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(faces).astype(np.int64)
