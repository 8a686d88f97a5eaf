"""Build the solids of sketches from their groups of numbers; `sketches` says what the numbers of each are."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from meshdeform.nouns.families.buildings import arch, bar, block, roof_of
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    box,
    curved,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    moved,
    named,
    plate,
    turned,
)
from meshdeform.nouns.families.vehicles import tyre

__all__ = ["Groups", "solid", "tapered"]

Groups = list[list[float]]


def _drum(axis: str, groups: Groups) -> Part:
    centre, (radius, half) = groups
    cut = 0.25 * min(radius, half)
    side = lathe([(radius - cut, -half), (radius, cut - half), (radius, half - cut), (radius - cut, half)], segments=20)
    return moved(turned(side, 0 if axis == "y" else 90, "z" if axis == "x" else "x"), centre)


def _hoop(groups: Groups) -> Part:
    centre, (radius, thick, *tall) = groups
    turn = np.linspace(0, 2 * np.pi, 21)
    ring = np.c_[radius * np.sin(turn), (tall or [1.0])[0] * radius * np.cos(turn), 0 * turn]
    return moved(limb(ring, np.full(21, thick), segments=8, samples=1), centre)


def _rod(smooth: bool, groups: Groups) -> Part:
    radii: list[float] = []
    points = []
    for x, y, z, *own in groups:
        radii = own or radii
        points.append([x, y, z, radii[0], radii[-1]])
    knots = curved(points, samples=3) if smooth else np.array(points)
    way = knots[1, :3] - knots[0, :3]
    if abs(way[2]) > 0.9 * np.linalg.norm(way):  # there `limb` takes the radius along Y first
        knots = knots[:, [0, 1, 2, 4, 3]]
    return limb(knots[:, :3], np.maximum(knots[:, 3:], 0.01), segments=10, samples=1 if smooth else 2)


def _profile(smooth: bool, groups: Groups) -> Array:
    """Return (radius, height) along a profile; a smooth one keeps its ends."""
    points: Array = curved(groups, samples=3) if smooth else np.asarray(groups, float)
    return np.maximum(points, [0.004 if smooth else 0.0, -np.inf])


def _outline(groups: Groups) -> Array:
    """Return the corners (N, 2) of an outline counter-clockwise; five numbers are an arc of seven corners."""
    corners: list[list[float]] = []
    for group in groups:
        if len(group) == 5:
            angle = np.radians(np.linspace(group[3], group[4], 7))
            corners += (group[:2] + group[2] * np.stack([np.cos(angle), np.sin(angle)], 1)).tolist()
        else:
            corners.append(group)
    rim = np.array(corners)
    after = np.roll(rim, -1, axis=0)
    clockwise = float((rim[:, 0] * after[:, 1] - rim[:, 1] * after[:, 0]).sum()) < 0
    return rim[::-1] if clockwise else rim


def _plate(smooth: bool, groups: Groups) -> Part:
    rim = groups[1:]
    if smooth:
        rim = curved(np.concatenate([rim[-2:], rim, rim[:3]]), samples=4)[8:-12].tolist()
    return extrude(_outline(rim), groups[0][0], bevel=0.15, puff=(*groups[0], 0.0)[1])


def _side(groups: Groups) -> Part:
    width, bevel = (*groups[0], 0.06)[:2]
    return turned(extrude(_outline(groups[1:]), width, bevel=bevel), -90, "y")


def _keys(groups: Groups) -> Part:
    centre, (rows, columns), (wide, deep, high) = groups
    x, z = (np.arange(count) / count + 0.5 / count - 0.5 for count in (columns, rows))
    size = [0.75 * wide / columns, high, 0.75 * deep / rows]
    key = box(centre, size, round_by=0.0, cells=1)
    return join([moved(key, [wide * a, 0, deep * b]) for b in z for a in x])


def _box(cells: int, round_by: float, groups: Groups) -> Part:
    return box(groups[0], groups[1], round_by=groups[2][0] if len(groups) > 2 else round_by, cells=cells)


def _slab(cells: int, groups: Groups) -> Part:
    return block(groups[0], groups[1], groups[2][0] if len(groups) > 2 else 0.1, cells)


def _roof(kind: str, groups: Groups) -> Part:
    base, (width, rise, depth) = groups
    return moved(roof_of(kind, width, depth, rise), base)


def _wheel(groups: Groups) -> Part:
    """Return a tyre about a sunk rim with a hub."""
    dish = np.array([(0.0, 0.75), (0.22, 0.75), (0.3, 0.45), (0.62, 1.0), (0.86, 1.0), (1.0, 0.55)]) * groups[1]
    return moved(turned(lathe([*(dish * [1, -1]), *dish[::-1]], segments=16), 90, "z"), groups[0])


def _spoked(groups: Groups) -> Part:
    """Return a rim about a thin disc, which leaves no hole, a hub, and spokes right across."""
    centre, (radius, half, spokes) = groups
    outer = np.array([(0.0, 0.2), (0.84, 0.2), (0.85, 1.0), (1.0, 1.0)]) * [radius, half]
    rim = turned(lathe([*(outer * [1, -1]), *outer[::-1]], segments=22), 90, "z")
    spoke = box([0, 0, 0], [1.3 * half, 1.8 * radius, 0.1 * radius], round_by=0.1, cells=2)
    across = [turned(spoke, k * 180 / spokes, "x") for k in range(int(spokes))]
    return moved(join([rim, _drum("x", [[0, 0, 0], [0.2 * radius, 1.6 * half]]), *across]), centre)


def _cab(groups: Groups) -> Part:
    """Return a cabin of a side view that narrows upward, with a roof, posts, and raised windows all around."""
    (width, narrow, posts), *corners = groups
    rim = _outline(corners)
    low, high = rim.min(0), rim.max(0)
    deep = high[1] - low[1]
    middle = np.array([rim[:, 0].mean(), (low[1] + 2 * high[1]) / 3])
    panes = [_side([[width + 0.025, 0.02], *(middle + (rim - middle) * [0.86, 0.68])])]
    panes += [_side([[0.82 * width], *(middle + (rim - middle) * [1, 0.7] + [push, 0])]) for push in (-0.02, 0.02)]
    tops = rim[rim[:, 1] > high[1] - 0.06 * deep][:, 0]
    boards = [([0, high[1], tops.mean()], [width + 0.02, 0.1 * deep + 0.02, np.ptp(tops) + 0.06])]
    for z in np.linspace(low[0], high[0], int(posts) + 2)[1:-1]:
        boards.append(([0, middle[1], z], [width + 0.035, 0.86 * deep, 0.06]))
    solids = [_side([[width], *rim]), *(_box(3, 0.12, [*each]) for each in boards)]
    return tapered(named(cabin=solids, window=panes), 1, narrow)


def tapered(part: Part, axis: int, by: float) -> Part:
    """Narrow a solid along X by a share, from none at its foot, or at the middle of the axis Z, to `by`."""
    along = part.verts[:, axis : axis + 1]
    low = along.min() if axis == 1 else max(0.0, float(along.min()))
    scale = 1 - by * np.clip((along - low) / (along.max() - low), 0, 1)
    return part._replace(verts=part.verts * np.concatenate([scale, np.ones_like(scale), np.ones_like(scale)], 1))


def _wing(groups: Groups) -> Part:
    """Return the left wing, its root's front edge at the origin."""
    (span, chord, sweep, taper, thick, rise_deg) = groups[0]
    end = chord * taper
    outline = [(-0.02, 0), (0.5 * span, -0.5 * sweep), (0.94 * span, -sweep), (span, -sweep - 0.3 * end)]
    outline += [(span, -sweep - 0.85 * end), (0.94 * span, -sweep - end), (-0.02, -chord)]
    return turned(plate(outline, thick, across="y"), rise_deg, "z")


