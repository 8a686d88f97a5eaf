"""Shape animals of the sea and small creatures."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, both, hoop, plate, rod, rods

__all__ = ["butterfly", "crab", "dolphin", "fish", "frog", "octopus", "shark", "snail", "snake", "spider", "whale"]

Rng = np.random.Generator


def butterfly(rng: Rng) -> list[Solid]:
    """Shape a butterfly: four round wings about a thin body, with feelers."""
    u = rng.uniform
    solids = rods([(0, 0, 0.5), (0, 0, 0), (0, 0, -0.5)], [0.09, 0.11, 0.06]) + [ball((0, 0, 0.55), 0.12)]
    tilt, thick = u(-15, 50), u(0.07, 0.1)
    if rng.random() < 0.5:
        solids += both(ball((0.48, 0, 0.32), (0.5, thick / 2, 0.36), (0, u(-40, -15), 0)))
        solids += both(ball((0.38, 0, -0.33), (0.4, thick / 2, 0.3), (0, u(20, 45), 0)))
        solids = _lifted(solids, tilt, 3)
    else:
        wing = [(0.1, 0), (0.75, u(0.7, 1.0)), (0.45, 1.0), (0.05, 0.7), (-0.1, 0.6), (-0.55, 0.7), (-0.6, 0.4)]
        wing += [(-0.1, 0)]
        solids += both(plate(wing, thick, (0, 0, 0), "y", (0, 0, tilt)))
    return solids + both(rods([(0.03, 0.05, 0.6), (0.12, 0.2, 0.85), (0.25, 0.25, 0.95)], [0.035, 0.03, 0.045]))


def _lifted(solids: list[Solid], degrees: float, keep: int) -> list[Solid]:
    """Raise the wings (all but the first `keep` solids) about the body's axis."""
    angle = np.radians(degrees)
    slope = float(np.tan(angle))

    def bent(solid: Solid) -> Solid:
        lift = max(abs(solid.low[0]), abs(solid.high[0])) * abs(slope)

        def field(p: np.ndarray) -> np.ndarray:
            q = p.copy()
            q[:, 1] -= np.abs(p[:, 0]) * slope
            return solid.field(q) * float(np.cos(angle))

        return Solid(field, solid.low - [0, lift, 0], solid.high + [0, lift, 0], solid.hole)

    return solids[:keep] + [bent(solid) for solid in solids[keep:]]


def crab(rng: Rng) -> list[Solid]:
    """Shape a crab: a wide flat body, eight bent legs, two raised claws, eyes on stalks."""
    u = rng.uniform
    wide, claw = u(0.55, 0.7), u(0.18, 0.28)
    solids = [ball((0, 0.35, 0), (wide, u(0.2, 0.3), 0.42))]
    for at in np.linspace(-0.35, 0.2, 4):
        solids += both(
            rods(
                [(wide * 0.7, 0.35, at), (wide + 0.3, u(0.45, 0.6), at * 1.4), (wide + 0.5, 0, at * 1.8)],
                [0.08, 0.075, 0.04],
            )
        )
    elbow = np.array([wide + u(0.1, 0.25), u(0.35, 0.5), 0.4])
    hand = np.array([u(0.4, 0.7), u(0.45, 0.85), u(0.65, 0.85)])
    solids += both(rods([(wide * 0.7, 0.35, 0.25), elbow, hand], [0.1, 0.09, 0.1]))
    solids += both([ball(hand + [0, 0.1, 0.08], (claw * 0.85, claw, claw * 0.6)),
                  rod(hand + [0.06, 0.2, 0.1], hand + [0.12, 0.25 + claw, 0.22], 0.09, 0.03),
                  rod(hand + [-0.08, 0.2, 0.1], hand + [-0.17, 0.25 + claw, 0.22], 0.08, 0.03)])  # fmt: skip
    return solids + both([rod((0.13, 0.45, 0.33), (0.16, 0.72, 0.38), 0.05), ball((0.16, 0.74, 0.38), 0.085)])


def _swimmer(rng: Rng, deep: float, wide: float) -> list[Solid]:
    """Return a spindle from the nose at z = 1 to the tail at z = -1."""
    u = rng.uniform
    return rods([(0, u(-0.05, 0.05), 0.85), (0, 0, 0.35), (0, 0, -0.1), (0, 0, -0.95)],
                [0.12, deep, deep * u(0.9, 1.1) * wide, 0.07])  # fmt: skip


def dolphin(rng: Rng) -> list[Solid]:
    """Shape a dolphin: bowed, with a beak, a fin on the back and level flukes."""
    u = rng.uniform
    bow, deep = u(0.05, 0.3), u(0.25, 0.32)
    solids = rods([(0, -bow * 0.7, 0.75), (0, 0, 0.3), (0, 0, -0.2), (0, -bow, -0.95)], [0.19, deep, deep * 0.95, 0.07])
    nose = np.array([0, -bow * 0.7 - 0.06, 0.8])
    solids += [rod(nose, nose + [0, -0.06, u(0.28, 0.42)], 0.1, 0.06), _fin(rng, deep * 0.75, 0.0, u(0.3, 0.42))]
    solids += both(ball((0.32, -0.2, 0.35), (0.28, 0.05, 0.13), (0, 25, -35)))
    flukes = [(0.12, 0), (-0.05, 0.35), (-0.25, 0.5), (-0.22, 0.2), (-0.16, 0), (-0.22, -0.2), (-0.25, -0.5)]
    flukes += [(-0.05, -0.35)]
    return [*solids, plate(flukes, 0.08, (0, -bow, -0.95), "y")]


