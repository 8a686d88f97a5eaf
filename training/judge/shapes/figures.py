"""Shape figures on two legs, and a ghost."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, drum, rod, rods

__all__ = ["ghost", "monkey", "person", "robot", "snowman"]

Rng = np.random.Generator


def ghost(rng: Rng) -> list[Solid]:
    """Shape a ghost: a sheet over a head with a wavy hem, hollow eyes and short arms."""
    u = rng.uniform
    r, high, hem = u(0.42, 0.52), u(0.75, 1.0), u(0.5, 0.65)
    solids = [ball((0, high, 0), r), drum((0, 0.1, 0), (0, high, 0), hem, r)]
    count, turn = int(rng.integers(5, 9)), u(0, 6)
    for k in range(count):
        a = turn + 2 * np.pi * k / count
        solids += [ball((hem * 0.88 * np.sin(a), 0.08, hem * 0.88 * np.cos(a)), (0.19, u(0.15, 0.3), 0.19))]
    if rng.random() < 0.7:
        solids += both(rod((r * 0.8, high * 0.8, 0.1), (hem + u(0.15, 0.3), high * u(0.6, 1.1), 0.3), 0.15, 0.09))
    eyes = [
        Solid(s.field, s.low, s.high, hole=True) for s in both(ball((0.17, high + 0.05, r * 0.95), (0.1, 0.14, 0.16)))
    ]
    return solids + eyes


def _figure(rng: Rng, head: float, boxy: bool) -> tuple[list[Solid], float, float]:
    """Return a standing figure without its head, the height of its shoulders, and their half width."""
    u = rng.uniform
    thick, wide = u(0.09, 0.16), u(0.2, 0.32)
    hips, top = u(0.5, 0.85), 0.0
    top = hips + u(0.5, 0.65)
    raise_by = rng.choice([u(-80, -60), u(-50, 10)])
    arm = (top - hips) * u(0.95, 1.15)
    way = np.array([np.cos(np.radians(raise_by)), np.sin(np.radians(raise_by)), u(-0.1, 0.25)])
    shoulder = np.array([wide + 0.5 * thick, top - thick, 0.0])
    hand, foot = shoulder + arm * way, np.array([wide * u(0.5, 0.9), 0, u(-0.05, 0.05)])
    if boxy:
        solids = [block((0, (hips + top) / 2, 0), (2 * wide, top - hips, 0.3), 0.2)]
        solids += both(block((wide * 0.55, hips / 2, 0), (wide * 0.85, hips + 0.1, 0.26), 0.2))
        solids += both(drum(shoulder, hand, thick, sides=4))
    else:
        solids = [rod((0, hips, 0), (0, top - 0.12, 0), wide * u(0.8, 0.95), wide * u(0.85, 1.05))]
        solids += both(rod((wide * 0.5, hips, 0), foot + [0, 0.08, 0], thick * 1.3, thick * 0.9))
        solids += both(
            rods([shoulder, (shoulder + hand) / 2 + [0, 0, -0.03], hand], [thick, thick * 0.85, thick * 0.75])
        )
        solids += both(ball(hand, thick))
    solids += both(ball(foot + [0, 0.06, 0.1], (thick * 1.05, 0.08, 0.2)))
    return [*solids, rod((0, top - 0.1, 0), (0, top + 0.3 * head, 0), 0.1)], top, wide


def person(rng: Rng) -> list[Solid]:
    """Shape a person: of nature's proportions or a figure with a big head, with hair, a hat, a cape or a skirt."""
    u = rng.uniform
    head = rng.choice([u(0.16, 0.22), u(0.26, 0.45)])
    boxy = rng.random() < 0.35
    solids, top, wide = _figure(rng, head, boxy)
    at = np.array([0, top + 0.75 * head + 0.08, 0.02])
    if boxy:
        solids += [block(at, (1.8 * head, 1.8 * head, 1.7 * head), u(0.1, 0.7))]
    else:
        solids += [ball(at, head * np.array([0.9, 1.1, 0.95])), ball(at + [0, 0, 0.95 * head], 0.2 * head)]
    match int(rng.integers(5)):
        case 0:
            solids += [ball(at + [0, 0.35 * head, -0.15 * head], head * np.array([1.08, 0.85, 1.05]))]
        case 1:
            solids += [drum(at + [0, 0.5 * head, 0], at + [0, 0.65 * head, 0], 1.3 * head)]
            solids += [drum(at + [0, 0.5 * head, 0], at + [0, 1.3 * head, 0], 0.9 * head)]
        case 2:
            solids += [drum((0, 0.3, 0), (0, top - 0.3, 0), wide * 1.5, wide * 0.8)]
        case 3:
            solids += [block((0, top / 2 + 0.2, -0.22), (2.2 * wide, top * 0.7, 0.09), 0.5, (-6, 0, 0))]
        case _:
            pass
    if rng.random() < 0.3:
        # A fighter of a kit of figures: something long in one hand, often a shield in the other.
        side = rng.choice([-1.0, 1.0])
        x, y = side * (wide + u(0.2, 0.5)), top * u(0.45, 0.7)
        if rng.random() < 0.5:
            solids += [rod((x, y, -0.2), (x, y + u(-0.1, 0.1), u(0.6, 0.9)), 0.05)]
        else:
            solids += [rod((x, 0.1, 0.15), (x, top + u(0.0, 0.5), 0.15), 0.05)]
            solids += [block((x, top, 0.15), (0.3, 0.25, 0.08), 0.2)]
        if rng.random() < 0.6:
            solids += [block((-x, y, 0.15), (0.09, u(0.4, 0.6), u(0.35, 0.5)), 0.5, (0, u(0, 70) * -side, 0))]
    return solids