def _hull(groups: Groups) -> Part:
    """Return a ship's hull with a flat deck."""
    (long, beam, depth), (bow, stern, sheer, keel) = groups
    whole = box([0, 0, 0], [2, 2, 2], round_by=0.06, cells=10)
    x, y, z = whole.verts.T
    ahead, behind, up = np.clip(z, 0, 1), np.clip(-z, 0, 1), (y + 1) / 2
    wide = (1 - bow * ahead**2.6) * (1 - stern * behind**3) * (1 - keel * (1 - up) ** 1.5)
    height = depth * up + sheer * (ahead**2 + 0.4 * behind**2) * (0.3 + 0.7 * up)
    return whole._replace(verts=np.column_stack([x * beam * wide, height, (z + 0.12 * ahead * up) * long]))


def _shell(groups: Groups) -> Part:
    """Return a boat's shell, open above; its ends rise."""
    (long, beam, depth), (rise, stern) = groups
    wall = [(0.25, 0.0), (0.7, 0.12), (0.92, 0.5), (1.0, 1.0), (0.93, 1.0), (0.84, 0.5), (0.6, 0.24), (0.2, 0.2)]
    whole = lathe(wall, segments=32)
    x, y, z = whole.verts.T
    power = np.where(z < 0, 1.5 - 1.1 * stern, 1.5)
    across = np.sign(x) * np.abs(np.sin(np.arctan2(x, z))) ** power * np.hypot(x, z)
    along = np.where(z < 0, (1 - 0.2 * stern) * z, z)
    lift = rise * np.abs(along) ** 3 * (0.4 + 0.6 * y)
    return whole._replace(verts=np.column_stack([across * beam, y * depth + lift, along * long]))