def _fin(rng: Rng, height: float, at: float, size: float) -> Solid:
    """Return an upright fin on the back, swept backwards."""
    sweep = rng.uniform(0.8, 1.2) * size
    outline = [(-0.08, 0.6 * size), (size, 0.5 * size - sweep), (size, 0.35 * size - sweep), (-0.08, -0.5 * size)]
    return plate(outline, 0.1, (0, height, at), "x")


def fish(rng: Rng) -> list[Solid]:
    """Shape a fish: flattened sideways, an upright forked tail, fins above, below and beside."""
    u = rng.uniform
    deep, wide, long = u(0.32, 0.55), u(0.16, 0.26), u(0.65, 0.8)
    solids = [ball((0, 0, 0.1), (wide, deep, long))]
    tall, fork = u(0.35, 0.55), u(0.0, 0.25)
    solids += [plate([(0, -0.3), (tall, -0.75), (0, -0.75 + fork), (-tall, -0.75), (0, -0.3)], 0.1, (0, 0, -0.35), "x")]
    solids += [
        plate(
            [(0.6 * deep, 0.3), (deep + u(0.2, 0.35), -0.1), (deep + 0.1, -0.4), (0.5 * deep, -0.35)],
            0.1,
            (0, 0, 0.05),
            "x",
        )
    ]
    solids += [plate([(-0.6 * deep, 0.15), (-deep - 0.2, -0.15), (-0.5 * deep, -0.25)], 0.1, (0, 0, 0.05), "x")]
    return solids + both(ball((wide + 0.1, -0.08, 0.25), (0.2, 0.05, 0.13), (0, 35, -30)))


def frog(rng: Rng) -> list[Solid]:
    """Shape a sitting frog: folded hind legs, eyes on top of the head, a wide mouth."""
    u = rng.uniform
    wide, tilt = u(0.38, 0.5), u(15, 40)
    solids = [ball((0, 0.4, 0), (wide, 0.33, 0.55), (-tilt, 0, 0))]
    solids += [ball((0, 0.58, 0.36), (wide * u(0.85, 1.0), 0.24, 0.33))]
    solids += both(ball((wide * 0.55, 0.84, 0.35), u(0.13, 0.2)))
    solids += both(ball((wide + 0.08, 0.28, -0.2), (0.17, 0.22, 0.4), (20, 15, 0)))
    solids += both(ball((wide + u(0.1, 0.25), 0.06, 0.15), (0.16, 0.07, 0.33), (0, 30, 0)))
    solids += both(
        [rod((0.28, 0.4, 0.35), (0.33, 0.08, 0.55), 0.11, 0.08), ball((0.35, 0.05, 0.65), (0.14, 0.06, 0.16))]
    )
    return solids


def octopus(rng: Rng) -> list[Solid]:
    """Shape an octopus: a big soft head over eight curling arms."""
    u = rng.uniform
    head, high = u(0.38, 0.5), u(0.7, 0.95)
    solids = [ball((0, high, u(-0.12, 0)), (head, head * u(1.0, 1.3), head)), ball((0, 0.35, 0), (0.32, 0.3, 0.32))]
    solids += both(ball((0.22, 0.6, 0.35), 0.11))
    turn, long, curl = u(0, 0.8), u(0.8, 1.1), u(0.1, 0.4)
    for k in range(8):
        a = turn + k * np.pi / 4
        d, s = np.array([np.sin(a), 0, np.cos(a)]), np.array([np.cos(a), 0, -np.sin(a)]) * u(-0.25, 0.25)
        solids += rods(
            [
                d * 0.2 + [0, 0.3, 0],
                d * 0.5 * long + [0, 0.08, 0] + s,
                d * 0.8 * long + [0, 0.08, 0] - s,
                d * long + [0, curl, 0] + s,
            ],
            [0.16, 0.13, 0.1, 0.05],
        )
    return solids


def shark(rng: Rng) -> list[Solid]:
    """Shape a shark: a pointed spindle with a high fin, an upright crescent tail and fins to the sides."""
    u = rng.uniform
    solids = _swimmer(rng, u(0.24, 0.3), 1.0) + [rod((0, -0.02, 0.8), (0, 0.03, 1.1), 0.14, 0.05)]
    solids += [_fin(rng, 0.2, 0.15, u(0.42, 0.58))]
    tall = u(0.5, 0.65)
    solids += [
        plate(
            [
                (0.05, 0.1),
                (tall, -0.35),
                (tall, -0.45),
                (0.02, -0.12),
                (-0.6 * tall, -0.35),
                (-0.6 * tall, -0.25),
                (-0.05, 0.1),
            ],
            0.1,
            (0, 0, -0.9),
            "x",
        )
    ]
    side = [(0.35, 0.1), (-0.1, u(0.6, 0.75)), (-0.22, 0.62), (0.0, 0.1)]
    return solids + both(plate(side, 0.09, (0.02, -0.08, 0.2), "y", (0, 0, u(-35, -10))))


