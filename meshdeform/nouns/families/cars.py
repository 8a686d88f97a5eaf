"""Draw cars, and vans and lorries that serve a town, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.chassis import (
    WHEELS,
    Motor,
    bar,
    block,
    circle,
    drum,
    motor,
    narrowed,
    share,
    side,
    wheel,
    wheels,
)
from meshdeform.nouns.families.parts import Part, ellipsoid, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["ambulance", "caravan", "firetruck", "jeep", "pickup", "racecar", "taxi"]

SALOON = Motor(
    (1.85, 2.1), (0.78, 0.86), (0.54, 0.6),
    [(-1, 0.08), (-1, 0.5), (-0.9, 0.6), (-0.4, 0.62), (0.4, 0.6), (0.9, 0.52), (1, 0.42), (1, 0.08)],
    [(-0.72, 0.5), (-0.44, 1), (0.1, 1), (0.46, 0.5)],
)  # fmt: skip
HATCHBACK = SALOON._replace(
    long=(1.5, 1.7), tall=(0.62, 0.7), posts=(0.62,), cabin=[(-0.98, 0.5), (-0.82, 1), (0.12, 1), (0.52, 0.5)]
)
SPORTS = SALOON._replace(
    long=(1.95, 2.15), wide=(0.88, 0.96), tall=(0.44, 0.5), radius=(0.2, 0.22), posts=(), narrow=0.3,
    body=[(-1, 0.1), (-1, 0.66), (-0.8, 0.72), (-0.3, 0.62), (0.3, 0.6), (0.8, 0.45), (1, 0.24), (1, 0.08)],
    cabin=[(-0.74, 0.55), (-0.34, 1), (-0.06, 1), (0.4, 0.5)],
)  # fmt: skip
OFFROAD = SALOON._replace(
    long=(1.65, 1.85), wide=(0.84, 0.92), tall=(0.76, 0.84), radius=(0.25, 0.28), posts=(0.36, 0.66), narrow=0.12,
    cabin=[(-0.98, 0.5), (-0.92, 1), (0.2, 1), (0.42, 0.5)],
)  # fmt: skip
TOY = SALOON._replace(
    long=(1.25, 1.45), wide=(0.84, 0.95), tall=(0.7, 0.82), radius=(0.25, 0.29), bevel=0.3, posts=(0.5,),
    cabin=[(-0.8, 0.5), (-0.6, 1), (0.24, 1), (0.44, 0.5)],
)  # fmt: skip
PICKUP = SALOON._replace(
    long=(1.95, 2.2), wide=(0.82, 0.92), tall=(0.68, 0.76), radius=(0.24, 0.27),
    body=[(-1, 0.08), (-1, 0.34), (0.3, 0.34), (0.32, 0.58), (0.9, 0.54), (1, 0.46), (1, 0.08)],
    cabin=[(-0.14, 0.3), (-0.1, 1), (0.22, 1), (0.44, 0.52)],
)  # fmt: skip


VAN = SALOON._replace(
    long=(1.8, 2.05), wide=(0.8, 0.88), tall=(0.86, 0.98), radius=(0.19, 0.22), posts=(), narrow=0.08,
    body=[(-1, 0.08), (-1, 0.97), (-0.96, 1), (0.3, 1), (0.42, 0.9), (0.44, 0.5), (0.9, 0.44), (1, 0.36), (1, 0.08)],
    cabin=[(0.2, 0.45), (0.24, 0.98), (0.44, 0.98), (0.74, 0.46)],
)  # fmt: skip
MINIBUS = VAN._replace(
    posts=(0.25, 0.5, 0.75), body=[(-1, 0.06), (-1, 0.5), (0.7, 0.52), (0.94, 0.44), (1, 0.36), (1, 0.06)],
    cabin=[(-0.98, 0.45), (-0.94, 1), (0.4, 1), (0.76, 0.48)],
)  # fmt: skip
CAMPER = VAN._replace(
    bevel=0.25, posts=(0.28, 0.52, 0.76), body=[(-1, 0.06), (-1, 0.54), (0.97, 0.54), (1, 0.4), (1, 0.06)],
    cabin=[(-0.99, 0.5), (-0.96, 1), (0.76, 1), (0.95, 0.52)],
)  # fmt: skip


def saloon(rng: Rng, traits: Traits) -> Part:
    """Draw a saloon car with a boot: three boxes."""
    return named(**motor(rng, traits, SALOON).solids)


def hatchback(rng: Rng, traits: Traits) -> Part:
    """Draw a small car that ends behind its cabin."""
    return named(**motor(rng, traits, HATCHBACK).solids)


def offroad_car(rng: Rng, traits: Traits) -> Part:
    """Draw a tall car with a long cabin on large wheels, half of them with rails on the roof."""
    drawn = motor(rng, traits, OFFROAD)
    if rng.random() < 0.5:
        rail = bar([0.3, drawn.top + 0.06, -0.7], [0.3, drawn.top + 0.06, 0.1], radius=0.03)
        drawn.solids["cabin"] += pair(rail)
    return named(**drawn.solids)


def sports_car(rng: Rng, traits: Traits) -> Part:
    """Draw a low wide car with a wedge of a nose, most with a wing over the tail."""
    drawn = motor(rng, traits, SPORTS)
    if rng.random() < 0.7:
        z, y = drawn.at(-0.92, rng.uniform(0.95, 1.15))
        drawn.solids["fin"] = [block([0, y, z], [1.9 * drawn.wide, 0.05, 0.24], 0.3)]
        drawn.solids["fin"] += pair(block([0.7 * drawn.wide, y - 0.1, z], [0.05, 0.24, 0.14]))
    return named(**drawn.solids)


def toy_car(rng: Rng, traits: Traits) -> Part:
    """Draw a short round car on large wheels, as toys and cartoons have it."""
    return named(**motor(rng, traits, TOY).solids)


def vintage_car(rng: Rng, traits: Traits) -> Part:
    """Draw a car of the twenties: a narrow bonnet, an upright cabin, arched mudguards, footboards, big round lamps."""
    long, wide, wheel_radius = share(rng, 0.85, 0.95), share(rng, 0.28, 0.32), share(rng, 0.25, 0.29)
    level, top = 0.8 * wheel_radius, share(rng, 0.92, 1.05)
    hood = share(rng, 0.05, 0.2)  # where the bonnet begins
    mudguard = [
        *circle(1.25 * wheel_radius, wheel_radius, 0, 10, 170, 9),
        *circle(1.02 * wheel_radius, wheel_radius, 0, 10, 170, 9)[::-1],
    ]
    axles = [-0.68 * long, 0.72 * long]
    solids = {
        "body": [
            block([0, level, 0], [1.6 * wide, 0.14, 1.9 * long]),
            side([(hood, level), (hood, 0.66), (0.85 * long, 0.6), (0.85 * long, level)], 1.4 * wide, bevel=0.2),
            block([0, 0.4 * (level + 0.6), 0.87 * long], [1.2 * wide, 0.36, 0.06], 0.3),
        ],
        "cabin": [
            side([(-0.9 * long, level), (-0.95 * long, top), (hood, top), (hood + 0.05, level)], 2 * wide),
            block([0, top, -0.4 * long], [2.2 * wide, 0.08, long + 0.35], 0.4),
        ],
        "window": [
            block([0, 0.8 * top, z], [2 * wide + 0.04, 0.28 * top, 0.28], 0.05) for z in (-0.68 * long, -0.2 * long)
        ],
        "bumper": pair(block([wide + 0.12, level - 0.05, 0], [0.22, 0.06, long])),
        "lamp": pair(drum(0.1, 0.08, [wide + 0.02, 0.55, 0.86 * long], "z")),
        "wheel": wheels(wheel_radius, 0.08, wide + 0.14, axles),
    }
    for z in axles:
        solids["bumper"] += pair(side(np.add(mudguard, [z, 0.02]), 0.2, at=wide + 0.14))
    return named(**solids)


def taxi(rng: Rng, traits: Traits) -> Part:
    """Draw a taxi: a saloon car, or a tall one, with a sign on its roof."""
    drawn = motor(rng, traits, SALOON if rng.random() < 0.7 else HATCHBACK)
    sign = block([0, drawn.top + 0.08, drawn.at(-0.15, 0)[0]], [0.42, share(rng, 0.14, 0.18), 0.16], 0.3)
    return named(**drawn.solids, top=sign)


def pickup(rng: Rng, traits: Traits) -> Part:
    """Draw a pickup: a bonnet, a cabin for two, an open bed between boards."""
    drawn = motor(rng, traits, PICKUP)
    (back, rim), (front, low) = drawn.at(-0.99, 0.58), drawn.at(-0.12, 0.2)
    tall, middle = rim - low, (rim + low) / 2
    boards = pair(block([0.94 * drawn.wide, middle, (back + front) / 2], [0.09, tall, front - back + 0.06]))
    return named(**drawn.solids, load=[*boards, block([0, middle - 0.01, back + 0.03], [1.9 * drawn.wide, tall, 0.08])])


def jeep(rng: Rng, traits: Traits) -> Part:
    """Draw a jeep: a flat square body, an upright windscreen, seats under a canvas or bars, a spare wheel behind."""
    long, wide, tall = share(rng, 0.72, 0.8), share(rng, 0.38, 0.43), share(rng, 0.34, 0.4)
    radius = share(rng, 0.25, 0.29) * traits.draw(rng, "wheels", *WHEELS)
    floor = 0.8 * radius
    deck, top = floor + tall, floor + tall + share(rng, 0.42, 0.5)
    body = [(-long, floor), (-long, deck), (0.2, deck), (0.24, deck + 0.04), (long, deck), (long, floor)]
    solids = {
        "body": [side(body, 1.6 * wide, bevel=0.03), block([0, deck - 0.2, long], [1.1 * wide, 0.24, 0.08])],
        "wheel": [*wheels(radius, 0.11, wide, [-0.62 * long, 0.66 * long]), _spare(0.24, [0, deck, -long - 0.08])],
        "bumper": [block([0, floor + 0.05, z], [1.8 * wide, 0.12, 0.1]) for z in (-long - 0.02, long + 0.06)],
        "lamp": pair(drum(0.08, 0.05, [0.56 * wide, deck - 0.18, long + 0.03], "z")),
        "window": [block([0, deck + 0.2, 0.26], [1.44 * wide, 0.38, 0.06])],
    }
    for z in (-0.62 * long, 0.66 * long):
        solids["body"] += pair(block([wide, floor + 0.62 * tall, z], [0.44 * wide, 0.08, 0.5], 0.4))
    if rng.random() < 0.5:
        solids["cabin"] = [narrowed(side([(-long, deck - 0.03), (-long + 0.04, top), (0.18, top), (0.24, deck - 0.03)],
                                1.56 * wide), deck, top, 0.1)]  # fmt: skip
    else:
        solids["cabin"] = [*pair(bar([0.64 * wide, deck, -0.3], [0.6 * wide, top, -0.26], radius=0.05)),
                           bar([-0.6 * wide, top, -0.26], [0.6 * wide, top, -0.26], radius=0.05)]  # fmt: skip
        solids["seat"] = [*pair(block([0.36 * wide, deck + 0.12, -0.12], [0.26, 0.36, 0.12], 0.3))]
    return named(**solids)


def _spare(radius: float, centre: list[float]) -> Part:
    return moved(turned(wheel(radius, 0.09), 90, "y"), centre)


def racecar(rng: Rng, traits: Traits) -> Part:
    """Draw a racing car: a needle of a body, open wheels on arms, wings before and behind, a driver's helmet."""
    long, slim = share(rng, 0.98, 1.1), share(rng, 0.16, 0.2)
    size = traits.draw(rng, "wheels", *WHEELS)
    rear, front, track = 0.25 * size, 0.22 * size, share(rng, 0.42, 0.48)
    body = [(-0.86 * long, 0.1), (-0.86 * long, 0.32), (-0.1, 0.54), (-0.05, 0.36), (0.25, 0.34), (long, 0.18)]
    body += [(long, 0.1)]
    hull = side(body, 2 * slim, bevel=0.3)
    taper = np.clip(1 - 0.6 * hull.verts[:, 2] / long, 0.4, 1)
    hull = hull._replace(verts=hull.verts * np.column_stack([taper, np.ones_like(taper), np.ones_like(taper)]))
    z, wing = -0.86 * long, share(rng, 0.42, 0.52)
    solids = {
        "body": [hull, *pair(side([(-0.7 * long, 0.1), (-0.6 * long, 0.28), (0.15, 0.32), (0.2, 0.1)], 0.2, at=slim))],
        "head": [ellipsoid([0, 0.44, 0.04], 0.11, rings=8)],
        "wheel": [*wheels(rear, 0.15, track, [-0.62 * long]), *wheels(front, 0.12, track, [0.62 * long])],
        "fin": [block([0, wing, z], [0.84, 0.05, 0.22]), block([0, 0.1, 0.96 * long], [0.9, 0.05, 0.2])],
        "axle": [bar([-track, 0.22, z], [track, 0.22, z], radius=0.035) for z in (-0.62 * long, 0.62 * long)],
    }
    solids["fin"] += pair(block([0.4, wing - 0.05, z], [0.05, 0.26, 0.28]))
    return named(**solids, mast=[block([0, wing - 0.12, z], [0.1, 0.24, 0.1])])


