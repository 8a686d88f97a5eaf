"""Draw buildings and bridges, their doors facing +Z, and what they consist of: roofs, arches, boards and bars."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import (
    Array,
    Part,
    box,
    disc,
    extrude,
    join,
    lathe,
    limb,
    moved,
    named,
    pair,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits

ROOT2 = float(np.sqrt(2.0))


def pyramid(half: float, height: float, base: ArrayLike) -> Part:
    """Return an upright pyramid on a square of side 2 `half` whose centre is `base`."""
    side = half * np.sqrt(2.0)
    return moved(turned(lathe([(side, 0.0), (0.5 * side, 0.5 * height), (0.04, height)], segments=4), 45, "y"), base)


def gable(half: float, rise: float, depth: float, base: ArrayLike) -> Part:
    """Return a gabled roof whose ridge runs along Z; `base` is the middle of its eaves' plane."""
    outline = [(-half, 0.0), (-half, -0.1), (0.0, -0.1), (half, -0.1), (half, 0.0), (0.06, rise), (-0.06, rise)]
    return moved(extrude(outline, depth, bevel=0.03), base)


def arch(width: float, height: float, depth: float, base: ArrayLike) -> Part:
    """Return a plate with a round top, a door or a window; `base` is the middle of its foot."""
    turn = np.linspace(0, np.pi, 9)
    half = width / 2
    top = [(half * np.cos(t), height - half + half * np.sin(t)) for t in turn]
    return moved(extrude([(-half, 0.0), (half, 0.0), *top], depth, bevel=0.3), base)


def castle(rng: Rng, traits: Traits) -> Part:
    """Draw a castle: a square wall with battlements, four round towers with battlements at its corners, a gate."""
    half, wall = rng.uniform(0.62, 0.72), rng.uniform(0.5, 0.6)
    rise = traits.draw(rng, "tower", (0.04, 0.1), (0.42, 0.55), (1.2, 1.45))
    radius, keep = rng.uniform(0.23, 0.27), rng.uniform(0.2, 0.26)
    top = wall + rise
    crown = [(radius, top - 0.1), (1.2 * radius, top), (1.2 * radius, top + 0.1), (0.8 * radius, top + 0.1)]
    tower = lathe([(1.12 * radius, 0.0), (radius, 0.2), (radius, 0.6 * top), *crown, (0.8 * radius, top)], segments=24)
    tooth = box([0, top + 0.14, radius], [0.17, 0.26, 0.14], round_by=0.2, cells=4)
    turret = join([tower, *(turned(tooth, 60 * step, "y") for step in range(6))])
    parts = [part for z in (half, -half) for part in pair(moved(turret, [half, 0, z]))]
    parts.append(box([0, wall / 2, 0], [2 * half, wall, 2 * half], round_by=0.04))
    row = [box([x, wall, half], [0.17, 0.26, 0.14], round_by=0.2, cells=4) for x in (-0.34 * half, 0.0, 0.34 * half)]
    parts += [turned(part, 90 * side, "y") for side in range(4) for part in row]
    # The gate lies deep between two posts and a lintel.
    parts.append(box([0, 0.5 * wall + keep, half + 0.1], [0.64, 0.7 * wall, 0.24], round_by=0.15))
    parts += pair(box([0.23, (wall + keep) / 2, half + 0.1], [0.2, wall + keep, 0.3], round_by=0.15))
    return join([*parts, box([0, wall, 0], [0.7 * half, wall + 2 * keep, 0.7 * half], round_by=0.1)])


