"""Draw what stands around houses and on playgrounds: fences, gates, stairs, swings, slides; doors and windows."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, posts, slats, spread
from meshdeform.nouns.families.buildings import pyramid
from meshdeform.nouns.families.dungeon import arched
from meshdeform.nouns.families.parts import (
    Part,
    box,
    curved,
    disc,
    ellipsoid,
    extrude,
    limb,
    moved,
    named,
    pair,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import roof_of

__all__ = ["dock", "fence", "gate", "playground", "slide", "stairs", "swing", "wall", "window"]


def fence(rng: Rng, _: Traits) -> Part:
    """Draw a fence along X: pointed pales on two rails, open rails between posts, or iron bars with tips."""
    half, tall, kind = rng.uniform(0.9, 1.3), rng.uniform(0.7, 0.95), int(rng.integers(3))
    count = int(rng.integers(2, 5))
    stakes = [block([x, 0, 0], [0.14, tall + 0.08, 0.14], 0.1) for x in spread(half, count)]
    stakes += [pyramid(0.07, 0.1, [x, tall + 0.07, 0]) for x in spread(half, count)]
    if kind == 1:
        levels = np.linspace(0.3, 0.92, int(rng.integers(2, 4))) * tall
        return named(
            pole=stakes, rail=[box([0, y, 0.02], [2 * half + 0.2, 0.13, 0.07], round_by=0.2, cells=4) for y in levels]
        )
    rails = [block([0, y * tall, -0.03], [2 * half, 0.09, 0.06], 0.1) for y in (0.2, 0.72)]
    places = spread(half - 0.08, int(rng.integers(9, 14)))
    if kind == 2:
        bars = [
            *slats(half, 0.08 * tall, tall, -0.03, len(places), 0.025),
            *(pyramid(0.04, 0.12, [x, tall, -0.03]) for x in spread(half, len(places))),
        ]
        return named(pole=stakes, rail=rails, plank=bars)
    wide = 0.34 * (places[1] - places[0])
    pale = extrude(
        [(-wide, 0), (wide, 0), (wide, tall - 0.08), (0, tall + 0.02), (-wide, tall - 0.08)], 0.05, bevel=0.1
    )
    return named(pole=stakes, rail=rails, plank=[moved(pale, [x, 0.05, 0.03]) for x in places])


def gate(rng: Rng, traits: Traits) -> Part:
    """Draw a gate: two pillars with caps or balls, between them two wings of iron bars or of planks with braces."""
    wide, thick = rng.uniform(0.55, 0.75), rng.uniform(0.13, 0.18)
    tall = traits.draw(rng, "columns", (0.3, 0.4), (0.95, 1.2), (2.0, 2.4))
    high, edge = rng.uniform(0.75, 1.05), wide + thick
    caps = pair(block([edge, tall - 0.01, 0], [2.7 * thick, 0.1, 2.7 * thick], 0.15))
    caps += (
        pair(ellipsoid([edge, tall + 0.17, 0], 0.11, rings=8))
        if rng.random() < 0.5
        else pair(pyramid(1.2 * thick, 0.16, [edge, tall + 0.08, 0]))
    )
    iron, bow = rng.random() < 0.6, rng.uniform(-0.2, 0.25)
    places = np.linspace(0.05, wide - 0.05, 6)
    tops = high + bow * (1 - (places / wide) ** 2) - 0.1
    if iron:
        wings = [bar([x, 0.08, 0], [x, y, 0], 0.026, 6) for x, y in zip(places, tops, strict=True)]
        wings += [pyramid(0.04, 0.12, [x, y, 0]) for x, y in zip(places, tops, strict=True)]
    else:
        wings = [block([x, 0.06, 0], [0.19 * wide, y - 0.06, 0.07], 0.1) for x, y in zip(places, tops, strict=True)]
    lines = [
        box([wide / 2, y * high, 0.0 if iron else 0.05], [wide - 0.02, 0.08, 0.06], round_by=0.2, cells=2)
        for y in (0.18, 0.62)
    ]
    lines += [] if iron else [bar([0.08, 0.2 * high, 0.05], [wide - 0.08, 0.6 * high, 0.05], 0.035, 6)]
    return named(column=pair(block([edge, 0, 0], [2 * thick, tall, 2 * thick], 0.06, 4)), cap=caps, door=[side for part in wings for side in pair(part)],
                 line=[side for part in lines for side in pair(part)])  # fmt: skip


def torii(rng: Rng, traits: Traits) -> Part:
    """Draw a torii: two round posts that lean together under a long beam with raised ends and a second one below."""
    wide = rng.uniform(0.55, 0.7)
    tall = traits.draw(rng, "columns", (0.25, 0.35), (1.05, 1.3), (2.1, 2.5))
    bow = np.linspace(-1, 1, 7)
    beams = [
        limb(np.c_[1.45 * wide * bow, tall + 0.02 + 0.12 * bow**2, 0 * bow], [[0.1, 0.1]] * 7, segments=4, samples=1)
    ]
    beams += [
        limb(np.c_[1.6 * wide * bow, tall + 0.13 + 0.14 * bow**2, 0 * bow], [[0.07, 0.15]] * 7, segments=8, samples=1)
    ]
    lower = block([0, 0.74 * tall, 0], [2.7 * wide, 0.12, 0.11], 0.1, 3)
    return named(column=pair(bar([wide, 0.08, 0], [0.9 * wide, tall, 0], 0.09, 14)), cap=pair(moved(disc(0.14, 0, 0.14), [wide, 0, 0])),
                 door=[*beams, lower], line=block([0, 0.8 * tall, 0], [0.14, 0.2 * tall, 0.09], 0.1))  # fmt: skip


def wall(rng: Rng, _: Traits) -> Part:
    """Draw a wall along X: of bricks in courses, with battlements, or plain under a coping between two pillars."""
    half, tall, deep, kind = rng.uniform(0.8, 1.1), rng.uniform(0.8, 1.1), rng.uniform(0.12, 0.2), int(rng.integers(3))
    core = block([0, 0, 0], [2 * half, tall, 2 * deep], 0.03, 4)
    if kind == 1:
        walk = block([0, 0.86 * tall, 0], [2 * half + 0.04, 0.1, 2 * deep + 0.14], 0.1, 3)
        teeth = [
            block([x, 0.95 * tall, s * (deep + 0.01)], [0.2, 0.26, 0.12], 0.1)
            for x in spread(half - 0.1, 5)
            for s in (1, -1)
        ]
        return named(body=core, top=[walk, *teeth], base=block([0, 0, 0], [2 * half, 0.14, 2 * deep + 0.14], 0.1))
    if kind == 2:
        ends = pair(block([half, 0, 0], [0.3, 1.1 * tall, 2 * deep + 0.16], 0.06, 3))
        cap = [
            *pair(block([half, 1.08 * tall, 0], [0.4, 0.1, 2 * deep + 0.26], 0.15)),
            block([0, tall - 0.02, 0], [2 * half, 0.1, 2 * deep + 0.12], 0.15),
        ]
        return named(body=[core, *ends], top=cap, base=block([0, 0, 0], [2 * half, 0.16, 2 * deep + 0.1], 0.1))
    rows, bricks = int(rng.integers(5, 7)), int(rng.integers(4, 6))
    high, wide = tall / rows, 2 * half / bricks
    stones = []
    for row in range(rows):
        lap = 0.5 * (row % 2)
        for k in range(bricks + row % 2):
            low, high_x = max(k - lap, 0) * wide - half, min(k + 1 - lap, bricks) * wide - half
            size = [high_x - low - 0.025, high - 0.025, 2 * deep + 0.06]
            stones.append(block([(low + high_x) / 2, row * high + 0.01, 0], size, 0.08))
    return named(body=[core, *stones], base=block([0, -0.05, 0], [2 * half + 0.1, 0.1, 2 * deep + 0.16], 0.1))


def stairs(rng: Rng, _: Traits) -> Part:
    """Draw stairs that rise to the back: solid or on two leaning beams, with rails on posts or without."""
    count, width = int(rng.integers(5, 10)), rng.uniform(0.7, 1.1)
    rise, run = rng.uniform(0.13, 0.17), rng.uniform(0.18, 0.24)
    high, deep, open_ = count * rise, count * run, rng.random() < 0.4
    z = deep / 2 - run * (np.arange(count) + 0.5)
    if open_:
        steps = [block([0, (k + 1) * rise - 0.06, z[k]], [width, 0.07, 1.15 * run], 0.15) for k in range(count)]
        beam = bar([width / 2, 0.05, z[0] + 0.5 * run], [width / 2, high - 0.05, z[-1] - 0.2 * run], 0.055)
        steps += pair(beam)
    else:
        steps = [block([0, 0, z[k]], [width + 0.002 * k, (k + 1) * rise, 1.02 * run], 0.04) for k in range(count)]
    rail = rng.random()
    if rail < 0.35:
        return named(step=steps)
    x = width / 2 - 0.04
    stakes = [
        bar([x, (k + 0.9) * rise, z[k]], [x, (k + 1) * rise + 0.5, z[k]], 0.022, 6)
        for k in range(0, count, 1 if count < 7 else 2)
    ]
    hand = bar([x, rise + 0.5, z[0]], [x, high + 0.5, z[-1]], 0.04)
    sides = [side for part in stakes for side in pair(part)], pair(hand)
    return named(step=steps, pole=sides[0], rail=sides[1]) if rail < 0.85 else named(step=steps, pole=stakes, rail=hand)


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


def dock(rng: Rng, traits: Traits) -> Part:
    """Draw a dock that runs out toward +Z: planks across two beams on round piles, of which some rise above it."""
    width, count = rng.uniform(0.6, 0.85), int(rng.integers(11, 16))
    leg = traits.draw(rng, "legs", (0.06, 0.1), (0.35, 0.5), (1.1, 1.3))
    length, pairs = 0.15 * count, int(rng.integers(3, 5))
    planks = [
        block([rng.uniform(-0.02, 0.02), leg, z], [width, 0.06, 0.13], 0.15) for z in spread(length / 2 - 0.07, count)
    ]
    if rng.random() < 0.35:
        planks += [
            block([0, leg - 0.01, length / 2 + 0.16 + 0.15 * k], [2.2 * width, 0.06, 0.13], 0.15) for k in range(4)
        ]
    beams = pair(block([0.38 * width, leg - 0.09, 0], [0.08, 0.1, length], 0.1))
    above = 0.06 + rng.choice([0.0, 0.2, 0.3])
    places = [(x, z) for z in spread(length / 2 - 0.12, pairs) for x in (-width / 2, width / 2)]
    piles = [bar([x, 0.06, z], [x, leg + 0.04, z], 0.06) for x, z in places]
    tops = [bar([x, leg + 0.05, z], [x, leg + above, z], 0.07) for x, z in places]
    return named(top=[*planks, *beams], leg=piles, pole=tops)


def swing(rng: Rng, traits: Traits) -> Part:
    """Draw a swing: one or two seats on ropes under a beam, on two legs at either end."""
    seats = int(rng.integers(1, 3))
    half, open_ = 0.32 + 0.34 * (seats - 1), rng.uniform(0.35, 0.5)
    tall = traits.draw(rng, "legs", (0.6, 0.7), (1.15, 1.35), (2.1, 2.4))
    thick = rng.uniform(0.04, 0.06)
    legs = [part for z in (1, -1) for part in pair(bar([half + 0.1, thick, z * open_], [half, tall, 0], thick))]
    frame = [bar([-half - 0.08, tall, 0], [half + 0.08, tall, 0], 1.15 * thick)]
    if rng.random() < 0.5:
        frame += pair(
            bar([half + 0.05, 0.45 * tall, 0.5 * open_], [half + 0.05, 0.45 * tall, -0.5 * open_], 0.8 * thick)
        )
    level, ropes, boards = 0.34, [], []
    for x in spread(0.34 * (seats - 1), seats):
        ropes += [bar([x + s * 0.17, level, 0], [x + s * 0.17, tall, 0], 0.02, 6) for s in (1, -1)]
        boards.append(block([x, level - 0.03, 0], [0.44, 0.06, 0.2], 0.2, 3))
    return named(leg=legs, frame=frame, rope=ropes, seat=boards)


def _chute(top: float, reach: float, half: float, wave: float, start: float) -> list[Part]:
    """Return a slide's bed with two side walls, from a height at depth `start` down toward +Z."""
    ways = [
        [0, top, start],
        [0, top - 0.03, start + 0.12],
        [0, 0.55 * top + wave, start + 0.45 * reach],
        [0, 0.14, start + 0.85 * reach],
        [0, 0.11, start + reach],
    ]
    path = curved(ways, samples=3)
    bed = limb(path, [[0.03, half]] * len(path), segments=8, samples=1)
    return [bed, *pair(limb(path + [half, 0.07, 0], [[0.08, 0.03]] * len(path), segments=8, samples=1))]


