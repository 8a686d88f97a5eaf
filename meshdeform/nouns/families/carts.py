"""Draw what is drawn, pushed, thrown from or hung on rails and ropes, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.chassis import (
    WHEELS,
    Outline,
    Solids,
    bar,
    block,
    circle,
    drum,
    share,
    side,
    spoked,
    wheels,
)
from meshdeform.nouns.families.parts import Array, Part, box, curved, ellipsoid, lathe, limb, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["cablecar", "cannon", "carriage", "cart", "catapult", "sled", "tram", "wagon"]


def _spoked(radius: float, x: float, places: tuple[float, ...], spokes: int = 4) -> list[Part]:
    """Return spoked wheels on the ground left and right, and their axles."""
    return [each for z in places for s in (-1, 1) for each in spoked(radius, 0.05, [s * x, radius, z], spokes)] + [
        bar([-x, radius, z], [x, radius, z], radius=0.045) for z in places
    ]


def _boarded(level: float, tall: float, wide: float, long: float, lean: float = 0.0) -> list[Part]:
    """Return a bottom and four walls of boards, which lean out."""
    floor = block([0, level, 0], [2 * wide, 0.07, 2 * long])
    walls = pair(moved(turned(block([0, tall / 2, 0], [0.06, tall, 2 * long]), -lean, "z"), [wide, level, 0]))
    for front in (-1, 1):
        wall = turned(block([0, tall / 2, 0], [2 * wide + 0.05, tall, 0.06]), front * lean, "x")
        walls.append(moved(wall, [0, level, front * long]))
    return [floor, *walls]


def cart(rng: Rng, traits: Traits) -> Part:
    """Draw a cart: an open box of boards on two large spoked wheels, two shafts ahead."""
    radius = 0.36 * traits.draw(rng, "wheels", *WHEELS)
    long, wide, tall = share(rng, 0.46, 0.58), share(rng, 0.3, 0.36), share(rng, 0.22, 0.34)
    level = 0.42
    box_ = _boarded(level, tall, wide, long, share(rng, 0, 16))
    ribs = [
        each
        for z in (-0.6 * long, 0, 0.6 * long)
        for each in pair(block([wide + 0.04, level + 0.1, z], [0.06, 0.3, 0.07]))
    ]
    return named(
        body=[*box_, *(ribs if rng.random() < 0.6 else [])],
        wheel=_spoked(radius, wide + 0.13, (0.0,)),
        handle=[*pair(bar([0.8 * wide, level, 0.8 * long], [0.7 * wide, level - share(rng, 0, 0.2), long + 0.75], radius=0.045)),
                bar([-0.76 * wide, level - 0.06, long + 0.4], [0.76 * wide, level - 0.06, long + 0.4], radius=0.04)],
        leg=pair(bar([0.7 * wide, 0.05, -0.8 * long], [0.7 * wide, level, -0.8 * long], radius=0.04)),
    )  # fmt: skip


def wagon(rng: Rng, traits: Traits) -> Part:
    """Draw a wagon: a long box of boards on four spoked wheels, under canvas on hoops or open, with a pole ahead."""
    size = traits.draw(rng, "wheels", *WHEELS)
    long, wide, level = share(rng, 0.72, 0.85), share(rng, 0.3, 0.36), 0.42
    solids: Solids = {
        "body": _boarded(level, share(rng, 0.2, 0.3), wide, long, 6),
        "wheel": [*_spoked(0.32 * size, wide + 0.12, (-0.6 * long,)), *_spoked(0.26 * size, wide + 0.12, (0.62 * long,))],
        "handle": [bar([0, 0.32, 0.7 * long], [0, 0.3, long + 0.6], radius=0.045)],
    }  # fmt: skip
    if rng.random() < 0.7:
        tall, flare = share(rng, 0.42, 0.52), share(rng, 0.0, 0.16)
        solids["canopy"] = []
        profile = np.column_stack([circle(1.0, 0, 0, 0, 180, 9), np.zeros(9)])
        for z in np.linspace(-0.8, 0.8, 5) * long:
            grown = 1 + flare * abs(z) / long
            at = curved(np.column_stack([profile[:, 0] * wide * 1.06, level + 0.18 + profile[:, 1] * tall * grown,
                                         np.full(9, z * grown)]), samples=1)  # fmt: skip
            solids["canopy"].append(limb(at, np.full(len(at), 0.045), segments=6, samples=1))
        arch = np.concatenate([circle(1.0, 0, 0, 0, 180, 9)]) * [wide, tall] + [0, level + 0.18]
        cloth = turned(side(arch, 1.7 * long, bevel=0.02), 90, "y")
        z = cloth.verts[:, 2:] / long
        solids["canopy"].append(cloth._replace(verts=cloth.verts * np.column_stack([0 * z + 1, 1 + 0.6 * flare * z**2,
                                                                                    1 + 0 * z])))  # fmt: skip
    else:
        rails = [level + 0.36, level + 0.48]
        solids["frame"] = [each for y in rails for each in pair(block([wide + 0.04, y, 0], [0.05, 0.06, 2 * long]))]
        solids["frame"] += [each for z in (-0.9, 0, 0.9) for each in pair(bar(
            [wide + 0.02, level + 0.1, z * long], [wide + 0.05, level + 0.52, z * long], radius=0.035))]  # fmt: skip
    return named(**solids)


def carriage(rng: Rng, traits: Traits) -> Part:
    """Draw a carriage: a closed curved box with a door and windows on springs, four spoked wheels, a driver's seat."""
    size = traits.draw(rng, "wheels", *WHEELS)
    wide, level, tall = share(rng, 0.28, 0.33), 0.42, share(rng, 0.62, 0.72)
    belly: Outline = [(-0.46, level + 0.3), (-0.5, level + tall), (0.42, level + tall), (0.38, level + 0.3),
                      (0.2, level), (-0.26, level)]  # fmt: skip
    pane = level + 0.7 * tall
    solids: Solids = {
        "body": [side(belly, 2 * wide, bevel=0.06)],
        "roof": [box([0, level + tall, -0.04], [2 * wide + 0.1, 0.1, 1.04], round_by=0.5, cells=4)],
        "door": [block([0, level + 0.46 * tall, -0.04], [2 * wide + 0.05, 0.76 * tall, 0.3])],
        "window": [block([0, pane, z], [2 * wide + (0.09 if z == -0.04 else 0.04), 0.3 * tall, 0.2])
                   for z in (-0.36, -0.04, 0.28)],
        "seat": [block([0, level + 0.3, 0.6], [1.7 * wide, 0.1, 0.26]), block([0, level + 0.16, 0.66], [1.4 * wide, 0.26, 0.1]),
                 block([0, level + 0.02, 0.78], [1.7 * wide, 0.05, 0.3])],
        "wheel": [*_spoked(0.34 * size, wide + 0.1, (-0.62,), 5), *_spoked(0.26 * size, wide + 0.1, (0.72,), 5)],
        "frame": [*pair(bar([0.7 * wide, 0.34, -0.7], [0.7 * wide, 0.36, 0], [0.7 * wide, 0.34, 0.86], radius=0.04))],
        "handle": [bar([0, 0.3, 0.7], [0, 0.3, 1.35], radius=0.035)],
        "lamp": pair(block([wide + 0.06, level + 0.66 * tall, 0.42], [0.08, 0.16, 0.08])),
    }  # fmt: skip
    return named(**solids)


