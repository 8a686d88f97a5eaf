"""Draw houses, what stands beside them, and places of work, their doors facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, roundel, spread
from meshdeform.nouns.families.buildings import arch
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.parts import Part, extrude, lathe, limb, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import house_of, panes, roof_of

__all__ = [
    "barn",
    "birdhouse",
    "cabin",
    "doghouse",
    "factory",
    "garage",
    "greenhouse",
    "shed",
    "shop",
    "tipi",
]

_SLOPED = ("front", "side")


def _rise(rng: Rng, traits: Traits, scale: float = 1.0) -> float:
    """Draw the rise of a roof."""
    return scale * traits.draw(rng, "roof", (0.1, 0.15), (0.4, 0.55), (0.95, 1.15))


def barn(rng: Rng, traits: Traits) -> Part:
    """Draw a barn: a broad hall under a roof of two slopes a side, a large crossed double door, a hatch above it."""
    width, wall, depth = rng.uniform(1.2, 1.5), rng.uniform(0.55, 0.75), rng.uniform(1.5, 2.1)
    rise = _rise(rng, traits, 1.3)
    hall = house_of((width, wall, depth), "gambrel", rise, door=(0.04, 0.1), columns=2, eaves=0.08)
    front, leaf, tall = depth / 2, 0.23 * width, 0.8 * wall
    doors = pair(block([leaf / 2 + 0.01, 0, front], [leaf, tall, 0.16], 0.1))
    doors += pair(bar([0.04, 0.06, front + 0.08], [leaf - 0.03, tall - 0.06, front + 0.08], 0.03, 6))
    doors += pair(bar([0.04, tall - 0.06, front + 0.08], [leaf - 0.03, 0.06, front + 0.08], 0.03, 6))
    hatch = block([0, wall + 0.15 * rise, front + 0.08], [0.24 * width, 0.4 * rise, 0.1], 0.1)
    return named(**hall | {"door": doors, "window": [*hall["window"], hatch]})


def cabin(rng: Rng, traits: Traits) -> Part:
    """Draw a log cabin: walls of round logs that cross at the corners, a gabled roof, a chimney beside it, a door."""
    width, depth, thick = rng.uniform(1.1, 1.4), rng.uniform(0.9, 1.2), rng.uniform(0.06, 0.075)
    count, rise = int(rng.integers(5, 7)), _rise(rng, traits)
    tall = traits.draw(rng, "chimney", (0.16, 0.24), (0.55, 0.7), (1.3, 1.6))
    wall, logs = 1.9 * thick * count + thick, []
    for k in range(count):
        y = (1 + 1.9 * k) * thick
        logs += [bar([-width / 2 - 0.1, y, z], [width / 2 + 0.1, y, z], thick, 6) for z in (-depth / 2, depth / 2)]
        logs += pair(
            bar([width / 2, y + 0.9 * thick, -depth / 2 - 0.1], [width / 2, y + 0.9 * thick, depth / 2 + 0.1], thick, 6)
        )
    roof = roof_of(str(rng.choice(_SLOPED)), width, depth, rise, wall - 0.02, 0.2)
    x, front = 0.28 * width, depth / 2 + thick
    window = block([x, 0.4 * wall, front], [0.24, 0.26, 0.1], 0.15)
    door = block([-0.2 * width, 0, front], [0.3, 0.78 * wall, 0.1], 0.12)
    stack = block([width / 2 - 0.2, 0.4 * wall, -0.15 * depth], [0.2, 0.6 * wall + 0.75 * rise + tall, 0.2], 0.1)
    return named(body=logs, roof=roof, door=door, window=window, chimney=stack)


def shed(rng: Rng, traits: Traits) -> Part:
    """Draw a shed: a small hut of upright boards with one slope or a low gable, a plank door and a window."""
    width, wall, depth = rng.uniform(0.9, 1.2), rng.uniform(0.8, 0.95), rng.uniform(0.7, 0.95)
    rise = _rise(rng, traits, 0.75)
    kind = str(rng.choice(["shed", "front", "shed", "side"]))
    boards = [block([x, 0.01, 0], [0.05, wall, depth + 0.06]) for x in spread(0.46 * width, 7)]
    boards += [block([0, 0.01, z], [width + 0.06, wall, 0.05]) for z in spread(0.46 * depth, 5)]
    walls = [block([0, 0, 0], [width, wall, depth], 0.02), *boards]
    door = [block([-0.2 * width, 0, depth / 2 + 0.02], [0.34, 0.8 * wall, 0.1], 0.1)]
    door += [block([-0.2 * width, y * wall, depth / 2 + 0.07], [0.32, 0.06, 0.06], 0.1) for y in (0.12, 0.62)]
    window = block([0.26 * width, 0.5 * wall, depth / 2 + 0.02], [0.26, 0.26, 0.1], 0.2)
    return named(body=walls, roof=roof_of(kind, width, depth, rise, wall, 0.14), door=door, window=window)


def garage(rng: Rng, traits: Traits) -> Part:
    """Draw a garage: a wide low building, its front filled by one or two doors of level panels."""
    doors = int(rng.integers(1, 3))
    width, wall, depth = rng.uniform(0.85, 1.0) * (1, 1.7)[doors - 1], rng.uniform(0.72, 0.85), rng.uniform(1.1, 1.3)
    rise = _rise(rng, traits, 0.85)
    wide, front, tall = 0.8 * width / doors, depth / 2, 0.74 * wall
    leaves = [block([x, 0, front], [wide, tall, 0.1], 0.1) for x in spread(0.43 * width * (doors - 1) / 1.8, doors)]
    lines = [block([leaf.verts[:, 0].mean(), y, front + 0.04], [0.94 * wide, 0.17 * tall, 0.08], 0.3, 3)
             for leaf in leaves for y in tall * np.array([0.03, 0.27, 0.51, 0.75])]  # fmt: skip
    window = panes(width, depth, 0.3 * wall, 0.95 * wall, 2, 1, sides=(90, 270))
    roof = roof_of(str(rng.choice(["flat", "front", "side", "hip"])), width, depth, rise, wall, 0.1)
    return named(
        body=block([0, 0, 0], [width, wall, depth], 0.03, 4), roof=roof, door=leaves, line=lines, window=window
    )


def greenhouse(rng: Rng, traits: Traits) -> Part:
    """Draw a greenhouse: a glass house of many bars with a gabled or a round roof, a door in its gable."""
    width, wall, depth = rng.uniform(0.95, 1.15), rng.uniform(0.45, 0.6), rng.uniform(1.4, 1.9)
    rise, rounded = _rise(rng, traits), rng.random() < 0.4
    bow = np.linspace(0, np.pi, 9)
    arc = np.stack([width / 2 * np.cos(bow), wall + rise * np.sin(bow)], 1)
    ridge = [(width / 2, wall), (0, wall + rise), (-width / 2, wall)]
    profile = np.array([(width / 2, 0), *(arc if rounded else ridge), (-width / 2, 0)])
    glass = extrude((profile[1:-1] - [0, wall]) * 0.96, depth - 0.04, bevel=0.02)
    ribs = [limb(np.c_[profile, np.full(len(profile), z)], [0.035] * len(profile), segments=6, samples=1)
            for z in spread(depth / 2, 6)]  # fmt: skip
    ribs += [
        bar([x, y, -depth / 2], [x, y, depth / 2], 0.03, 6) for x, y in [*profile, *(profile[1:-2] + profile[2:-1]) / 2]
    ]
    walls = block([0, 0, 0], [0.96 * width, wall + 0.02, depth - 0.04], 0.02)
    door = block([0, 0, depth / 2], [0.3, 0.9 * wall, 0.12], 0.1)
    return named(body=walls, roof=moved(glass, [0, wall, 0]), frame=ribs, door=door)


def factory(rng: Rng, traits: Traits) -> Part:
    """Draw a factory: a long hall under a saw-tooth roof, one to three tall chimneys, rows of windows, a gate."""
    width, wall, depth, teeth = (
        rng.uniform(1.5, 1.9),
        rng.uniform(0.5, 0.65),
        rng.uniform(0.9, 1.1),
        int(rng.integers(3, 6)),
    )
    tall = traits.draw(rng, "chimney", (0.14, 0.22), (0.6, 0.85), (1.5, 1.8))
    tooth = width / teeth
    saw = extrude(
        [(-tooth / 2, -0.03), (tooth / 2, -0.03), (tooth / 2, 0.02), (-tooth / 2, 0.55 * tooth)],
        depth + 0.04,
        bevel=0.02,
    )
    roof = [moved(saw, [x, wall, 0]) for x in spread((width - tooth) / 2, teeth)]
    level, stacks = wall + 0.3, []
    for x in spread(0.18, int(rng.integers(1, 4))):
        pipe = [
            (0.13, 0.0),
            (0.09, level + tall - 0.08),
            (0.115, level + tall - 0.06),
            (0.115, level + tall),
            (0.06, level + tall),
        ]
        stacks.append(moved(lathe(pipe, segments=14), [0.3 * width + 1.8 * x, 0, -0.25 * depth]))
    windows = panes(width, depth, 0.3 * wall, 0.95 * wall, 2 * teeth, 1, share=(0.6, 0.6))
    gate = block([-0.25 * width, 0, depth / 2], [0.36, 0.75 * wall, 0.14], 0.1)
    return named(
        body=block([0, 0, 0], [width, wall, depth], 0.03), roof=roof, chimney=stacks, window=windows, door=gate
    )


def shop(rng: Rng, _: Traits) -> Part:
    """Draw a shop: a wide show window and a door under a striped awning, a sign above them, on one or two floors."""
    width, depth, floors = rng.uniform(1.0, 1.35), rng.uniform(0.8, 1.0), int(rng.integers(1, 3))
    wall, front = 0.8 + 0.55 * (floors - 1), depth / 2
    kind = "flat" if floors == 2 or rng.random() < 0.5 else str(rng.choice(["side", "hip"]))
    strips = int(rng.integers(6, 9))
    wide = (width + 0.06) / strips
    sheet = [[0, 0.69, front - 0.02], [0, 0.58, front + 0.24], [0, 0.5, front + 0.3]]
    awning = [
        moved(limb(sheet, [[0.035, wide / 2]] * 3, segments=8, samples=1), [x, 0, 0])
        for x in spread((width + 0.06 - wide) / 2, strips)
    ]
    sign = block([0, 0.76 if floors == 1 else 0.73, front + 0.02], [0.7 * width, 0.22, 0.14], 0.15)
    glass = block([-0.14 * width, 0.16, front], [0.56 * width, 0.4, 0.08], 0.15)
    windows = [glass] if floors == 1 else [glass, *panes(width, depth, 0.85, wall, 3, 1)]
    door = block([0.31 * width, 0, front], [0.24, 0.54, 0.1], 0.15)
    roof = roof_of(kind, width, depth, 0.3, wall, 0.06)
    return named(
        body=block([0, 0, 0], [width, wall, depth], 0.03, 4),
        roof=roof,
        canopy=awning,
        door=door,
        window=windows,
        panel=sign,
    )


def doghouse(rng: Rng, traits: Traits) -> Part:
    """Draw a doghouse: a small house whose arched opening fills most of its front, with a name plate above it."""
    width, wall, depth = rng.uniform(0.85, 1.0), rng.uniform(0.62, 0.78), rng.uniform(0.9, 1.15)
    rise = _rise(rng, traits)
    ring, hole = 0.58 * width, 0.82 * wall
    edge = arch(ring + 0.12, hole + 0.06, 0.1, [0, 0, depth / 2])
    inside = arch(ring, hole, 0.16, [0, 0, depth / 2])
    plate = block([0, wall + 0.1 * rise, depth / 2 + 0.12], [0.4 * width, 0.13, 0.1], 0.2)
    return named(body=[block([0, 0, 0], [width, wall, depth], 0.04, 4), edge], roof=roof_of("front", width, depth, rise, wall, 0.12),
                 door=inside, panel=plate)  # fmt: skip


def birdhouse(rng: Rng, traits: Traits) -> Part:
    """Draw a birdhouse: a small tall box with a round hole and a perch under a gabled roof, on a post or without one."""
    width, wall, depth = rng.uniform(0.55, 0.7), rng.uniform(0.6, 0.8), rng.uniform(0.5, 0.65)
    rise, kind = _rise(rng, traits, 0.8), str(rng.choice(["front", "side", "shed", "front"]))
    foot = rng.uniform(0.9, 1.3) if rng.random() < 0.6 else 0.0
    box_ = [
        block([0, foot, 0], [width, wall, depth], 0.03, 4),
        block([0, foot - 0.03, 0], [width + 0.12, 0.08, depth + 0.12], 0.2),
    ]
    hole = roundel([0, foot + 0.62 * wall, depth / 2], 0.25 * width, 0.1)
    perch = bar([0, foot + 0.26 * wall, depth / 2 - 0.05], [0, foot + 0.26 * wall, depth / 2 + 0.2], 0.035)
    stand = {"pole": bar([0, 0.06, 0], [0, foot, 0], 0.06)} if foot else {}
    return named(body=box_, roof=roof_of(kind, width, depth, rise, foot + wall, 0.1), door=hole, perch=perch, **stand)


def tipi(rng: Rng, _: Traits) -> Part:
    """Draw a tipi: a cone of hides, the ends of its poles spread above the top, an opening with a flap, bands."""
    radius, tall, count = rng.uniform(0.66, 0.85), rng.uniform(1.25, 1.6), int(rng.integers(7, 11))
    share = np.linspace(0, 0.93, 8)
    cover = lathe([*((radius * (1 - t), tall * t) for t in share), (0.02, 0.95 * tall)], segments=2 * count)
    over = rng.uniform(0.16, 0.28)
    poles = around(bar([0, 0.9 * tall, 0.1 * radius], [0, (1 + over) * tall, -over * radius * 1.1], 0.025, 6), count)
    slope = np.degrees(np.arctan2(radius, tall))
    door = turned(extrude([(-0.26 * radius, 0), (0.26 * radius, 0), (0, 0.5 * tall)], 0.1), -slope, "x")
    bands = [lathe([(radius * (1 - t) + 0.012, tall * (t - 0.02)), (radius * (1 - t) + 0.012, tall * (t + 0.02))], segments=2 * count)
             for t in (0.62, 0.72)]  # fmt: skip
    return named(body=cover, pole=poles, door=moved(door, [0, 0, radius]), line=bands)