def slide(rng: Rng, traits: Traits) -> Part:
    """Draw a slide: a chute with side walls, straight or wavy, a ladder with hand rails behind it, posts."""
    top = traits.draw(rng, "legs", (0.35, 0.45), (0.85, 1.05), (1.7, 2.0))
    half, reach, wave = rng.uniform(0.17, 0.22), rng.uniform(1.2, 1.6), rng.choice([0, 0.08])
    back = -0.5 * reach
    legs = [
        *pair(bar([half, 0.04, back - 0.4], [half, top + 0.02, back - 0.08], 0.035)),
        *pair(bar([half, 0.04, back + 0.14], [half, top - 0.05, back + 0.06], 0.035)),
    ]
    steps = [
        bar([-half, y * top, back - 0.4 + 0.32 * y], [half, y * top, back - 0.4 + 0.32 * y], 0.03, 6)
        for y in np.linspace(0.14, 0.9, 6)
    ]
    steps.append(block([0, top - 0.06, back], [2 * half, 0.07, 0.24], 0.2))
    hoop = [
        [half, top, back - 0.12],
        [half, top + 0.3, back - 0.06],
        [half, top + 0.3, back + 0.1],
        [half, top, back + 0.16],
    ]
    return named(
        chute=_chute(top, reach, half, wave, back + 0.08),
        step=steps,
        leg=legs,
        rail=pair(limb(hoop, [0.028] * 4, segments=6, samples=1)),
    )


