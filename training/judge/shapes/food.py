"""Shape food. y = 0 is the plate."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import (
    Solid,
    around,
    ball,
    block,
    both,
    carved,
    drum,
    half_ball,
    hoop,
    petal,
    plate,
    rod,
    rods,
    spun,
)

__all__ = [
    "apple", "banana", "bread", "burger", "cake", "carrot", "corn", "cupcake", "hotdog", "pear", "pineapple",
    "pumpkin", "strawberry",
]  # fmt: skip

Rng = np.random.Generator


def _rounded(profile: list[tuple[float, float]]) -> np.ndarray:
    """Round the corners of an open outline by cutting them three times (Chaikin 1974); its ends stay."""
    points = np.array(profile)
    for _ in range(3):
        near, far = 0.75 * points[:-1] + 0.25 * points[1:], 0.25 * points[:-1] + 0.75 * points[1:]
        points = np.concatenate([points[:1], np.stack([near, far], 1).reshape(-1, 2), points[-1:]])
    return points


def apple(rng: Rng) -> list[Solid]:
    """Shape an apple: broad above, dented at both ends, with a stem and often a leaf."""
    u = rng.uniform
    r, high = u(0.5, 0.6), u(0.42, 0.52)
    profile = [(0, -high * 0.82), (0.2, -high * 0.98), (0.7 * r, -high * 0.7), (r, 0.1), (r * 0.93, high * 0.65)]
    profile += [(0.6 * r, high * 0.98), (0.2, high * 0.95), (0, high * u(0.45, 0.6))]
    solids = [spun(_rounded(profile)), rod((0, high * 0.4, 0), (u(-0.1, 0.1), high + u(0.15, 0.3), 0), 0.045)]
    if rng.random() < 0.6:
        solids += [ball((0.2, high + 0.15, 0), (0.22, 0.05, 0.11), (0, u(-40, 40), u(10, 35)))]
    return solids


def pear(rng: Rng) -> list[Solid]:
    """Shape a pear: a ball that runs into a narrow top, with a stem."""
    u = rng.uniform
    r, top, high = u(0.4, 0.5), u(0.16, 0.24), u(0.62, 0.85)
    solids = [ball((0, 0, 0), (r, r * 0.95, r)), rod((0, 0.1, 0), (0, high, 0), r * 0.8, top)]
    return [*solids, rod((0, high, 0), (u(-0.12, 0.12), high + u(0.3, 0.42), 0), 0.045)]


def banana(rng: Rng) -> list[Solid]:
    """Shape a banana: a bent tapered rod with a stem, lying on its side or standing; sometimes a bunch."""
    u = rng.uniform
    bow, thick, span = u(0.7, 1.0), u(0.14, 0.2), u(70, 110)
    angles = np.radians(np.linspace(-span, span, 9) * 0.8 - 90)
    radii = thick * np.array([0.45, 0.75, 0.95, 1, 1, 1, 0.95, 0.75, 0.4])
    solids: list[Solid] = []
    for k in range(int(rng.choice([1, 1, 1, 3]))):
        path = [bow * np.array([np.cos(a), np.sin(a), 0]) + [0, 0, (k - 1) * thick * 1.6] for a in angles]
        solids += [*rods(path, list(radii)), rod(path[-1], path[-1] + [-0.03, 0.17, 0], thick * 0.4, thick * 0.38)]
    return solids


def burger(rng: Rng) -> list[Solid]:
    """Shape a burger: a domed bun, layers and a flat bun."""
    u = rng.uniform
    r, dome, layers = u(0.55, 0.65), u(0.28, 0.4), int(rng.integers(2, 5))
    solids, y = [drum((0, 0, 0), (0, 0.16, 0), r * 0.93, r)], 0.2
    for _ in range(layers):
        match int(rng.integers(3)):
            case 0:
                thick = u(0.1, 0.17)
                solids += [drum((0, y - 0.02, 0), (0, y + thick, 0), r * 1.05)]
            case 1:
                thick = 0.07
                solids += [block((0, y + 0.03, 0), (1.7 * r, 0.08, 1.7 * r), 0, (0, u(0, 90), 0))]
            case _:
                thick = 0.1
                solids += [
                    ball(way * r * 0.95 + [0, y + 0.04, 0], (0.2, 0.06, 0.2), (u(-15, 15), 0, u(-15, 15)))
                    for way, _ in around(10)
                ]
                solids += [drum((0, y, 0), (0, y + 0.08, 0), r * 0.95)]
        y += thick
    if rng.random() < 0.5:
        solids += [ball(way * r * 0.5 + [0, y + 0.06 + dome * 0.85, 0], 0.05) for way, _ in around(5, u(0, 1))]
    return [*half_ball((0, y + 0.03, 0), (r, dome, r)), *solids]


def cake(rng: Rng) -> list[Solid]:
    """Shape a cake: one to three tiers with candles or a cherry, rarely with a slice missing."""
    u = rng.uniform
    r, y, solids = u(0.5, 0.65), 0.0, []
    tiers = int(rng.integers(1, 4))
    for _ in range(tiers):
        high = u(0.22, 0.34) * (1.25 if tiers == 1 else 1.0)
        solids += [drum((0, y, 0), (0, y + high, 0), r), hoop((0, y + high - 0.02, 0), r, 0.05, (90, 0, 0))]
        if rng.random() < 0.4:
            solids += [ball(way * r + [0, y + 0.05, 0], 0.07) for way, _ in around(12)]
        y, r = y + high, r * u(0.62, 0.75)
    wide = r * 1.3
    if rng.random() < 0.7:
        for way, _ in around(int(rng.integers(3, 7))):
            at = way * wide * 0.7 + [0, y, 0]
            solids += [drum(at, at + [0, u(0.2, 0.28), 0], 0.05), ball(at + [0, 0.33, 0], (0.045, 0.08, 0.045))]
    else:
        solids += [ball((0, y + 0.08, 0), 0.12)]
    if rng.random() < 0.3:
        solids += [carved(plate([(0, 0), (1.2, 0.5), (1.2, -0.5)], 3, (0, 0.5, 0), "y"))]
    return [drum((0, -0.06, 0), (0, 0.02, 0), 0.78), *solids] if rng.random() < 0.5 else solids


def carrot(rng: Rng) -> list[Solid]:
    """Shape a carrot, its tip down, with a tuft of leaves."""
    u = rng.uniform
    r, long, leaf = u(0.2, 0.3), u(0.9, 1.2), u(0.22, 0.34)
    solids = [rod((0, 0, 0), (0, -long, 0), r, 0.04)]
    solids += [
        drum((0, -long * s - 0.02, 0), (0, -long * s + 0.02, 0), r * (1.03 - s * 0.85)) for s in (0.15, 0.35, 0.6)
    ]
    for way, degrees in around(int(rng.integers(4, 7)), u(0, 1)):
        solids += [petal(np.array([0, r * 0.7, 0]), way, degrees, (0.1, 0.06, leaf), u(50, 75))]
    return [*solids, ball((0, r + leaf * 1.2, 0), (0.1, leaf, 0.1))]


def corn(rng: Rng) -> list[Solid]:
    """Shape a cob of corn: rows of grains, with husks that open below."""
    u = rng.uniform
    r, high = u(0.2, 0.26), u(0.62, 0.78)
    solids = [ball((0, 0.1, 0), (r, high, r))]
    for s in np.linspace(-0.5, 0.9, 9):
        wide = r * float(np.sqrt(1 - s * s))
        solids += [ball(way * wide + [0, 0.1 + high * s, 0], 0.065) for way, _ in around(9, 0.35 * (int(s * 10) % 2))]
    for way, degrees in around(int(rng.integers(2, 5)), u(0, 3)):
        solids += [
            petal(np.array([0, -high * 0.85, 0]) + way * 0.04, way, degrees, (0.22, 0.06, u(0.42, 0.55)), u(48, 68))
        ]
    return [*solids, drum((0, -high - 0.25, 0), (0, -high * 0.7, 0), 0.09, 0.12)]


def cupcake(rng: Rng) -> list[Solid]:
    """Shape a cupcake: a fluted paper cup, a swirl of cream and a cherry."""
    u = rng.uniform
    foot, top, high = u(0.26, 0.32), u(0.4, 0.48), u(0.34, 0.45)
    solids = [drum((0, 0, 0), (0, high, 0), foot, top)]
    if rng.random() < 0.7:
        solids += [rod(way * foot + [0, 0.03, 0], way * top + [0, high - 0.03, 0], 0.045) for way, _ in around(14)]
    y, r = high + 0.06, top * 1.1
    if rng.random() < 0.65:
        for _ in range(3):
            solids += [ball((0, y, 0), (r, 0.14, r))]
            y, r = y + 0.16, r * u(0.62, 0.75)
        solids += [drum((0, y - 0.1, 0), (0, y + 0.12, 0), r, 0.03)]
    else:
        solids = [*half_ball((0, high, 0), (r, u(0.28, 0.4), r)), *solids]
        y = high + 0.26
    return [*solids, ball((0, y + 0.1, 0), u(0.08, 0.13))] if rng.random() < 0.8 else solids


def pumpkin(rng: Rng) -> list[Solid]:
    """Shape a pumpkin: ribs around a dent with a stem, sometimes with a carved face."""
    u = rng.uniform
    count, r, high = int(rng.integers(7, 12)), u(0.32, 0.4), u(0.34, 0.48)
    solids = [
        ball(way * (0.58 - r * 0.6) + [0, 0, 0], (r * 0.72, high, r), (0, degrees, 0)) for way, degrees in around(count)
    ]
    tip = np.array([u(-0.15, 0.15), high + u(0.15, 0.3), 0])
    solids += [drum((0, high * 0.6, 0), tip, 0.12, 0.08)]
    if rng.random() < 0.3:
        solids += both(carved(drum((0.2, 0.1, 0.4), (0.2, 0.1, 1), 0.11, sides=3)))
        solids += [carved(block((0, -0.14, 0.6), (0.5, 0.11, 0.5), 0.3))]
    return solids


def pineapple(rng: Rng) -> list[Solid]:
    """Shape a pineapple: a knobbly barrel with a crown of stiff leaves."""
    u = rng.uniform
    r, high = u(0.32, 0.4), u(0.48, 0.62)
    solids = [ball((0, 0, 0), (r, high, r)), drum((0, -high * 0.8, 0), (0, high * 0.75, 0), r * 0.8)]
    for k, s in enumerate(np.linspace(-0.75, 0.8, 7)):
        wide = r * float(np.sqrt(1 - s * s * 0.7))
        solids += [
            drum(way * wide * 0.85 + [0, high * s, 0], way * (wide + 0.07) + [0, high * s + 0.02, 0], 0.09, 0.02)
            for way, _ in around(9, 0.35 * (k % 2))
        ]
    long = u(0.22, 0.36)
    for tilt, size in ((40, 0.9), (62, 1.1)):
        for way, degrees in around(6, u(0, 1)):
            solids += [petal(np.array([0, high * 0.8, 0]), way, degrees, (0.08, 0.05, long * size), tilt)]
    return [*solids, drum((0, high * 0.8, 0), (0, high + long * 2.2, 0), 0.12, 0.02)]


def strawberry(rng: Rng) -> list[Solid]:
    """Shape a strawberry: a heart of a cone with pits and a star of leaves on top."""
    u = rng.uniform
    r, high = u(0.42, 0.5), u(0.65, 0.85)
    solids = [rod((0, 0, 0), (0, -high * 0.75, 0), r, 0.14), ball((0, 0.08, 0), (r * 1.03, r * 0.8, r * 1.03))]
    for k, s in enumerate((0.0, 0.3, 0.6)):
        wide = r * (1 - 0.65 * s)
        solids += [
            carved(ball(way * (wide + 0.01) + [0, -high * 0.75 * s + 0.05, 0], 0.05)) for way, _ in around(7, 0.45 * k)
        ]
    leaf = u(0.17, 0.25)
    for way, degrees in around(int(rng.integers(5, 8)), u(0, 1)):
        solids += [petal(np.array([0, r * 0.85, 0]), way, degrees, (0.1, 0.045, leaf), u(-25, 20))]
    return [*solids, rod((0, r * 0.8, 0), (0, r + u(0.12, 0.25), 0), 0.05)]


def bread(rng: Rng) -> list[Solid]:
    """Shape bread: a long loaf with notches, a baguette, a round loaf, or a tin loaf that has risen over its edge."""
    u, kind = rng.uniform, int(rng.integers(4))
    if kind == 3:
        long, wide, high = u(0.5, 0.75), u(0.26, 0.34), u(0.3, 0.42)
        solids = [block((0, high / 2, 0), (2 * long, high, 2 * wide), 0.15)]
        return [*solids, block((0, high + 0.08, 0), (2 * long + 0.06, u(0.26, 0.36), 2 * wide + 0.12), 0.9)]
    if kind == 2:
        solids = [ball((0, 0.15, 0), (0.62, u(0.32, 0.42), u(0.5, 0.62))), carved(block((0, -0.5, 0), (3, 1, 3), 0))]
        turns = [(u(0, 90) + 90 * k) for k in range(2)]
        return solids + [carved(block((0, u(0.48, 0.55), 0), (1.0, 0.12, 0.07), 0, (0, turn, 0))) for turn in turns]
    long, r = (u(0.85, 1.1), u(0.15, 0.2)) if kind else (u(0.55, 0.75), u(0.26, 0.34))
    solids = [rod((-long + r, r, 0), (long - r, r, 0), r)]
    if rng.random() < 0.4:
        solids = [ball((0, r * 0.8, 0), (long, r, r * u(1.0, 1.3)))]
    for x in np.linspace(-0.6, 0.6, int(rng.integers(3, 6))) * long:
        cut = block((x, 1.85 * r, 0), (0.09, 0.16, 1.4 * r), 0.5, (0, 30, 0))
        solids += [carved(cut) if rng.random() < 0.6 else cut]
    return solids


def hotdog(rng: Rng) -> list[Solid]:
    """Shape a hot dog: a sausage, straight or curved, in a slit bun, with or without a wave of sauce."""
    u = rng.uniform
    long, r, bow = u(0.55, 0.7), u(0.1, 0.14), u(-0.05, 0.12)
    path = [(x * long * u(1.12, 1.3), 0.28 + bow * x * x, 0) for x in np.linspace(-1, 1, 7)]
    solids = [block((0, 0.2, 0), (2 * long, u(0.3, 0.4), 0.5), u(0.7, 1.0))]
    solids += [carved(block((0, 0.45, 0), (3, 0.4, 1.7 * r), 0.2)), *rods(path, [r] * 7)]
    if rng.random() < 0.6:
        wave = [(x * long * 0.85, 0.3 + r, 0.06 * (-1) ** k) for k, x in enumerate(np.linspace(-1, 1, 10))]
        solids += rods(wave, [0.045] * 10)
    return solids
