"""Draw what flies in space, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.aircraft import WINGS, wing_of
from meshdeform.nouns.families.chassis import Solids, bar, block, drum, share, side
from meshdeform.nouns.families.parts import Part, ellipsoid, lathe, limb, moved, named, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["satellite", "spaceship", "ufo"]


def _nozzle(radius: float, centre: list[float]) -> Part:
    """Return an engine's bell that opens behind."""
    bell = [(0.6 * radius, -0.1), (0.7 * radius, 0.0), (radius, 0.2), (0.85 * radius, 0.2), (0.45 * radius, 0.04)]
    return moved(turned(lathe(bell, segments=16), -90, "x"), centre)


def spaceship(rng: Rng, traits: Traits) -> Part:
    """Draw a spaceship: a wedge or a spindle with a cockpit, swept wings with guns, engines and fins behind."""
    long, wide, tall = share(rng, 0.85, 1.0), share(rng, 0.24, 0.34), share(rng, 0.13, 0.18)
    span = share(rng, 0.5, 0.7) * traits.draw(rng, "wings", *WINGS)
    sweep, droop = share(rng, -0.3, 0.55), share(rng, -22, 16)
    if rng.random() < 0.5:
        hull = side([(-0.75 * long, -tall), (-0.8 * long, tall), (-0.1 * long, 1.3 * tall), (0.6 * long, 0.4 * tall),
                     (long, -0.4 * tall), (0.5 * long, -tall)], 2 * wide, bevel=0.12)  # fmt: skip
        narrow = 1 - 0.75 * np.clip(hull.verts[:, 2] / long, 0, 1)
        hull = hull._replace(verts=hull.verts * np.column_stack([narrow, 0 * narrow + 1, 0 * narrow + 1]))
    else:
        path = [[0, -0.04, long], [0, 0, 0.5 * long], [0, 0, -0.2 * long], [0, 0, -0.75 * long]]
        hull = limb(path, [[0.06, 0.05], [0.7 * wide, tall], [wide, 1.2 * tall], [0.8 * wide, tall]], samples=4)
    wing = wing_of(0.6 * wide + span, 0.62, sweep, share(rng, 0.25, 0.6), 0.07, droop)
    solids: Solids = {
        "body": [hull],
        "cabin": [ellipsoid([0, 0.9 * tall, 0.22 * long], [0.42 * wide, 0.75 * tall, 0.24 * long], rings=8)],
        "wing": [moved(each, [0, 0, 0.05]) for each in wing],
        "exhaust": [_nozzle(0.5 * wide, [0, 0, -0.74 * long])] if rng.random() < 0.4 else pair(
            _nozzle(0.36 * wide, [0.5 * wide, 0, -0.74 * long])),
    }  # fmt: skip
    high = share(rng, 0.2, 0.34)
    fin = moved(
        plate([(0.2, 0.0), (-0.12, high), (-0.26, high), (-0.2, 0.0)], 0.06, across="x"), [0, tall, -0.55 * long]
    )
    solids["fin"] = [fin] if rng.random() < 0.5 else pair(moved(turned(fin, -24, "z"), [0.5 * wide, -0.3 * tall, 0]))
    if rng.random() < 0.6:
        x = 0.6 * wide + 0.45 * span
        y, z = np.sin(np.radians(droop)) * x, 0.05 - 0.45 * sweep
        solids["gun"] = pair(bar([x, y, z - 0.5], [x, y, z + 0.2], [x, y, z + 0.55], radius=(0.07, 0.06, 0.03)))
    return named(**solids)


def ufo(rng: Rng, _: Traits) -> Part:
    """Draw a flying saucer: a flat disc with a glass dome, a ring of lamps at its rim, sometimes on three legs."""
    rim, upper, lower = share(rng, 0.9, 1.0), share(rng, 0.16, 0.26), share(rng, 0.12, 0.22)
    dome, edge = share(rng, 0.32, 0.44), share(rng, 0.03, 0.07)
    disc_ = lathe([(0.3, -lower), (0.5 * rim, -0.75 * lower), (rim, -edge), (1.04 * rim, 0), (rim, edge), (0.55 * rim, 0.7 * upper),
                   (1.15 * dome, upper), (dome, upper)], segments=36)  # fmt: skip
    solids: Solids = {
        "body": [disc_, drum(0.3, 0.05, [0, -lower - 0.03, 0], "y", 20)],
        "cabin": [ellipsoid([0, upper, 0], [dome, share(rng, 0.8, 1.1) * dome, dome], rings=12)],
        "lamp": [],
    }
    count = int(rng.integers(8, 13))
    for turn in np.arange(count) * 2 * np.pi / count:
        place = [0.82 * rim * np.sin(turn), 0.3 * upper + edge * 0.6, 0.82 * rim * np.cos(turn)]
        solids["lamp"].append(ellipsoid(place, 0.065, rings=4))
    if rng.random() < 0.4:
        leg = bar([0.45, -0.6 * lower, 0], [0.66, -lower - 0.34, 0], radius=0.035)
        foot = drum(0.09, 0.03, [0.66, -lower - 0.36, 0], "y", 12)
        solids["leg"] = [turned(each, turn, "y") for turn in (30, 150, 270) for each in (leg, foot)]
    return named(**solids)


def satellite(rng: Rng, traits: Traits) -> Part:
    """Draw a satellite: a box or a drum with two wings of solar panels, a dish on an arm, aerials."""
    wings = traits.draw(rng, "wings", (0.3, 0.4), (0.75, 0.95), (1.35, 1.6))
    wide, tall = share(rng, 0.2, 0.25), share(rng, 0.26, 0.36)
    high, start = share(rng, 0.17, 0.23), wide + 0.14
    body = (
        drum(wide, tall, axis="z", segments=12)
        if rng.random() < 0.4
        else block([0, 0, 0], [2 * wide, 2 * wide, 2 * tall])
    )
    frames = [block([start + wings / 2, 0, 0], [wings, 2 * high, 0.05])]
    frames += [block([start + wings * t, 0, 0], [0.035, 2.06 * high, 0.08]) for t in np.linspace(0.02, 0.98, 5)]
    frames.append(block([start + wings / 2, 0, 0], [wings, 0.035, 0.08]))
    aim, radius = share(rng, -25, 25), share(rng, 0.24, 0.32)
    bowl = lathe(
        [(0.04, -0.02), (0.6 * radius, 0.04), (radius, 0.14), (0.94 * radius, 0.15), (0.5 * radius, 0.08)], segments=22
    )
    dish = [bowl, bar([0, 0.04, 0], [0, 0.24, 0], radius=0.02), drum(0.035, 0.03, [0, 0.25, 0], "y", 8)]
    return named(
        body=[body, block([0, 0, -tall], [1.3 * wide, 1.3 * wide, 0.12])],
        wing=[each for one in frames for each in pair(turned(one, aim, "x"))],
        dish=[moved(turned(turned(each, 90, "x"), share(rng, -3, 3), "y"), [0, 0, tall + 0.12]) for each in dish],
        arm=[*pair(bar([0, 0, 0], [start + 0.02, 0, 0], radius=0.03)), bar([0, 0, tall - 0.05], [0, 0, tall + 0.13], radius=0.05),
             bar([0, wide, -0.1], [0.02, wide + 0.3, -0.1], radius=0.018)],
        lens=[drum(0.06, 0.05, [0, -wide - 0.03, 0.1], "y", 12)],
    )  # fmt: skip