def playground(rng: Rng, traits: Traits) -> Part:
    """Draw a playground: a roofed platform with a slide in front, a ladder behind and a swing at its side."""
    leg = traits.draw(rng, "legs", (0.3, 0.4), (0.75, 0.9), (1.5, 1.8))
    half, side, rise = rng.uniform(0.3, 0.36), int(rng.choice([-1, 1])), rng.uniform(0.25, 0.4)
    top, beam = leg + 0.75, leg + 0.6
    legs = posts(half, half, 0, top, 0.045, square=True)
    rails = [turned(block([0, leg + 0.12, half], [2 * half, 0.22, 0.05], 0.1), turn, "y") for turn in (90 * -side,)]
    out = half + 0.95
    frame = [bar([side * half, beam, 0], [side * out, beam, 0], 0.045)]
    legs += [bar([side * (out + 0.02), 0.04, z], [side * out, beam, 0], 0.04) for z in (0.35, -0.35)]
    x = side * (half + 0.5)
    ropes = [bar([x + s * 0.16, 0.35, 0], [x + s * 0.16, beam, 0], 0.018, 6) for s in (1, -1)]
    ladder = [
        bar([-0.2, y, -half - 0.18 * (1 - y / leg)], [0.2, y, -half - 0.18 * (1 - y / leg)], 0.026, 6)
        for y in np.linspace(0.15, 0.85, 4) * leg
    ]
    ladder += pair(bar([0.2, 0.04, -half - 0.2], [0.2, leg + 0.2, -half], 0.03, 6))
    return named(top=block([0, leg - 0.04, 0], [2 * half + 0.1, 0.08, 2 * half + 0.1], 0.1), roof=roof_of(str(rng.choice(["hip", "front", "side"])), 2 * half, 2 * half, rise, top, 0.1),
                 leg=legs, step=ladder, chute=_chute(leg, rng.uniform(1.0, 1.3), 0.2, 0.0, half - 0.04), frame=frame, rope=ropes, seat=block([x, 0.32, 0], [0.4, 0.06, 0.18], 0.2), rail=rails)  # fmt: skip


