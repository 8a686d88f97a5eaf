"""Shape plants and emblems. y = 0 is the ground."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, around, ball, both, carved, drum, half_ball, petal, plate, rod, rods

__all__ = ["cactus", "flower", "heart", "mushroom", "palm", "pine", "star", "tree"]

Rng = np.random.Generator


def cactus(rng: Rng) -> list[Solid]:
    """Shape a cactus: a ribbed column with bent arms, often in a pot."""
    u = rng.uniform
    r, high = u(0.16, 0.22), u(0.9, 1.2)
    solids = [rod((0, 0, 0), (0, high, 0), r)]
    if rng.random() < 0.5:
        solids += [rod(way * r * 0.8, way * r * 0.8 + [0, high, 0], 0.07) for way, _ in around(8)]
    sides = [1.0, -1.0] if rng.random() < 0.75 else [1.0]
    for side in sides:
        y, out = high * u(0.3, 0.6), u(0.36, 0.48)
        solids += rods([(0, y, 0), (side * out, y, 0), (side * out, y + u(0.25, 0.5), 0)], [r * 0.7, r * 0.7, r * 0.65])
    if rng.random() < 0.5:
        solids += [drum((0, -0.3, 0), (0, 0.05, 0), r * 1.3, r * 1.8), drum((0, -0.03, 0), (0, 0.07, 0), r * 2.0)]
    return solids


def flower(rng: Rng) -> list[Solid]:
    """Shape a flower: a stem with leaves and a head of petals, a bell or a disc; sometimes in a pot."""
    u = rng.uniform
    high, r, leaf = u(0.8, 1.1), u(0.28, 0.42), u(0.17, 0.28)
    solids = [rod((0, 0, 0), (0, high, 0), 0.05)]
    for side in (1.0, -1.0):
        solids += [
            petal(
                np.array([0, high * u(0.15, 0.45), 0]),
                np.array([side, 0, 0]),
                90 * side,
                (0.09, 0.045, leaf),
                u(20, 50),
            )
        ]
    top, tilt = np.array([0, high, 0]), u(0, 1)
    if rng.random() < 0.65:
        face = rng.random() < 0.6
        for a in 2 * np.pi * np.arange(count := int(rng.integers(5, 9))) / count:
            if face:
                solids += [
                    ball(
                        top + r * 0.6 * np.array([np.sin(a), np.cos(a), 0.1]),
                        (r * 0.32, r * 0.55, 0.06),
                        (0, 0, -np.degrees(a)),
                    )
                ]
            else:
                way = np.array([np.sin(a), 0, np.cos(a)])
                solids += [petal(top, way, np.degrees(a), (r * 0.32, 0.06, r * 0.55), 25 * tilt)]
        solids += [ball(top + ([0, 0, 0.05] if face else [0, 0.04, 0]), r * 0.36)]
    else:
        solids += [ball(top + [0, 0.15, 0], (r * 0.65, 0.3, r * 0.65))]
        solids += [carved(drum(top + [0, 0.3, 0], top + [0, 0.6, 0], r * 0.4))]
        solids += [
            ball(way * r * 0.45 + top + [0, 0.25, 0], (r * 0.3, 0.25, 0.1), (0, degrees, 0))
            for way, degrees in around(5)
        ]
    if rng.random() < 0.35:
        solids += [drum((0, -0.25, 0), (0, 0.1, 0), 0.18, 0.26)]
    return solids


def mushroom(rng: Rng) -> list[Solid]:
    """Shape a mushroom: a domed, flat or pointed cap on a stem, sometimes with a ring or a small one beside."""
    u = rng.uniform
    cap, high, dome, r = u(0.42, 0.6), u(0.45, 0.75), u(0.22, 0.45), u(0.12, 0.2)
    solids = [drum((0, 0, 0), (0, high + 0.1, 0), r * u(1.0, 1.4), r)]
    top = half_ball((0, high, 0), (cap, dome, cap))
    if rng.random() < 0.25:
        top = [drum((0, high, 0), (0, high + dome * 1.5, 0), cap, 0.05)]
    solids = [*top, *solids, ball((0, 0.05, 0), (r * 1.4, 0.12, r * 1.4))]
    if rng.random() < 0.3:
        solids += [drum((0, high * 0.6, 0), (0, high * 0.68, 0), r * 1.7, r)]
    if rng.random() < 0.3:
        solids += [rod((0.35, 0, 0.15), (0.4, 0.25, 0.17), 0.08), ball((0.4, 0.28, 0.17), (0.19, 0.12, 0.19))]
    return solids


def palm(rng: Rng) -> list[Solid]:
    """Shape a palm: a bent ringed trunk and a crown of drooping leaves, with nuts."""
    u = rng.uniform
    high, bow, leaf, count = u(0.9, 1.3), u(-0.3, 0.3), u(0.5, 0.7), int(rng.integers(6, 10))
    path = [np.array([bow * s * s, high * s, 0]) for s in np.linspace(0, 1, 6)]
    solids = rods(path, [0.12, 0.1, 0.09, 0.08, 0.075, 0.075])
    top = path[-1]
    for way, degrees in around(count, u(0, 1)):
        droop = u(0.2, 0.45)
        a, b = top + way * leaf * 0.5 + [0, u(0.08, 0.2), 0], top + way * leaf - [0, droop, 0]
        solids += [rod(top, a, 0.06, 0.08), rod(a, b, 0.08, 0.03)]
        solids += [
            ball((a + b) / 2, (0.13, 0.05, leaf * 0.36), (np.degrees(np.arctan2(a[1] - b[1], leaf * 0.5)), degrees, 0))
        ]
    return solids + [ball(top + way * 0.1 - [0, 0.07, 0], 0.08) for way, _ in around(3)]


def pine(rng: Rng) -> list[Solid]:
    """Shape a pine: cones of branches, one above the other, on a trunk."""
    u = rng.uniform
    count, r, y, trunk = int(rng.integers(2, 6)), u(0.42, 0.55), 0.0, u(0.15, 0.3)
    solids = [drum((0, 0, 0), (0, trunk + 0.3, 0), u(0.08, 0.12))]
    y, sides = trunk, int(rng.choice([0, 0, 6]))
    step = u(1.0, 1.4) / count
    for k in range(count):
        wide = r * (1 - 0.72 * k / count)
        solids += [drum((0, y, 0), (0, y + step * u(1.5, 1.8), 0), wide, 0.03, sides=sides)]
        y += step
    return solids


def tree(rng: Rng) -> list[Solid]:
    """Shape a broad tree: a trunk with branches under one ball of leaves, or under several."""
    u = rng.uniform
    trunk, r, size = u(0.5, 0.75), u(0.09, 0.14), u(0.42, 0.55)
    solids = rods([(0, 0, 0), (0, trunk, 0), (0, trunk + size * 0.6, 0)], [r * 1.4, r, r * 0.8])
    top = np.array([0, trunk + size * 0.7, 0])
    match int(rng.integers(3)):
        case 0:
            solids += [ball(top, (size, size * u(0.8, 1.15), size))]
        case 1:
            solids += [
                ball(top + rng.normal(size=3) * 0.24 * size * 2 * np.array([1, 0.6, 1]), size * u(0.45, 0.65))
                for _ in range(8)
            ]
        case _:
            for way, _ in around(int(rng.integers(3, 5)), u(0, 2)):
                at = top + way * size * 0.75 + [0, u(-0.1, 0.2), 0]
                solids += [rod((0, trunk * 0.8, 0), at, 0.06), ball(at, size * u(0.48, 0.62))]
            solids += [ball(top + [0, 0.3 * size, 0], size * 0.65)]
    return solids


def heart(rng: Rng) -> list[Solid]:
    """Shape an upright heart, flat or like a cushion."""
    u = rng.uniform
    r, deep, thick = u(0.3, 0.36), u(0.65, 0.85), u(0.12, 0.3)
    if rng.random() < 0.5:
        a = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        outline = np.stack(
            [0.6 * np.sin(a) ** 3, (13 * np.cos(a) - 5 * np.cos(2 * a) - 2 * np.cos(3 * a) - np.cos(4 * a)) / 25], 1
        )
        return [plate(outline * [1, u(0.85, 1.15)], 2 * thick, (0, 0, 0))]
    solids = both(ball((r * 0.85, 0.2, 0), (r, r, thick)))
    for s in np.linspace(0, 1, 8):
        solids += both(
            ball((r * 0.85 * (1 - s), 0.2 - deep * s, 0), (r * (1 - 0.8 * s), r * (1 - 0.8 * s), thick * (1 - 0.5 * s)))
        )
    return [*solids, *both(rod((r * 1.35, 0.02, 0), (0, -deep, 0), thick * 0.8, 0.08))]


def star(rng: Rng) -> list[Solid]:
    """Shape an upright star of five or more points: a plate, a ridged one, or a starfish of rods."""
    u = rng.uniform
    count, inner, thick = int(rng.choice([5, 5, 5, 6, 8])), u(0.35, 0.52), u(0.14, 0.3)
    a = np.pi / 2 + np.pi * np.arange(2 * count) / count
    outline = np.stack([np.cos(a), np.sin(a)], 1) * np.where(np.arange(2 * count) % 2, inner, 1.0)[:, None] * 0.7
    if rng.random() < 0.4:
        return [plate(outline, thick, (0, 0, 0))]
    points = outline[::2]
    if rng.random() < 0.5:
        return [
            ball((0, 0, 0), (0.3, 0.3, thick)),
            *[rod((0, 0, 0), (x, y, 0), u(0.17, 0.22), 0.06) for x, y in points],
        ]
    return [plate(outline * s, thick * (1.3 - s) * 1.6, (0, 0, 0)) for s in (1.0, 0.85, 0.7, 0.55, 0.4)]