def ambulance(rng: Rng, traits: Traits) -> Part:
    """Draw an ambulance: a van, or a van's cab before a box, with lamps on the roof and a cross on its sides."""
    drawn = motor(rng, traits, VAN)
    long, wide, top = drawn.long, drawn.wide, drawn.top
    if rng.random() < 0.5:
        top += share(rng, 0.04, 0.12)
        box = [(-long, drawn.floor + 0.12), (-long, top), (0.2 * long, top), (0.3 * long, drawn.floor + 0.12)]
        drawn.solids["body"].append(side(box, 2.12 * wide, bevel=0.04))
        wide *= 1.06
    z, y, arm = -0.4 * long, 0.62 * top + 0.1, share(rng, 0.3, 0.38)
    bars = [block([0, y, z], [2 * wide + 0.08, *size], 0.2) for size in ((arm, arm / 3), (arm / 3, arm))]
    front = drawn.at(share(rng, 0.16, 0.24), 1)[0]
    lamps = [block([0, top + 0.05, z], [1.1 * wide, 0.13, 0.13], 0.4) for z in (front, -0.93 * long)]
    drawn.solids["lamp"] += lamps[: int(rng.integers(1, 3))]
    return named(**drawn.solids, cross=bars)


def firetruck(rng: Rng, traits: Traits) -> Part:
    """Draw a fire truck: a square cab, a longer body with lockers, lamps, and a ladder along the roof."""
    long, wide, floor = share(rng, 1.0, 1.12), share(rng, 0.36, 0.4), 0.16
    radius = 0.2 * traits.draw(rng, "wheels", *WHEELS)
    tall, load = share(rng, 0.56, 0.64), share(rng, 0.48, 0.58)
    split = 0.38 * long
    cab = [
        (split, floor),
        (split, floor + tall),
        (0.96 * long, floor + tall),
        (long, floor + 0.45 * tall),
        (long, floor),
    ]
    top, reach = floor + load, share(rng, 0.86, 1.0) * long
    ladder = [*pair(block([0.14, 0, 0], [0.055, 0.09, 2 * reach])),
              *(block([0, 0, z], [0.3, 0.06, 0.05]) for z in np.linspace(-0.85, 0.85, 7) * reach)]  # fmt: skip
    tilt = share(rng, 3, 16)
    base = np.array([0, top + 0.05, -0.85 * long])
    solids = {
        "body": [side([(-long, floor), (-long, floor + load), (split - 0.08, floor + load), (split - 0.08, floor)],
                      1.96 * wide, bevel=0.03),
                 block([0, floor + 0.06, 0], [1.6 * wide, 0.14, 1.9 * long]),
                 drum(0.2, 0.1, base, "y")],
        "cabin": [side(cab, 2 * wide, bevel=0.06)],
        "window": [block([0, floor + 0.72 * tall, 0.7 * long], [2 * wide + 0.03, 0.32 * tall, 0.26]),
                   block([0, floor + 0.7 * tall, 0.93 * long], [1.7 * wide, 0.36 * tall, 0.14])],
        "door": [block([0, floor + 0.5 * load, z * long], [1.96 * wide + 0.04, 0.7 * load, 0.3], 0.1)
                 for z in (-0.8, -0.42, -0.04)],
        "bumper": [block([0, floor, long + 0.02], [2.04 * wide, 0.14, 0.12], 0.3)],
        "lamp": [block([0, floor + tall + 0.05, 0.66 * long], [1.3 * wide, 0.11, 0.13], 0.4),
                 *pair(drum(0.065, 0.04, [0.7 * wide, floor + 0.22, long], "z"))],
        "ladder": [moved(turned(moved(each, [0, 0.1, reach]), -tilt, "x"), base) for each in ladder],
        "wheel": wheels(radius, 0.1, wide - 0.02, [-0.62 * long, 0.68 * long]),
    }  # fmt: skip
    return named(**solids)


