"""Draw what stands or lies in a castle, a churchyard or a yard."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def around(part: Part, count: int, start: float = 0.0, axis: str = "y") -> list[Part]:
    """Return copies of a part evenly around an axis, +Y unless another is given."""
    return [turned(part, start + 360.0 * k / count, axis) for k in range(count)]


def _dented(part: Part, centre: ArrayLike, radii: ArrayLike, push: ArrayLike) -> Part:
    """Push a smooth hollow about `centre` into a part."""
    near = np.exp(-((((part.verts - np.asarray(centre)) / np.asarray(radii)) ** 2).sum(1, keepdims=True) ** 2))
    return Part(part.verts + near * np.asarray(push, float), part.faces)


def arched(width: float, height: float, rise: float, depth: float) -> Part:
    """Return an upright slab on the ground whose top is an arch that rises by `rise` above its shoulders."""
    turn = np.linspace(0.0, np.pi, 15)
    top = [(0.5 * width * np.cos(t), height - rise + rise * np.sin(t)) for t in turn]
    return extrude([(-width / 2, 0.0), (width / 2, 0.0), *top], depth, bevel=0.12)


def skull(rng: Rng, _: Traits) -> Part:
    """Draw a skull: a round crown, hollow eyes and nose, cheekbones, a row of teeth, with or without its jaw."""
    long, eye = rng.uniform(0.72, 0.86), rng.uniform(0.15, 0.175)
    polar = np.linspace(0, np.pi, 37)
    ball = lathe(np.stack([np.sin(polar), -np.cos(polar)], 1), segments=56)
    x, y, z = (ball.verts * [0.62, 0.62, long]).T
    # The face is narrow below the cheekbones and flat in front.
    x, z = x * (1 - 0.22 * np.clip(-y - 0.1, 0, 1)), np.minimum(z + 0.25 * np.clip(-y, 0, 1) * (z > 0), 0.92 * long)
    part = Part(np.stack([x, y, z], 1), ball.faces)
    for side in (-1, 1):
        part = _dented(part, [0.25 * side, -0.14, long], [eye, eye, 0.7], [0, 0, -0.3])
        part = _dented(part, [0.62 * side, 0, 0.35], [0.2, 0.25, 0.25], [-0.05 * side, 0, 0])
    part = _dented(part, [0.0, -0.4, 0.9 * long], [0.075, 0.1, 0.5], [0, 0, -0.2])
    front = 0.72 * long
    gum = [[-0.3, -0.55, front - 0.3], [-0.2, -0.58, front], [0.2, -0.58, front], [0.3, -0.55, front - 0.3]]
    parts = [part, limb(gum, [0.15] * 4)]
    turn = np.linspace(0, 2 * np.pi, 17)
    ring = eye * np.stack([1.05 * np.cos(turn), 1.1 * np.sin(turn), -0.25 * np.cos(turn)], 1)
    parts += pair(moved(limb(ring, [0.06] * 17, segments=8, samples=1), [0.25, -0.14, 0.8 * long]))
    parts += [box([x, -0.68, front + 0.1], [0.1, 0.2, 0.12], round_by=0.3) for x in np.linspace(-0.22, 0.22, 4)]
    if rng.random() < 0.6:
        low = -0.86 - rng.uniform(0.02, 0.15)
        half = [[0.15, low, front], [0.36, low, 0.2], [0.42, -0.5, 0.0]]
        parts += [limb([*(np.array(half[::-1]) * [-1, 1, 1]), *half], [0.12] * 6)]
        parts += [box([x, low + 0.12, front + 0.06], [0.1, 0.16, 0.12], round_by=0.3) for x in (-0.17, 0.0, 0.17)]
    return join(parts)


def crown(rng: Rng, _: Traits) -> Part:
    """Draw a crown: a ring with five to eight points that carry beads, open or closed by a cap with arches."""
    points, wide, tall = int(rng.integers(5, 9)), rng.uniform(0.56, 0.66), rng.uniform(0.42, 0.6)
    lean, level = rng.uniform(1.02, 1.25), 0.3
    band = [(wide, 0.0), (wide + 0.07, 0.03), (wide + 0.07, 0.17), (wide, 0.2)]
    wall = [(wide * (1 + (lean - 1) * t), level + 0.12 * t) for t in (0.0, 0.5, 1.0)]
    ring = lathe([*band, *wall, *((r - 0.1, y) for r, y in wall[::-1]), (wide - 0.12, 0.14)], segments=8 * points)
    x, y, z = ring.verts.T
    # Each point rises in a straight line to its tip.
    tip = 1 - np.abs((np.arctan2(x, z) / (2 * np.pi) * points) % 1 - 0.5) * 2
    reach = np.clip((y - level) / 0.12, 0, 1) * (1 - tip)
    out = 1 + (lean - 1) * reach * tall
    parts = [Part(np.stack([x * out, y + reach * tall, z * out], 1), ring.faces)]
    away = (wide * lean - 0.05) * (1 + (lean - 1) * tall)
    parts += around(ellipsoid([0, level + 0.14 + tall, away], rng.uniform(0.09, 0.12), rings=8), points)
    parts += around(ellipsoid([0, 0.1, wide + 0.06], [0.09, 0.07, 0.06], rings=8), points, 180 / points)
    if rng.random() < 0.35:
        parts += [ellipsoid([0, 0.3, 0], [wide * 0.9, tall + 0.2, wide * 0.9]), ellipsoid([0, tall + 0.62, 0], 0.13)]
        parts += around(limb([[0, 0.3, wide], [0, 0.3 + 0.8 * tall, 0.7 * wide], [0, tall + 0.5, 0]], [0.08] * 3), 4)
    return join(parts)


def gravestone(rng: Rng, _: Traits) -> Part:
    """Draw a gravestone on a foot: a slab with a round or pointed top and a cross in relief, or a cross with a ring."""
    width, height, kind = rng.uniform(0.8, 1.0), rng.uniform(1.1, 1.4), rng.integers(3)
    deep = rng.uniform(0.26, 0.34)
    parts = [box([0, 0.1, 0], [width + 0.3, 0.26, deep + 0.3], round_by=0.15)]
    if kind == 2:
        level = 0.68 * height
        parts += [box([0, height / 2 + 0.1, 0], [0.3, height + 0.2, deep], round_by=0.1)]
        parts += [box([0, level, 0], [width, 0.3, 0.95 * deep], round_by=0.1)]
        if rng.random() < 0.5:
            turn = np.linspace(0, 2 * np.pi, 21)
            ring = np.stack([0.33 * np.sin(turn), level + 0.33 * np.cos(turn), 0 * turn], 1)
            parts += [limb(ring, [0.1] * 21, samples=1)]
        return join([*parts, box([0, 0.28, 0], [0.6, 0.2, deep + 0.1], round_by=0.15)])
    rise = width / 2 if kind else 0.18
    parts += [arched(width, height, rise, deep)]
    cross = 0.62 * height
    parts += [box([0, cross, 0.5 * deep], [0.13, 0.5, 0.14], round_by=0.3)]
    parts += [box([0, cross + 0.08, 0.5 * deep], [0.38, 0.13, 0.14], round_by=0.3)]
    parts += [box([0, y * height, 0.5 * deep], [0.6 * width, 0.08, 0.1], round_by=0.4) for y in (0.26, 0.38)]
    return join(parts)


def crate(rng: Rng, _: Traits) -> Part:
    """Draw a crate: a box with a thick frame along its edges and a plank or two across each side."""
    half = rng.uniform(0.42, 0.6, 3) * [1, rng.choice([1.0, 0.75]), 1]
    x, y, z = half
    bar, thick, double = rng.uniform(0.13, 0.18), 0.07, rng.random() < 0.4
    parts = [box([0, 0, 0], 2 * half, round_by=0.03)]
    for axis in range(3):
        size = np.full(3, bar)
        size[axis] = 2 * half[axis] + bar
        for one in (-1, 1):
            for two in (-1, 1):
                place = half.copy()
                place[axis], place[axis - 1], place[axis - 2] = 0.0, one * half[axis - 1], two * half[axis - 2]
                parts.append(box(place, size, round_by=0.12))
    for across, deep, turn in ((x, z, 0), (z, x, 90), (x, z, 180), (z, x, 270)):
        for side in (-1, 1) if double else (1,):
            ends = [[-side * across, -y, deep + 0.01], [side * across, y, deep + 0.01]]
            parts.append(turned(limb(ends, [[0.1, thick], [0.1, thick]], segments=8), turn, "y"))
    return join(parts)


def column(rng: Rng, _: Traits) -> Part:
    """Draw a fluted column on a square foot, with a plain capital or one with scrolls; or broken off."""
    wide, tall, kind = rng.uniform(0.24, 0.3), rng.uniform(1.5, 1.9), rng.integers(4)
    low = [(1.4 * wide, 0.14), (1.45 * wide, 0.2), (1.35 * wide, 0.26), (1.12 * wide, 0.28)]
    shaft = [(wide * (1.08 - 0.2 * t), 0.3 + (tall - 0.3) * t) for t in np.linspace(0, 1, 9)]
    high = [(1.05 * wide, tall + 0.02), (1.05 * wide, tall + 0.08), (1.5 * wide, tall + 0.2)]
    post = lathe([*low, *shaft, *(high if kind else [])], segments=72)
    x, y, z = post.verts.T
    flute = np.where((y > 0.29) & (y < tall + 0.01), 1 - 0.11 * np.abs(np.cos(6 * np.arctan2(x, z))), 1.0)
    crack = np.where(y > tall - 0.01, 0.5 * x + 0.2 * np.sin(11 * z), 0.0) if kind == 0 else 0.0
    parts = [Part(np.stack([x * flute, y + crack, z * flute], 1), post.faces)]
    parts += [box([0, 0.07, 0], [3.1 * wide, 0.18, 3.1 * wide], round_by=0.1)]
    if kind:
        parts += [box([0, tall + 0.24, 0], [3.2 * wide, 0.14, 3.2 * wide], round_by=0.15)]
    if kind == 1:
        roll = limb([[1.35 * wide, tall + 0.08, -1.2 * wide], [1.35 * wide, tall + 0.08, 1.2 * wide]], [0.16, 0.16])
        parts += pair(roll)
    return join(parts)


def torch(rng: Rng, _: Traits) -> Part:
    """Draw a torch: a stick that widens to a bound or a caged head, with a flame of several tongues."""
    thick, tall, head = rng.uniform(0.1, 0.13), rng.uniform(1.0, 1.3), rng.uniform(0.22, 0.28)
    stick = [(thick * 0.8, 0.0), (thick, 0.1), (thick * 1.1, tall)]
    parts = [lathe([*stick, (head, tall + 0.08), (head * 1.05, tall + 0.4), (0.6 * head, tall + 0.44)])]
    for level in (0.1, 0.3) if rng.random() < 0.6 else (0.37,):
        parts += [lathe([(head, tall + level - 0.05), (head + 0.07, tall + level), (head + 0.05, tall + level + 0.06)])]
    if rng.random() < 0.5:
        parts += [disc(thick + 0.06, y, y + 0.1) for y in (0.04, 0.4)]
    blaze, lean = rng.uniform(0.6, 0.85), rng.uniform(-0.1, 0.1)
    tongue = [[0, 0.42, 0], [0.3 * lean, 0.55, 0], [lean, 0.4 + 0.6 * blaze, 0], [0, 0.4 + blaze, 0]]
    parts += [limb(np.array(tongue) + [0, tall, 0], [0.24, 0.32, 0.17, 0.02])]
    lick = [[0, tall + 0.45, 0.12], [0, tall + 0.62, 0.3], [0, tall + 0.45 + 0.55 * blaze, 0.3]]
    side = limb(lick, [0.15, 0.14, 0.02], segments=10)
    return join([*parts, *around(side, 4, rng.uniform(0, 90))])


def bone(rng: Rng, _: Traits) -> Part:
    """Draw a bone along X: a shaft, narrow in its middle, with two knobs at each end."""
    long, thick, knob = rng.uniform(0.6, 0.85), rng.uniform(0.13, 0.17), rng.uniform(0.2, 0.26)
    shaft = [limb([[-long, 0, 0], [0, 0, 0], [long, 0, 0]], [1.4 * thick, thick, 1.4 * thick])]
    for y in (-0.75, 0.75):
        shaft += pair(ellipsoid([long + 0.5 * knob, y * knob, 0], [knob * 1.15, knob, 0.9 * knob], rings=10))
    return turned(join(shaft), rng.choice([0.0, rng.uniform(-25, 25)]), "z")


def log(rng: Rng, _: Traits) -> Part:
    """Draw a log along Z with ridges of bark, rings on its sawn ends and the stump of a branch."""
    long, thick = rng.uniform(0.85, 1.1), rng.uniform(0.26, 0.4)
    bark = [(thick, -long), *((thick, long * t) for t in np.linspace(-0.9, 0.9, 9)), (thick, long)]
    wood = [(0.85 * thick, -long), *bark, (0.85 * thick, long)]
    rings = [(0.8 * thick, long - 0.05), (0.5 * thick, long - 0.05), (0.4 * thick, long), (0.2 * thick, long)]
    part = lathe([*((r, -y) for r, y in rings[::-1]), *wood, *rings], segments=48)
    x, y, z = part.verts.T
    ridge = 1 - 0.07 * (np.cos(9 * np.arctan2(x, z) + 1.5 * np.sin(3 * y)) > 0.3) * (np.hypot(x, z) > 0.82 * thick)
    bent = rng.uniform(-0.08, 0.08) * (y / long) ** 2
    part = turned(Part(np.stack([x * ridge + bent, y, z * ridge], 1), part.faces), 90, "x")
    at, tilt = rng.uniform(-0.5, 0.5) * long, rng.uniform(-80, 80)
    stump = moved(turned(turned(disc(0.42 * thick, 0.0, thick + 0.2), 25, "x"), tilt, "z"), [0, 0, at])
    return join([part, stump])


def scroll(rng: Rng, _: Traits) -> Part:
    """Draw a scroll: open between two rollers with knobs, facing +Z; or rolled up along X, tied, with a free end."""
    wide, tall, roll = rng.uniform(0.5, 0.62), rng.uniform(0.5, 0.75), rng.uniform(0.13, 0.18)

    def roller(y: float, knobs: bool) -> list[Part]:
        rod = [(0.06, -wide - 0.28), (0.12, -wide - 0.24), (0.12, -wide - 0.14), (0.06, -wide - 0.1)] if knobs else []
        curl = [(0.5 * roll, -wide), (0.5 * roll, 0.05 - wide), (roll, 0.05 - wide), (roll, -wide)]
        half = [*rod, *curl[:1], *curl[3:], (roll, 0.0)]
        return [moved(turned(lathe([*half, *((r, -h) for r, h in half[-2::-1])]), 90, "z"), [0, y, 0])]

    if rng.random() < 0.25:
        tie = [(roll * 1.3, -0.1), (roll * 1.3, 0.1)]
        free = turned(box([0, -0.85 * roll, 0.22], [1.8 * wide, 0.09, 0.5], round_by=0.4), -8, "x")
        seal = ellipsoid([0, 0.1 * roll, 1.2 * roll], [0.14, 0.14, 0.07], rings=8)
        return join([*roller(0.0, knobs=False), turned(lathe(tie), 90, "z"), free, seal])
    bow = np.linspace(-1.0, 1.0, 7)
    sheet = [[0, tall * t, 0.12 * t**2 - 0.06] for t in bow]
    lines = [box([0, y * tall, -0.02], [1.2 * wide, 0.07, 0.13], round_by=0.45) for y in (-0.36, 0.0, 0.36)]
    return join([limb(sheet, [[wide - 0.07, 0.05]] * 7), *lines, *roller(tall, knobs=True), *roller(-tall, knobs=True)])


def crystal(rng: Rng, _: Traits) -> Part:
    """Draw crystals: one cut stone with a point above and below, or a bunch of prisms with points that lean apart."""
    if rng.random() < 0.4:
        wide, sides = rng.uniform(0.45, 0.75), int(rng.integers(5, 9))
        return lathe([(0.02, -0.9), (wide, 0.1), (wide, 0.25), (0.55 * wide, 0.55)], segments=sides)
    parts = [ellipsoid([0, 0.05, 0], [0.55, 0.16, 0.5], rings=8)]
    for k in range(int(rng.integers(4, 7))):
        tall, wide = (1.5, 0.24) if k == 0 else (rng.uniform(0.6, 1.1), rng.uniform(0.13, 0.19))
        prism = lathe([(wide, -0.1), (1.1 * wide, 0.7 * tall), (0.02, tall)], segments=6)
        lean = turned(prism, 0 if k == 0 else rng.uniform(18, 38), "x")
        parts.append(turned(lean, 72 * k + rng.uniform(-15, 15), "y"))
    return join(parts)
