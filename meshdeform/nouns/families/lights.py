"""Draw lamps and other things of rooms that stand alone or hang: clocks, fans, mirrors, bins; other kinds of lamps."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, roundel
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    curved,
    disc,
    ellipsoid,
    extrude,
    lathe,
    limb,
    moved,
    named,
    pair,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import hat

__all__ = ["candlestick", "chandelier", "clock", "fan", "lantern", "mirror", "trashcan"]


def _ring(centre: Array, radius: float, thick: float, axis: str = "z", tall: float = 1.0) -> Part:
    """Return a ring about a point whose hole looks along an axis."""
    turn = np.linspace(0, 2 * np.pi, 21)
    flat = limb(
        np.stack([radius * np.sin(turn), tall * radius * np.cos(turn), 0 * turn], 1),
        [thick] * 21,
        segments=8,
        samples=1,
    )
    return moved({"z": flat, "y": turned(flat, 90, "x"), "x": turned(flat, 90, "y")}[axis], centre)


def _candle(base: Array, tall: float, thick: float = 0.06) -> tuple[Part, Part]:
    """Return a candle that stands on a point, and its flame."""
    stick = moved(lathe([(thick, 0), (thick, tall - 0.02), (0.6 * thick, tall)], segments=10), base)
    flame = [(0.01, tall - 0.01), (0.6 * thick, tall + 0.05), (0.5 * thick, tall + 0.1), (0.01, tall + 0.2)]
    return stick, moved(lathe(flame, segments=8), base)


def candlestick(rng: Rng, traits: Traits) -> Part:
    """Draw a candlestick: a foot and a knobbed stem with a dish and a candle, or with two or four more on arms."""
    stem, foot, arms = (
        traits.draw(rng, "stem", (0.12, 0.2), (0.6, 0.85), (1.6, 1.9)),
        rng.uniform(0.26, 0.36),
        int(rng.choice([0, 2, 2, 4])),
    )
    top, thick = stem + 0.1, rng.uniform(0.04, 0.06)
    base = lathe([(foot, 0), (foot, 0.05), (0.6 * foot, 0.09), (1.4 * thick, 0.13)], segments=20)
    swell = np.tile([1.0, 2.0, 1.1], 3)[: int(rng.choice([5, 8]))]
    rod = lathe(
        [
            (thick * s, 0.1 + (stem + 0.02) * t)
            for s, t in zip([*swell, 1.6], np.linspace(0, 1, len(swell) + 1), strict=True)
        ],
        segments=14,
    )
    dish = lathe(
        [(1.2 * thick, top - 0.04), (0.15, top), (0.16, top + 0.03), (0.08, top + 0.03), (0.09, top + 0.1)], segments=16
    )
    branch = curved([[0, 0.75 * top, 0], [0, 0.62 * top, 0.2], [0, 0.72 * top, 0.38], [0, top - 0.02, 0.4]], samples=3)
    out = around(limb(branch, [0.035] * len(branch), segments=8, samples=1), arms, 90)
    places = [
        np.array([0, top, 0]),
        *(
            0.4 * np.array([np.sin(a), 0, np.cos(a)]) + [0, top, 0]
            for a in np.pi / 2 + 2 * np.pi * np.arange(arms) / max(arms, 1)
        ),
    ]
    candles = [_candle(place + [0, 0.05, 0], 0.38) for place in places]
    dishes = [moved(dish, place - [0, top, 0]) for place in places]
    solids = {
        "base": [base],
        "stem": [rod],
        "dish": dishes,
        "candle": [c for c, _ in candles],
        "flame": [f for _, f in candles],
    }
    return named(**solids, **({"arm": out} if arms else {}))


def chandelier(rng: Rng, traits: Traits) -> Part:
    """Draw a chandelier: five to eight curved arms from a turned middle with candles at their ends, on a chain."""
    arms, tall = int(rng.integers(5, 9)), rng.uniform(0.55, 0.75)
    reach = traits.draw(rng, "arms", (0.2, 0.28), (0.55, 0.7), (1.15, 1.35))
    body = lathe(
        [(0.02, -0.12), (0.1, -0.06), (0.05, 0.02), (0.16, 0.12), (0.06, 0.24), (0.1, 0.34), (0.04, tall)], segments=16
    )
    bow = curved([[0, 0.12, 0.05], [0, -0.04, 0.45 * reach], [0, 0.02, 0.85 * reach], [0, 0.2, reach]], samples=2)
    branch = around(limb(bow, [0.035] * len(bow), segments=5, samples=1), arms)
    cup = lathe([(0.03, 0.17), (0.1, 0.2), (0.1, 0.23), (0.05, 0.24)], segments=10)
    candle, flame = _candle(np.array([0, 0.22, reach]), 0.2, 0.045)
    chain = [
        _ring(np.array([0, tall + 0.06 + 0.1 * k, 0]), 0.05, 0.018, "zx"[k % 2]) for k in range(int(rng.integers(2, 5)))
    ]
    chain = [
        *chain,
        disc(0.14, float(chain[-1].verts[:, 1].max()) - 0.01, float(chain[-1].verts[:, 1].max()) + 0.05, edge=0.015),
    ]
    return named(
        body=body,
        arm=[*branch, *around(moved(cup, [0, 0, reach]), arms)],
        candle=around(candle, arms),
        flame=around(flame, arms),
        chain=chain,
    )


def _hands(middle: Array, size: float, rng: Rng) -> list[Part]:
    """Return the two hands of a clock at a random time."""
    ways = rng.uniform(0, 2 * np.pi, 2)
    return [
        bar(middle, middle + long * size * np.array([np.sin(a), np.cos(a), 0]), thick, 6)
        for a, long, thick in zip(ways, (0.52, 0.8), (0.03, 0.022), strict=True)
    ]


def _face(middle: Array, size: float, rng: Rng) -> dict[str, list[Part]]:
    """Return the face of a clock, its twelve marks and its hands."""
    mark = block([0, 0.76 * size, 0], [0.05 * size, 0.16 * size, 0.04], 0.1)
    marks = [turned(mark, 30 * k, "z") for k in range(12)]
    return {
        "face": [roundel(middle, size, 0.06, segments=28)],
        "line": [moved(mark, middle + [0, 0, 0.035]) for mark in marks],
        "hand": _hands(middle + [0, 0, 0.06], size, rng),
    }


def clock(rng: Rng, _: Traits) -> Part:
    """Draw a wall clock: a round or a square rim around a face with twelve marks and two hands."""
    size, middle = rng.uniform(0.7, 0.9), np.array([0, 0.0, 0.06])
    if rng.random() < 0.6:
        body = [
            turned(
                lathe(
                    [(size, -0.06), (size + 0.12, 0.0), (size + 0.1, 0.14), (size, 0.12), (size - 0.02, 0.02)],
                    segments=32,
                ),
                90,
                "x",
            )
        ]
    else:
        body = [
            block([0, -size - 0.1, 0], [2 * size + 0.2, 2 * size + 0.2, 0.14], 0.2, 4),
            *(turned(block([0, size + 0.02, 0.08], [2 * size + 0.2, 0.1, 0.1], 0.2), 90 * k, "z") for k in range(4)),
        ]
    return named(body=body, **_face(middle, size, rng))


def grandfather_clock(rng: Rng, _: Traits) -> Part:
    """Draw a long-case clock: a narrow tall case with a pendulum behind a door, a wider head with the face, a foot."""
    half, tall = rng.uniform(0.22, 0.27), rng.uniform(1.0, 1.3)
    head, level = half + 0.07, 0.3 + tall
    body = [
        block([0, 0, 0], [2 * half + 0.16, 0.3, 0.42], 0.06, 3),
        block([0, 0.28, 0], [2 * half, tall + 0.04, 0.32], 0.04, 3),
        block([0, level, 0], [2 * head, 2 * head, 0.38], 0.05, 3),
        block([0, level + 2 * head - 0.02, 0], [2 * head + 0.1, 0.07, 0.46], 0.2),
    ]
    peak = rng.random() < 0.5
    top = extrude(
        [(-head, 0), (head, 0), (0, 0.55 * head)]
        if peak
        else [(head * np.cos(t), 0.6 * head * np.sin(t)) for t in np.linspace(0, np.pi, 13)],
        0.3,
    )
    body.append(moved(top, [0, level + 2 * head + 0.04, 0]))
    swing = [
        bar([0, 0.5 + 0.15 * tall, 0.19], [0, level - 0.1, 0.19], 0.02, 6),
        roundel([0, 0.45 + 0.15 * tall, 0.19], 0.1, 0.06),
    ]
    door = [
        *pair(block([half - 0.05, 0.34, 0.16], [0.06, tall - 0.08, 0.05], 0.1)),
        *(block([0, y, 0.16], [2 * half - 0.04, 0.06, 0.05], 0.1) for y in (0.34, 0.2 + tall)),
    ]
    return named(body=body, weight=swing, door=door, **_face(np.array([0, level + head, 0.2]), 0.8 * head, rng))


def alarm_clock(rng: Rng, _: Traits) -> Part:
    """Draw an alarm clock: a thick round case on two feet with two bells and a hammer on top."""
    size, deep = rng.uniform(0.5, 0.58), rng.uniform(0.3, 0.42)
    case = [roundel([0, size, 0], size, deep, segments=28), _ring(np.array([0, size, deep / 2]), size - 0.03, 0.05)]
    feet = pair(bar([0.55 * size, 0.3 * size, 0], [0.85 * size, -0.12, 0], 0.055))
    bells = [
        side
        for part in (turned(lathe([(0.24, 0), (0.22, 0.1), (0.12, 0.18), (0.02, 0.2)], segments=16), -32, "z"),)
        for side in pair(moved(part, [0.52 * size, 1.86 * size, 0]))
    ]
    crest = [bar([0, 1.9 * size, 0], [0, 2.3 * size, 0], 0.03, 6), block([0, 2.25 * size, 0], [0.16, 0.1, 0.1], 0.2)]
    return named(body=case, leg=feet, cap=bells, handle=crest, **_face(np.array([0, size, deep / 2]), 0.88 * size, rng))


def fan(rng: Rng, traits: Traits) -> Part:
    """Draw a fan: broad blades about a hub between two round guards of wire, a motor behind, on a stem with a foot."""
    blade = traits.draw(rng, "blade", (0.14, 0.2), (0.42, 0.52), (0.95, 1.1))
    stem = traits.draw(rng, "stem", (0.1, 0.16), (0.35, 0.9), (1.7, 2.0))
    count, size = int(rng.integers(3, 6)), blade + 0.1
    level = stem + size
    leaf = extrude(
        [(-0.05, 0.08), (0.05, 0.08), (0.5 * blade, 0.75 * blade), (0.2 * blade, blade), (-0.2 * blade, 0.95 * blade)],
        0.05,
    )
    blades = [moved(turned(turned(leaf, 20, "y"), 360 * k / count, "z"), [0, level, 0.1]) for k in range(count)]
    guards = [
        _ring(np.array([0, level, z]), size * r, 0.022)
        for z, r in ((0.1, 1.06), (0.2, 0.75), (0.22, 0.35), (0.02, 0.7))
    ]
    wire = limb(
        [[0, 0.08, 0.23], [0, 0.7 * size, 0.21], [0, 1.06 * size, 0.1], [0, 0.3 * size, -0.02]],
        [0.014] * 4,
        segments=4,
        samples=1,
    )
    guards += [moved(turned(wire, 36 * k, "z"), [0, level, 0]) for k in range(10)]
    motor = [
        turned(lathe([(0.1, -0.26), (0.13, -0.2), (0.13, -0.05), (0.07, 0.0), (0.07, 0.14)], segments=16), 90, "x")
    ]
    base = lathe([(0.36, 0), (0.36, 0.04), (0.12, 0.09), (0.05, 0.12)], segments=24)
    return named(
        base=base,
        stem=bar([0, 0.08, -0.12], [0, level - 0.04, -0.12], 0.045, 12),
        body=[moved(part, [0, level, 0]) for part in motor],
        blade=blades,
        guard=guards,
    )


def ceiling_fan(rng: Rng, traits: Traits) -> Part:
    """Draw a ceiling fan: three to five long flat blades about a motor that hangs on a rod, with a lamp or without."""
    blade = traits.draw(rng, "blade", (0.3, 0.38), (0.8, 1.0), (1.7, 2.0))
    stem = traits.draw(rng, "stem", (0.05, 0.08), (0.25, 0.4), (1.0, 1.2))
    count = int(rng.integers(3, 6))
    wide = rng.uniform(0.11, 0.15)
    leaf = block([0, 0, 0.14 + blade / 2], [2 * wide, 0.035, blade], 0.2, 3)
    arms = [bar([0, 0, 0.05], [0, 0.01, 0.2], 0.035, 6)]
    body = [lathe([(0.06, -0.16), (0.2, -0.1), (0.22, 0.0), (0.16, 0.08), (0.05, 0.12)], segments=20)]
    if rng.random() < 0.6:
        body.append(ellipsoid([0, -0.18, 0], [0.15, 0.12, 0.15], rings=8))
    rod = [bar([0, 0.1, 0], [0, 0.1 + stem, 0], 0.03), disc(0.12, 0.08 + stem, 0.16 + stem, edge=0.02)]
    return named(stem=rod, body=[*body, *around(arms[0], count)], blade=around(leaf, count))


def lantern(rng: Rng, traits: Traits) -> Part:
    """Draw a lantern: glass with a candle between four or six bars, a foot, a cap with a chimney, a bow to carry it."""
    sides, radius, tall = int(rng.choice([4, 6, 20])), rng.uniform(0.34, 0.42), rng.uniform(0.6, 0.8)
    bow = traits.draw(rng, "handle", (0.05, 0.09), (0.26, 0.36), (0.75, 0.95))
    scale = np.array([np.sqrt(2) if sides == 4 else 1, 1])
    spin = 45 if sides == 4 else 0
    base = turned(
        lathe(np.array([(1.15 * radius, 0), (1.15 * radius, 0.07), (radius, 0.11)]) * scale, segments=sides), spin, "y"
    )
    rise = rng.uniform(0.2, 0.34)
    roof = hat(radius + 0.1, rise, 0.1 + tall, sides, bow=0.3)
    edge = 0.94 * radius * scale[0]
    bars = around(bar([0, 0.08, edge], [0, 0.12 + tall, edge], 0.032, 6), sides if sides < 20 else 4, spin)
    candle, flame = _candle(np.array([0, 0.1, 0]), 0.4 * tall, 0.1)
    level = 0.1 + tall + rise
    turn = np.linspace(-1.75, 1.75, 11)
    hoop = limb(
        np.stack([0.7 * bow * np.sin(turn), level - 0.04 + bow * (np.cos(turn) + 0.35), 0 * turn], 1),
        [0.026] * 11,
        segments=8,
        samples=1,
    )
    knob = disc(0.1, level - 0.1, level - 0.02, edge=0.02)
    return named(base=base, pole=bars, lamp=[candle, flame], cap=[roof, knob], handle=hoop)


def mirror(rng: Rng, traits: Traits) -> Part:
    """Draw a standing mirror: a tall oval, square or arched glass in a frame that swings between two posts with feet."""
    leg = traits.draw(rng, "legs", (0.05, 0.09), (0.24, 0.34), (0.85, 1.0))
    wide, tall, kind = rng.uniform(0.34, 0.42), rng.uniform(0.65, 0.8), int(rng.integers(3))
    level = leg + tall
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    x, y = [
        np.sign(v) * np.abs(v) ** p * s
        for v, p, s in ((np.sin(turn), (1, 0.25, 0.5)[kind], wide), (np.cos(turn), (1, 0.25, 0.5)[kind], tall))
    ]
    frame = limb(np.stack([*(np.r_[v, v[:1]] for v in (x, y)), np.zeros(33)], 1), [0.055] * 33, segments=8, samples=1)
    glass = extrude(np.stack([x, y], 1)[::-1], 0.04)
    lean = -rng.uniform(4, 12)
    side = wide + 0.12
    stand = [
        *pair(bar([side, 0.05, 0], [side, level + 0.18, 0], 0.04)),
        bar([-side, 0.6 * leg, 0], [side, 0.6 * leg, 0], 0.035),
    ]
    stand += [
        part
        for z in (0.32, -0.32)
        for part in pair(
            limb([[side, 0.18, 0], [side, 0.12, 0.5 * z], [side, 0.04, z]], [0.045, 0.04, 0.035], segments=8)
        )
    ]
    knobs = [
        *pair(bar([wide - 0.02, level, 0], [side + 0.08, level, 0], 0.035)),
        *pair(ellipsoid([side, level + 0.2, 0], 0.06, rings=6)),
    ]
    return named(
        frame=moved(turned(frame, lean, "x"), [0, level, 0]),
        screen=moved(turned(glass, lean, "x"), [0, level, 0]),
        leg=stand,
        knob=knobs,
    )


def table_mirror(rng: Rng, traits: Traits) -> Part:
    """Draw a mirror for a table, round on a stem with a foot, or a hand mirror with a grip in place of it."""
    leg = traits.draw(rng, "legs", (0.08, 0.12), (0.3, 0.5), (1.0, 1.2))
    size, oval, foot = rng.uniform(0.42, 0.52), rng.uniform(1.0, 1.3), rng.random() < 0.6
    level = leg + 0.06 + oval * size
    frame = [
        _ring(np.array([0, level, 0]), size, 0.06, tall=oval),
        moved(stretched(roundel([0, 0, 0], size, 0.06), 1, oval, 1), [0, level, -0.03]),
    ]
    glass = moved(stretched(roundel([0, 0, 0], 0.93 * size, 0.05), 1, oval, 1), [0, level, 0.0])
    post = bar([0, 0.06, 0], [0, leg + 0.08, 0], 0.05, 12)
    stand = [
        post,
        lathe([(0.32, 0), (0.3, 0.05), (0.08, 0.1)], segments=20)
        if foot
        else ellipsoid([0, 0.08, 0], [0.075, 0.1, 0.06], rings=6),
    ]
    return named(
        frame=frame, screen=glass, leg=stand, knob=ellipsoid([0, level + oval * size + 0.06, 0], 0.07, rings=6)
    )


def trashcan(rng: Rng, _: Traits) -> Part:
    """Draw a dustbin: a ribbed tapering can with a handle at each side and a domed lid, shut or ajar."""
    low, high, tall = rng.uniform(0.36, 0.42), rng.uniform(0.44, 0.5), rng.uniform(0.95, 1.2)
    ribs = np.abs(np.sin(np.linspace(0, 16 * np.pi, 97)[:-1])) if rng.random() < 0.6 else np.zeros(96)
    can = vessel(
        [
            (low, 0),
            (low, 0.06),
            (low + 0.1 * (high - low), 0.1),
            (0.94 * high, 0.9 * tall),
            (high, tall - 0.04),
            (high, tall),
        ],
        0.05,
        0.1,
        segments=32,
    )
    angle = np.arctan2(can.verts[:, 0], can.verts[:, 2]) % (2 * np.pi)
    dent = 1 - 0.05 * ribs[(angle / (2 * np.pi) * 96).astype(int) % 96] * (
        (can.verts[:, 1] > 0.08) & (can.verts[:, 1] < 0.95 * tall)
    )
    can = Part(can.verts * np.stack([dent, np.ones_like(dent), dent], 1), can.faces)
    hoops = [
        lathe([(r, y - 0.03), (r + 0.04, y - 0.02), (r + 0.04, y + 0.02), (r, y + 0.03)], segments=24)
        for r, y in ((0.5 * (low + high) - 0.02, 0.5 * tall), (0.9 * high, 0.84 * tall))
    ]
    grip = pair(
        limb(
            [
                [0.94 * high, 0.8 * tall, 0.1],
                [high + 0.1, 0.76 * tall, 0.08],
                [high + 0.1, 0.76 * tall, -0.08],
                [0.94 * high, 0.8 * tall, -0.1],
            ],
            [0.03] * 4,
            segments=6,
        )
    )
    if rng.random() < 0.2:
        return named(body=can, handle=grip, hoop=hoops)
    lid = [
        lathe([(high + 0.05, -0.06), (high + 0.06, 0.03), (0.75 * high, 0.12), (0.3 * high, 0.17)], segments=24),
        limb([[-0.12, 0.13, 0], [-0.1, 0.26, 0], [0.1, 0.26, 0], [0.12, 0.13, 0]], [0.03] * 4, segments=8),
    ]
    tilt = rng.choice([0.0, 0.0, rng.uniform(10, 18)])
    return named(
        body=can,
        handle=grip,
        hoop=hoops,
        lid=[moved(turned(part, tilt, "z"), [0, tall + 0.02 + 0.008 * tilt, 0]) for part in lid],
    )


def wheelie_bin(rng: Rng, _: Traits) -> Part:
    """Draw a bin on two wheels: a deep square body that widens upward, a lid with a bar behind it."""
    half, tall, deep = rng.uniform(0.32, 0.38), rng.uniform(1.0, 1.25), rng.uniform(0.36, 0.44)
    shell = block([0, 0.06, 0], [2, tall, 2], 0.03, 4)
    wide = 0.78 + 0.22 * (shell.verts[:, 1] - 0.06) / tall
    body = Part(
        np.stack([shell.verts[:, 0] * half * wide, shell.verts[:, 1], shell.verts[:, 2] * deep * wide], 1), shell.faces
    )
    lid = turned(block([0, 0, 0.02], [2 * half + 0.1, 0.1, 2 * deep + 0.12], 0.3, 4), rng.uniform(-6, 0), "x")
    wheels = pair(roundel([half * 0.9, 0.13, -0.72 * deep], 0.14, 0.1, "x"))
    grip = [
        bar([-half, tall + 0.03, -deep - 0.12], [half, tall + 0.03, -deep - 0.12], 0.035),
        *pair(bar([half - 0.06, tall + 0.02, -deep], [half - 0.06, tall + 0.03, -deep - 0.12], 0.03, 6)),
    ]
    rim = block([0, tall - 0.04, 0], [2 * half + 0.08, 0.09, 2 * deep + 0.08], 0.2)
    return named(body=[body, rim], lid=moved(lid, [0, tall + 0.05, 0]), wheel=wheels, handle=grip)


_STEM, _SHADE = ((0.3, 0.4), (0.8, 1.0), (1.7, 2.0)), ((0.16, 0.19), (0.3, 0.36), (0.58, 0.68))


def floor_lamp(rng: Rng, traits: Traits) -> Part:
    """Draw a floor lamp: a shade on a tall thin pole with a foot, or on three legs."""
    stem, shade = traits.draw(rng, "stem", *_STEM) + 0.4, traits.draw(rng, "shade", *_SHADE)
    tripod, slope, tall = rng.random() < 0.4, rng.uniform(0.55, 0.95), 1.1 * shade
    pole = [bar([0, 0.5 * stem if tripod else 0.05, 0], [0, stem + 0.5 * tall, 0], 0.03)]
    if tripod:
        pole += around(bar([0, 0.04, 0.34], [0, 0.92 * stem, 0.03], 0.035), 3)
    base = (
        lathe([(0.26, 0), (0.26, 0.04), (0.08, 0.07), (0.04, 0.1)], segments=20)
        if not tripod
        else disc(0.09, 0.88 * stem, 0.96 * stem, edge=0.02)
    )
    cover = vessel(
        [(0.3 * shade, stem), (shade, stem), (shade, stem + 0.03), (shade * slope, stem + tall)],
        0.03,
        stem + 0.5 * tall,
        segments=24,
    )
    return named(base=base, stem=pole, shade=cover)


def desk_lamp(rng: Rng, traits: Traits) -> Part:
    """Draw a desk lamp: a heavy foot, two arms with a joint, a cone-shaped or bell-shaped shade that looks ahead."""
    stem, shade = traits.draw(rng, "stem", (0.25, 0.34), (0.7, 0.9), (1.5, 1.8)), traits.draw(rng, "shade", *_SHADE)
    knee, lift = np.array([0, 0.1 + 0.55 * stem, -0.36 * stem]), rng.uniform(0.3, 0.7)
    tip = knee + stem * np.array([0, 0.55 * lift, 0.8])
    thick = 0.035
    arms = [
        bar([0, 0.08, -0.05], knee, thick),
        bar(knee, tip, thick),
        roundel(knee, 0.07, 0.12, "x", segments=12),
        roundel([0, 0.1, -0.05], 0.07, 0.12, "x", segments=12),
    ]
    bell = [
        (0.08, 0.1),
        (0.12, -0.05),
        (0.5 * shade + 0.05, -0.25 * shade),
        (shade, -shade),
        (0.9 * shade, -0.98 * shade),
        (0.1, -0.3 * shade),
    ]
    cover = moved(turned(lathe(bell[::-1], segments=24), -rng.uniform(20, 45), "x"), tip)
    return named(base=[disc(0.3, 0, 0.08, edge=0.03)], stem=arms, shade=cover)


def hanging_lamp(rng: Rng, traits: Traits) -> Part:
    """Draw a hanging lamp: a bell, a cone, a ball or a drum on a cord under a cap."""
    stem, shade, kind = (
        0.6 * traits.draw(rng, "stem", *_STEM),
        1.3 * traits.draw(rng, "shade", *_SHADE),
        int(rng.integers(4)),
    )
    turn = np.linspace(0, np.pi, 13)
    outlines = ([(shade, -0.9 * shade), (0.95 * shade, -0.5 * shade), (0.6 * shade, -0.1 * shade), (0.15, 0.05)], [(1.1 * shade, -0.7 * shade), (0.16, 0)],
                [(shade * np.sin(t) + 0.001, -shade * (1 + np.cos(t))) for t in turn], [(shade, -0.8 * shade), (shade, 0)])  # fmt: skip
    cover = lathe([*([(0.8 * shade, -0.6 * shade)] if kind in (0, 1, 3) else []), *outlines[kind]], segments=24)
    bulb = [ellipsoid([0, -0.75 * shade, 0], 0.3 * shade, rings=8)] if kind in (0, 1) else []
    return named(
        stem=[
            bar([0, 0, 0], [0, stem, 0], 0.025),
            disc(0.12, stem - 0.02, stem + 0.07, edge=0.02),
            disc(0.09, -0.02, 0.12, edge=0.02),
        ],
        shade=[cover, *bulb],
    )


def globe_lamp(rng: Rng, traits: Traits) -> Part:
    """Draw a table lamp with a round body below its shade, or with a ball of glass on its foot."""
    stem, shade, ball = (
        0.6 * traits.draw(rng, "stem", *_STEM),
        1.2 * traits.draw(rng, "shade", *_SHADE),
        rng.random() < 0.4,
    )
    body = lathe(
        [
            (0.2, 0),
            (0.2, 0.04),
            (0.12, 0.06),
            (0.24, 0.08 + 0.25 * stem),
            (0.26, 0.08 + 0.45 * stem),
            (0.1, 0.08 + 0.85 * stem),
            (0.05, 0.1 + stem),
        ],
        segments=20,
    )
    slim = lathe([(0.26, 0), (0.26, 0.05), (0.06, 0.09), (0.05, 0.1 + stem)], segments=20)
    level = 0.1 + stem
    cover = (
        ellipsoid([0, level + 0.85 * shade, 0], shade)
        if ball
        else vessel(
            [(0.3 * shade, level), (shade, level), (shade, level + 0.03), (0.65 * shade, level + 0.9 * shade)],
            0.03,
            level + 0.45 * shade,
            segments=24,
        )
    )
    return named(
        base=lathe([(0.24, 0), (0.24, 0.05), (0.1, 0.08)], segments=20), stem=slim if ball else body, shade=cover
    )


KINDS = {
    "clock": (grandfather_clock, alarm_clock),
    "fan": (ceiling_fan,),
    "lamp": (floor_lamp, desk_lamp, hanging_lamp, globe_lamp),
    "mirror": (table_mirror,),
    "trashcan": (wheelie_bin,),
}
