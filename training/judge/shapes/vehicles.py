"""Shape vehicles on wheels and tracks. They face +Z; y = 0 is the ground."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, carved, drum, hoop, plate, rod

__all__ = ["bus", "car", "motorcycle", "tank", "tractor", "train", "truck", "van"]

Rng = np.random.Generator


def _wheels(x: float, radius: float, wide: float, places: list[float]) -> list[Solid]:
    """Return pairs of wheels with hubs at z = `places` whose outer sides are at x = +-`x`."""
    solids = []
    for z in places:
        solids += both(drum((x - wide, radius, z), (x, radius, z), radius))
        solids += both(drum((x - wide, radius, z), (x + 0.03, radius, z), 0.4 * radius))
    return solids


def bus(rng: Rng) -> list[Solid]:
    """Shape a bus: a long box with rows of windows, four wheels and mirrors; rarely with two floors."""
    u = rng.uniform
    wide, high, long = u(0.28, 0.36), u(0.55, 0.7), u(0.85, 1.15)
    floors = 2 if rng.random() < 0.2 else 1
    low, r = 0.12, u(0.14, 0.18)
    top = low + high * (1.55 if floors == 2 else 1.0)
    solids = [block((0, (low + top) / 2, 0), (2 * wide, top - low, 2 * long), u(0.05, 0.35))]
    count = int(rng.integers(4, 7))
    step = 1.75 * long / count
    for floor in range(floors):
        y = top - 0.3 * high - 0.55 * high * floor
        for k in range(count):
            z = -0.9 * long + step * (k + 0.55)
            solids += both(carved(block((wide, y, z), (0.1, 0.3 * high, step * 0.72), 0.1)))
        solids += [carved(block((0, y, long), (1.6 * wide, 0.32 * high, 0.1), 0.1))]
    if rng.random() < 0.3:
        solids += [block((0, low + 0.2, long + 0.12), (1.7 * wide, 0.3, 0.4), 0.4)]
    return solids + _wheels(wide + 0.03, r, 0.14, [-0.6 * long, 0.6 * long])


def car(rng: Rng) -> list[Solid]:
    """Shape a car: saloon, estate, beetle or sports car."""
    u = rng.uniform
    wide, long, r = u(0.34, 0.44), u(0.75, 0.95), u(0.16, 0.22)
    sill = r * 0.8
    bonnet, roof = sill + u(0.22, 0.3), 0.0
    roof = bonnet + u(0.2, 0.32)
    front, back = u(0.3, 0.45) * long, -u(0.4, 0.95) * long
    solids = [block((0, (sill + bonnet) / 2, 0), (2 * wide, bonnet - sill, 2 * long), u(0.2, 0.9))]
    cabin = [(bonnet - 0.05, front + 0.1), (roof, front - u(0.15, 0.3)), (roof, back + u(0.0, 0.25))]
    cabin += [(bonnet - 0.05, back)]
    if rng.random() < 0.7:
        solids += [plate(cabin, 1.75 * wide, (0, 0, 0), "x")]
        solids += both(
            carved(
                block(
                    (0.9 * wide, (bonnet + roof) / 2, (front + back) / 2 - 0.02),
                    (0.1, 0.6 * (roof - bonnet), 0.55 * (front - back)),
                    0.2,
                )
            )
        )
    else:
        solids += [
            ball((0, bonnet - 0.05, (front + back) / 2), (wide * 0.9, roof - bonnet + 0.08, (front - back) / 2 + 0.1))
        ]
    return solids + _wheels(wide + 0.03, r, 0.15, [-0.6 * long, 0.62 * long])


def motorcycle(rng: Rng) -> list[Solid]:
    """Shape a motorcycle: two wheels in line, tank, saddle, fork and handlebars."""
    u = rng.uniform
    r, base, thick = u(0.27, 0.34), u(0.55, 0.68), u(0.1, 0.15)
    solids: list[Solid] = []
    for z in (-base, base):
        solids += [drum((-thick / 2, r, z), (thick / 2, r, z), r)]
        if rng.random() < 0.6:
            solids += both(carved(drum((0.6 * thick, r, z), (0.25 * thick, r, z), 0.62 * r)))
    top = r + u(0.42, 0.55)
    solids += both(rod((0.09, r, base), (0.09, top + 0.1, base - 0.3), 0.045))
    solids += [ball((0, top - 0.08, base - 0.62), (0.15, 0.14, 0.3))]
    solids += [block((0, top - 0.18, -0.35), (0.24, 0.12, u(0.5, 0.7)), 0.6)]
    solids += [block((0, r + 0.05, 0), (0.26, 0.32, 0.4), 0.3), rod((0, r + 0.1, 0), (0, r, -base), 0.08)]
    bar = np.array([u(0.28, 0.4), top + u(0.15, 0.28), base - 0.4])
    solids += both(rod((0, top + 0.1, base - 0.3), bar, 0.045)) + [ball((0, top + 0.02, base - 0.14), 0.12)]
    solids += both(rod((0.15, r - 0.08, 0.15), (0.15, r - 0.02, -base - 0.1), 0.055)) if rng.random() < 0.7 else []
    solids += [ball((0, 2 * r + 0.03, -base), (0.09, 0.06, 0.24))]
    if rng.random() < 0.35:
        solids += [block((0, top - 0.2, 0.42), (0.34, 0.5, 0.07), 0.3, (-20, 0, 0))]
        solids += [block((0, r * 0.6, 0.05), (0.3, 0.1, 0.5), 0.3)]
    return solids


def tank(rng: Rng) -> list[Solid]:
    """Shape a tank: tracks, hull, turret and a gun."""
    u = rng.uniform
    long, r, wide = u(0.65, 0.8), u(0.18, 0.23), u(0.42, 0.52)
    track = [(0.0, -long + r), (0.0, long - r * 1.5), (r, long), (2 * r, long - r * 0.5), (2 * r, -long + r * 0.5)]
    track += [(r, -long)]
    solids = both(plate(track, 0.22, (wide - 0.02, 0, 0), "x"))
    for z in np.linspace(-long + r, long - r * 1.2, 4):
        solids += both(drum((wide, r * 0.9, z), (wide + 0.13, r * 0.9, z), r * 0.6))
    solids += [block((0, r * 1.7, -0.02), (wide * 1.7, r * 1.6, 1.75 * long), 0.2)]
    top, at, high = r * 2.4, u(-0.2, 0.1), u(0.2, 0.28)
    if rng.random() < 0.5:
        solids += [drum((0, top, at), (0, top + high, at), u(0.3, 0.36), 0.25)]
    else:
        solids += [block((0, top + high / 2, at), (0.6, high, 0.6), u(0.1, 0.8))]
    gun = u(0.6, 1.0)
    solids += [rod((0, top + high * 0.55, at), (0, top + high * 0.55 + u(0, 0.15), at + gun + 0.25), u(0.05, 0.075))]
    return [*solids, drum((0.12, top + high, at - 0.1), (0.12, top + high + 0.08, at - 0.1), 0.11)]


def tractor(rng: Rng) -> list[Solid]:
    """Shape a tractor: huge wheels behind, small ones in front, a bonnet, a cabin and an exhaust."""
    u = rng.uniform
    big, small, nose = u(0.36, 0.46), u(0.18, 0.24), u(0.55, 0.75)
    solids = both(drum((0.26, big, -0.35), (0.48, big, -0.35), big))
    solids += both(drum((0.26, big, -0.35), (0.52, big, -0.35), big * 0.4))
    solids += both(drum((0.22, small, nose * 0.8), (0.36, small, nose * 0.8), small))
    solids += [block((0, big + 0.08, nose * 0.45), (0.36, 0.36, nose + 0.1), 0.3)]
    solids += [block((0, big - 0.12, 0.1), (0.3, 0.2, 1.1), 0)]
    solids += [rod((0, small, nose * 0.8), (0.25, small, nose * 0.8), 0.06)]
    solids += [rod((0, small, nose * 0.8), (-0.25, small, nose * 0.8), 0.06)]
    top = big + u(0.7, 0.85)
    if rng.random() < 0.7:
        solids += [block((0, (big + top) / 2, -0.35), (0.5, top - big, 0.5), 0.1)]
        solids += [block((0, top, -0.35), (0.6, 0.08, 0.62), 0.2)]
        solids += both(carved(block((0.28, top - 0.25, -0.35), (0.15, 0.3, 0.34), 0.1)))
        solids += [carved(block((0, top - 0.25, -0.1), (0.36, 0.3, 0.12), 0.1))]
    else:
        solids += [block((0, big + 0.2, -0.5), (0.36, 0.4, 0.12), 0.3)]
        solids += [hoop((0, big + 0.42, -0.1), 0.13, 0.04, (60, 0, 0))]
    return [*solids, rod((0.1, big + 0.2, nose * 0.6), (0.1, big + u(0.55, 0.7), nose * 0.6), 0.05)]


def train(rng: Rng) -> list[Solid]:
    """Shape a locomotive: a boiler with chimney and dome, a cab behind, wheels with rods, a cowcatcher."""
    u = rng.uniform
    r, wheel = u(0.22, 0.3), u(0.17, 0.23)
    axis = 2 * wheel + 0.5 * r + 0.06
    solids = [drum((0, axis, -0.3), (0, axis, 0.75), r), block((0, 2 * wheel, 0), (0.48, 0.14, 1.7), 0)]
    solids += [block((0, axis + 0.1, -0.55), (0.56, u(0.65, 0.8), 0.5), 0.05)]
    solids += [block((0, axis + 0.5, -0.55), (0.68, 0.08, 0.64), 0.3)]
    solids += both(carved(block((0.28, axis + 0.25, -0.55), (0.15, 0.22, 0.24), 0.1)))
    solids += [drum((0, axis, 0.55), (0, axis + r + u(0.28, 0.4), 0.55), 0.09, u(0.09, 0.16))]
    solids += [ball((0, axis + r, 0.1), (0.13, 0.17, 0.13)), *_wheels(0.32, wheel, 0.12, [-0.55, -0.1, 0.33])]
    solids += both(drum((0.2, wheel * 0.7, 0.7), (0.3, wheel * 0.7, 0.7), wheel * 0.7))
    solids += [plate([(0.02, 0.75), (0.02, 1.1), (2 * wheel, 0.8)], 0.5, (0, 0, 0), "x")]
    solids += [drum((0, axis, 0.7), (0, axis, 0.8), r * 0.7)]
    return solids + (both(rod((0.33, wheel, -0.55), (0.33, wheel, 0.33), 0.04)) if rng.random() < 0.7 else [])


def van(rng: Rng) -> list[Solid]:
    """Shape a van: one tall box with a short sloping nose; windows in front or all along."""
    u = rng.uniform
    wide, r, long, high, nose = u(0.32, 0.4), u(0.14, 0.19), u(0.65, 0.85), u(0.6, 0.8), u(0.15, 0.3)
    floor = r
    side = [(floor, -long), (floor, long + nose), (floor + 0.3, long + nose), (floor + 0.36, long)]
    side += [(floor + high, long - u(0.05, 0.15)), (floor + high, -long)]
    solids = [plate(side, 2 * wide, (0, 0, 0), "x")]
    solids += both(carved(block((wide, floor + 0.68 * high, long * 0.75), (0.08, 0.25, 0.25), 0.1)))
    solids += [carved(block((0, floor + 0.68 * high, long), (1.6 * wide, 0.25, 0.2), 0.1))]
    for z in np.linspace(-0.75, 0.3, 3) * long if rng.random() < 0.5 else ():
        solids += both(carved(block((wide, floor + 0.68 * high, z), (0.08, 0.25, 0.32), 0.1)))
    solids += [block((0, floor, z), (1.9 * wide, 0.1, 0.1), 0.2) for z in (-long, long + nose)]
    return solids + _wheels(wide + 0.02, r, 0.13, [-0.65 * long, long - 0.05])


def truck(rng: Rng) -> list[Solid]:
    """Shape a truck: a cab, and a box, a tank, a flat bed or a tipper behind a gap; or a pickup."""
    u = rng.uniform
    wide, r, long = u(0.3, 0.38), u(0.15, 0.22), u(0.85, 1.1)
    floor, cab, front = r + 0.14, u(0.55, 0.75), u(0.36, 0.5)
    solids = [block((0, floor - 0.05, -0.1), (wide * 1.4, 0.16, 2 * long - 0.2), 0)]
    solids += [block((0, floor + cab / 2 - 0.08, long - front / 2), (2 * wide, cab, front), u(0.1, 0.5))]
    solids += [carved(block((0, floor + cab * 0.62, long), (1.6 * wide, 0.3 * cab, 0.1), 0.1))]
    solids += both(carved(block((wide, floor + cab * 0.62, long - front * 0.45), (0.1, 0.3 * cab, front * 0.5), 0.1)))
    nose = u(0.2, 0.3) if rng.random() < 0.4 else 0.0
    if nose:
        solids += [block((0, floor + 0.13, long + nose / 2), (1.9 * wide, 0.36, nose + 0.1), 0.3)]
    start = long - front - u(0.05, 0.15)
    middle, size = (start - long) / 2, start + long
    match int(rng.integers(5)):
        case 0 | 1:
            high = u(0.7, 1.0)
            solids += [block((0, floor + high / 2, middle), (2.05 * wide, high, size), u(0.0, 0.15))]
        case 2:
            solids += [drum((0, floor + 0.3, -long), (0, floor + 0.3, start), wide * 0.95)]
        case 3:
            solids += [block((0, floor + 0.06, middle), (2 * wide, 0.12, size), 0)]
            solids += both(block((wide - 0.04, floor + 0.15, middle), (0.09, u(0.2, 0.35), size), 0))
            solids += [block((0, floor + 0.15, -long + 0.04), (2 * wide, 0.25, 0.09), 0)]
        case _:
            high = u(0.35, 0.5)
            tub = [(floor, -long), (floor, start), (floor + high, start + 0.08), (floor + high, -long - 0.08)]
            solids += [plate(tub, 2 * wide, (0, 0, 0), "x")]
            solids += [carved(block((0, floor + high, middle), (1.6 * wide, high * 1.2, size - 0.2), 0))]
    return solids + _wheels(
        wide + 0.02, r, 0.14, [-0.7 * long, -0.7 * long + 2.1 * r, long - front / 2][int(rng.random() < 0.35) :]
    )
