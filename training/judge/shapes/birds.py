"""Shape birds."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, drum, plate, rod, rods

__all__ = ["bird", "chicken", "duck", "owl", "penguin", "swan"]

Rng = np.random.Generator


def bird(rng: Rng) -> list[Solid]:
    """Shape a small bird: perched, its tail straight behind, or flying with spread wings."""
    u = rng.uniform
    wide, long, head = u(0.28, 0.36), u(0.42, 0.52), u(0.2, 0.27)
    at = np.array([0, u(0.42, 0.55), long * 0.75])
    solids = [ball((0, 0.1, 0), (wide, wide * u(1.0, 1.15), long), (-25, 0, 0)), rod((0, 0.2, 0.2), at, 0.24, head)]
    solids += [ball(at, head), drum(at + [0, 0, 0.6 * head], at + [0, -0.05, head + u(0.15, 0.35)], 0.1, 0.01)]
    tail = [(-0.2, -0.09), (-0.2, 0.09), (-0.75, u(0.15, 0.28)), (-0.75, -0.16)]
    solids += [plate(tail, 0.1, (0, 0, -0.15), "y", (u(0, 25), 0, 0))]
    if rng.random() < 0.5:
        solids += both(ball((wide * 0.95, 0.12, -0.08), (0.09, 0.22, 0.42), (-25, 8, 0)))
        solids += both(rod((0.13, -0.1, 0.0), (0.14, -u(0.4, 0.55), 0.03), 0.05))
        solids += both(ball((0.14, -0.45, 0.1), (0.08, 0.05, 0.14)))
    else:
        span, back = u(0.8, 1.1), u(0.1, 0.4)
        wing = [(0.25, 0), (0.2, span * 0.6), (-back, span), (-0.3, span * 0.55), (-0.3, 0)]
        solids += both(plate(wing, 0.09, (0.05, 0.22, 0.02), "y", (0, 0, u(0, 40))))
    return solids


def chicken(rng: Rng) -> list[Solid]:
    """Shape a hen or a cock: raised tail, comb, wattle and two legs."""
    u = rng.uniform
    wide, head = u(0.32, 0.42), u(0.16, 0.22)
    at = np.array([0, u(0.62, 0.85), u(0.42, 0.55)])
    solids = [ball((0, 0.1, 0), (wide, u(0.36, 0.45), 0.5)), rod((0, 0.2, 0.2), at, 0.3, head * 0.85), ball(at, head)]
    solids += [drum(at + [0, 0, 0.6 * head], at + [0, -0.06, head + 0.17], 0.09, 0.01)]
    solids += [ball(at + [0, -0.2, head * 0.8], (0.06, 0.12, 0.07))]
    for z, r in ((-0.12, 0.09), (0.0, 0.12), (0.12, 0.09)):
        solids += [ball(at + [0, head + 0.05, z], (0.06, r * 1.4, r))]
    rise = u(0.55, 0.95)
    for k, side in enumerate((-0.12, 0.0, 0.12)):
        solids += rods(
            [(side, 0.2, -0.3), (side * 1.5, rise * 0.85, -0.62), (side * 2, rise - 0.1 * k, -0.85)], [0.18, 0.16, 0.08]
        )
    solids += both(ball((wide * 0.95, 0.12, -0.03), (0.1, 0.22, 0.34)))
    for_leg = both(rod((0.17, -0.2, 0.0), (0.17, -u(0.5, 0.65), 0.0), 0.06))
    foot = for_leg[0].low[1] + 0.05
    return solids + for_leg + both(block((0.17, foot, 0.08), (0.22, 0.08, 0.32), 0.4))


def duck(rng: Rng) -> list[Solid]:
    """Shape a duck that swims or stands: flat bill, raised tail, wings at its sides."""
    u = rng.uniform
    wide, head, neck = u(0.34, 0.46), u(0.22, 0.34), u(0.2, 0.45)
    at = np.array([0, 0.45 + neck, u(0.35, 0.5)])
    solids = [ball((0, 0.2, 0), (wide, u(0.28, 0.38), u(0.6, 0.72))), rod((0, 0.25, 0.35), at, 0.24, 0.15)]
    solids += [ball(at, head), ball(at + [0, -0.06, head + 0.08], (0.15, 0.055, 0.2))]
    solids += [rod((0, 0.25, -0.4), (0, u(0.45, 0.65), -0.85), 0.24, 0.06)]
    solids += both(ball((wide * 0.95, 0.27, -0.1), (0.09, 0.2, 0.4), (u(0, 20), 0, 0)))
    if rng.random() < 0.4:
        solids += both([rod((0.17, 0, 0), (0.17, -0.35, 0), 0.06), block((0.17, -0.36, 0.1), (0.24, 0.08, 0.34), 0.4)])
    return solids


def owl(rng: Rng) -> list[Solid]:
    """Shape an owl: an egg with a broad face, huge eyes, ear tufts and folded wings."""
    u = rng.uniform
    wide, high = u(0.42, 0.52), u(0.62, 0.78)
    solids = [ball((0, high * 0.9, 0), (wide, high, wide * 0.85))]
    solids += [ball((0, high * 1.45, 0.03), (wide * u(0.9, 1.05), wide * 0.75, wide * 0.8))]
    eye = u(0.15, 0.22)
    face = high * 1.48
    solids += both(drum((eye * 1.02, face, 0.2), (eye * 1.1, face, wide * 0.83 + 0.06), eye))
    solids += both(ball((eye * 1.05, face, wide * 0.85 + 0.06), eye * 0.45))
    solids += [drum((0, face - 0.1, wide * 0.7), (0, face - 0.24, wide * 0.85 + 0.12), 0.09, 0.01)]
    tuft = face + wide * 0.45
    solids += both(drum((wide * 0.5, tuft, 0), (wide * u(0.75, 0.95), tuft + u(0.25, 0.4), 0.02), 0.15, 0.02))
    solids += both(ball((wide * 0.95, high * 0.8, -0.05), (0.11, high * 0.62, 0.28), (0, 0, 6)))
    return (
        solids
        + both(ball((0.17, 0.08, 0.3), (0.13, 0.08, 0.17)))
        + [block((0, 0.12, -0.35), (0.4, 0.1, 0.4), 0.4, (20, 0, 0))]
    )


def penguin(rng: Rng) -> list[Solid]:
    """Shape a penguin: upright, with flippers and flat feet."""
    u = rng.uniform
    wide, high, head = u(0.34, 0.46), u(0.6, 0.75), u(0.23, 0.3)
    at = np.array([0, 2 * high - 0.05 + 0.5 * head, 0.03])
    solids = [
        ball((0, high, 0), (wide, high, wide * 0.9)),
        ball(at, head),
        rod((0, high, 0), at, wide * 0.7, head * 0.9),
    ]
    solids += [drum(at + [0, -0.03, 0.7 * head], at + [0, -0.07, head + u(0.12, 0.28)], 0.09, 0.02)]
    out = u(0.05, 0.35)
    solids += both(ball((wide + 0.05 + out / 2, high * 1.05, 0), (0.08, 0.42, 0.17), (0, 0, 8 + 70 * out)))
    return (
        solids
        + both(ball((0.2, 0.05, 0.25), (0.16, 0.07, 0.27)))
        + [rod((0, 0.25, -0.25), (0, 0.07, -0.5), 0.15, 0.06)]
    )


def swan(rng: Rng) -> list[Solid]:
    """Shape a swan: a boat of a body with raised wings and the neck an S."""
    u = rng.uniform
    wide, top, out = u(0.3, 0.4), u(0.95, 1.25), u(0.15, 0.3)
    solids = [ball((0, 0.2, 0), (wide, u(0.24, 0.32), 0.65)), rod((0, 0.25, -0.4), (0, 0.42, -0.9), 0.22, 0.06)]
    solids += rods(
        [(0, 0.25, 0.45), (0, 0.45, 0.7), (0, 0.75 * top, 0.55), (0, top, 0.62), (0, top + 0.02, 0.75)],
        [0.17, 0.12, 0.09, 0.09, 0.12],
    )
    solids += [drum((0, top, 0.8), (0, top - 0.1, 0.8 + out), 0.08, 0.03)]
    lift = u(0.15, 0.4)
    return solids + both(ball((wide * 0.9, 0.3 + lift / 2, -0.2), (0.09, 0.22 + lift / 3, 0.5), (30, 0, -12)))