def caravan(rng: Rng, traits: Traits) -> Part:
    """Draw a caravan: a rounded box on two wheels, with windows, a door and a drawbar that ends on a stand."""
    long, wide, tall = share(rng, 0.72, 0.9), share(rng, 0.4, 0.46), share(rng, 0.8, 0.92)
    radius = 0.2 * traits.draw(rng, "wheels", *WHEELS)
    slope, floor = share(rng, 0.05, 0.3), 0.17
    shell = [(-0.86 * long, floor), (-long, floor + 0.3 * tall), (-0.94 * long, floor + 0.85 * tall),
             (-0.8 * long, floor + tall), ((0.9 - slope) * long, floor + tall), (long, floor + 0.4 * tall),
             (0.9 * long, floor)]  # fmt: skip
    pane = floor + 0.64 * tall
    solids = {
        "body": [side(shell, 2 * wide, bevel=share(rng, 0.08, 0.3))],
        "window": [block([0, pane, z * long], [2 * wide + 0.04, 0.28 * tall, 0.34], 0.1) for z in (-0.52, 0.34)],
        "door": [block([wide, floor + 0.42 * tall, -0.06 * long], [0.06, 0.74 * tall, 0.3], 0.1)],
        "handle": [bar([0, floor + 0.05, 0.8 * long], [0, floor + 0.05, long + 0.36], radius=0.05),
                   *pair(bar([0.3, floor + 0.05, 0.85 * long], [0, floor + 0.05, long + 0.24], radius=0.04))],
        "stand": [bar([0, 0.04, long + 0.3], [0, floor + 0.16, long + 0.3], radius=0.05)],
        "wheel": wheels(radius, 0.09, wide - 0.02, [-0.06 * long]),
    }  # fmt: skip
    solids["bumper"] = pair(block([wide, 0.1 + 1.15 * radius, -0.06 * long], [0.12, 0.06, 0.56], 0.4))
    return named(**solids)


def panel_van(rng: Rng, traits: Traits) -> Part:
    """Draw a van with a short bonnet and no windows behind the driver."""
    return named(**motor(rng, traits, VAN).solids)


def minibus(rng: Rng, traits: Traits) -> Part:
    """Draw a van with windows all along and a short bonnet."""
    return named(**motor(rng, traits, MINIBUS).solids)


def camper(rng: Rng, traits: Traits) -> Part:
    """Draw a round van with a flat front and windows all along, half of them with a spare wheel on it."""
    drawn = motor(rng, traits, CAMPER)
    if rng.random() < 0.5:
        drawn.solids["wheel"].append(
            _spare(0.16, [0, drawn.floor + 0.42 * (drawn.top - drawn.floor), drawn.long + 0.02])
        )
    return named(**drawn.solids)


KINDS = {
    "car": (saloon, hatchback, sports_car, offroad_car, vintage_car, toy_car),
    "van": (panel_van, minibus, camper),
}