def sled(rng: Rng, traits: Traits) -> Part:
    """Draw a sled: slats on two runners that curl up ahead, or a sleigh with a curved body and a seat."""
    long, wide = share(rng, 0.7, 0.85), share(rng, 0.26, 0.33)
    curl, level = share(rng, 0.26, 0.4), share(rng, 0.24, 0.3)
    runner = curved([(wide, 0.05, -long), (wide, 0.05, 0), (wide, 0.06, 0.7 * long), (wide, 0.4 * curl, long + 0.08),
                     (wide, curl + 0.05, long + 0.04), (wide, curl, 0.82 * long)], samples=3)  # fmt: skip
    solids: Solids = {
        "skid": pair(limb(runner, np.full(len(runner), 0.045), segments=8, samples=1)),
        "leg": [each for z in (-0.6, 0.1, 0.55) for each in
                pair(bar([wide, 0.05, z * long], [wide - 0.03, level, z * long], radius=0.04))],
    }  # fmt: skip
    if rng.random() < 0.5:
        solids["seat"] = [
            block([x, level, 0], [0.3 * wide, 0.05, 1.7 * long]) for x in np.linspace(-0.8, 0.8, 4) * wide
        ]
        solids["frame"] = [block([0, level - 0.05, z * long], [2 * wide, 0.06, 0.1]) for z in (-0.6, 0.1, 0.55)]
        solids["rope"] = [bar([-wide, curl, long], [0, curl + 0.1, long + 0.4], [wide, curl, long], radius=0.025)]
    else:
        shell = [(-0.92 * long, level + 0.72), (-0.5 * long, level + 0.4), (0.3 * long, level + 0.3), (0.72 * long, level + 0.5),
                 (0.9 * long, level + 0.36), (0.6 * long, level), (-0.6 * long, level)]  # fmt: skip
        solids["body"] = [*pair(side(shell, 0.06, at=wide)), side([(z, y) for z, y in shell[-3:]] + [(-0.7 * long, level + 0.3)],
                                                                  2 * wide)]  # fmt: skip
        solids["seat"] = [block([0, level + 0.26, -0.36 * long], [2 * wide, 0.1, 0.36], 0.3),
                          moved(turned(block([0, 0.22, 0], [2 * wide, 0.5, 0.08], 0.3), -14, "x"), [0, level + 0.2, -0.6 * long])]  # fmt: skip
    return named(**solids)