def igloo(rng: Rng, _: Traits) -> Part:
    """Draw an igloo: a dome of blocks with grooves between them, a round tunnel with an open mouth in front (+Z)."""
    tall, blocks = rng.uniform(0.86, 1.02), 14
    levels, across = np.linspace(0.0, np.pi / 2, 41)[:-1], 56
    dome = lathe([(np.cos(t), np.sin(t)) for t in levels] + [(0.0, 1.0)], segments=across)
    x, y, z = dome.verts.T
    course = np.arcsin(np.clip(y, 0, 1)) / (np.pi / 2) * 5
    around = np.arctan2(x, z) / (2 * np.pi) * blocks + 0.5 * np.floor(course)
    seam = np.minimum(np.abs(course - np.round(course)) * 0.3, np.abs(around - np.round(around)) * 0.42)
    # The lowest seam is the ground, the highest course one lid.
    seam[(course < 0.2) | (course > 4.6)] = 1.0
    groove = 1 - 0.075 * (seam < 0.045)
    shell = Part(dome.verts * groove[:, None] * [1.0, tall, 1.0], dome.faces)
    radius, reach = rng.uniform(0.36, 0.42), rng.uniform(1.35, 1.5)
    outer = [(radius, 0.4), (radius, reach - 0.24), (radius * 1.14, reach - 0.2), (radius * 1.14, reach)]
    tube = lathe([*outer, (radius * 0.68, reach), (radius * 0.66, reach - 0.32)], segments=28)
    passage = moved(turned(tube, 90, "x"), [0, 0.12, 0])
    return join([shell, Part(np.maximum(passage.verts, [-9.0, 0.0, -9.0]), passage.faces)])


def skyscraper(rng: Rng, _: Traits) -> Part:
    """Draw a skyscraper: a broad base, tall stepped tiers with ribs all round, a crown and a mast."""
    parts: list[Part] = []
    bottom, half, deep = 0.0, rng.uniform(0.56, 0.66), rng.uniform(0.48, 0.56)
    for tall in (rng.uniform(0.3, 0.4), rng.uniform(0.6, 0.75), rng.uniform(0.75, 0.95), rng.uniform(0.24, 0.32)):
        parts.append(box([0, bottom + tall / 2, 0], [2 * half, tall, 2 * deep], round_by=0.04))
        for place in (-0.72, -0.24, 0.24, 0.72):
            rib = (bottom + tall / 2 + 0.01, tall + 0.02)
            parts.append(box([place * half, rib[0], 0], [0.24 * half, rib[1], 2 * deep + 0.09], round_by=0.3))
            parts.append(box([0, rib[0], place * deep], [2 * half + 0.09, rib[1], 0.24 * deep], round_by=0.3))
        shrink = rng.uniform(0.7, 0.78)
        bottom, half, deep = bottom + tall, half * shrink, deep * shrink
    mast = [(0.17, 0.0), (0.15, 0.16), (0.09, 0.22), (0.08, rng.uniform(0.5, 0.65)), (0.06, 0.75)]
    return join([*parts, moved(lathe(mast), [0, bottom - 0.02, 0])])


def tent(rng: Rng, _: Traits) -> Part:
    """Draw a ridge tent: two sloping cloths down to the ground, poles crossed at the ends, flaps turned open (+Z)."""
    half, tall, length = rng.uniform(0.72, 0.86), rng.uniform(0.92, 1.08), rng.uniform(1.5, 1.8)
    cloth = [(-half + 0.1, 0.0), (half - 0.1, 0.0), (0.03, tall - 0.06), (-0.03, tall - 0.06)]
    parts = [moved(extrude(cloth, length - 0.5, bevel=0.02), [0, 0, -0.16])]
    sheet = [(half - 0.17, 0.0), (half + 0.06, 0.0), (0.4 * half, 0.42 * tall), (0.03, tall), (-0.08, tall - 0.08)]
    sheet += [(0.4 * half - 0.17, 0.42 * tall - 0.02)]
    parts += pair(extrude(sheet, length, bevel=0.1))
    # Each flap is folded back beside the opening, broad at its foot.
    flap = extrude([(half * 0.45, 0.0), (half, 0.0), (0.08, tall - 0.08), (0.0, tall - 0.12)], 0.12)
    parts += pair(moved(flap, [0, 0, length / 2 - 0.08]))
    for z in (-length / 2 + 0.04, length / 2 - 0.04):
        parts += pair(limb([[half + 0.06, 0.05, z], [-0.14, tall + 0.16, z]], [0.065, 0.06], segments=10))
    return join([*parts, limb([[0, tall - 0.01, -length / 2], [0, tall - 0.01, length / 2]], [0.075, 0.075])])