def robot(rng: Rng) -> list[Solid]:
    """Shape a robot: boxes for head and body, an aerial, thick arms with grippers, big feet."""
    u = rng.uniform
    wide, high, deep, legs = u(0.35, 0.5), u(0.55, 0.8), u(0.35, 0.5), u(0.3, 0.55)
    top, edge = legs + high, u(0.05, 0.5)
    body = block((0, legs + high / 2, 0), (2 * wide, high, deep), edge)
    solids = [body] if rng.random() < 0.7 else [drum((0, legs, 0), (0, top, 0), wide * 0.8, wide)]
    head, tall = u(0.22, 0.42), u(0.3, 0.5)
    solids += [drum((0, top - 0.05, 0), (0, top + 0.1, 0), 0.12)]
    if rng.random() < 0.7:
        solids += [block((0, top + 0.07 + tall / 2, 0), (2 * head, tall, head * 1.7), edge)]
    else:
        solids += [ball((0, top + 0.07 + tall / 2, 0), (head, tall * 0.6, head))]
    solids += both(
        drum((0.45 * head, top + 0.1 + 0.55 * tall, 0.6 * head), (0.45 * head, top + 0.1 + 0.55 * tall, head), 0.09)
    )
    aerial = top + tall
    if rng.random() < 0.6:
        solids += [rod((0, aerial, 0), (0, aerial + 0.25, 0), 0.045), ball((0, aerial + 0.28, 0), 0.09)]
    else:
        solids += both(drum((head * 0.9, top + 0.07 + tall / 2, 0), (head + 0.13, top + 0.07 + tall / 2, 0), 0.13))
    reach = np.array([wide + u(0.15, 0.3), legs + u(0.05, 0.25), u(0.0, 0.35)])
    if rng.random() < 0.35:
        reach = np.array([wide + u(0.4, 0.6), top - u(0.05, 0.3), 0.1])
    shoulder = np.array([wide + 0.1, top - 0.16, 0])
    solids += both(
        [ball(shoulder, 0.15), *rods([shoulder, (shoulder + reach) / 2 + [0.08, 0, -0.05], reach], [0.09, 0.09, 0.1])]
    )
    solids += both(
        [
            block(reach + [0.08, -0.1, 0.03], (0.07, 0.22, 0.12), 0.3),
            block(reach + [-0.08, -0.1, 0.03], (0.07, 0.22, 0.12), 0.3),
        ]
    )
    solids += both(drum((wide * 0.5, 0.1, 0), (wide * 0.5, legs + 0.1, 0), u(0.09, 0.15)))
    return solids + both(block((wide * 0.55, 0.08, 0.07), (wide * 0.85, 0.17, u(0.4, 0.6)), 0.3))


def monkey(rng: Rng) -> list[Solid]:
    """Shape a monkey: sitting with long arms and a curled tail, or its head with big ears alone."""
    u = rng.uniform
    head, ear = u(0.32, 0.42), u(0.16, 0.26)
    at = np.array([0, 1.15, 0.1])
    face = [ball(at, (head, head * u(0.9, 1.05), head))]
    face += [ball(at + [0, -0.35 * head, 0.75 * head], (0.62 * head, 0.42 * head, 0.42 * head))]
    face += both(ball(at + [head + 0.6 * ear, 0.02, -0.05], (ear, ear, 0.08), (0, u(-35, 0), 0)))
    face += [ball(at + [0, 0.3 * head, 0.72 * head], (0.62 * head, 0.2 * head, 0.28 * head))]
    if rng.random() < 0.25:
        return face
    solids = [*face, rod((0, 0.3, 0), (0, 0.8, 0), u(0.28, 0.36), 0.24)]
    hand = np.array([u(0.4, 0.8), u(0.1, 0.9), u(0.2, 0.5)])
    solids += both([*rods([(0.25, 0.8, 0), (0.55, 0.5, 0.05), hand], [0.11, 0.1, 0.09]), ball(hand, 0.12)])
    solids += both(
        [
            *rods([(0.2, 0.2, 0.05), (0.45, 0.45, 0.35), (0.42, 0.06, 0.45)], [0.14, 0.12, 0.1]),
            ball((0.42, 0.05, 0.55), (0.11, 0.07, 0.2)),
        ]
    )
    side = rng.choice([-1.0, 1.0])
    return solids + rods(
        [
            (0, 0.1, -0.25),
            (0.2 * side, 0.1, -0.6),
            (0.3 * side, 0.6, -0.75),
            (0.2 * side, 0.95, -0.6),
            (0.1 * side, 0.8, -0.5),
        ],
        [0.08] * 5,
    )


def snowman(rng: Rng) -> list[Solid]:
    """Shape a snowman of two or three balls with a carrot, often a hat and arms."""
    u = rng.uniform
    r = [u(0.48, 0.6), u(0.36, 0.44), u(0.24, 0.32)]
    if rng.random() < 0.35:
        r = [r[0], r[2] * 1.15]
    solids, y = [], 0.0
    for k, radius in enumerate(r):
        y += radius * (0.9 if k == 0 else 0.85)
        solids += [ball((0, y, 0), radius)]
        y += radius * (0.75 if k < len(r) - 1 else 0.0)
    head = r[-1]
    solids += [drum((0, y, 0.7 * head), (0, y - 0.03, head + u(0.2, 0.4)), 0.09, 0.01)]
    if rng.random() < 0.6:
        solids += [drum((0, y + 0.7 * head, 0), (0, y + 0.85 * head, 0), head * 1.25)]
        solids += [drum((0, y + 0.7 * head, 0), (0, y + u(1.5, 1.9) * head, 0), head * 0.75)]
    if rng.random() < 0.6:
        solids += both(rod((0.25, y * 0.62, 0), (u(0.75, 0.95), y * u(0.55, 0.95), 0.1), 0.05))
    return solids