def window(rng: Rng, _: Traits) -> Part:
    """Draw a window: a frame with bars across its panes over a sill, arched or not, with shutters or without."""
    wide, tall, kind = rng.uniform(0.4, 0.6), rng.uniform(1.1, 1.5), int(rng.integers(3))
    columns, rows = int(rng.integers(1, 3)) * 2, int(rng.integers(2, 4))
    sill = [block([0, -0.08, 0.06], [2 * wide + 0.26, 0.1, 0.3], 0.2)]
    if kind == 0:
        rise = wide * rng.uniform(0.6, 1.0)
        turn = np.linspace(0, np.pi, 13)
        path = [
            (wide, 0),
            (wide, 0.5 * (tall - rise)),
            *((wide * np.cos(t), tall - rise + rise * np.sin(t)) for t in turn),
            (-wide, 0.5 * (tall - rise)),
            (-wide, 0),
        ]
        frame = [limb(np.c_[path, np.zeros(len(path))], [[0.07, 0.08]] * len(path), segments=8, samples=1)]
        pane, high = arched(2 * wide, tall, rise, 0.05), tall - rise
        frame += [
            bar([0, 0, 0], [0, tall - 0.02, 0], 0.035),
            *(bar([-wide, y, 0], [wide, y, 0], 0.035) for y in high * (np.arange(rows) + 1) / rows),
        ]
    else:
        frame = [
            *pair(block([wide, 0, 0], [0.12, tall, 0.16], 0.15)),
            block([0, -0.01, 0], [2 * wide, 0.1, 0.15], 0.15),
            block([0, tall - 0.05, 0], [2 * wide + 0.16, 0.12, 0.18], 0.15),
        ]
        frame += [block([x, 0, 0], [0.05, tall, 0.1], 0.15) for x in spread(wide * (1 - 2 / columns), columns - 1)]
        frame += [block([0, y * tall, 0], [2 * wide, 0.05, 0.09], 0.15) for y in (np.arange(rows - 1) + 1) / rows]
        pane = block([0, 0, 0], [2 * wide, tall, 0.04], 0.2, 4)
    if kind != 2:
        return named(frame=frame, panel=pane, base=sill)
    shutter = [block([1.55 * wide + 0.07, 0.02, 0.02], [0.95 * wide, tall - 0.06, 0.07], 0.15)]
    shutter += [
        block([1.55 * wide + 0.07, y * tall, 0.06], [0.75 * wide, 0.05, 0.07], 0.2) for y in np.linspace(0.1, 0.86, 7)
    ]
    return named(frame=frame, panel=pane, base=sill, flap=[side for part in shutter for side in pair(part)])