_SHAPES: dict[str, Callable[[Groups], Part]] = {
    "arch": lambda groups: arch(groups[1][0], groups[1][1], groups[1][2], groups[0]),
    "ball": lambda groups: ellipsoid(*groups, rings=8),
    "bar": lambda groups: bar(groups[0], groups[1], groups[2][0]),
    "blob": partial(_plate, True),
    "block": partial(_slab, 4),
    "board": partial(_box, 3, 0.12),
    "box": partial(_box, 4, 0.2),
    "brick": partial(_box, 2, 0.2),
    "cab": _cab,
    "drum": partial(_drum, "y"),
    "drumx": partial(_drum, "x"),
    "drumz": partial(_drum, "z"),
    "hoop": _hoop,
    "hull": _hull,
    "keys": _keys,
    "plate": partial(_plate, False),
    **{kind: partial(_roof, kind) for kind in ("gable", "gambrel", "hip", "ridge", "slope")},
    "rod": partial(_rod, False),
    "shell": _shell,
    "side": _side,
    "slab": partial(_slab, 2),
    "spoked": _spoked,
    "tube": partial(_rod, True),
    "tyre": lambda groups: tyre(groups[1][0], groups[1][1], groups[0]),
    "wheel": _wheel,
    "wing": _wing,
}


def solid(name: str, groups: Groups) -> Part:
    """Return a solid by the word of its shape.

    Raises
    ------
    KeyError, TypeError, ValueError
        If there is no such shape, or it needs other numbers.
    """
    form, sides = name.rstrip("0123456789"), name.lstrip("abcdefghijklmnopqrstuvwxyz")
    if form in ("lathe", "turn"):
        return _of_sides(lathe(_profile(form == "turn", groups), segments=24), sides)
    if form == "cube":
        return _box(int(sides or 6), 0.25, groups)
    if form == "limb":
        return limb([group[:3] for group in groups], [group[3:] * (6 - len(group)) for group in groups],
            segments=int(sides or 16))  # fmt: skip
    if form == "orb":
        return ellipsoid(*groups, rings=int(sides or 14))
    if form == "spin":
        return lathe(groups, segments=int(sides or 28))
    if form in ("cup", "vase"):
        wall, floor = groups[0]
        return _of_sides(vessel(_profile(form == "vase", groups[1:]), wall, floor, segments=24), sides)
    return _SHAPES[name](groups)


def _of_sides(part: Part, sides: str) -> Part:
    """Press a surface of revolution flat on as many sides as are given; a corner is at +Z."""
    if not sides:
        return part
    x, y, z = part.verts.T
    half = np.pi / int(sides)
    flat = np.cos(half) / np.cos(np.arctan2(x, z) % (2 * half) - half)
    return part._replace(verts=np.stack([x * flat, y, z * flat], 1))
