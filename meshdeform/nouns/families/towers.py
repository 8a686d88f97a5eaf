"""Draw towers and other tall buildings, and other kinds of those that exist: lighthouses, windmills, castles."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, posts, roundel
from meshdeform.nouns.families.buildings import arch
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    disc,
    ellipsoid,
    lathe,
    named,
    pair,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import hat, merlons, roof_of, shaft

__all__ = ["clock_tower", "silo", "tower", "water_tower"]

_ROOF = ((0.1, 0.16), (0.42, 0.6), (1.05, 1.3))


def tower(rng: Rng, traits: Traits) -> Part:
    """Draw a tower: a round, square or eight-sided shaft with a wider top storey under a pointed roof, slits, a door."""
    sides, radius, tall = int(rng.choice([20, 4, 8])), rng.uniform(0.3, 0.38), rng.uniform(1.2, 1.7)
    rise = traits.draw(rng, "roof", *_ROOF)
    wide = radius * rng.uniform(1.12, 1.3)
    upper = 0.34
    level = tall + upper
    body = [
        shaft(radius, tall + 0.02, 0, sides),
        shaft(wide, level, tall, sides, foot=1),
        shaft(wide + 0.04, tall + 0.06, tall - 0.05, sides, foot=0.9),
    ]
    face = wide * (1 if sides != 8 else 0.95)
    slits = around(arch(0.12, 0.2, 0.1, [0, tall + 0.08, face]), 4)
    slits += [
        turned(arch(0.1, 0.2, 0.12, [0, share * tall, radius * (1.1 - 0.1 * share)]), 90 * k, "y")
        for k, share in enumerate((0.62, 0.4, 0.55, 0.3))
    ]
    roof = hat(wide + 0.08, rise, level, sides, bow=float(rng.choice([0, 0.2])))
    door = arch(0.26, 0.4, 0.14, [0, 0, 1.08 * radius])
    return named(body=body, roof=[roof, ellipsoid([0, level + rise, 0], 0.05, rings=6)], window=slits, door=door)


def battlement_tower(rng: Rng, _: Traits) -> Part:
    """Draw a tower of a castle: a round or square shaft that widens to battlements, slits, an arched door."""
    sides, radius, tall = int(rng.choice([20, 4])), rng.uniform(0.34, 0.42), rng.uniform(1.1, 1.6)
    wide = radius * rng.uniform(1.12, 1.25)
    body = [
        shaft(radius, tall + 0.02, 0, sides),
        shaft(wide, tall + 0.22, tall, sides, foot=1),
        shaft(wide, tall + 0.02, tall - 0.1, sides, foot=0.86),
    ]
    slits = [
        turned(arch(0.1, 0.22, 0.12, [0, share * tall, 1.04 * radius]), 90 * k, "y")
        for k, share in enumerate((0.66, 0.4, 0.55, 0.6))
    ]
    return named(
        body=body,
        top=merlons(0.93 * wide, tall + 0.2, 8, sides),
        window=slits,
        door=arch(0.28, 0.42, 0.14, [0, 0, 1.08 * radius]),
    )


def watchtower(rng: Rng, traits: Traits) -> Part:
    """Draw a watchtower: a railed platform under a roof on four leaning legs with crossed braces and a ladder."""
    half, tall, spread_ = rng.uniform(0.36, 0.44), rng.uniform(1.0, 1.4), rng.uniform(0.1, 0.2)
    rise = traits.draw(rng, "roof", (0.06, 0.1), (0.28, 0.4), (0.75, 0.95))
    legs = posts(half, half, 0, tall, 0.05, splay=spread_)
    braces = around(
        bar([-half - 0.8 * spread_, 0.2 * tall, half + 0.8 * spread_], [half, 0.9 * tall, half], 0.03, 6), 4
    )
    braces += around(
        bar([half + 0.8 * spread_, 0.2 * tall, half + 0.8 * spread_], [-half, 0.9 * tall, half], 0.03, 6), 4
    )
    floor = block([0, tall - 0.02, 0], [2 * half + 0.24, 0.08, 2 * half + 0.24], 0.1)
    walls = around(block([0, tall + 0.04, half + 0.06], [2 * half + 0.16, 0.26, 0.05], 0.1), 4)
    walls += posts(half + 0.05, half + 0.05, tall, tall + 0.6, 0.04, square=True)
    roof = roof_of("hip", 2 * half, 2 * half, rise, tall + 0.58, 0.22)
    out = half + spread_ + 0.06
    rungs = [
        bar([-0.12, y, out - y / tall * (spread_ - 0.06)], [0.12, y, out - y / tall * (spread_ - 0.06)], 0.022, 6)
        for y in np.linspace(0.1, tall - 0.05, 7)
    ]
    rails = pair(bar([0.12, 0.03, out], [0.12, tall, out - spread_ + 0.06], 0.028, 6))
    return named(body=[floor, *walls], leg=[*legs, *braces], roof=roof, step=[*rungs, *rails])


def clock_tower(rng: Rng, traits: Traits) -> Part:
    """Draw a clock tower: a square shaft with a clock on each side of a wider storey, under a pointed roof."""
    half, tall, upper = rng.uniform(0.26, 0.32), rng.uniform(1.3, 1.8), rng.uniform(0.55, 0.62)
    rise = traits.draw(rng, "roof", *_ROOF)
    wide = half + 0.06
    level = tall + upper
    body = [
        shaft(half, tall + 0.02, 0.1, 4, foot=1.05),
        block([0, tall, 0], [2 * wide, upper, 2 * wide], 0.04, 3),
        block([0, 0, 0], [2.7 * half, 0.14, 2.7 * half], 0.06),
    ]
    rims = [block([0, y, 0], [2 * wide + 0.1, 0.07, 2 * wide + 0.1], 0.1) for y in (tall - 0.03, level - 0.04)]
    middle = tall + upper / 2
    faces = around(roundel([0, middle, wide], 0.23, 0.08), 4)
    hands = around(bar([0, middle, wide + 0.05], [0, middle + 0.17, wide + 0.05], 0.018, 6), 4)
    hands += around(bar([0, middle, wide + 0.05], [0.1, middle - 0.05, wide + 0.05], 0.02, 6), 4)
    slits = [
        turned(arch(0.12, 0.26, 0.1, [0, share * tall, 1.03 * half]), 90 * k, "y")
        for share in (0.35, 0.65)
        for k in range(4)
    ]
    roof = [
        hat(wide + 0.08, rise, level, 4, bow=float(rng.choice([0, 0.3]))),
        *pair(bar([0, level + 0.9 * rise, 0], [0, level + rise + 0.16, 0], 0.022, 6))[:1],
    ]
    return named(
        body=[*body],
        roof=roof,
        face=faces,
        hand=hands,
        door=arch(0.24, 0.38, 0.12, [0, 0.1, 1.08 * half]),
        window=slits,
        top=rims,
    )


def silo(rng: Rng, traits: Traits) -> Part:
    """Draw a silo: a tall cylinder with hoops under a round or pointed roof, a ladder."""
    radius, tall, kind = rng.uniform(0.34, 0.44), rng.uniform(1.1, 1.5), rng.random()
    rise = traits.draw(rng, "roof", (0.04, 0.08), (0.28, 0.38), (0.8, 1.0))
    cap = hat(radius + 0.04, rise, tall, 24, bow=-0.5 if kind < 0.6 else 0.0)
    hoops = [
        lathe(
            [(radius, y - 0.03), (radius + 0.03, y - 0.02), (radius + 0.03, y + 0.02), (radius, y + 0.03)], segments=20
        )
        for y in np.linspace(0.12, 0.95, 5) * tall
    ]
    out = radius + 0.07
    ladder = [
        *pair(bar([0.09, 0.03, out], [0.09, tall, out], 0.02, 6)),
        *(bar([-0.09, y, out], [0.09, y, out], 0.016, 4) for y in np.linspace(0.1, tall - 0.1, 8)),
    ]
    one: dict[str, list[Part]] = {
        "body": [shaft(radius, tall, 0, 24, foot=1)],
        "roof": [cap, disc(0.07, tall + rise - 0.06, tall + rise + 0.05, edge=0.02)],
        "hoop": hoops,
        "step": ladder,
    }
    return named(**one)


def _turn(angle: float) -> Array:
    """Return the matrix that turns rows about +Y."""
    return np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])


def water_tower(rng: Rng, traits: Traits) -> Part:
    """Draw a water tower: a tank with hoops under a pointed or a round roof on four or six braced legs."""
    radius, deep, count = rng.uniform(0.42, 0.54), rng.uniform(0.55, 0.75), int(rng.choice([4, 4, 6]))
    leg = traits.draw(rng, "legs", (0.12, 0.2), (0.8, 1.1), (1.9, 2.3))
    top, ball = leg + deep, rng.random() < 0.35
    bottom = [(0.06, leg - 0.2), (0.5 * radius, leg - 0.12)] if ball else [(0.5 * radius, leg)]
    tank = lathe([*bottom, (radius, leg + 0.05), (radius, top)])
    hoops = [
        lathe(
            [(radius, y - 0.03), (radius + 0.025, y - 0.02), (radius + 0.025, y + 0.02), (radius, y + 0.03)],
            segments=20,
        )
        for y in leg + deep * np.array([0.25, 0.6])
    ]
    roof = [
        hat(radius + 0.07, rng.uniform(0.22, 0.4), top, 24, bow=-0.5 if ball else 0.0),
        ellipsoid([0, top + 0.3, 0], 0.05, rings=6),
    ]
    foot, head = np.array([0, 0.05, 1.05 * radius]), np.array([0, leg + 0.08, 0.84 * radius])
    legs = around(bar(foot, head, 0.045), count, 180 / count)
    braces = []
    for low, high in ((0.1, 0.55), (0.55, 0.95)):
        turn = np.pi / count
        ends = [(foot + t * (head - foot)) @ _turn(side * turn) for t, side in ((low, 1), (high, -1))]
        for mirror in ([1, 1, 1], [-1, 1, 1]):
            braces += around(bar(ends[0] * mirror, ends[1] * mirror, 0.022, 4), count)
    pipe = bar([0, 0.06, 0], [0, leg + 0.04, 0], 0.06)
    return named(tank=[tank, *hoops], roof=roof, leg=legs, frame=braces, stem=pipe)


KINDS = {"tower": (battlement_tower, watchtower)}
