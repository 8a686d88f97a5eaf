"""Draw cases and what is built like them: wardrobes, stoves, sinks; other kinds of cabinets, tables and desks."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import Solids, bar, block, case, fronts, posts, roundel, spread
from meshdeform.nouns.families.dungeon import arched, around
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import (
    Part,
    box,
    disc,
    ellipsoid,
    lathe,
    limb,
    moved,
    named,
    pair,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = [
    "fireplace",
    "microwave",
    "nightstand",
    "oven",
    "radiator",
    "shelf",
    "shower",
    "sink",
    "stove",
    "wardrobe",
    "washer",
]

_CASE_LEGS = ((0.03, 0.05), (0.14, 0.24), (0.7, 0.85))


def wardrobe(rng: Rng, traits: Traits) -> Part:
    """Draw a wardrobe: a tall wide case with two or three long doors, drawers below them or none, a cornice."""
    doors = int(rng.integers(2, 4))
    width, height, depth = 0.34 + 0.34 * doors, rng.uniform(1.6, 1.9), rng.uniform(0.48, 0.58)
    leg = traits.draw(rng, "legs", (0.03, 0.05), (0.1, 0.16), (0.6, 0.75))
    rows = [(1.0, "door", doors)] if rng.random() < 0.5 else [(0.8, "door", doors), (0.2, "drawer", max(1, doors - 1))]
    solids = case((width, height, depth), leg, rows, grip="knob", top=float(rng.choice([0.03, 0.09])))
    solids["panel"] = [
        block([x, leg + height * (0.3 + 0.34 * k), depth / 2 + 0.05], [0.2, 0.28 * height, 0.07], 0.35, 3)
        for x in spread((width - 0.38) / 2, doors)
        for k in (0, 1)
    ]
    return named(**solids)


def nightstand(rng: Rng, traits: Traits) -> Part:
    """Draw a nightstand: a small case with one to three drawers, or a drawer over a door, on slim legs."""
    width, height, depth = rng.uniform(0.62, 0.75), rng.uniform(0.45, 0.65), rng.uniform(0.5, 0.6)
    leg = traits.draw(rng, "legs", _CASE_LEGS[0], (0.16, 0.32), _CASE_LEGS[2])
    rows = [
        [(1.0, "drawer", 1)],
        [(0.5, "drawer", 1)] * 2,
        [(1 / 3, "drawer", 1)] * 3,
        [(0.35, "drawer", 1), (0.65, "door", 1)],
    ][int(rng.integers(4))]
    return named(**case((width, height, depth), leg, rows, square=rng.random() < 0.5))


def stove(rng: Rng, traits: Traits) -> Part:
    """Draw a kitchen stove: four plates on its top, a row of knobs, an oven door with a handle and a window below."""
    width, height, depth = rng.uniform(0.78, 0.95), rng.uniform(0.75, 0.88), rng.uniform(0.7, 0.8)
    leg = traits.draw(rng, "legs", (0.02, 0.03), (0.06, 0.1), (0.5, 0.65))
    top, front = leg + height, depth / 2
    plates = [
        moved(
            lathe([(0.14, 0), (0.14, 0.04), (0.11, 0.055), (0.1, 0.03), (0.05, 0.03), (0.04, 0.05)], segments=20),
            [x, top + 0.05, z],
        )
        for x in (-0.24 * width, 0.24 * width)
        for z in (-0.23 * depth, 0.23 * depth)
    ]
    knobs = [roundel([x, top - 0.1, front + 0.03], 0.045, 0.08, segments=10) for x in spread(0.36 * width, 5)]
    door = [
        block([0, leg + 0.1, front], [0.9 * width, 0.66 * height, 0.08], 0.15, 3),
        block([0, leg + 0.2, front + 0.03], [0.62 * width, 0.34 * height, 0.06], 0.3, 3),
    ]
    handle = [
        bar([-0.36 * width, top - 0.23, front + 0.12], [0.36 * width, top - 0.23, front + 0.12], 0.028),
        *pair(bar([0.33 * width, top - 0.23, front], [0.33 * width, top - 0.23, front + 0.11], 0.024, 6)),
    ]
    tops = [block([0, top - 0.02, 0], [width + 0.05, 0.08, depth + 0.05], 0.2, 3)]
    if rng.random() < 0.5:
        tops.append(block([0, top, -depth / 2 + 0.04], [width + 0.02, rng.uniform(0.2, 0.3), 0.09], 0.15))
    return named(
        body=block([0, leg, 0], [width, height, depth], 0.04, 3),
        top=tops,
        plate=plates,
        door=door,
        handle=handle,
        knob=knobs,
        leg=posts(width / 2 - 0.08, depth / 2 - 0.08, 0, leg + 0.02, 0.05, square=True),
    )


def wood_stove(rng: Rng, traits: Traits) -> Part:
    """Draw an iron stove: a round or a square body on bent legs, a door with a window, a pipe that rises from its top."""
    half, height, round_ = rng.uniform(0.3, 0.38), rng.uniform(0.65, 0.85), rng.random() < 0.5
    leg = traits.draw(rng, "legs", (0.04, 0.07), (0.16, 0.24), (0.65, 0.8))
    top = leg + height
    if round_:
        body = lathe(
            [(0.8 * half, leg), (half, leg + 0.08), (1.05 * half, leg + 0.4 * height), (0.92 * half, top - 0.06)]
        )
        tops = disc(half * 1.08, top - 0.07, top + 0.02)
    else:
        body, tops = (
            block([0, leg, 0], [2 * half, height, 1.8 * half], 0.06, 3),
            block([0, top - 0.02, 0], [2.2 * half, 0.07, 2 * half], 0.2),
        )
    front = half * (1.0 if round_ else 0.9)
    door = [
        block([0, leg + 0.24 * height, front], [1.2 * half, 0.5 * height, 0.12], 0.15, 3),
        block([0, leg + 0.36 * height, front + 0.05], [0.8 * half, 0.28 * height, 0.06], 0.3),
    ]
    pipe = [
        bar([0, top, -0.2 * half], [0, top + rng.uniform(0.7, 1.0), -0.2 * half], 0.085, 14),
        disc(0.12, top + 0.3, top + 0.36, edge=0.02),
    ]
    pipe[1] = moved(pipe[1], [0, 0, -0.2 * half])
    legs = posts(0.72 * half, 0.62 * half, 0, leg + 0.06, 0.045, splay=0.07)
    return named(
        body=[body, *pipe],
        top=tops,
        plate=disc(0.4 * half, top + 0.01, top + 0.045, edge=0.015),
        door=door,
        handle=bar(
            [0.5 * half, leg + 0.4 * height, front + 0.1], [0.5 * half, leg + 0.6 * height, front + 0.1], 0.025, 6
        ),
        knob=roundel([0, leg + 0.12 * height, front + 0.03], 0.06, 0.08, segments=10),
        leg=legs,
    )


def oven(rng: Rng, _: Traits) -> Part:
    """Draw an oven: a box filled by a door with a large window and a bar, a panel of knobs above it, one or two."""
    width, one, depth, count = (
        rng.uniform(0.85, 1.0),
        rng.uniform(0.62, 0.75),
        rng.uniform(0.7, 0.8),
        int(rng.choice([1, 1, 2])),
    )
    height, front = one * count + 0.24, depth / 2
    solids: Solids = {
        "body": [block([0, 0.05, 0], [width, height, depth], 0.04, 4)],
        "door": [],
        "window": [],
        "handle": [],
    }
    for k in range(count):
        low = 0.1 + k * one
        solids["door"].append(block([0, low, front], [0.94 * width, one - 0.06, 0.1], 0.15, 4))
        solids["window"].append(block([0, low + 0.12 * one, front + 0.03], [0.68 * width, 0.55 * one, 0.07], 0.3, 4))
        level = low + 0.8 * one
        solids["handle"] += [
            bar([-0.38 * width, level, front + 0.14], [0.38 * width, level, front + 0.14], 0.03),
            *pair(bar([0.34 * width, level, front], [0.34 * width, level, front + 0.13], 0.025, 6)),
        ]
    level = height - 0.04
    solids["panel"] = [
        block([0, level - 0.08, front], [0.94 * width, 0.14, 0.07], 0.15),
        block([0, level - 0.05, front + 0.03], [0.22 * width, 0.08, 0.05], 0.2),
    ]
    solids["knob"] = [
        roundel([side * x * width, level - 0.01, front + 0.05], 0.045, 0.07, segments=10)
        for x in (0.24, 0.38)
        for side in (1, -1)
    ]
    return named(**solids, foot=posts(width / 2 - 0.1, depth / 2 - 0.1, 0, 0.07, 0.05, square=True))


def brick_oven(rng: Rng, _: Traits) -> Part:
    """Draw a brick oven: a dome on a block with an arched mouth that has a rim, a chimney above it, a hole for logs."""
    half, base = rng.uniform(0.55, 0.68), rng.uniform(0.4, 0.55)
    turn = np.linspace(0, np.pi / 2, 9)
    dome = lathe([(half * np.cos(t), base + 0.9 * half * np.sin(t)) for t in turn])
    mouth = [moved(arched(0.62 * half + 0.16, 0.55 * half + 0.08, 0.4 * half, 0.5 * half), [0, base, 0.78 * half])]
    hole = moved(arched(0.62 * half, 0.55 * half, 0.3 * half, 0.5 * half), [0, base + 0.01, 0.8 * half])
    store = moved(arched(0.8 * half, 0.7 * base, 0.3 * base, 0.1), [0, 0.04, 1.15 * half])
    chimney = block([0, base + 0.5 * half, 0.62 * half], [0.24, 0.5 * half + rng.uniform(0.3, 0.5), 0.22], 0.1, 3)
    slab = block([0, base - 0.05, 0.06], [2.2 * half, 0.08, 2.4 * half], 0.1)
    return named(
        body=[block([0, 0, 0.04], [2.1 * half, base, 2.25 * half], 0.04, 3), slab, dome, chimney],
        door=[*mouth, hole],
        window=store,
    )


def microwave(rng: Rng, _: Traits) -> Part:
    """Draw a microwave oven: a low wide box, a door with a window and a bar on the left, buttons on the right."""
    width, height, depth = rng.uniform(1.1, 1.3), rng.uniform(0.62, 0.72), rng.uniform(0.7, 0.85)
    front, middle = depth / 2, 0.05 + height / 2
    wide = 0.7 * width
    x = -(width - wide) / 2 + 0.02
    door = [block([x, 0.08, front], [wide - 0.04, height - 0.06, 0.09], 0.2, 3)]
    window = box([x - 0.04, middle, front + 0.04], [wide - 0.28, height - 0.24, 0.06], round_by=0.3, cells=4)
    panel_x = width / 2 - 0.15
    buttons = [
        block([panel_x + a, 0.15 + b * height, front + 0.02], [0.055, 0.05, 0.06], 0.3)
        for a in (-0.075, 0, 0.075)
        for b in (0.05, 0.18, 0.31, 0.44)
    ]
    if rng.random() < 0.35:
        buttons = [roundel([panel_x, 0.05 + y * height, front + 0.04], 0.075, 0.1, segments=14) for y in (0.25, 0.55)]
    panel = block([panel_x, 0.05 + 0.76 * height, front], [0.22, 0.13, 0.07], 0.2)
    grip = [
        bar(
            [x + wide / 2 - 0.09, middle - 0.32 * height, front + 0.11],
            [x + wide / 2 - 0.09, middle + 0.32 * height, front + 0.11],
            0.026,
        )
    ]
    return named(
        body=block([0, 0.05, 0], [width, height, depth], 0.06, 4),
        door=[*door, window],
        panel=panel,
        handle=grip,
        button=buttons,
        foot=posts(width / 2 - 0.1, depth / 2 - 0.1, 0, 0.07, 0.05),
    )


def washer(rng: Rng, _: Traits) -> Part:
    """Draw a washing machine: a box with a round door with a deep ring, a panel with a knob and a drawer above it."""
    width, height, depth = rng.uniform(0.85, 0.95), rng.uniform(1.05, 1.2), rng.uniform(0.8, 0.9)
    front, radius, level = depth / 2, rng.uniform(0.28, 0.33), 0.44 * height
    ring = turned(
        lathe(
            [(radius, 0), (radius + 0.02, 0.05), (radius - 0.03, 0.1), (radius - 0.09, 0.09), (radius - 0.1, 0.05)],
            segments=28,
        ),
        90,
        "x",
    )
    glass = ellipsoid([0, level, front + 0.03], [radius - 0.06, radius - 0.06, 0.07], rings=8)
    top = 0.04 + height
    panel = block([0, top - 0.2, front], [0.96 * width, 0.17, 0.06], 0.15)
    drawer = block([-0.3 * width, top - 0.18, front + 0.02], [0.28 * width, 0.13, 0.07], 0.2)
    knobs = [
        roundel([0.08 * width, top - 0.115, front + 0.05], 0.065, 0.1, segments=14),
        *(block([x * width, top - 0.15, front + 0.02], [0.05, 0.06, 0.05], 0.3) for x in (0.25, 0.33, 0.41)),
    ]
    return named(body=[block([0, 0.04, 0], [width, height, depth], 0.05, 4), block([0, top - 0.02, 0], [width + 0.03, 0.06, depth + 0.03], 0.2)], door=[moved(ring, [0, level, front]), bar([radius - 0.04, level - 0.06, front + 0.11], [radius - 0.04, level + 0.06, front + 0.11], 0.03, 6)],
                 window=glass, panel=panel, drawer=drawer, knob=knobs, foot=posts(width / 2 - 0.1, depth / 2 - 0.1, 0, 0.06, 0.05))  # fmt: skip


def _tap(x: float, level: float, rear: float, tall: float) -> list[Part]:
    """Return a bent tap that stands behind a basin, with a grip at each side."""
    path = [
        [x, level, rear],
        [x, level + tall, rear],
        [x, level + tall + 0.05, rear + 0.09],
        [x, level + tall, rear + 0.2],
        [x, level + 0.7 * tall, rear + 0.21],
    ]
    grips = [disc(0.045, level, level + 0.1, edge=0.01)]
    return [
        limb(path, [0.032] * 5, segments=8, samples=2),
        *(moved(part, [x + s * 0.14, 0, rear]) for part in grips for s in (1, -1)),
    ]


def sink(rng: Rng, _: Traits) -> Part:
    """Draw a washbasin with a tap: an oval one on a pedestal, or a square one sunk in a small cabinet with doors."""
    if rng.random() < 0.55:
        wide, deep, level = rng.uniform(0.46, 0.56), rng.uniform(0.36, 0.44), rng.uniform(0.85, 1.0)
        rows = [
            (0.3, level - 0.28),
            (0.6, level - 0.2),
            (0.92, level - 0.08),
            (1.0, level - 0.02),
            (1.02, level + 0.03),
        ]
        bowl = stretched(vessel(rows, 0.14, level - 0.18), wide, 1, deep)
        shelf = block([0, level - 0.1, -0.9 * deep], [1.5 * wide, 0.14, 0.26], 0.3, 4)
        foot = [(0.24, 0), (0.22, 0.06), (0.12, 0.2), (0.12, 0.5 * level), (0.2, level - 0.22)]
        stem = lathe(foot, segments=20)
        return named(basin=[bowl, shelf], stem=stem, tap=_tap(0, level + 0.02, -0.9 * deep, 0.2))
    width, height, depth = rng.uniform(0.9, 1.3), rng.uniform(0.72, 0.8), rng.uniform(0.6, 0.68)
    solids = case((width, height, depth), 0.06, [(1.0, "door", 2)], grip="knob", top=0.0)
    top, half, far = 0.06 + height, 0.34 * width, 0.32 * depth
    rim = [*pair(block([width / 2 - (width / 2 - half) / 2, top - 0.02, 0], [width / 2 - half + 0.04, 0.12, depth + 0.06], 0.15)),
           block([0, top - 0.015, -depth / 2 + 0.08], [2 * half + 0.02, 0.12, depth / 2 - far + 0.06], 0.15), block([0, top - 0.015, depth / 2 - 0.02], [2 * half + 0.02, 0.12, depth / 2 - far - 0.02], 0.15)]  # fmt: skip
    return named(
        basin=rim,
        tap=_tap(0, top + 0.08, -depth / 2 + 0.09, 0.22),
        **{name: own for name, own in solids.items() if name != "leg"},
    )


def radiator(rng: Rng, traits: Traits) -> Part:
    """Draw a radiator: six to twelve upright ribs side by side on feet, a pipe along them with a valve."""
    count, tall, deep = int(rng.integers(6, 13)), rng.uniform(0.7, 0.95), rng.uniform(0.1, 0.14)
    leg = traits.draw(rng, "legs", (0.02, 0.04), (0.1, 0.15), (0.5, 0.65))
    step, double = rng.uniform(0.11, 0.14), rng.random() < 0.5
    half = step * (count - 1) / 2
    ribs = []
    for x in spread(half, count):
        ribs += [
            box([x, leg + tall / 2, z], [0.82 * step, tall, deep if double else 1.9 * deep], round_by=0.5, cells=3)
            for z in ((-0.6 * deep, 0.6 * deep) if double else (0.0,))
        ]
    pipes = [bar([-half - 0.06, leg + y * tall, 0], [half + 0.06, leg + y * tall, 0], 0.04) for y in (0.12, 0.88)]
    pipes += [
        bar([half + 0.12, 0.03, 0], [half + 0.12, leg + 0.14 * tall, 0], 0.03),
        bar([half, leg + 0.12 * tall, 0], [half + 0.12, leg + 0.12 * tall, 0], 0.03),
    ]
    x = half - 0.5 * step
    return named(
        body=ribs,
        pipe=pipes,
        leg=posts(x, deep, 0, leg + 0.08 * tall, 0.04, square=True),
        knob=moved(disc(0.055, 0, 0.12, edge=0.015), [half + 0.12, leg + 0.14 * tall, 0]),
    )


def fireplace(rng: Rng, traits: Traits) -> Part:
    """Draw a fireplace: two jambs under a shelf around a hollow with logs and flames on a hearth, a chimney above."""
    width, tall, depth = rng.uniform(0.55, 0.7), rng.uniform(0.75, 0.9), rng.uniform(0.3, 0.4)
    rise = traits.draw(rng, "chimney", (0.08, 0.14), (0.5, 0.7), (1.3, 1.6))
    jamb, top = 0.2, tall + 0.2
    body = [
        *pair(block([width + jamb / 2, 0.05, 0], [jamb, tall, depth], 0.06, 3)),
        block([0, 0.05, -depth / 2 + 0.04], [2 * width + 0.1, tall, 0.09], 0.05),
    ]
    body.append(block([0, 0.72 * tall, 0.01], [2 * (width + jamb) - 0.02, 0.28 * tall + 0.05, depth - 0.01], 0.06, 3))
    base = block([0, 0, 0.12], [2 * (width + jamb) + 0.2, 0.08, depth + 0.34], 0.1)
    shelf = [
        block([0, tall + 0.03, 0.04], [2 * (width + jamb) + 0.16, 0.1, depth + 0.14], 0.2, 3),
        block([0, tall - 0.03, 0.03], [2 * (width + jamb) + 0.04, 0.07, depth + 0.06], 0.1),
    ]
    share = rng.uniform(0.6, 1.0)
    breast = box([0, 0, 0], [1, 1, 1], round_by=0.03, cells=3)
    x, y, z = breast.verts.T
    slope = 1 - (1 - share) * (y + 0.5)
    chimney = Part(
        np.stack(
            [
                x * 1.7 * (width + jamb) * slope,
                top - 0.08 + (y + 0.5) * rise,
                (z * 0.85 * slope - 0.075 * (1 - slope)) * depth,
            ],
            1,
        ),
        breast.faces,
    )
    logs = [bar([-0.5 * width, 0.13, 0.02 + z], [0.5 * width, 0.13, 0.05 - z], 0.055) for z in (-0.06, 0.07)]
    flames = [
        limb(
            [[x, 0.17, 0.03], [1.2 * x, 0.17 + 0.4 * h, 0.05], [0.8 * x, 0.17 + h, 0.03]],
            [0.06, 0.08, 0.012],
            segments=8,
            samples=2,
        )
        for x, h in ((-0.24, 0.26), (0.0, 0.4), (0.22, 0.3))
    ]
    grate = pair(bar([0.6 * width, 0.08, 0.12], [0.6 * width, 0.26, 0.14], 0.03, 6))
    return named(body=body, base=base, top=shelf, chimney=chimney, frame=grate, log=logs, flame=flames)


def _things(rng: Rng, x: float, level: float, room: float, high: float, depth: float) -> list[Part]:
    """Return a row of books of all heights from x on, as many as have room."""
    books: list[Part] = []
    end = x + room
    while (thick := rng.uniform(0.05, 0.1)) + x < end:
        books.append(
            block(
                [x + thick / 2, level, 0.02],
                [0.92 * thick, high * rng.uniform(0.6, 0.95), depth * rng.uniform(0.6, 0.85)],
                0.1,
            )
        )
        x += thick
    return books


def shelf(rng: Rng, _: Traits) -> Part:
    """Draw shelves: one to three boards on brackets for a wall with books on them, or an open rack on four posts."""
    width, depth = rng.uniform(1.0, 1.4), rng.uniform(0.28, 0.36)
    if rng.random() < 0.5:
        rows, step, tall = int(rng.integers(3, 6)), rng.uniform(0.36, 0.46), 0.1
        tall = step * (rows - 1) + 0.2
        boards = [block([0, 0.1 + step * k, 0], [width, 0.06, 1.3 * depth], 0.15, 3) for k in range(rows)]
        books = [
            book
            for k in range(rows - 1)
            for book in _things(
                rng, rng.uniform(-0.45, -0.1) * width, 0.15 + step * k, 0.4 * width, 0.7 * step, 1.2 * depth
            )
        ]
        return named(
            shelf=boards, pole=posts(width / 2 - 0.03, 0.65 * depth - 0.02, 0, tall, 0.032, square=True), book=books
        )
    rows, boards, brackets, books = int(rng.integers(1, 4)), [], [], []
    for k in range(rows):
        level, shift = 0.2 + 0.46 * k, rng.uniform(-0.15, 0.15) * (rows > 1)
        boards.append(block([shift, level, 0], [width, 0.07, depth], 0.15, 4))
        brackets += [
            block([shift + x, level - 0.17, -depth / 2 + 0.04], [0.05, 0.2, 0.06], 0.1)
            for x in (-0.36 * width, 0.36 * width)
        ]
        brackets += [
            bar([shift + x, level - 0.15, -depth / 2 + 0.06], [shift + x, level, 0.3 * depth], 0.022, 6)
            for x in (-0.36 * width, 0.36 * width)
        ]
        books += _things(
            rng, shift + rng.uniform(-0.46, -0.1) * width, level + 0.06, rng.uniform(0.25, 0.5) * width, 0.3, depth
        )
    return named(shelf=boards, bracket=brackets, book=books)


def shower(rng: Rng, _: Traits) -> Part:
    """Draw a shower: a tray with two or three glass walls in frames, a pole with a rose at the back, a tap."""
    half, tall, round_ = rng.uniform(0.45, 0.55), rng.uniform(1.5, 1.75), rng.random() < 0.7
    base = [
        block([0, 0, 0], [2 * half + 0.08, 0.13, 2 * half + 0.08], 0.15, 3),
        block([0, 0.06, 0], [2 * half - 0.14, 0.09, 2 * half - 0.14], 0.2),
    ]
    side, high = rng.choice([-1, 1]), tall + rng.uniform(0.05, 0.25)
    walls = [
        block([0, 0.1, -half], [2 * half, tall, 0.06], 0.1),
        block([side * half, 0.1, 0], [0.05, 0.9 * tall, 2 * half - 0.04], 0.1),
    ]
    frame = [bar([side * half, 0.1, half], [side * half, 0.9 * tall + 0.1, half], 0.035)]
    if rng.random() < 0.4:
        walls.append(block([side * 0.5 * half, 0.1, half], [half, 0.9 * tall, 0.04], 0.1))
        frame.append(bar([0, 0.1, half], [0, 0.9 * tall + 0.1, half], 0.03))
    pole = [
        limb(
            [[0, 0.75, 0.08 - half], [0, high, 0.08 - half], [0, high + 0.08, 0.3 - half], [0, high, 0.5 - half]],
            [0.035] * 4,
            segments=8,
            samples=2,
        )
    ]
    rose = (
        lathe([(0.2, high - 0.16), (0.2, high - 0.1), (0.05, high)], segments=20)
        if round_
        else block([0, high - 0.12, 0], [0.36, 0.07, 0.36], 0.2, 3)
    )
    taps = [roundel([x, 0.75, 0.06 - half], 0.06, 0.1, segments=12) for x in (-0.12, 0.12)]
    return named(
        base=base,
        panel=walls,
        frame=frame,
        pole=pole,
        head=moved(rose, [0, 0, 0.5 - half]),
        tap=[*taps, bar([-0.12, 0.75, 0.05 - half], [0.12, 0.75, 0.05 - half], 0.03)],
    )


def sideboard(rng: Rng, traits: Traits) -> Part:
    """Draw a sideboard: a long low case with doors beside or below drawers, on slim legs."""
    width, height, depth = rng.uniform(1.4, 1.8), rng.uniform(0.5, 0.7), rng.uniform(0.42, 0.5)
    leg = traits.draw(rng, "legs", (0.04, 0.08), (0.2, 0.3), (0.8, 1.0))
    rows = [[(1.0, "door", 4)], [(0.3, "drawer", 3), (0.7, "door", 3)], [(0.5, "drawer", 2)] * 2][int(rng.integers(3))]
    return named(**case((width, height, depth), leg, rows, square=rng.random() < 0.5))


def chest_of_drawers(rng: Rng, traits: Traits) -> Part:
    """Draw a chest of drawers: three to five rows of drawers one over another, the topmost row in two."""
    width, rows, depth = rng.uniform(0.8, 1.2), int(rng.integers(3, 6)), rng.uniform(0.45, 0.55)
    leg = traits.draw(rng, "legs", (0.04, 0.08), (0.12, 0.2), (0.7, 0.9))
    drawers = [(1 / rows, "drawer", 1 + (k == 0 and width > 0.95)) for k in range(rows)]
    return named(**case((width, 0.26 * rows, depth), leg, drawers, grip=str(rng.choice(["knob", "handle"]))))


def filing_cabinet(rng: Rng, traits: Traits) -> Part:
    """Draw a filing cabinet: a narrow tall case of two to four deep drawers with bars and label plates."""
    width, rows, depth = rng.uniform(0.52, 0.6), int(rng.integers(2, 5)), rng.uniform(0.6, 0.75)
    leg = traits.draw(rng, "legs", (0.01, 0.02), (0.04, 0.08), (0.5, 0.65))
    solids = case((width, 0.42 * rows, depth), leg, [(1 / rows, "drawer", 1)] * rows, grip="handle", top=0.0)
    solids["panel"] = [
        block([0, leg + 0.42 * (k + 0.68), depth / 2 + 0.03], [0.16, 0.08, 0.06], 0.1) for k in range(rows)
    ]
    solids["leg"] = posts(width / 2 - 0.06, depth / 2 - 0.06, 0, leg + 0.03, 0.04, square=True)
    return named(**solids)


def glass_cabinet(rng: Rng, traits: Traits) -> Part:
    """Draw a dresser: a case with doors below, on it a shallower one of open boards or with glass doors above."""
    width, low, high, depth = (
        rng.uniform(0.95, 1.25),
        rng.uniform(0.6, 0.75),
        rng.uniform(0.75, 0.95),
        rng.uniform(0.45, 0.52),
    )
    leg = traits.draw(rng, "legs", (0.03, 0.06), (0.1, 0.16), (0.7, 0.85))
    solids = case((width, low, depth), leg, [(0.28, "drawer", 2), (0.72, "door", 2)])
    level, upper, rear = leg + low + 0.06, 0.62 * depth, -0.19 * depth
    solids["body"] += [
        *pair(block([width / 2 - 0.05, level, rear], [0.08, high, upper], 0.1)),
        block([0, level, rear - upper / 2 + 0.03], [width - 0.04, high, 0.05], 0.1),
    ]
    solids["top"] += [block([0, level + high - 0.02, rear + 0.02], [width + 0.1, 0.1, upper + 0.1], 0.2)]
    solids["shelf"] = [
        block([0, level + share * high, rear], [width - 0.08, 0.05, upper - 0.04], 0.1) for share in (0.33, 0.66)
    ]
    if rng.random() < 0.5:
        more = fronts(
            width - 0.06, level + 0.03, level + high - 0.03, rear + upper / 2 - 0.03, [(1.0, "door", 2)], "knob"
        )
        solids = {name: [*solids.get(name, []), *more.get(name, [])] for name in {**solids, **more}}
    return named(**solids)


def round_table(rng: Rng, traits: Traits) -> Part:
    """Draw a round table: a round top on one turned post with a foot or four feet, or on three or four legs."""
    radius, slab, kind = rng.uniform(0.6, 0.8), rng.uniform(0.08, 0.13), int(rng.integers(3))
    level = traits.draw(rng, "legs", (0.3, 0.4), (0.75, 0.92), (1.4, 1.7))
    top = disc(radius, level, level + slab, edge=0.03)
    if kind == 2:
        legs = around(
            bar([0, 0.05, 0.8 * radius], [0, level + 0.02, 0.68 * radius], 0.055, 12), int(rng.integers(3, 5)), 45
        )
        return named(top=[top, disc(0.72 * radius, level - 0.08, level + 0.02)], leg=legs)
    post = [
        (0.09, 0.06),
        (0.07, 0.3 * level),
        (0.12, 0.45 * level),
        (0.07, 0.6 * level),
        (0.08, level - 0.08),
        (0.2, level),
    ]
    foot = (
        [lathe([(0.5 * radius, 0), (0.48 * radius, 0.05), (0.14, 0.1), (0.09, 0.14)])]
        if kind
        else around(
            limb([[0, 0.16, 0], [0, 0.12, 0.3 * radius], [0, 0.05, 0.62 * radius]], [0.07, 0.055, 0.045], segments=8),
            4,
            45,
        )
    )
    return named(top=top, leg=[lathe(post, segments=16), *foot])


def coffee_table(rng: Rng, traits: Traits) -> Part:
    """Draw a low table: a long thin top, a board between its legs below or none, square or spread legs."""
    width, depth = rng.uniform(1.3, 1.7), rng.uniform(0.7, 0.9)
    level = traits.draw(rng, "legs", (0.14, 0.2), (0.36, 0.46), (1.0, 1.2))
    square = rng.random() < 0.6
    tops = [block([0, level, 0], [width, rng.uniform(0.06, 0.14), depth], 0.2, 6)]
    if rng.random() < 0.6:
        tops.append(block([0, 0.35 * level, 0], [width - 0.14, 0.05, depth - 0.14], 0.15, 3))
    return named(
        top=tops,
        leg=posts(
            width / 2 - 0.1, depth / 2 - 0.1, 0, level + 0.02, 0.05, square=square, splay=0.0 if square else 0.09
        ),
    )


def trestle_table(rng: Rng, traits: Traits) -> Part:
    """Draw a table on two crossed or straight trestles with a beam between them; a picnic table has its benches on it."""
    half, depth = rng.uniform(0.8, 1.0), rng.uniform(0.65, 0.8)
    level = traits.draw(rng, "legs", (0.3, 0.4), (0.7, 0.85), (1.35, 1.6))
    count, picnic, x = int(rng.choice([1, 4, 5])), rng.random() < 0.45, half - 0.24
    wide = depth / count
    tops = [
        block([0, level, z], [2 * half, 0.09, wide - 0.02 * (count > 1)], 0.15, 5)
        for z in spread((depth - wide) / 2, count)
    ]
    out = 0.95 * depth if picnic else 0.5 * depth
    if picnic or rng.random() < 0.5:
        legs = [
            side
            for s in (1, -1)
            for side in pair(
                bar(
                    [x + 0.02 * s, 0.05, s * (0.72 * depth if picnic else 0.42 * depth)],
                    [x + 0.02 * s, level, (0.3 if picnic else -0.34) * s * depth],
                    0.05,
                )
            )
        ]
    else:
        legs = [
            *pair(block([x, 0, 0], [0.12, level + 0.02, 0.3 * depth], 0.1)),
            *pair(block([x, 0, 0], [0.14, 0.09, 0.85 * depth], 0.15)),
        ]
    legs += [bar([-x, 0.5 * level, 0], [x, 0.5 * level, 0], 0.045)]
    if picnic:
        tops += [block([0, 0.55 * level, s * out], [2 * half, 0.08, 0.26], 0.15, 3) for s in (1, -1)]
        legs += pair(block([x, 0.48 * level, 0], [0.07, 0.08, 2 * out], 0.1))
    return named(top=tops, leg=legs)


def side_table(rng: Rng, traits: Traits) -> Part:
    """Draw a small square table: a top over a frame with or without a drawer, slim legs, a board below."""
    half, depth = rng.uniform(0.36, 0.46), rng.uniform(0.34, 0.46)
    level = traits.draw(rng, "legs", (0.25, 0.35), (0.7, 0.9), (1.4, 1.7))
    tops = [
        block([0, level, 0], [2 * half + 0.1, 0.07, 2 * depth + 0.1], 0.2, 5),
        block([0, level - 0.13, 0], [2 * half - 0.02, 0.14, 2 * depth - 0.02], 0.05),
    ]
    if rng.random() < 0.6:
        tops.append(block([0, 0.22 * level, 0], [2 * half - 0.02, 0.05, 2 * depth - 0.02], 0.15, 3))
    return named(top=tops, leg=posts(half - 0.03, depth - 0.03, 0, level, 0.045, square=rng.random() < 0.5))


_DESK_LEGS = ((0.04, 0.09), (0.16, 0.26), (0.9, 1.1))


def pedestal_desk(rng: Rng, traits: Traits) -> Part:
    """Draw a desk with a block of drawers at each side, a wide top, a panel between them."""
    width, depth, tall, block_ = (
        rng.uniform(1.6, 1.9),
        rng.uniform(0.75, 0.9),
        rng.uniform(0.55, 0.65),
        rng.uniform(0.4, 0.48),
    )
    leg, rows = traits.draw(rng, "legs", (0.02, 0.04), (0.08, 0.16), (0.8, 1.0)), int(rng.integers(2, 4))
    one = case((block_, tall, depth - 0.06), leg, [(1 / rows, "drawer", 1)] * rows, top=0.0)
    x = (width - block_) / 2 - 0.04
    solids = {name: [moved(part, [s * x, 0, 0]) for s in (1, -1) for part in own] for name, own in one.items()}
    solids["body"].append(block([0, leg + 0.2 * tall, -depth / 2 + 0.1], [2 * x, 0.8 * tall, 0.06], 0.1))
    return named(**solids, top=block([0, leg + tall - 0.01, 0], [width + 0.06, 0.1, depth + 0.06], 0.2, 4))


def office_desk(rng: Rng, traits: Traits) -> Part:
    """Draw an office desk: a thin top on two frames or side panels, with a screen and a keyboard on it or without."""
    width, depth = rng.uniform(1.5, 1.8), rng.uniform(0.7, 0.85)
    level = traits.draw(rng, "legs", (0.28, 0.36), (0.66, 0.78), (1.3, 1.5))
    x, panels = width / 2 - 0.06, rng.random() < 0.5
    legs = (
        pair(block([x, 0, 0], [0.07, level + 0.01, depth - 0.08], 0.1, 3))
        if panels
        else [
            *posts(x, depth / 2 - 0.08, 0, level + 0.01, 0.04, square=True),
            *pair(block([x, 0, 0], [0.07, 0.06, depth], 0.1)),
        ]
    )
    solids: Solids = {
        "top": [block([0, level, 0], [width, 0.07, depth], 0.2, 5)],
        "leg": legs,
        "body": [block([0, 0.45 * level, -0.36 * depth], [2 * x, 0.5 * level, 0.05], 0.1)],
    }
    if rng.random() < 0.5:
        top = level + 0.07
        solids["screen"] = [
            block([0, top + 0.16, -0.2 * depth], [0.66, 0.4, 0.06], 0.2, 3),
            block([0, top - 0.01, -0.22 * depth], [0.08, 0.24, 0.05], 0.1),
            block([0, top - 0.01, -0.2 * depth], [0.28, 0.04, 0.2], 0.2),
        ]
        solids["panel"] = [block([0, top - 0.01, 0.2 * depth], [0.5, 0.045, 0.17], 0.2)]
    if rng.random() < 0.5:
        more = fronts(0.4, 0.12, level - 0.02, 0.36 * depth, [(1 / 3, "drawer", 1)] * 3)
        solids |= {name: [moved(part, [x - 0.24, 0, 0]) for part in own] for name, own in more.items()}
        solids["body"].append(block([x - 0.24, 0.1, 0], [0.42, level - 0.1, 0.72 * depth], 0.05))
    return named(**solids)


def writing_table(rng: Rng, traits: Traits) -> Part:
    """Draw a writing table: a top over a row of flat drawers on slim legs, some with a rack of pigeonholes behind."""
    width, depth = rng.uniform(1.2, 1.5), rng.uniform(0.6, 0.72)
    leg = traits.draw(rng, "legs", (0.2, 0.28), (0.55, 0.68), (1.2, 1.45))
    solids = case((width, 0.2, depth), leg, [(1.0, "drawer", int(rng.integers(2, 4)))], square=rng.random() < 0.5)
    if rng.random() < 0.5:
        top, rear = leg + 0.26, -0.36 * depth
        solids["shelf"] = [
            block([0, top + 0.3, rear], [width, 0.06, 0.2], 0.15, 3),
            *(block([x, top, rear], [0.05, 0.32, 0.19], 0.1) for x in spread(width / 2 - 0.04, 5)),
            block([0, top + 0.14, rear], [width - 0.06, 0.04, 0.18], 0.1),
        ]
    return named(**solids)


def open_bookcase(rng: Rng, _: Traits) -> Part:
    """Draw an empty or half empty bookcase: two sides, three to five boards, with a back or without."""
    width, depth, rows, row = (
        rng.uniform(0.8, 1.3),
        rng.uniform(0.34, 0.44),
        int(rng.integers(2, 5)),
        rng.uniform(0.36, 0.46),
    )
    tall = rows * row + 0.12
    body = pair(block([width / 2, 0, 0], [0.08, tall, depth], 0.1, 3))
    boards = [
        block(
            [0, 0.04 + k * row, 0],
            [width + 0.02 + 0.12 * (k == rows), 0.07, depth - 0.01 + 0.06 * (k == rows)],
            0.15,
            3,
        )
        for k in range(rows + 1)
    ]
    back = (
        [block([0, 0.02, -depth / 2 + 0.03], [width - 0.02, tall - 0.06, 0.04], 0.1)]
        if rng.random() < 0.6
        else [
            bar([-width / 2, 0.15, 0.02 - depth / 2], [width / 2, tall - 0.15, 0.02 - depth / 2], 0.025),
            bar([width / 2, 0.15, 0.02 - depth / 2], [-width / 2, tall - 0.15, 0.02 - depth / 2], 0.025),
        ]
    )
    books = [
        book
        for k in range(rows)
        if rng.random() < 0.4
        for book in _things(rng, -0.42 * width, 0.1 + k * row, rng.uniform(0.2, 0.5) * width, 0.75 * row, 0.9 * depth)
    ]
    return named(body=body, shelf=boards, back=back, **({"book": books} if books else {}))


def cube_bookcase(rng: Rng, _: Traits) -> Part:
    """Draw a bookcase of square compartments, two to four across and down, some of which have books or a box."""
    columns, rows, cell, depth = int(rng.integers(2, 5)), int(rng.integers(2, 5)), 0.4, rng.uniform(0.36, 0.42)
    width, tall = columns * cell, rows * cell
    body = [
        block([x, 0.02, 0], [0.06 if abs(x) < width / 2 - 0.1 else 0.09, tall, depth], 0.1)
        for x in spread(width / 2, columns + 1)
    ]
    boards = [
        block(
            [0, k * cell, 0],
            [
                width + (0.12 if k in (0, rows) else 0),
                0.06 + 0.03 * (k in (0, rows)),
                depth - 0.01 + 0.03 * (k in (0, rows)),
            ],
            0.1,
        )
        for k in range(rows + 1)
    ]
    solids: Solids = {
        "body": body,
        "shelf": boards,
        "back": [block([0, 0.03, 0.03 - depth / 2], [width, tall, 0.04], 0.1)],
    }
    for x in spread(width / 2 - cell / 2, columns):
        for k in range(rows):
            fate = rng.random()
            if fate < 0.4:
                solids.setdefault("book", []).extend(
                    _things(rng, x - 0.16, 0.06 + k * cell, rng.uniform(0.15, 0.3), 0.28, depth)
                )
            elif fate < 0.55:
                solids.setdefault("drawer", []).append(
                    block([x, 0.07 + k * cell, 0.03], [0.31, 0.28, depth - 0.04], 0.08)
                )
    return named(**solids)


KINDS = {
    "bookcase": (open_bookcase, cube_bookcase),
    "cabinet": (sideboard, chest_of_drawers, filing_cabinet, glass_cabinet),
    "desk": (pedestal_desk, office_desk, writing_table),
    "oven": (brick_oven,),
    "stove": (wood_stove,),
    "table": (round_table, coffee_table, trestle_table, side_table),
}
