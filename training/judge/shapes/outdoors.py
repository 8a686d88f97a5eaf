"""Shape what is found outdoors: stones, shrubs, clouds, signs; and coins. It faces +Z; y = 0 is the ground."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, around, ball, block, carved, drum, hoop, plate, rod, spun

__all__ = ["bush", "cloud", "coin", "crystal", "rock", "sign", "target"]

Rng = np.random.Generator


def rock(rng: Rng) -> list[Solid]:
    """Shape a rock: some blocks and drums with few sides that lean into one another."""
    u = rng.uniform
    made = [block((0, 0.3, 0), (u(0.8, 1.1), u(0.5, 0.8), u(0.7, 1.0)), 0.25, tuple(u(-25, 25, 3)))]
    for _ in range(int(rng.integers(2, 5))):
        place = u(-0.3, 0.3, 3) * [1, 0.5, 1] + [0, 0.3, 0]
        made += [block(place, u(0.45, 0.8, 3), u(0.05, 0.4), tuple(u(-50, 50, 3)))]
    return made


def cloud(rng: Rng) -> list[Solid]:
    """Shape a cloud: a long flat bottom with three to five bumps of uneven size."""
    u, count = rng.uniform, int(rng.integers(3, 6))
    made = [block((0, 0, 0), (1.5, 0.32, 0.5), 1.0)]
    for x in np.linspace(-0.55, 0.55, count) + u(-0.08, 0.08, count):
        r = u(0.24, 0.36) + 0.12 * (abs(x) < 0.3)
        made += [ball((x, 0.5 * r, u(-0.08, 0.08)), (r, r, r * u(0.7, 1.0)))]
    return made


def bush(rng: Rng) -> list[Solid]:
    """Shape a shrub: a low dome of tufts around a ball, or spikes of leaves that fan out from the ground."""
    u = rng.uniform
    if rng.random() < 0.25:
        return [
            rod((0, 0, 0), way * u(0.5, 0.8) + [0, u(0.4, 0.8), 0], 0.12, 0.03)
            for start, count in ((0, 7), (0.4, 6))
            for way, _ in around(count, start)
        ] + [rod((0, 0, 0), (0, 0.9, 0), 0.14, 0.03)]
    made = [ball((0, 0.4, 0), (0.55, 0.45, 0.55))]
    for level, count, out in ((0.2, 8, 0.55), (0.5, 6, 0.42), (0.75, 3, 0.2)):
        made += [ball(way * out + [0, level, 0], u(0.17, 0.25)) for way, _ in around(count, u(0, 1))]
    return made


def coin(rng: Rng) -> list[Solid]:
    """Shape a coin on its edge with a raised rim, a smaller ring or a letter, sometimes with a square hole."""
    u = rng.uniform
    half = u(0.06, 0.12)
    made = [drum((0, 0, -half), (0, 0, half), 0.7), hoop((0, 0, half), 0.65, 0.05), hoop((0, 0, -half), 0.65, 0.05)]
    match int(rng.integers(3)):
        case 0:
            made += [carved(block((0, 0, 0), (0.3, 0.3, 1.0), 0))]
        case 1:
            made += [hoop((0, 0, s * half), 0.35, 0.05) for s in (-1, 1)]
        case _:
            made += [block((0, 0, 0), (0.12, 0.7, 2 * half + 0.09), 0), block((0, 0, 0), (0.5, 0.12, 2 * half + 0.09), 0)]
    return made


def crystal(rng: Rng) -> list[Solid]:
    """Shape a gem with a flat table, or a cluster of pointed prisms of uneven height."""
    u = rng.uniform
    if rng.random() < 0.4:
        r, sides = u(0.5, 0.7), int(rng.choice([4, 6, 8]))
        return [drum((0, -0.7, 0), (0, 0, 0), 0.01, r, sides), drum((0, 0, 0), (0, u(0.2, 0.35), 0), r, 0.6 * r, sides)]
    made = []
    for k in range(int(rng.integers(3, 8))):
        way, high = around(7, u(0, 1))[k][0], u(0.4, 0.9) + 0.4 * (k == 0)
        foot, tip, r = way * 0.18, way * (0.18 + 0.35 * high * (k > 0)) + [0, high, 0], u(0.09, 0.17)
        neck = foot + 0.7 * (tip - foot)
        made += [drum(foot, neck, r, r, 5), drum(neck, tip, r, 0.01, 5)]
    return made


def sign(rng: Rng) -> list[Solid]:
    """Shape a signpost with one to three boards, or a road sign: a triangle, a disc or a square on a pole."""
    u = rng.uniform
    high = u(1.1, 1.5)
    made = [drum((0, 0, 0), (0, high, 0), u(0.04, 0.07))]
    if rng.random() < 0.5:
        for k in range(int(rng.integers(1, 4))):
            side, half, y = rng.choice([-1, 1]), u(0.4, 0.6), high - 0.16 - 0.34 * k
            arrow = [(-half, -0.13), (half, -0.13), (half + 0.14, 0), (half, 0.13), (-half, 0.13)]
            flat = np.array(arrow[:: int(side)]) * [side, 1]
            made += [plate(flat, 0.09, (0.12 * side, y, 0.07), "z", (0, 0, u(-6, 6)))]
        return made
    match int(rng.integers(3)):
        case 0:
            made += [drum((0, high, 0.02), (0, high, 0.12), u(0.34, 0.45))]
        case 1:
            made += [plate([(-0.45, -0.3), (0.45, -0.3), (0, 0.48)], 0.1, (0, high, 0.06))]
        case _:
            made += [block((0, high, 0.06), (u(0.6, 1.1), u(0.4, 0.7), 0.1), 0.1)]
    return made


def target(rng: Rng) -> list[Solid]:
    """Shape a target: rings that step toward a middle, on an easel or hung from a post."""
    u = rng.uniform
    y, r = u(0.7, 0.9), u(0.42, 0.55)
    steps = [(r, 0.0), (r, 0.12), (0.66 * r, 0.12), (0.66 * r, 0.18), (0.33 * r, 0.18), (0.33 * r, 0.24), (0, 0.24)]
    face = spun([(0, 0), *steps])
    made = [Solid(lambda p: face.field(p[:, [0, 2, 1]] * [1, 1, -1] + [0, 0, y]), *_box(r, y))]
    if rng.random() < 0.7:
        return [*made, *(rod((0.6 * s * r, y, -0.03), (1.1 * s * r, 0, 0.1), 0.05) for s in (-1, 1)),
                rod((0, y, -0.05), (0, 0, -0.5), 0.05)]  # fmt: skip
    return [*made, block((0, y / 2, -0.06), (0.14, y, 0.1), 0.1), block((0, 0.04, 0), (0.7, 0.08, 0.4), 0.1)]


def _box(radius: float, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the box of a target's face."""
    return np.array([-radius, level - radius, 0.0]), np.array([radius, level + radius, 0.3])