def roof_of(kind: str, width: float, depth: float, rise: float) -> Part:
    """Return a roof over a rectangle at the level 0.

    `kind`: "gable" (toward +Z), "ridge" (it runs along X), "hip", "slope" (one, which falls to the back) or "gambrel"
    (a gable toward +Z with two slopes on each side).
    """
    if kind == "ridge":
        return turned(gable(depth / 2, rise, width, [0, 0.05, 0]), 90, "y")
    if kind == "gable":
        return gable(width / 2, rise, depth, [0, 0.05, 0])
    if kind == "hip":
        four = turned(lathe([(1.0, -0.06), (1.0, 0.02), (0.62, 0.5 * rise), (0.26, rise)], segments=4), 45, "y")
        return stretched(four, width / ROOT2, 1, depth / ROOT2)
    if kind == "slope":
        half = depth / 2
        outline = [(-half, -0.04), (half, -0.04), (half, 0.08), (-half, rise)]
        return moved(turned(extrude(outline, width, bevel=0.03), -90, "y"), [0, 0.02, 0])
    half = width / 2
    right = [(half, -0.06), (half, 0.02), (0.68 * half, 0.62 * rise)]
    left = [(-x, y) for x, y in right[::-1]]
    return extrude([*right, (0, rise), *left], depth, bevel=0.03)


def block(base: ArrayLike, size: ArrayLike, soft: float = 0.05, cells: int = 2) -> Part:
    """Return a box of full side lengths `size` that stands on the middle `base` of its foot."""
    sides = np.asarray(size, float)
    return box(np.asarray(base, float) + [0, sides[1] / 2, 0], sides, round_by=soft, cells=cells)


def bar(start: ArrayLike, end: ArrayLike, thick: float, segments: int = 8) -> Part:
    """Return a straight round bar of radius `thick` between two points, beyond which its blunt ends reach."""
    foot, way = np.asarray(start, float), np.subtract(end, start)
    length, blunt = float(np.linalg.norm(way)), 0.7 * thick
    rod = lathe(
        [(blunt, -blunt), (thick, 0), (thick, length / 2), (thick, length), (blunt, length + blunt)], segments=segments
    )
    up = way / length
    side = np.cross([0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0], up)
    side /= np.linalg.norm(side)
    return Part(foot + rod.verts @ np.stack([-side, up, np.cross(up, side)]), rod.faces)


def bridge(rng: Rng, _: Traits) -> Part:
    """Draw a bridge along X: a deck over one to three round arches, level or humped, between two parapets or rails."""
    half, deep, arches = rng.uniform(1.0, 1.3), rng.uniform(0.26, 0.36), int(rng.integers(1, 4))
    hump, stone = rng.uniform(0.0, 0.3) if arches == 1 else rng.uniform(0, 0.12), rng.random() < 0.6
    tall = rng.uniform(0.42, 0.6)
    line = np.linspace(-1, 1, 14 * arches + 1)
    phase = np.abs((line + 1) * arches / 2 % 1 - 0.5) * 2
    top = tall + hump * (1 - line**2)
    under = np.where(phase < 0.8, np.sqrt(np.clip(1 - (phase / 0.8) ** 2, 0, 1)) * (top - 0.16), 0.0)
    body = [_span(half * line, under, top, deep)]
    body += [
        moved(_span(half * line[::2], top[::2] - 0.07, top[::2] + 0.01, 0.05), [0, 0, side * deep]) for side in (1, -1)
    ]
    ends = [(x, z) for x in (-half, half) for z in (-deep, deep)]
    pillars = [block([x, 0, z], [0.15, tall + 0.26, 0.15], 0.1) for x, z in ends]
    if stone:
        rails = [moved(_span(half * line, top, top + 0.17, 0.04), [0, 0, z]) for z in (-deep, deep)]
        return named(body=body, rail=rails, pole=pillars)
    across = np.linspace(-1, 1, 9)
    path = np.stack([half * across, tall + hump * (1 - across**2) + 0.2, 0 * across + deep], 1)
    rails = [limb(path * [1, 1, side], [0.028] * len(path), segments=6, samples=1) for side in (1, -1)]
    pillars += [bar([x, y - 0.22, side * z], [x, y, side * z], 0.022, 6) for x, y, z in path[1:-1] for side in (1, -1)]
    return named(body=body, rail=rails, pole=pillars)


