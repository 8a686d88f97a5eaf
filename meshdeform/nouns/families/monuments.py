"""Draw what stands on squares and in parks: temples, domes, fountains, statues, bridges; all face +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, spread
from meshdeform.nouns.families.buildings import arch as arched_plate
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    box,
    curved,
    disc,
    ellipsoid,
    lathe,
    limb,
    moved,
    named,
    pair,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import ROOT2, column_of, hat, onion, roof_of, shaft

__all__ = [
    "altar",
    "arch",
    "bridge",
    "dome",
    "fountain",
    "gazebo",
    "mosque",
    "obelisk",
    "pagoda",
    "pyramid",
    "ruin",
    "statue",
    "temple",
    "well",
]

_COLUMNS = ((0.14, 0.22), (0.6, 0.75), (1.25, 1.5))


def _steps(width: float, depth: float, count: int, rise: float = 0.07, run: float = 0.08) -> list[Part]:
    """Return broad steps one on another, the topmost `width` by `depth`."""
    sides = [(width + 2 * run * k, depth + 2 * run * k) for k in range(count)[::-1]]
    return [block([0, k * rise, 0], [w, rise + 0.01, d], 0.1) for k, (w, d) in enumerate(sides)]


def temple(rng: Rng, traits: Traits) -> Part:
    """Draw a temple: columns all round on broad steps under a beam and a low gable, a closed room between them."""
    front, side = int(rng.integers(2, 4)) * 2, int(rng.integers(4, 7))
    tall = traits.draw(rng, "columns", *_COLUMNS)
    rise = traits.draw(rng, "roof", (0.06, 0.1), (0.28, 0.38), (0.75, 0.95))
    width, depth, thick = 0.25 * front + 0.1, rng.uniform(0.25, 0.32) * side, rng.uniform(0.06, 0.075)
    count = int(rng.integers(2, 5))
    level = 0.07 * count
    places = [(x, z) for x in spread(width / 2 - 0.1, front) for z in (depth / 2 - 0.1, 0.1 - depth / 2)]
    places += [(x, z) for x in (width / 2 - 0.1, 0.1 - width / 2) for z in spread(depth / 2 - 0.1, side)[1:-1]]
    beam = block([0, level + tall - 0.01, 0], [width + 0.04, 0.13, depth + 0.04], 0.1)
    return named(
        base=_steps(width + 0.1, depth + 0.1, count),
        column=[column_of([x, level, z], tall, thick) for x, z in places],
        body=block([0, level, 0], [width - 0.5, tall, depth - 0.5], 0.03),
        top=beam,
        roof=roof_of("front", width, depth, rise, level + tall + 0.16, 0.06),
    )


def dome(rng: Rng, _: Traits) -> Part:
    """Draw a domed hall: a half sphere with ribs on a round wall, with columns and a lantern, or plain and low."""
    radius, wall, rich = rng.uniform(0.6, 0.75), rng.uniform(0.15, 0.45), rng.random() < 0.6
    turn, bulge = np.linspace(0, np.pi / 2, 9), rng.uniform(0.9, 1.15)
    shell = lathe([(radius * np.cos(t), wall + bulge * radius * np.sin(t)) for t in turn], segments=24)
    rib = [[0, wall + bulge * radius * np.sin(t), radius * np.cos(t)] for t in turn[:-1:2]]
    ribs = around(limb(rib, [0.03] * len(rib), segments=4, samples=1), 12)
    base = [disc(radius + 0.12, 0, 0.1), disc(radius + 0.06, wall - 0.07, wall + 0.02)]
    level = wall + bulge * radius
    top = (
        [disc(0.13, level - 0.05, level + 0.16, edge=0.02), hat(0.16, 0.16, level + 0.16, 16)]
        if rich
        else [ellipsoid([0, level, 0], 0.06, rings=6)]
    )
    door = arched_plate(0.26, max(0.9 * wall, 0.26), 0.14, [0, 0.05, radius + 0.02])
    posts = around(column_of([0, 0.08, radius + 0.05], wall - 0.1, 0.04), 8, 22.5) if rich and wall > 0.25 else []
    return named(
        base=base, body=shaft(radius, wall, 0, 24, foot=1), dome=[shell, *ribs], top=top, door=door, column=posts
    )


def mosque(rng: Rng, traits: Traits) -> Part:
    """Draw a mosque: a square hall under a pointed dome, two or four slim minarets, arched door and windows."""
    half, wall = rng.uniform(0.5, 0.62), rng.uniform(0.45, 0.6)
    radius = traits.draw(rng, "dome", (0.12, 0.17), (0.34, 0.42), (0.62, 0.72))
    rise = traits.draw(rng, "tower", (0.05, 0.12), (0.55, 0.75), (1.35, 1.6))
    top, swell = wall + 0.1 + rise, rng.uniform(0.85, 1.15)
    rows = [
        (0.1, 0.0),
        (0.09, 0.1),
        (0.075, top - 0.16),
        (0.12, top - 0.1),
        (0.12, top - 0.04),
        (0.07, top - 0.03),
        (0.065, top + 0.12),
    ]
    minaret = lathe([*rows, (0.075, top + 0.15), (0.06, top + 0.22), (0.01, top + 0.36)], segments=14)
    rear = (1, -1) if rng.random() < 0.6 else (1,)
    corner = half + 0.04
    towers = [part for z in rear for part in pair(moved(minaret, [corner, 0, z * corner]))]
    domes = [moved(disc(0.98 * radius, 0, 0.1), [0, wall, 0]), moved(onion(radius, 0.08, swell), [0, wall, 0])]
    if rng.random() < 0.5:
        domes += [
            moved(onion(0.14, 0, swell), [x, wall, z])
            for x in (-0.72 * half, 0.72 * half)
            for z in (-0.72 * half, 0.72 * half)
        ]
    pane = arched_plate(0.17, 0.5 * wall, 0.1, [0, 0.2 * wall, half])
    windows = [turned(moved(pane, [x, 0, 0]), side, "y") for side in (90, 180, 270) for x in spread(0.5 * half, 2)]
    windows += pair(moved(pane, [0.62 * half, 0, 0]))
    porch = [arched_plate(0.4, 0.98 * wall, 0.1, [0, 0, half]), arched_plate(0.28, 0.8 * wall, 0.18, [0, 0, half])]
    rim = block([0, wall - 0.03, 0], [2 * half + 0.08, 0.08, 2 * half + 0.08], 0.1)
    return named(
        body=[block([0, 0, 0], [2 * half, wall, 2 * half], 0.03, 4), rim],
        dome=domes,
        tower=towers,
        door=porch,
        window=windows,
    )


def pagoda(rng: Rng, traits: Traits) -> Part:
    """Draw a pagoda: three to five storeys, each smaller, under roofs whose eaves turn up, and a spire with rings."""
    sides, storeys = int(rng.choice([4, 4, 6, 8])), int(rng.integers(3, 6))
    out = traits.draw(rng, "roof", (0.06, 0.09), (0.24, 0.3), (0.6, 0.75))
    radius, level, shrink = rng.uniform(0.38, 0.46), 0.1, rng.uniform(0.8, 0.87)
    tall = rng.uniform(0.3, 0.4)
    scale = ROOT2 if sides == 4 else 1.0
    walls, roofs = [], []
    for _ in range(storeys):
        walls.append(shaft(radius, level + tall, level - 0.02, sides, foot=1))
        level += 0.82 * tall
        eaves = radius + out
        rows = [
            (0.8 * eaves, 0.03),
            (eaves, 0.06),
            (eaves + 0.01, 0.09),
            (0.75 * eaves, 0.1),
            (0.6 * radius, 0.14 + 0.22 * tall),
        ]
        roof = lathe([(scale * r, level + y) for r, y in rows], segments=sides)
        roofs.append(turned(roof, 45, "y") if sides == 4 else roof)
        level, radius = level + 0.3 * tall, radius * shrink
    mast = [
        (0.06, 0.0),
        (0.05, 0.1),
        *((r, 0.12 + 0.05 * k) for k, r in enumerate((0.03, 0.075, 0.03, 0.065, 0.03, 0.055, 0.02))),
    ]
    door = block([0, 0.08, walls[0].verts[:, 2].max() - 0.02], [0.22, 0.7 * tall, 0.12], 0.15)
    foot = block([0, 0, 0], [1.3, 0.12, 1.3], 0.1) if sides == 4 else disc(0.62, 0, 0.12)
    return named(
        base=foot, body=walls, roof=roofs, mast=moved(lathe(mast, segments=12), [0, level + 0.08 * tall, 0]), door=door
    )


def pyramid(rng: Rng, _: Traits) -> Part:
    """Draw a pyramid of courses of stone, with a smooth tip or without, and an entrance."""
    half, tall, rows = rng.uniform(0.85, 1.0), rng.uniform(0.85, 1.25), int(rng.choice([8, 12, 18, 60]))
    share = np.arange(rows) / rows
    steps = [(half * (1 - t) * ROOT2, tall * y) for t in share for y in (t, t + 1 / rows)]
    if rng.random() < 0.3:  # A cap of smooth stones is left.
        steps = [(r, y) for r, y in steps if y < 0.8 * tall] + [(0.24 * half * ROOT2, 0.8 * tall)]
    part = turned(lathe(steps, segments=4), 45, "y")
    x, y, z = box([0, 0, 0], [2, 2, 2], round_by=0.0, cells=8).verts.T
    core = box([0, 0, 0], [2, 2, 2], round_by=0.0, cells=8)
    slope = 0.99 * (1 - (y + 1) / 2) * half
    smooth = Part(np.stack([x * slope, (y + 1) / 2 * tall * 0.99, z * slope], 1), core.faces)
    gate = block([0, 0, half - 0.1], [0.24, 0.24, 0.28], 0.1, 3)
    return named(body=[part, smooth], door=gate)


def obelisk(rng: Rng, _: Traits) -> Part:
    """Draw an obelisk: a tall four-sided shaft, a little slimmer above, with a pointed tip, on a stepped foot."""
    wide, tall, foot = rng.uniform(0.15, 0.2), rng.uniform(1.6, 2.1), int(rng.integers(1, 4))
    level, base = 0.0, []
    for k in range(foot):
        size = 2 * wide + 0.2 + 0.22 * (foot - 1 - k)
        base.append(block([0, level, 0], [size, 0.16, size], 0.08, 3))
        level += 0.15
    rows = [(1.0, 0.0), *((1 - 0.34 * t, t) for t in np.linspace(0.05, 1, 40))]
    body = turned(lathe([(wide * r * ROOT2, level + tall * y) for r, y in rows], segments=4), 45, "y")
    tip = turned(
        lathe(
            [(wide * 0.67 * (1 - t) * ROOT2, level + tall * 0.995 + 1.5 * wide * t) for t in np.linspace(0, 0.99, 12)],
            segments=4,
        ),
        45,
        "y",
    )
    return named(base=base, body=body, top=tip)


def arch(rng: Rng, traits: Traits) -> Part:
    """Draw an arch: a round ring of stones with its keystone on two piers, or under a heavy block as for a triumph."""
    tall = traits.draw(rng, "columns", (0.12, 0.2), (0.75, 0.95), (1.6, 1.9))
    radius, thick, triumph = rng.uniform(0.4, 0.5), rng.uniform(0.13, 0.19), rng.random() < 0.5
    deep = thick * rng.uniform(1.1, 1.8)
    middle = radius + thick
    turn = np.linspace(0, np.pi, 14)
    ring = [box([0, 0, 0], [2 * thick, 1.05 * np.pi * middle / 13, 2 * deep], round_by=0.08, cells=2)] * 13
    stones = [moved(turned(moved(one, [middle, 0, 0]), np.degrees(t), "z"), [0, tall, 0])
              for one, t in zip(ring, (turn[1:] + turn[:-1]) / 2, strict=True)]  # fmt: skip
    key = block([0, tall + radius - 0.04, 0], [1.3 * thick, 2.4 * thick, 2.3 * deep], 0.1, 3)
    piers = pair(block([middle, 0.08, 0], [2 * thick, tall, 2 * deep], 0.05, 3))
    feet = [
        *pair(block([middle, 0, 0], [2.8 * thick, 0.16, 2.8 * deep], 0.1)),
        *pair(block([middle, tall - 0.06, 0], [2.6 * thick, 0.1, 2.5 * deep], 0.1)),
    ]
    top = []
    if triumph:
        outer, high = middle + thick, tall + radius + 2 * thick
        piers += pair(block([0.84 * outer, tall + 0.6 * outer, 0], [0.5 * outer, 0.4 * outer - 0.02, 1.7 * deep], 0.05))
        piers += pair(block([outer + 0.02, 0.05, 0], [1.7 * thick, high - 0.05, 1.9 * deep], 0.05, 3))
        top = [
            block([0, high - 0.05, 0], [2 * outer + 2.2 * thick, 0.12, 2.5 * deep], 0.1),
            block([0, high + 0.06, 0], [2 * outer + 1.6 * thick, 0.3, 2.1 * deep], 0.05),
        ]
    return named(body=stones, column=piers, base=feet, top=[*top, key])


def fountain(rng: Rng, traits: Traits) -> Part:
    """Draw a fountain: a low round or eight-sided basin, a stem with one or two dishes, a jet that falls back."""
    radius, wall, sides = rng.uniform(0.8, 0.95), rng.uniform(0.22, 0.32), int(rng.choice([28, 28, 8, 6]))
    stem = traits.draw(rng, "stem", (0.1, 0.18), (0.6, 0.8), (1.5, 1.8))
    rim = [(radius, 0.0), (radius, wall - 0.08), (radius + 0.06, wall - 0.06), (radius + 0.06, wall)]
    basin = vessel(rim, 0.14, 0.1, segments=sides)
    wide, tiers = rng.uniform(0.34, 0.44), int(rng.integers(1, 3))
    foot = [(0.2, 0.08), (0.2, 0.16), (0.1, 0.22), (0.08, 0.5 * (0.3 + stem)), (0.1, 0.2 + stem), (0.09, 0.3 + stem)]
    levels = [(0.2 + stem, wide), (0.5 + stem, 0.55 * wide)][:tiers]
    dishes = [
        vessel([(0.1, y), (0.6 * r, y + 0.04), (0.92 * r, y + 0.11), (r, y + 0.16)], 0.05, y + 0.08) for y, r in levels
    ]
    posts = [lathe(foot, segments=14)] + [bar([0, 0.26 + stem, 0], [0, 0.56 + stem, 0], 0.06)] * (tiers - 1)
    top = levels[-1][0] + 0.08
    jet = lathe([(0.05, top), (0.035, top + 0.2), (0.07, top + 0.28), (0.03, top + 0.36)], segments=10)
    fall = curved([[0, top + 0.24, 0], [0, top + 0.32, 0.1], [0, top + 0.18, 0.2], [0, top + 0.02, 0.24]], samples=2)
    return named(
        basin=basin,
        stem=posts,
        dish=dishes,
        water=[jet, *around(limb(fall, [0.025] * len(fall), segments=6, samples=1), 6)],
    )


def gazebo(rng: Rng, traits: Traits) -> Part:
    """Draw a gazebo: six or eight posts on a low floor with rails between them, a pointed roof with a knob, steps."""
    sides, radius = int(rng.choice([6, 8])), rng.uniform(0.72, 0.85)
    tall = traits.draw(rng, "columns", *_COLUMNS)
    rise = traits.draw(rng, "roof", (0.08, 0.13), (0.4, 0.55), (1.0, 1.2))
    turn = 180 / sides
    edge = np.radians(turn)
    ends = np.array([[np.sin(edge), 0, np.cos(edge)], [-np.sin(edge), 0, np.cos(edge)]]) * 0.94 * radius
    rails = []
    for y in (0.08 + 0.12 * tall, 0.08 + 0.42 * tall):
        rails += around(bar(ends[0] + [0, y, 0], ends[1] + [0, y, 0], 0.028, 6), sides)[1:]
    rails += [
        bar([x, 0.1, z], [x, 0.1 + 0.4 * tall, z], 0.02, 6)
        for part in rails[: sides - 1]
        for x, z in [part.verts[:, [0, 2]].mean(0)]
    ]
    post = around(bar([0, 0.08, 0.94 * radius], [0, 0.1 + tall, 0.94 * radius], 0.045), sides, turn)
    roof = turned(hat(radius + 0.16, rise, 0.1 + tall, sides, bow=float(rng.choice([0, 0.25]))), turn, "y")
    floor = turned(shaft(radius, 0.1, 0, sides, foot=1.02), turn, "y")
    knob = ellipsoid([0, 0.12 + tall + rise, 0], 0.07, rings=6)
    return named(
        base=floor, column=post, rail=rails, roof=[roof, knob], step=block([0, 0, radius], [0.5, 0.05, 0.3], 0.1)
    )


def altar(rng: Rng, _: Traits) -> Part:
    """Draw an altar: a stone table on steps, a cloth that hangs over its front, a cross between two candles."""
    width, tall, depth, steps = (
        rng.uniform(1.0, 1.35),
        rng.uniform(0.5, 0.62),
        rng.uniform(0.45, 0.55),
        int(rng.integers(1, 4)),
    )
    level = 0.09 * steps
    base = [
        block([0, 0.09 * k, 0.04], [width + 0.24 * (steps - k), 0.1, depth + 0.24 * (steps - k)], 0.08)
        for k in range(steps)
    ]
    solid = rng.random() < 0.5
    body = (
        [block([0, level, 0], [0.86 * width, tall, 0.8 * depth], 0.05, 3)]
        if solid
        else [
            *pair(block([0.36 * width, level, 0], [0.16 * width, tall, 0.7 * depth], 0.05, 3)),
            block([0, level, -0.1], [0.8 * width, tall, 0.1], 0.1),
        ]
    )
    top = level + tall + 0.1
    high = rng.uniform(0.5, 0.65)
    cross = [
        block([0, top, -0.1], [0.08, high, 0.08], 0.1),
        block([0, top + 0.62 * high, -0.1], [0.56 * high, 0.08, 0.08], 0.1),
        block([0, top, -0.1], [0.24, 0.06, 0.18], 0.1),
    ]
    candle = lathe(
        [
            (0.07, 0.0),
            (0.07, 0.03),
            (0.025, 0.05),
            (0.025, 0.12),
            (0.05, 0.13),
            (0.035, 0.14),
            (0.035, 0.34),
            (0.01, 0.4),
        ],
        segments=10,
    )
    cloth = [
        block([0, top - 0.12, 0.02], [0.46 * width, 0.14, depth + 0.1], 0.1),
        block([0, top - 0.36, depth / 2 + 0.04], [0.46 * width, 0.34, 0.05], 0.1),
    ]
    return named(base=base, body=body, top=block([0, top - 0.11, 0], [width, 0.11, depth], 0.12), blanket=cloth, cross=cross,
                 candle=pair(moved(candle, [0.36 * width, top - 0.01, -0.04])))  # fmt: skip


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


def _span(x: Array, low: Array, high: Array, half: float) -> Part:
    """Return a bar along X of square section whose lower and upper sides run at the levels given at places x."""
    part = turned(lathe([(1.0, t) for t in range(len(x))], segments=8), -90, "z")
    at = np.round(part.verts[:, 0]).astype(int)
    section = part.verts[:, 1:]
    section = section / np.maximum(np.abs(section).max(1, keepdims=True), 1e-9)
    level = low[at] + (high - low)[at] * (section[:, 0] + 1) / 2
    return Part(np.stack([x[at], level, half * section[:, 1]], 1), part.faces)


def ruin(rng: Rng, traits: Traits) -> Part:
    """Draw a ruin: two ragged walls that meet in a corner, columns of which most are broken, fallen stones."""
    tall = traits.draw(rng, "columns", _COLUMNS[0], (0.7, 0.9), _COLUMNS[2])
    width, thick = rng.uniform(0.8, 1.0), 0.16
    walls = []
    for side in (0, 90):
        x, level = -width, rng.uniform(0.7, 1.0)
        while x < width - 0.05:
            wide = min(rng.uniform(0.2, 0.32), width - x)
            walls.append(
                turned(block([x + wide / 2, 0, -width], [wide + 0.02, max(level, 0.15), thick], 0.08), side, "y")
            )
            x, level = x + wide, level + (rng.uniform(-0.3, 0.1) if side == 0 else rng.uniform(-0.1, 0.25))
    floor = block([0, -0.06, 0], [2.2 * width, 0.1, 2.2 * width], 0.1, 3)
    heights = tall * np.array([1.0, rng.uniform(0.3, 0.6), rng.uniform(0.15, 0.3)])
    columns = [
        column_of([x, 0, z], h, 0.11)
        for (x, z), h in zip([(-0.25, 0.5), (0.35, 0.55), (0.6, 0.0)], heights, strict=True)
    ]
    drum = turned(disc(0.1, -0.3, 0.3), 90, "z")
    columns.append(moved(turned(drum, rng.uniform(0, 60), "y"), [0.1, 0.1, 0.0]))
    for _ in range(6):
        size = rng.uniform(0.1, 0.2, 3)
        stone = turned(
            turned(box([0, 0, 0], size, round_by=0.1, cells=2), rng.uniform(0, 90), "y"), rng.uniform(-20, 20), "z"
        )
        walls.append(moved(stone, [*rng.uniform(-0.8, 0.8, 1), 0.4 * size[1], rng.uniform(-0.4, 0.9)]))
    return named(body=walls, column=columns, base=floor)


def statue(rng: Rng, traits: Traits) -> Part:
    """Draw a statue: a figure on a square or a round pedestal, one arm raised, at its hip or at its side."""
    arm = traits.draw(rng, "arms", (0.1, 0.15), (0.42, 0.5), (0.85, 1.0))
    head = traits.draw(rng, "head", (0.08, 0.1), (0.14, 0.165), (0.27, 0.32))
    leg = traits.draw(rng, "legs", (0.1, 0.16), (0.5, 0.6), (1.05, 1.25))
    foot, tall, round_ = rng.uniform(0.3, 0.38), rng.uniform(0.4, 0.9), rng.random() < 0.4
    hip, chest = tall + 0.1 + leg, tall + 0.52 + leg
    if round_:
        base = [disc(foot + 0.1, 0, 0.14), disc(foot, 0.1, tall), disc(foot + 0.07, tall - 0.06, tall + 0.04)]
    else:
        base = [
            block([0, y, 0], [2 * (foot + more), high, 2 * (foot + more)], 0.08, 3)
            for y, high, more in ((0, 0.14, 0.1), (0.1, tall - 0.1, 0), (tall - 0.06, 0.1, 0.07))
        ]
    torso = limb(
        [[0, hip, 0], [0, hip + 0.2, 0.01], [0, chest - 0.06, 0], [0, chest + 0.12, 0]],
        [[0.16, 0.12], [0.14, 0.1], [0.19, 0.13], [0.06, 0.06]],
    )
    shoulder, stride = np.array([0.2, chest - 0.04, 0]), rng.uniform(0.0, 0.12)
    ways = ([0.12, -1.0, 0.08], [0.25, 0.95, 0.25], [0.35, -0.3, 0.9], [0.5, -0.75, 0.1])
    arms = []
    for side, way in zip((1, -1), rng.permutation(len(ways))[:2], strict=True):
        bend = shoulder + 0.5 * arm * np.array(ways[0])
        hand = bend + 0.5 * arm * np.array(ways[way]) if way else shoulder + arm * np.array(ways[0])
        arms.append(limb(np.array([shoulder, bend, hand]) * [side, 1, 1], [0.07, 0.06, 0.05], segments=10))
    legs = [
        limb(
            [[0.09 * s, hip, 0], [0.1 * s, (hip + tall) / 2, 0.6 * s * stride], [0.11 * s, tall + 0.07, s * stride]],
            [0.1, 0.085, 0.075],
            segments=10,
        )
        for s in (1, -1)
    ]
    body = [torso]
    if rng.random() < 0.4:  # A cloak, or a long gown.
        body.append(lathe([(0.26, tall + 0.03), (0.2, hip), (0.13, hip + 0.2), (0.08, hip + 0.3)], segments=16))
    return named(
        base=base,
        body=body,
        head=ellipsoid([0, chest + 0.12 + 0.95 * head, 0.02], [0.85 * head, head, 0.9 * head], rings=10),
        arm=arms,
        leg=legs,
    )


def well(rng: Rng, traits: Traits) -> Part:
    """Draw a well: a round wall of stones, two posts with a roof, a roller with a rope and a bucket."""
    radius, wall, tall = rng.uniform(0.5, 0.6), rng.uniform(0.42, 0.52), rng.uniform(1.15, 1.35)
    rise = traits.draw(rng, "roof", (0.06, 0.1), (0.32, 0.45), (0.85, 1.05))
    ring = vessel(
        [
            (radius + 0.05, 0.0),
            (radius, 0.06),
            (radius, wall - 0.1),
            (radius + 0.05, wall - 0.08),
            (radius + 0.05, wall),
        ],
        0.16,
        0.14,
    )
    count = int(rng.integers(9, 13))
    stones = [
        part
        for k in range(3)
        for part in around(
            box([0, wall * (0.2 + 0.3 * k), radius], [4.6 * radius / count, 0.25 * wall, 0.1], round_by=0.3, cells=2),
            count,
            15 * k,
        )
    ]
    poles = pair(block([radius, 0, 0], [0.1, tall, 0.12], 0.1))
    roller = turned(disc(0.07, -radius, radius, edge=0.02), 90, "z")
    level = 0.74 * tall
    crank = limb(
        [
            [radius, level, 0],
            [radius + 0.16, level, 0],
            [radius + 0.16, level - 0.16, 0],
            [radius + 0.26, level - 0.16, 0],
        ],
        [0.03] * 4,
        segments=6,
        samples=1,
    )
    drop = rng.uniform(wall + 0.05, wall + 0.14)
    bucket = moved(vessel([(0.1, 0.0), (0.13, 0.18), (0.14, 0.19)], 0.03, 0.03, segments=14), [0, drop, 0])
    roof = roof_of(str(rng.choice(["front", "side", "hip"])), 2 * radius + 0.1, 1.5 * radius, rise, tall - 0.03, 0.1)
    return named(
        body=[ring, *stones],
        roof=roof,
        pole=poles,
        roller=[moved(roller, [0, level, 0]), crank],
        rope=bar([0, level, 0.06], [0, drop + 0.16, 0], 0.02, 6),
        basket=bucket,
    )


KINDS = {"bridge": (suspension_bridge,)}