def cannon(rng: Rng, traits: Traits) -> Part:
    """Draw a cannon: a tapering barrel with rings and a knob, aimed up between two spoked wheels, on a trail."""
    gun = traits.draw(rng, "gun", (0.3, 0.42), (0.85, 1.0), (1.6, 1.85))
    ship = rng.random() < 0.35
    radius, girth = (0.13 if ship else 0.38) * share(rng, 0.9, 1.1), share(rng, 0.15, 0.19)
    level, aim = share(rng, 0.4, 0.46), share(rng, 4, 24)
    rings = [
        (0.0, 0.0),
        (0.06, 0.02),
        (0.06, 0.1),
        (0.035, 0.12),
        (girth, 0.16),
        (1.14 * girth, 0.18),
        (1.14 * girth, 0.24),
    ]
    rings += [
        (girth, 0.26),
        (0.92 * girth, 0.3 + 0.4 * gun),
        (1.02 * girth, 0.32 + 0.4 * gun),
        (1.02 * girth, 0.36 + 0.4 * gun),
    ]
    rings += [
        (0.86 * girth, 0.38 + 0.4 * gun),
        (0.7 * girth, 0.34 + gun),
        (0.9 * girth, 0.36 + gun),
        (0.9 * girth, 0.42 + gun),
    ]
    rings += [(0.5 * girth, 0.44 + gun), (0.46 * girth, 0.34 + gun)]
    barrel = moved(turned(lathe(rings, segments=20), 90 - aim, "x"), [0, level, -0.5])
    tail = [(-0.95, 0.06), (-0.85, 0.2), (0.24, level + 0.06), (0.3, level - 0.14), (-0.4, 0.12)]
    low = [(-0.6, 0.16), (-0.6, 0.3), (-0.3, 0.32), (0.05, level + 0.06), (0.4, level + 0.04), (0.44, 0.16)]
    return named(
        gun=[barrel],
        body=[*pair(side(low if ship else tail, 0.09, at=1.15 * girth)),
              block([0, 0.22 if ship else 0.2, -0.3], [2.3 * girth, 0.12, 0.5])],
        wheel=wheels(radius, 0.06, 1.15 * girth + 0.1, [-0.42, 0.26]) if ship else _spoked(radius, 0.36, (0.05,), 5),
    )  # fmt: skip


def catapult(rng: Rng, traits: Traits) -> Part:
    """Draw a catapult: a frame of beams on four wheels, an arm with a cup at its end through an upright, ropes."""
    reach = traits.draw(rng, "arms", (0.3, 0.4), (0.95, 1.1), (1.6, 1.8))
    long, wide, high = share(rng, 0.62, 0.75), share(rng, 0.28, 0.34), share(rng, 0.66, 0.82)
    radius, lift = share(rng, 0.15, 0.19), share(rng, 10, 65)
    level = radius + 0.06
    root = np.array([0, level + 0.08, 0.02])
    way = np.array([0, np.sin(np.radians(lift)), -np.cos(np.radians(lift))])
    cup = root + way * reach
    bowl = lathe([(0.0, -0.1), (0.1, -0.08), (0.16, 0.02), (0.13, 0.02), (0.08, -0.04)], segments=14)
    stone = [ellipsoid(cup + [0, 0.12, 0], 0.1, rings=6)] if rng.random() < 0.6 else []
    return named(
        frame=[*pair(block([wide, level, 0], [0.1, 0.13, 2 * long])),
               *(block([0, level, z * long], [2 * wide, 0.11, 0.1]) for z in (-0.85, 0.0, 0.85)),
               *pair(bar([wide, level, 0.14], [wide, level + high, 0.14], radius=0.055)),
               *pair(bar([wide, level, 0.62 * long], [wide, level + 0.85 * high, 0.16], radius=0.045)),
               block([0, level + high, 0.14], [2 * wide + 0.16, 0.13, 0.14], 0.3)],
        rope=[drum(0.1, 0.8 * wide, root, segments=12)],
        arm=[bar(root, cup, radius=(0.065, 0.05))],
        dish=[moved(bowl, cup + [0, 0.06, 0]), *stone],
        wheel=wheels(radius, 0.055, wide + 0.1, [-0.66 * long, 0.66 * long]),
    )  # fmt: skip