def double_door(rng: Rng, _: Traits) -> Part:
    """Draw a double door: two panelled leaves with handles in a frame, under an arch or a lintel."""
    wide, tall, arch = rng.uniform(0.5, 0.62), rng.uniform(1.3, 1.55), rng.random() < 0.4
    frame = [
        *pair(block([wide + 0.07, 0, 0], [0.17, tall, 0.3], 0.12)),
        block([0, tall - 0.01, 0], [2 * wide + 0.4, 0.16, 0.34], 0.12),
    ]
    frame += [moved(arched(2 * wide + 0.3, 0.4, 0.4, 0.2), [0, tall + 0.12, 0])] if arch else []
    leaf = [block([wide / 2 + 0.005, 0, 0], [wide - 0.01, tall, 0.14], 0.05, 3)]
    panels = [
        block([wide / 2, y * tall, s * 0.06], [0.6 * wide, h * tall, 0.08], 0.3)
        for y, h in ((0.08, 0.32), (0.5, 0.42))
        for s in (1, -1)
    ]
    knobs = [bar([0.09, 0.38 * tall, 0.13], [0.09, 0.58 * tall, 0.13], 0.035)]
    return named(
        frame=frame, body=pair(leaf[0]), panel=[side for part in panels for side in pair(part)], knob=pair(knobs[0])
    )


def plain_door(rng: Rng, _: Traits) -> Part:
    """Draw a door leaf without a frame: flat or with raised panels or panes, hinges at one side, a lever."""
    wide, tall, rows = rng.uniform(0.75, 0.95), rng.uniform(1.6, 1.9), int(rng.integers(1, 4))
    panels = [
        block([x, (k + 0.16) * tall / rows, s * 0.07], [0.34 * wide, 0.7 * tall / rows, 0.07], 0.3)
        for k in range(rows)
        for x in (-0.22 * wide, 0.22 * wide)
        for s in (1, -1)
    ]
    lever = [
        bar([0.42 * wide, 0.48 * tall, -0.16], [0.42 * wide, 0.48 * tall, 0.16], 0.035),
        *(bar([0.42 * wide, 0.48 * tall, z], [0.26 * wide, 0.48 * tall, z], 0.03) for z in (-0.16, 0.16)),
    ]
    hinges = [block([-wide / 2, y * tall, 0], [0.08, 0.12, 0.18], 0.2) for y in (0.1, 0.84)]
    return named(body=block([0, 0, 0], [wide, tall, 0.13], 0.1, 4), panel=panels, knob=lever, band=hinges)


KINDS = {"gate": (torii,), "stairs": (spiral_stairs,), "door": (double_door, plain_door)}
