"""Shape buildings. They face +Z; y = 0 is the ground."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, carved, drum, hoop, plate, rod

__all__ = ["castle", "church", "house", "igloo", "lighthouse", "skyscraper", "tent", "windmill"]

Rng = np.random.Generator


def castle(rng: Rng) -> list[Solid]:
    """Shape a castle: four towers with battlements or pointed roofs, walls, a gate and a keep."""
    u = rng.uniform
    half, wall, r, high = u(0.6, 0.75), u(0.45, 0.6), u(0.17, 0.24), u(0.8, 1.15)
    solids = [block((0, wall / 2, 0), (2 * half, wall, 2 * half), 0.0)]
    pointed, square = rng.random() < 0.45, rng.random() < 0.3
    sides = 4 if square else 0
    for x in (-half, half):
        for z in (-half, half):
            solids += [drum((x, 0, z), (x, high, z), r, sides=sides)]
            if pointed:
                solids += [drum((x, high, z), (x, high + u(0.35, 0.45), z), r * 1.25, 0.02)]
            else:
                solids += [drum((x, high - 0.05, z), (x, high + 0.12, z), r * 1.2, sides=sides)]
                solids += [carved(block((x, high + 0.12, z), (0.12, 0.16, 1.0), 0))]
                solids += [carved(block((x, high + 0.12, z), (1.0, 0.16, 0.12), 0))]
    for at in np.linspace(-half, half, 6)[1:-1] + 0.02:
        solids += [block((at, wall + 0.04, z), (0.13, 0.16, 0.12), 0) for z in (-half, half)]
        solids += [block((x, wall + 0.04, at), (0.12, 0.16, 0.13), 0) for x in (-half, half)]
    keep = u(0.95, 1.4)
    if rng.random() < 0.6:
        solids += [block((0, keep / 2, -0.05), (u(0.4, 0.6), keep, 0.5), 0)]
        solids += [drum((0, keep, -0.05), (0, keep + 0.4, -0.05), 0.4, 0.02, sides=4)] if pointed else []
    return [*solids, carved(block((0, 0.16, half), (0.3, 0.34, 0.25), 0.3))]


def church(rng: Rng) -> list[Solid]:
    """Shape a church: a nave with a steep roof, and a tower with a spire at its front."""
    u = rng.uniform
    wide, wall, long, roof = u(0.3, 0.4), u(0.42, 0.55), u(0.6, 0.8), u(0.3, 0.45)
    nave = [(-wide, 0), (wide, 0), (wide, wall), (wide + 0.05, wall), (0, wall + roof), (-wide - 0.05, wall)]
    nave += [(-wide, wall)]
    solids = [plate(nave, 2 * long, (0, 0, 0))]
    side, tower, spire = u(0.17, 0.23), u(0.85, 1.15), u(0.5, 0.85)
    z = long + 0.05
    solids += [block((0, tower / 2, z), (2 * side, tower, 2 * side), 0)]
    solids += [drum((0, tower, z), (0, tower + spire, z), side * 1.1, 0.02, sides=int(rng.choice([4, 8, 0])))]
    if rng.random() < 0.5:
        solids += [block((0, tower + spire + 0.1, z), (0.07, 0.3, 0.07), 0)]
        solids += [block((0, tower + spire + 0.13, z), (0.22, 0.07, 0.07), 0)]
    solids += [carved(block((0, 0.14, z + side), (0.18, 0.3, 0.14), 0.4))]
    solids += [carved(block((0, tower * 0.75, z + side), (0.15, 0.22, 0.12), 0.4))]
    for at in (-0.55, -0.1, 0.35):
        solids += both(carved(block((wide, wall * 0.55, at * long), (0.1, wall * 0.5, 0.16), 0.4)))
    return solids


def house(rng: Rng) -> list[Solid]:
    """Shape a house with a gabled or a hipped roof, chimney, door and windows."""
    u = rng.uniform
    wide, wall, long, roof, eaves = u(0.4, 0.6), u(0.4, 0.65), u(0.4, 0.6), u(0.3, 0.5), u(0.05, 0.14)
    solids = [block((0, wall / 2, 0), (2 * wide, wall, 2 * long), 0)]
    if rng.random() < 0.75:
        gable = [(-wide - eaves, wall - 0.03), (wide + eaves, wall - 0.03), (0, wall + roof)]
        solids += [plate(gable, 2 * (long + eaves), (0, 0, 0))]
    else:
        solids += [drum((0, wall - 0.03, 0), (0, wall + roof, 0), wide + eaves, 0.05, sides=4)]
    if rng.random() < 0.7:
        solids += [block((wide * 0.5, wall + roof * 0.65, -long * 0.4), (0.16, roof * 0.9, 0.16), 0)]
    solids += [carved(block((u(-0.1, 0.1), wall * 0.3, long), (0.2, wall * 0.62, 0.12), 0))]
    solids += both(carved(block((wide * 0.62, wall * 0.6, long), (0.18, 0.18, 0.12), 0)))
    return solids + both(carved(block((wide, wall * 0.6, 0), (0.12, 0.18, 0.3), 0)))


def igloo(rng: Rng) -> list[Solid]:
    """Shape an igloo: half a ball of blocks with an arched tunnel."""
    u = rng.uniform
    r, high, door, out = u(0.6, 0.7), u(0.5, 0.68), u(0.24, 0.32), u(0.2, 0.4)
    solids = [ball((0, 0, 0), (r, high, r)), drum((0, 0, r * 0.6), (0, 0, r + out), door)]
    for y in (0.28, 0.55, 0.8):
        ring = hoop((0, y * high, 0), r * float(np.sqrt(1 - y * y)) + 0.02, 0.04, (90, 0, 0))
        solids += [carved(ring)] if y < 0.9 else []
    solids += [carved(drum((0, 0, r * 0.8), (0, 0, r + out + 0.1), door * 0.62))]
    return [*solids, carved(block((0, -0.5, 0), (4, 1, 4), 0))]


def lighthouse(rng: Rng) -> list[Solid]:
    """Shape a lighthouse: a tall tapered tower, a gallery, a lantern and a cap."""
    u = rng.uniform
    foot, top, high = u(0.28, 0.36), u(0.16, 0.21), u(1.2, 1.6)
    solids = [drum((0, 0, 0), (0, high, 0), foot, top), drum((0, high, 0), (0, high + 0.08, 0), top * 1.6)]
    solids += [drum((0, high, 0), (0, high + 0.3, 0), top * 0.8)]
    solids += [drum((0, high + 0.3, 0), (0, high + u(0.45, 0.55), 0), top * 1.2, 0.03)]
    solids += [hoop((0, high + 0.18, 0), top * 1.5, 0.03, (90, 0, 0))]
    match int(rng.integers(3)):
        case 0:
            solids += [drum((0, -0.1, 0), (0, 0.08, 0), foot * 1.7, foot * 1.4)]
        case 1:
            solids += [block((0, 0.15, foot + 0.15), (0.4, 0.3, 0.4), 0), ball((0, -0.05, 0.1), (0.7, 0.15, 0.7))]
        case _:
            solids += [ball((u(-0.1, 0.1), -0.05, 0), (0.6, 0.2, 0.55))]
    return solids


def skyscraper(rng: Rng) -> list[Solid]:
    """Shape a skyscraper: steps that get smaller upward, grooves between rows of windows, a spire."""
    u = rng.uniform
    wide, deep, y = u(0.32, 0.45), u(0.3, 0.42), 0.0
    solids: list[Solid] = []
    for k in range(int(rng.integers(2, 5))):
        high = u(0.5, 1.0) if k else u(0.5, 0.9)
        solids += [block((0, y + high / 2, 0), (2 * wide, high, 2 * deep), 0)]
        y += high
        wide, deep = wide * u(0.68, 0.85), deep * u(0.68, 0.85)
    if rng.random() < 0.7:
        solids += [drum((0, y, 0), (0, y + 0.2, 0), wide * 0.6, 0.07, sides=4)]
        solids += [rod((0, y, 0), (0, y + u(0.4, 0.6), 0), 0.05)]
    for at in (-0.27, -0.09, 0.09, 0.27):
        side = solids[0].high
        if rng.random() < 0.8:
            solids += [carved(block((at, y / 2, z), (0.06, 2 * y, 0.07), 0)) for z in (-side[2], side[2])]
    return solids


def tent(rng: Rng) -> list[Solid]:
    """Shape a tent: a ridge, a cone or a dome, with an open door."""
    u = rng.uniform
    wide, high, long = u(0.5, 0.7), u(0.55, 0.75), u(0.55, 0.85)
    match int(rng.integers(4)):
        case 0 | 1:
            solids = [plate([(-wide, 0), (wide, 0), (0.03, high), (-0.03, high)], 2 * long, (0, 0, 0))]
            solids += [carved(plate([(-0.3 * wide, 0), (0.3 * wide, 0), (0, 0.7 * high)], 0.5, (0, 0, long)))]
            if rng.random() < 0.5:
                solids += [rod((0, high * 0.9, z), (0, high + 0.1, z), 0.05) for z in (-long, long)]
                solids += both(rod((wide, 0, 0), (wide + 0.2, 0, 0), 0.04))
        case 2:
            high *= 1.5
            solids = [drum((0, 0, 0), (0, high, 0), wide, 0.04, sides=int(rng.choice([0, 4, 6, 8])))]
            solids += [carved(plate([(-0.25, 0), (0.25, 0), (0, 0.6 * high)], 0.8, (0, 0, wide)))]
            solids += both(rod((0, high * 0.9, 0), (0.12, high + 0.18, 0), 0.04))
        case _:
            wall = u(0.3, 0.45)
            solids = [block((0, wall / 2, 0), (2 * wide, wall, 2 * long), 0)]
            solids += [drum((0, wall, 0), (0, wall + high * 0.8, 0), wide * 1.08, 0.03, sides=4)]
            solids += [carved(block((0, wall * 0.4, long), (0.6 * wide, wall * 0.85, 0.4), 0))]
    return solids


def windmill(rng: Rng) -> list[Solid]:
    """Shape a windmill: a tapered tower with a cap and four sails in front."""
    u = rng.uniform
    foot, top, high, arm = u(0.36, 0.46), u(0.2, 0.27), u(1.0, 1.25), u(0.65, 0.85)
    solids = [drum((0, 0, 0), (0, high, 0), foot, top, sides=int(rng.choice([0, 4, 8])))]
    solids += [
        drum((0, high, 0), (0, high + u(0.2, 0.35), 0), top * 1.2, 0.04)
        if rng.random() < 0.5
        else ball((0, high, 0), (top * 1.15, top, top * 1.15))
    ]
    hub = np.array([0, high * 0.93, top + 0.18])
    solids += [rod((0, high * 0.93, 0), hub, 0.08)]
    turn, broad = u(0, 90), u(0.09, 0.13)
    for k in range(4):
        a = turn + 90 * k
        solids += [
            plate(
                [(-0.03, 0), (0.03, 0), (0.03, 0.2 * arm), (broad * 1.6, 0.25 * arm), (broad * 1.6, arm), (-0.05, arm)],
                0.07,
                hub,
                "z",
                (0, 0, a),
            )
        ]
    return [*solids, carved(block((0, 0.15, foot), (0.2, 0.32, 0.3), 0.2))]
