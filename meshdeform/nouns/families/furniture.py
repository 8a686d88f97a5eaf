"""Draw furniture: boxes with rounded edges and thick legs."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.dungeon import arched
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def _legs(half_width: float, half_depth: float, height: float, radius: float) -> list[Part]:
    legs: list[Part] = []
    for z in (-half_depth, half_depth):
        foot, top = (half_width, radius * 0.5, z), (half_width, height, z)
        legs += pair(limb([foot, top], [radius * 0.85, radius], segments=10))
    return legs


def bathtub(rng: Rng, _: Traits) -> Part:
    """Draw a bathtub: a long hollow basin with a rolled rim on four feet, its head end high, a tap at its foot (+Z)."""
    width, length, deep = rng.uniform(0.46, 0.54), rng.uniform(0.9, 1.05), rng.uniform(0.55, 0.65)
    slope, lift = rng.uniform(0.66, 0.78), rng.uniform(0.1, 0.24)
    outer = [(slope, 0.0), (slope + 0.12, 0.14), (0.95, 0.75 * deep), (0.96, deep - 0.1)]
    rim = [(1.06, deep - 0.07), (1.08, deep), (1.0, deep + 0.03), (0.88, deep)]
    shell = lathe([*outer, *rim, (0.84, 0.7 * deep), (0.7, 0.2), (0.0, 0.16)], segments=40)
    x, y, z = shell.verts.T
    # A rounded rectangle from above; the head end rises.
    round_ = np.maximum(np.abs(x), np.abs(z))
    square = np.hypot(x, z) / np.where(round_ > 0, round_, 1.0)
    x, z = x * square**0.6, z * square**0.6
    head = np.clip(-z, 0, 1) ** 2 * np.clip(y / deep, 0, 1)
    basin = Part(np.stack([x * width, 0.2 + y + lift * head, z * length], 1), shell.faces)
    feet: list[Part] = []
    for end in (-0.6, 0.6):
        feet += pair(limb([[width * 0.62, 0.3, end * length], [width * 0.8, 0.08, end * length]], [0.13, 0.1]))
    top = deep + 0.2
    spout = [[0, top - 0.1, length * 0.98], [0, top + 0.32, length * 0.98], [0, top + 0.3, length * 0.72]]
    return join([basin, *feet, limb(spout, [0.09, 0.085, 0.085], segments=10)])


def door(rng: Rng, _: Traits) -> Part:
    """Draw a door with a knob in its frame: with raised panels, or arched, of planks with iron bands."""
    wide, tall, deep = rng.uniform(0.8, 1.0), rng.uniform(1.6, 1.9), rng.uniform(0.26, 0.34)
    knob = ellipsoid([0.36 * wide, 0.47 * tall, 0.5 * deep + 0.02], 0.09, rings=8)
    if rng.random() < 0.4:
        parts = [arched(wide + 0.3, tall + 0.15, 0.5 * wide, deep - 0.08), knob]
        for x, share in ((-0.36, 0.78), (-0.12, 0.95), (0.12, 0.95), (0.36, 0.78)):
            parts += [moved(arched(0.9 * wide / 4, tall * share, 0.02, 0.1), [x * wide, 0, 0.5 * deep - 0.04])]
        bands = [box([-0.05 * wide, y * tall, 0.5 * deep], [0.85 * wide, 0.13, 0.16], round_by=0.2) for y in (0.2, 0.7)]
        return join([*parts, *bands])
    parts = [box([0, tall / 2, 0], [wide, tall, deep - 0.14], round_by=0.1), knob]
    parts += pair(box([wide / 2 + 0.06, tall / 2, 0], [0.17, tall, deep], round_by=0.15))
    parts += [box([0, tall + 0.06, 0], [wide + 0.34, 0.2, deep + 0.04], round_by=0.15)]
    rows = [(0.2, 0.28), (0.72, 0.42)] if rng.random() < 0.5 else [(0.17, 0.22), (0.5, 0.24), (0.83, 0.2)]
    for middle, share in rows:
        for z in (-1, 1):
            place = [0.24 * wide, middle * tall, z * (0.5 * deep - 0.09)]
            parts += pair(box(place, [0.36 * wide, share * tall, 0.13], round_by=0.48))
    return join(parts)


def _panel(x: float, y: float, front: float, width: float, height: float, thick: float = 0.13) -> Part:
    """Return a raised panel with soft edges on a front."""
    return box([x, y, front], [width, height, thick], round_by=0.45)


def _grip(x: float, y: float, front: float, long: float, axis: int) -> Part:
    """Return a bar to pull at, `long` along x (0) or y (1)."""
    half = np.eye(3)[axis] * long / 2
    return limb([np.array([x, y, front]) - half, np.array([x, y, front]) + half], [0.06, 0.06], segments=10)


def bookcase(rng: Rng, _: Traits) -> Part:
    """Draw a bookcase, open in front, with rows of books of all heights on its boards."""
    wide, deep, rows = rng.uniform(0.9, 1.25), rng.uniform(0.4, 0.5), int(rng.integers(3, 5))
    row = rng.uniform(0.4, 0.48)
    tall = rows * row + 0.1
    parts = [box([0, tall / 2, -deep / 2 + 0.06], [wide, tall, 0.12], round_by=0.1)]
    parts += [*pair(box([wide / 2, tall / 2, 0], [0.13, tall, deep]))]
    for k in range(rows + 1):
        parts.append(box([0, 0.05 + k * row, 0], [wide + 0.1 * (k in (0, rows)), 0.11, deep], round_by=0.2))
        x = -wide / 2 + 0.08
        while k < rows:
            thick, high = rng.uniform(0.09, 0.15), row * rng.uniform(0.5, 0.8)
            if x + thick > wide / 2 - rng.choice([0.08, 0.2, 0.4]):
                break
            size = [0.95 * thick, high, deep - rng.uniform(0.06, 0.16)]
            parts.append(box([x + thick / 2, 0.1 + k * row + high / 2, 0.02], size, round_by=0.2, cells=4))
            x += thick
    return join(parts)


def fridge(rng: Rng, _: Traits) -> Part:
    """Draw a fridge with a small door over a large one or the other way round, or two side by side; some are round."""
    wide, tall, deep = rng.uniform(0.8, 0.95), rng.uniform(1.5, 1.8), rng.uniform(0.7, 0.8)
    kind, soft, front = rng.integers(3), rng.choice([0.05, 0.24]), deep / 2
    parts = [box([0, tall / 2 + 0.04, -0.04], [wide, tall, deep - 0.08], round_by=soft)]
    parts += [box([0, 0.05, -0.04], [0.9 * wide, 0.12, 0.8 * deep])]
    if kind == 2:
        parts += pair(_panel(0.25 * wide, tall / 2 + 0.06, front - 0.03, 0.49 * wide, tall - 0.14, 0.18))
        parts += [*pair(_grip(0.07, 0.55 * tall, front + 0.1, 0.7, 1))]
        return join([*parts, _panel(-0.26 * wide, 0.62 * tall, front + 0.06, 0.2, 0.32)])
    split = tall * (0.66 if kind else 0.36)
    for low, high in ((0.1, split), (split + 0.03, tall)):
        parts += [_panel(0, (low + high) / 2, front - 0.02, wide - 0.01, high - low, 0.2)]
        parts += [_grip(-0.36 * wide, split + (0.24 if low > 0.1 else -0.24), front + 0.12, 0.3, 1)]
    return join(parts)


def toilet(rng: Rng, _: Traits) -> Part:
    """Draw a toilet: a foot, an oval bowl with its seat, the lid up or down, a tank with a button behind."""
    wide, long, high = rng.uniform(0.4, 0.46), rng.uniform(0.52, 0.62), rng.uniform(0.62, 0.74)
    rows = [(0.62, 0.0), (0.6, 0.08), (0.45, 0.25), (0.55, 0.5), (0.95, 0.82), (1.0, 0.9), (1.08, 0.92), (1.08, 1.0)]
    bowl = vessel(np.array(rows) * [1, high], 0.34, 0.45 * high, segments=36)
    parts = [Part(bowl.verts * [wide, 1, long], bowl.faces)]
    parts += [box([0, 0.62 * high, -long], [0.7 * wide, 0.6 * high, 0.5])]
    back, tank = -long - 0.14, rng.uniform(0.5, 0.66)
    parts += [box([0, high + tank / 2, back], [2 * wide, tank, 0.36], round_by=0.15)]
    parts += [box([0, high + tank, back], [2 * wide + 0.1, 0.13, 0.44], round_by=0.3)]
    parts += [disc(0.07, high + tank, high + tank + 0.11, edge=0.02)]
    parts[-1] = moved(parts[-1], [0, 0, back])
    lid = disc(1.0, -0.045, 0.045)
    if rng.random() < 0.6:
        oval = turned(Part(lid.verts * [wide * 1.02, 1, long * 0.95], lid.faces), 80, "x")
        return join([*parts, moved(oval, [0, high + 0.92 * long, back + 0.33])])
    return join([*parts, moved(Part(lid.verts * [wide * 1.1, 1.2, long * 1.1], lid.faces), [0, high + 0.06, 0])])


def cone(rng: Rng, _: Traits) -> Part:
    """Draw a traffic cone: a square foot and a slim blunt cone with a raised band."""
    foot, tall, wide = rng.uniform(0.46, 0.56), rng.uniform(1.05, 1.4), rng.uniform(0.28, 0.34)
    share = np.array([0.0, 0.05, 0.3, 0.36, 0.37, 0.66, 0.67, 0.75, 0.97, 1.0])
    wall = np.stack([wide * (1 - share) + 0.08 + 0.035 * ((share > 0.365) & (share < 0.665)), 0.12 + tall * share], 1)
    return join([box([0, 0.07, 0], [2 * foot, 0.15, 2 * foot], round_by=0.25), lathe([(wide + 0.16, 0.1), *wall])])


def pillow(rng: Rng, _: Traits) -> Part:
    """Draw a pillow that leans back: a swollen cushion with drawn-out corners, with or without a button."""
    wide, tall, puff = rng.uniform(0.75, 1.0), rng.uniform(0.6, 0.75), rng.uniform(0.28, 0.4)
    part = box([0, 0, 0], [2, 2, 0.2], round_by=0.5, cells=20)
    x, y, z = part.verts.T
    full = 1 + puff / 0.1 * np.clip((1 - x**2) * (1 - y**2), 0, 1) ** 0.5
    # The sides are drawn in between the corners.
    x, y = wide * x * (0.86 + 0.14 * y**2), tall * y * (0.86 + 0.14 * x**2)
    parts = [Part(np.stack([x, y, z * full], 1), part.faces)]
    if rng.random() < 0.5:
        parts += [ellipsoid([0, 0, z * (puff + 0.1)], [0.13, 0.13, 0.06], rings=8) for z in (-1, 1)]
    return turned(join(parts), -rng.uniform(8, 30), "x")