def _panes(y: float, tall: float, wide: float, places: Array, long: float) -> list[Part]:
    """Return windows on both sides at places along Z."""
    return [block([0, y, z], [2 * wide + 0.04, tall, long], 0.05) for z in places]


def tram(rng: Rng, traits: Traits) -> Part:
    """Draw a tram: a long narrow car with tall windows, rounded ends, a rod to the wire, on low wheels."""
    long, wide, tall = share(rng, 1.05, 1.25), share(rng, 0.26, 0.31), share(rng, 0.6, 0.7)
    radius, floor = 0.1 * traits.draw(rng, "wheels", *WHEELS), 0.1
    old, top = rng.random() < 0.5, floor + tall
    ends = 0.96 if old else 0.86
    shape = [
        (-long, floor),
        (-long, floor + 0.5 * tall),
        (-ends * long, top),
        (ends * long, top),
        (long, floor + 0.5 * tall),
    ]
    places = np.linspace(-0.74, 0.74, 6 if old else 5) * long
    solids: Solids = {
        "body": [side([*shape, (long, floor)], 2 * wide, bevel=0.12)],
        "roof": [box([0, top + 0.02, 0], [1.9 * wide, 0.12, 1.9 * ends * long], round_by=0.5, cells=4)],
        "window": [*_panes(floor + 0.66 * tall, 0.4 * tall, wide, places, 0.19 if old else 0.3),
                   block([0, floor + 0.68 * tall, 0], [1.6 * wide, 0.36 * tall, (1.94 if old else 1.87) * long])],
        "door": [block([0, floor + 0.46 * tall, z], [2 * wide + 0.06, 0.84 * tall, 0.18], 0.05) for z in (places[:-1] + places[1:])[::3] / 2],
        "bumper": [block([0, floor + 0.04, z * long], [1.5 * wide, 0.12, 0.1], 0.3) for z in (-1.02, 1.02)],
        "lamp": [drum(0.07, 0.05, [0, floor + 0.3 * tall, 1.0 * long], "z")],
        "wheel": wheels(radius, 0.05, 0.8 * wide, [z * long for z in (-0.66, -0.46, 0.46, 0.66)]),
    }  # fmt: skip
    if old:
        solids["roof"].append(box([0, top + 0.1, 0], [1.1 * wide, 0.14, 1.3 * long], round_by=0.5, cells=4))
        solids["mast"] = [bar([0, top + 0.1, 0.1], [0, top + 0.55, -0.8 * long], radius=0.03)]
    else:
        solids["mast"] = [bar([0, top, -0.2], [0, top + 0.22, 0.12], [0, top + 0.42, -0.14], radius=0.03),
                          bar([-0.24, top + 0.42, -0.14], [0.24, top + 0.42, -0.14], radius=0.03)]  # fmt: skip
    return named(**solids)


def cablecar(rng: Rng, traits: Traits) -> Part:
    """Draw a cable car: a glazed cabin, rounded or square, that hangs by an arm from wheels on a rope."""
    arm = traits.draw(rng, "arms", (0.06, 0.14), (0.5, 0.6), (1.0, 1.2))
    long, wide, tall = share(rng, 0.4, 0.55), share(rng, 0.32, 0.4), share(rng, 0.6, 0.72)
    lean, round_by = share(rng, 0.0, 0.16), share(rng, 0.08, 0.4)
    body = [
        (-long + lean, 0),
        (-long, 0.5 * tall),
        (-long + lean, tall),
        (long - lean, tall),
        (long, 0.5 * tall),
        (long - lean, 0),
    ]
    top = tall + 0.05 + arm
    solids: Solids = {
        "body": [side(body, 2 * wide, bevel=round_by)],
        "roof": [block([0, tall, 0], [1.7 * wide, 0.1, 1.9 * (long - lean)], 0.4)],
        "window": [*_panes(0.62 * tall, 0.42 * tall, wide, np.array([-0.55, 0.0, 0.55]) * long, 0.36 * long),
                   block([0, 0.62 * tall, 0], [1.4 * wide, 0.4 * tall, 2 * long + 0.02])],
        "arm": [bar([0, tall, 0], [0, tall + 0.3 * arm, 0], [0.12, top, 0], radius=0.05)],
        "wheel": [drum(0.09, 0.035, [0.12, top + 0.04, z], segments=12) for z in (-0.22, -0.07, 0.08, 0.23)],
        "rope": [bar([0.12, top + 0.12, -1.0], [0.12, top + 0.12, 1.0], radius=0.03)],
        "frame": [block([0.12, top + 0.02, 0], [0.1, 0.06, 0.6])],
        "door": [block([wide, 0.46 * tall, 0], [0.05, 0.84 * tall, 0.5 * long], 0.05)],
    }  # fmt: skip
    return named(**solids)