def suspension_bridge(rng: Rng, _: Traits) -> Part:
    """Draw a suspension bridge along X: a level deck that hangs on two ropes over two tall gates."""
    half, deep, deck, tall = (
        rng.uniform(1.4, 1.8),
        rng.uniform(0.18, 0.24),
        rng.uniform(0.3, 0.4),
        rng.uniform(0.9, 1.15),
    )
    gates = [block([x, 0, z], [0.12, tall, 0.1], 0.1) for x in (-0.55 * half, 0.55 * half) for z in (-deep, deep)]
    gates += [
        block([x, y, 0], [0.09, 0.09, 2 * deep], 0.1)
        for x in (-0.55 * half, 0.55 * half)
        for y in (0.5 * tall, tall - 0.09)
    ]
    gates += [block([x, 0, 0], [0.16, deck, 2 * deep - 0.04], 0.05) for x in (-half, half)]
    inner, outer = np.linspace(-0.55, 0.55, 9), np.linspace(0.55, 1, 4)
    sag = deck + 0.08 + (tall - deck - 0.08) * (inner / 0.55) ** 2
    slope = deck + (tall - deck) * (1 - (outer - 0.55) / 0.45)
    x = half * np.concatenate([-outer[:0:-1], inner, outer[1:]])
    y = np.concatenate([slope[:0:-1], sag, slope[1:]])
    ropes = [limb(np.c_[x, y, 0 * x + z], [0.025] * len(x), segments=6, samples=1) for z in (deep, -deep)]
    ropes += [
        bar([a, deck, z], [a, b, z], 0.016, 4) for a, b in zip(x[1:-1], y[1:-1], strict=True) for z in (deep, -deep)
    ]
    return named(body=block([0, deck - 0.05, 0], [2 * half, 0.09, 2 * deep - 0.03], 0.1, 4), pole=gates, rope=ropes)


def spiral_stairs(rng: Rng, _: Traits) -> Part:
    """Draw spiral stairs: wedge-shaped steps that wind up about a post, with a rail on thin bars."""
    count, radius, rise = int(rng.integers(10, 15)), rng.uniform(0.5, 0.65), rng.uniform(0.11, 0.14)
    turn = rng.uniform(24, 32)
    wedge = turned(extrude([(0.02, -0.06), (radius, -0.16), (radius, 0.16), (0.02, 0.06)], 0.06), -90, "x")
    steps = [moved(turned(wedge, turn * k, "y"), [0, (k + 1) * rise, 0]) for k in range(count)]
    angle = np.radians(turn * np.arange(count))
    path = np.stack(
        [0.93 * radius * np.cos(angle), (np.arange(count) + 1) * rise + 0.45, -0.93 * radius * np.sin(angle)], 1
    )
    bars = [bar(end - [0, 0.45, 0], end, 0.018, 4) for end in path]
    return named(
        step=steps,
        pole=[disc(0.08, 0, (count + 1) * rise + 0.5), *bars],
        rail=limb(path, [0.03] * count, segments=6, samples=2),
    )


def _span(x: Array, low: Array, high: Array, half: float) -> Part:
    """Return a bar along X of square section whose lower and upper sides run at the levels given at places x."""
    part = turned(lathe([(1.0, t) for t in range(len(x))], segments=8), -90, "z")
    at = np.round(part.verts[:, 0]).astype(int)
    section = part.verts[:, 1:]
    section = section / np.maximum(np.abs(section).max(1, keepdims=True), 1e-9)
    level = low[at] + (high - low)[at] * (section[:, 0] + 1) / 2
    return Part(np.stack([x[at], level, half * section[:, 1]], 1), part.faces)


KINDS = {"bridge": (suspension_bridge,), "stairs": (spiral_stairs,)}
