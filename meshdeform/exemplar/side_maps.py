"""Give what rolls on wheels the body of another vehicle: its outline seen from the side, and its width.

1. Bodies, all but wheels, are seen from the side, filled, without what is thinner than 0.1 of the diagonal. Each
   outline is 160 points around the middle, from the bottom. The box of one goes to that of the other. Then outlines
   are matched from end to end in order, up to five points of one to one of the other, by the least sum of

       |p - q|^2 / D^2 + 0.1 (1 - m . n)                 m, n the normals at p and q, D the diagonal.

   So a windscreen becomes a front, and a bonnet a ledge.
2. A point in the plane of the picture goes with the outline, and around wheels with them, by thin plate splines in 8
   steps, each from where the former one ended, so that nothing folds.
3. Sideways, a point moves away from the middle as the half widths ask for, which are smooth over the side.
4. Wheels keep round; the first and the last go to the goal's first and last, and stand on the ground.

Sources: Sakoe and Chiba 1978, Dynamic programming algorithm optimization for spoken word recognition (the matching);
Bookstein 1989, Principal warps: thin-plate splines and the decomposition of deformations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from meshdeform.exemplar.shapes import Shape
from meshdeform.geometry.kernels import kernel
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.samples import spread

__all__ = ["by_side"]

_SAMPLES, _PIXELS = 20_000, 160
_THIN, _REGROWN, _CLOSED = 0.05, 0.45, 0.06
"""Radii, as shares of the diagonal, of what is left out and of gaps that are filled; share of the first that corners
grow back by."""
_POINTS, _RAYS, _NORMAL = 160, 720, 0.1
_STEPS = np.array([(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (1, 5), (5, 1)])
_FARTHEST = 0.045
"""Mean way of the points of an outline, as a share of the diagonal, beyond which the two bodies are too unlike."""
_TIMES, _GRID, _BEYOND, _SOFT = 8, (49, 37), 0.15, 1e-3
_CELLS, _SMOOTH, _RATIOS = (40, 30), 7.0, (0.3, 3.0)
_MOST_WIDE = 0.9
_AROUND, _RING = 1.3, 16
_RADII, _ACROSS = (0.9, 1.3), (0.7, 1.4)
_ON_GROUND, _APART = 0.03, 0.1


class _Wheel(NamedTuple):
    """A wheel seen from the side: its vertices (K,), its middle (2,) and radius, and where both are to go."""

    rows: Index
    middle: Floats
    radius: float
    goal: Floats
    goal_radius: float


@dataclass(frozen=True)
class _Outline:
    """Points and outward normals (N, 2) in order around a body, forward and upward, and the corners of its box."""

    points: Floats
    normals: Floats
    low: Floats
    high: Floats


def by_side(own: Shape, goal: Shape, wheels: Sequence[Index], goal_wheels: Sequence[Index]) -> Floats | None:
    """Return the vertices (V, 3) of a vehicle that has become another one; None if they are too unlike.

    `wheels`, `goal_wheels`: the faces of each wheel of both.
    """
    samples = [_body(shape, faces) for shape, faces in ((own, wheels), (goal, goal_wheels))]
    outlines = [_outline(positions[:, [2, 1]]) for positions in samples]
    boxed = _map_of_boxes(*outlines)
    points, to = _matched(boxed, outlines[0], outlines[1])
    diagonal = float(np.linalg.norm(outlines[1].high - outlines[1].low))
    if np.linalg.norm(to - points, axis=1).mean() > _FARTHEST * diagonal:
        return None
    rolling = _rolling(own, goal, wheels, goal_wheels)
    flow = _flow(*_with_wheels(points, to, rolling, boxed))
    flat = flow(boxed(own.verts[:, [2, 1]]))
    wider = _wider(flow(boxed(samples[0][:, [2, 1]])), samples[0][:, 0], samples[1])
    verts = np.column_stack([own.verts[:, 0] * wider(flat), flat[:, 1], flat[:, 0]])
    for wheel in rolling:
        verts[wheel.rows] = _rolled(own.verts[wheel.rows], wheel, float(wider(wheel.goal[None])[0]))
    return verts


def _body(shape: Shape, wheels: Sequence[Index]) -> Floats:
    """Return samples (N, 3) of all but wheels."""
    return spread(shape.verts, np.delete(shape.faces, np.concatenate(wheels), 0), _SAMPLES, 5).positions


def _map_of_boxes(own: _Outline, goal: _Outline) -> Callable[[Floats], Floats]:
    """Return the way from one box to the other."""
    scale = (goal.high - goal.low) / np.maximum(own.high - own.low, 1e-9)
    return lambda flat: np.asarray(goal.low + (flat - own.low) * scale)


def _disc(radius: float) -> Flags:
    reach = int(np.ceil(radius))
    return np.asarray(np.square(np.mgrid[-reach : reach + 1, -reach : reach + 1]).sum(0) <= radius * radius + 1e-9)


def _outline(flat: Floats) -> _Outline:
    """Return the outline of points (N, 2), without what is thin, and without gaps."""
    low, high = flat.min(0), flat.max(0)
    diagonal = float(np.linalg.norm(high - low))
    pixel = max(diagonal, 1e-9) / _PIXELS
    margin = int(np.ceil(_CLOSED * _PIXELS)) + 3
    corner = low - margin * pixel
    mask = np.zeros(tuple(np.ceil((high - corner) / pixel).astype(int) + margin), bool)
    mask[tuple(np.floor((flat - corner) / pixel).astype(int).T)] = True
    mask = ndimage.binary_fill_holes(ndimage.binary_closing(mask))
    thick = ndimage.binary_opening(mask, _disc(_THIN * _PIXELS))
    if thick.any():
        mask &= ndimage.binary_dilation(thick, _disc(_REGROWN * _THIN * _PIXELS))
    mask = ndimage.binary_fill_holes(ndimage.binary_closing(mask, _disc(_CLOSED * _PIXELS)))
    found, count = ndimage.label(mask)
    mask = found == 1 + np.argmax(ndimage.sum(mask, found, range(1, count + 1)))
    inside = np.argwhere(mask)
    points = corner + (_around(mask) + 0.5) * pixel
    smooth = ndimage.gaussian_filter1d(points[:-1], 1.5, axis=0, mode="wrap")
    along = np.roll(smooth, -1, 0) - np.roll(smooth, 1, 0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    ends = corner + np.stack([inside.min(0), inside.max(0) + 1]) * pixel
    return _Outline(points, np.concatenate([normals, normals[:1]]), ends[0], ends[1])


def _around(mask: Flags) -> Floats:
    """Return points (N + 1, 2) spread evenly around what a mask covers, seen from its middle, from the bottom on."""
    middle = np.array(ndimage.center_of_mass(mask))
    angles = np.linspace(-np.pi / 2, 1.5 * np.pi, _RAYS + 1)
    rays = np.stack([np.cos(angles), np.sin(angles)], 1)
    reach = np.arange(0, 1.5 * max(mask.shape), 0.25)
    soft = ndimage.gaussian_filter(mask.astype(float), 0.7)
    positions = middle + rays[:, None] * reach[None, :, None]
    inside = ndimage.map_coordinates(soft, positions.reshape(-1, 2).T, order=1).reshape(len(rays), -1) > 0.5
    last = len(reach) - 1 - inside[:, ::-1].argmax(1)
    points = middle + rays * reach[last, None]
    passed = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, passed[-1], _POINTS + 1)
    return np.stack([np.interp(at, passed, points[:, axis]) for axis in range(2)], 1)


def _matched(boxed: Callable[[Floats], Floats], own: _Outline, goal: _Outline) -> tuple[Floats, Floats]:
    """Return the points (N, 2) of an outline in the box of its goal, and where they go."""
    points = boxed(own.points)
    normals = own.normals / np.maximum((goal.high - goal.low) / np.maximum(own.high - own.low, 1e-9), 1e-9)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    diagonal = max(float(np.linalg.norm(goal.high - goal.low)), 1e-9)
    cost = np.square(points[:, None] - goal.points[None]).sum(2) / diagonal**2
    cost += _NORMAL * (1 - normals @ goal.normals.T)
    path = _cheapest(cost, _STEPS)
    at = np.interp(np.arange(len(points)), path[:, 0], path[:, 1])
    to = [np.interp(at, np.arange(len(goal.points)), goal.points[:, axis]) for axis in range(2)]
    return points[:-1], np.stack(to, 1)[:-1]


@kernel
def _cheapest(cost: Floats, steps: Index) -> Index:
    """Return the pairs (P, 2) of the cheapest way from the first pair to the last one, ascending."""
    rows, columns = cost.shape
    best = np.full((rows, columns), np.inf)
    came = np.zeros((rows, columns), np.int64)
    best[0, 0] = cost[0, 0]
    for i in range(rows):
        for j in range(columns):
            for k in range(len(steps)):
                a, b = i - steps[k, 0], j - steps[k, 1]
                if a >= 0 and b >= 0:
                    new = best[a, b] + (steps[k, 0] + steps[k, 1]) * (cost[i, j] + cost[a, b]) / 4
                    if new < best[i, j]:
                        best[i, j] = new
                        came[i, j] = k
    path = np.zeros((rows + columns, 2), np.int64)
    count, i, j = 0, rows - 1, columns - 1
    while i > 0 or j > 0:
        path[count, 0], path[count, 1] = i, j
        count += 1
        k = came[i, j]
        i, j = i - steps[k, 0], j - steps[k, 1]
    return path[: count + 1][::-1]


def _middle_and_radius(verts: Floats) -> tuple[Floats, float]:
    """Return the middle (2,) and the radius of a wheel."""
    middle = (verts.min(0) + verts.max(0)) / 2
    return middle[[2, 1]], float(np.ptp(verts[:, 1])) / 2


def _rolling(own: Shape, goal: Shape, wheels: Sequence[Index], goal_wheels: Sequence[Index]) -> list[_Wheel]:
    """Return the wheels on the ground with where they go: by where they are between the first and the last one."""
    ground, goal_ground = own.verts[own.faces][..., 1].min(), goal.verts[goal.faces][..., 1].min()
    rows = [np.unique(own.faces[faces]) for faces in wheels]
    seen = [_middle_and_radius(own.verts[each]) for each in rows]
    others = [_middle_and_radius(goal.verts[np.unique(goal.faces[faces])]) for faces in goal_wheels]
    ends = [_range_of([middle[0] for middle, _ in each]) for each in (seen, others)]
    if min(np.ptp(each) for each in ends) < _APART:
        return []
    radii = [others[int(np.argmin([abs(middle[0] - end) for middle, _ in others]))][1] for end in ends[1]]
    found = []
    for each, (middle, radius) in zip(rows, seen, strict=True):
        if middle[1] - radius < ground + _ON_GROUND:
            wished = float(np.interp(middle[0], ends[0], radii))
            to = radius * float(np.clip(wished / max(radius, 1e-9), *_RADII))
            along = float(np.interp(middle[0], ends[0], ends[1]))
            found.append(_Wheel(each, middle, radius, np.array([along, goal_ground + to]), to))
    return found


def _range_of(along: Sequence[float]) -> Floats:
    return np.array([min(along), max(along)])


def _with_wheels(
    points: Floats, to: Floats, wheels: Sequence[_Wheel], boxed: Callable[[Floats], Floats]
) -> tuple[Floats, Floats]:
    """Return points (N, 2) and their goals, those of the outline that are not beside wheels, and rings of these."""
    angles = np.linspace(0, 2 * np.pi, _RING, endpoint=False)
    ring = np.concatenate([np.zeros((1, 2)), np.stack([np.cos(angles), np.sin(angles)], 1)])
    free = np.ones(len(points), bool)
    around, goals = [], []
    for wheel in wheels:
        rim = boxed(wheel.middle + ring * wheel.radius)
        free &= np.linalg.norm(points - rim[0], axis=1) > _AROUND * np.linalg.norm(rim[1:] - rim[0], axis=1).max()
        around.append(rim)
        goals.append(wheel.goal + ring * wheel.goal_radius)
    source, goal = np.concatenate([points[free], *around]), np.concatenate([to[free], *goals])
    first = np.unique(np.round(source, 3), axis=0, return_index=True)[1]  # left and right wheels are seen as one
    return source[first], goal[first]


def _flow(points: Floats, goals: Floats) -> Callable[[Floats], Floats]:
    """Return the way of points (N, 2) that go with points to their goals, step by step."""
    from scipy.interpolate import RBFInterpolator  # takes long to import, and only what has wheels or a side needs it

    low, high = (np.minimum(points.min(0), goals.min(0)) - _BEYOND, np.maximum(points.max(0), goals.max(0)) + _BEYOND)
    cell = (high - low) / (np.array(_GRID) - 1)
    nodes = low + np.stack(np.meshgrid(*map(np.arange, _GRID), indexing="ij"), -1).reshape(-1, 2) * cell
    fields, at = [], points
    for left in range(_TIMES, 0, -1):
        step = RBFInterpolator(at, (goals - at) / left, kernel="thin_plate_spline", smoothing=_SOFT)
        fields.append(step(nodes).T.reshape(2, *_GRID))
        at = at + step(at)

    def moved(flat: Floats) -> Floats:
        for field in fields:
            nodes_of = ((flat - low) / cell).T
            flat = flat + np.stack(
                [ndimage.map_coordinates(one, nodes_of, order=1, mode="nearest") for one in field], 1
            )
        return flat

    return moved


def _wider(flat: Floats, across: Floats, goal: Floats) -> Callable[[Floats], Floats]:
    """Return by how much points in the picture move away from the middle.

    `flat` (N, 2), `across` (N,): samples of the body where it is now; `goal` (N, 3): those of its goal.
    """
    other = goal[:, [2, 1]]
    low = np.minimum(flat.min(0), other.min(0))
    cell = np.maximum(np.maximum(flat.max(0), other.max(0)) - low, 1e-9) / np.array(_CELLS)
    own, wished = (_widths((each - low) / cell, x) for each, x in ((flat, across), (other, goal[:, 0])))
    ratios = np.clip(wished / np.maximum(own, 1e-3), *_RATIOS)
    return lambda at: np.asarray(
        ndimage.map_coordinates(ratios, ((at - low) / cell - 0.5).T, order=1, mode="nearest"), np.float64
    )


def _widths(at: Floats, across: Floats) -> Floats:
    """Return half widths of samples in the cells (C, D) where they are, smooth; empty cells have the nearest one's."""
    shape = np.array(_CELLS)
    key = np.ravel_multi_index(tuple(np.clip(at.astype(np.int64), 0, shape - 1).T), _CELLS)
    order = np.lexsort((np.abs(across), key))
    cells, first, count = np.unique(key[order], return_index=True, return_counts=True)
    widths = np.full(_CELLS, np.nan)
    widths.ravel()[cells] = np.abs(across)[order][first + (_MOST_WIDE * (count - 1)).astype(np.int64)]
    nearest = ndimage.distance_transform_edt(np.isnan(widths), return_distances=False, return_indices=True)
    filled = ndimage.grey_closing(widths[tuple(nearest)], (5, 5), mode="nearest")
    return np.asarray(ndimage.gaussian_filter(filled, _SMOOTH, mode="nearest"))


def _rolled(verts: Floats, wheel: _Wheel, wider: float) -> Floats:
    """Return the vertices (K, 3) of a wheel where it goes."""
    middle = float(verts[:, 0].min() + verts[:, 0].max()) / 2
    scale = wheel.goal_radius / max(wheel.radius, 1e-9)
    along = wheel.goal + (verts[:, [2, 1]] - wheel.middle) * scale
    across = middle * wider + (verts[:, 0] - middle) * np.clip(wider, *_ACROSS)
    return np.column_stack([across, along[:, 1], along[:, 0]])