def snail(rng: Rng) -> list[Solid]:
    """Shape a snail: a coiled shell on a long foot, with two stalks."""
    u = rng.uniform
    r, wide = u(0.42, 0.55), u(0.24, 0.34)
    foot = rods([(0, 0.1, -0.9), (0, 0.14, 0), (0, 0.16, 0.55), (0, u(0.35, 0.55), 0.8)], [0.07, 0.2, 0.19, 0.17])
    at = np.array([0, r + 0.2, -0.12])
    solids = [*foot, ball(at, (wide, r, r))]
    for k, size in enumerate((0.72, 0.42)):
        solids += both(ball(at + [wide * (0.65 + 0.3 * k), 0.05 * k, -0.04 * k], (0.14, r * size, r * size)))
    head = foot[2].high[1] - 0.12
    return solids + both(
        [rod((0.08, head, 0.83), (0.17, head + u(0.28, 0.4), 0.95), 0.045), ball((0.17, head + 0.38, 0.95), 0.075)]
    )


def snake(rng: Rng) -> list[Solid]:
    """Shape a snake: winding along the ground, or coiled with a raised head."""
    u = rng.uniform
    thick = u(0.1, 0.15)
    if rng.random() < 0.5:
        at = np.linspace(0, 1, 22)
        swing, waves = u(0.3, 0.45), u(1.3, 2.0)
        path = [
            np.array(
                [swing * np.sin(2 * np.pi * waves * s), thick + 0.35 * max(s - 0.85, 0) / 0.15 * u(0.3, 1.0), 2 * s - 1]
            )
            for s in at
        ]
        radii = list(thick * np.clip(4 * at, 0.25, 1.0))
    else:
        at = np.linspace(0, 1, 34)
        turns, wide, rise = u(2.0, 2.8), u(0.5, 0.65), u(0.3, 0.5)
        path = []
        for s in at:
            a, r = 2 * np.pi * turns * s, wide * (1 - 0.65 * s)
            path.append(np.array([r * np.sin(a), thick + rise * s, r * np.cos(a)]))
        path[-3:] = [path[-4] + np.array([0, d, e]) for d, e in ((0.2, 0.0), (0.4, 0.05), (0.5, 0.2))]
        radii = list(thick * np.clip(4 * at, 0.3, 1.0))
    head = path[-1] + [0, 0.03, 0.1]
    flat = [ball(head, (thick * 1.5, thick * 0.9, thick * 2.0))]
    return rods(path, radii) + [rod(path[-1], head, thick)] + flat


def spider(rng: Rng) -> list[Solid]:
    """Shape a spider: two balls and eight high bent legs."""
    u = rng.uniform
    r, high, reach = u(0.28, 0.38), u(0.2, 0.35), u(0.85, 1.15)
    solids = [ball((0, high + 0.1, -0.35), (r, r * 0.9, r * 1.2)), ball((0, high, 0.15), (0.2, 0.17, 0.24))]
    knee = high + u(0.25, 0.5)
    for a in np.radians([28, 65, 105, 145]) + u(-0.1, 0.1):
        d = np.array([np.sin(a), 0, np.cos(a)])
        solids += both(
            rods(
                [d * 0.15 + [0, high, 0.1], d * 0.55 * reach + [0, knee, 0.1], d * reach + [0, 0, 0.1]],
                [0.065, 0.055, 0.04],
            )
        )
    return solids + both(rod((0.08, high, 0.35), (0.09, high - 0.1, 0.5), 0.06, 0.04))


def whale(rng: Rng) -> list[Solid]:
    """Shape a whale: a drop with a raised tail and level flukes."""
    u = rng.uniform
    wide, high, lift = u(0.4, 0.5), u(0.35, 0.46), u(0.1, 0.6)
    solids = [ball((0, 0.35, 0.3), (wide, high, 0.65))]
    solids += rods([(0, 0.35, 0.1), (0, 0.3, -0.5), (0, 0.3 + lift, -1.0)], [high * 0.95, 0.2, 0.08])
    flukes = [(0.12, 0), (0.0, 0.4), (-0.28, 0.55), (-0.22, 0.2), (-0.14, 0), (-0.22, -0.2), (-0.28, -0.55)]
    flukes += [(0.0, -0.4)]
    solids += [plate(flukes, 0.1, (0, 0.3 + lift, -1.0), "y", (u(-10, 35), 0, 0))]
    if rng.random() < 0.3:
        solids += [hoop((0, 0.8, 0.4), 0.12, 0.06, (0, 90, 0))]
    return solids + both(ball((wide + 0.12, 0.15, 0.3), (0.28, 0.06, 0.16), (0, 30, -25)))
