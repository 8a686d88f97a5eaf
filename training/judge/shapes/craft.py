"""Shape aircraft and ships, facing +Z."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import (
    Solid,
    ball,
    block,
    both,
    drum,
    plate,
    rod,
    rods,
)

__all__ = ["airplane", "balloon", "boat", "helicopter", "rocket", "submarine"]

Rng = np.random.Generator


def airplane(rng: Rng) -> list[Solid]:
    """Shape an airliner, a propeller plane or a jet."""
    u = rng.uniform
    r, span, place, sweep = u(0.12, 0.19), u(0.75, 1.1), u(0.05, 0.3), u(0.0, 0.45)
    solids = rods([(0, 0, 0.9), (0, 0, 0.6), (0, 0, -0.3), (0, u(0, 0.1), -1.0)], [r * u(0.4, 0.8), r, r, r * 0.4])
    chord, tip = u(0.28, 0.45), u(0.12, 0.25)
    wing = [(place, 0), (place - sweep, span), (place - sweep - tip, span), (place - chord, 0)]
    low, lean = u(-0.6, 0.7) * r, (0, 0, u(-2, 9))
    solids += both(plate(wing, 0.09, (0, low, 0), "y", lean))
    tail = [(-0.72, 0), (-0.88, 0.38), (-1.03, 0.38), (-1.0, 0)]
    solids += both(plate(tail, 0.08, (0, 0.06, 0), "y"))
    fin = u(0.32, 0.48)
    solids += [plate([(0, -0.65), (fin, -0.92), (fin, -1.08), (0, -1.03)], 0.08, (0, 0, 0), "x")]
    match int(rng.integers(3)):
        case 0:
            at = 0.45 * span
            front = place - 0.45 * sweep + 0.1
            solids += both(drum((at, low - 0.1, front - 0.28), (at, low - 0.1, front), 0.08))
        case 1:
            solids += [block((0, 0, 1.0), (0.6, 0.09, 0.06), 0.4, (0, 0, u(0, 90))), ball((0, 0, 0.98), 0.08)]
            solids += [ball((0, r, 0.25), (r * 0.7, r * 0.7, 0.22))]
        case _:
            solids += [ball((0, r * 0.9, 0.4), (r * 0.6, r * 0.6, 0.25))]
    if rng.random() < 0.12:
        solids += both(plate(wing, 0.09, (0, low + 0.4, 0), "y")) + both(
            rod((0.5, low, place - 0.2), (0.5, low + 0.4, place - 0.2), 0.04)
        )
    return solids


def balloon(rng: Rng) -> list[Solid]:
    """Shape a hot-air balloon: a drop above a basket, with ropes."""
    u = rng.uniform
    r, gap, wide = u(0.55, 0.7), u(0.12, 0.35), u(0.14, 0.22)
    skirt = -r * u(1.0, 1.3)
    solids = [ball((0, 0, 0), (r, r * u(0.95, 1.1), r)), drum((0, skirt, 0), (0, -0.35 * r, 0), 0.16, 0.93 * r)]
    low = skirt - gap
    if rng.random() < 0.4:
        for k in range(8):
            a = k * np.pi / 4
            solids += [ball((0.3 * r * np.sin(a), 0, 0.3 * r * np.cos(a)), (0.76 * r, r, 0.76 * r))]
    basket = (0, low - 0.12, 0)
    solids += [
        block(basket, (2 * wide, 0.28, 2 * wide), 0.2)
        if rng.random() < 0.5
        else drum((0, low - 0.26, 0), (0, low + 0.02, 0), wide * 0.85, wide)
    ]
    for z in (-0.8, 0.8):
        solids += both(rod((0.8 * wide, low, z * wide), (0.14, skirt + 0.06, z * 0.16), 0.04))
    return solids


def boat(rng: Rng) -> list[Solid]:
    """Shape a boat: a hull, and a sail or a cabin with a funnel."""
    u = rng.uniform
    wide, deep, long = u(0.28, 0.38), u(0.22, 0.34), u(0.75, 0.95)
    deck = [
        (-long, wide * 0.8),
        (0.2, wide),
        (0.6 * long, wide * 0.7),
        (long, 0.0),
        (0.6 * long, -wide * 0.7),
        (0.2, -wide),
        (-long, -wide * 0.8),
    ]
    solids = [
        plate(np.array(deck) * [s, 0.75 + 0.25 * s], deep * 0.5, (0, y, 0), "y")
        for s, y in ((1.0, 0.0), (0.9, -0.3 * deep), (0.75, -0.6 * deep))
    ]
    if rng.random() < 0.6:
        high, foot = u(1.0, 1.4), u(0.5, 0.75)
        solids += [
            rod((0, 0, 0.1), (0, high + 0.1, 0.1), 0.05),
            plate([(0.2, 0.1), (high, 0.1), (0.2, 0.1 - foot)], 0.08, (0, 0, 0), "x"),
        ]
        if rng.random() < 0.7:
            solids += [plate([(0.18, 0.2), (high * 0.85, 0.15), (0.18, long * 0.9)], 0.08, (0, 0, 0), "x")]
    else:
        solids += [block((0, deep * 0.25 + 0.17, -0.1), (wide * 1.2, 0.35, u(0.5, 0.8)), 0.1)]
        solids += [
            block((0, deep * 0.25 + 0.42, 0), (wide, 0.25, 0.35), 0.1),
            drum((0, 0.4, -0.3), (0, u(0.75, 0.95), -0.33), 0.1),
        ]
    return solids


def helicopter(rng: Rng) -> list[Solid]:
    """Shape a helicopter: a pod with a tail boom, a rotor above, a small one behind, and skids."""
    u = rng.uniform
    r, boom, blade = u(0.27, 0.36), u(0.85, 1.1), u(0.8, 1.1)
    solids = [ball((0, 0, 0.1), (r, r, u(0.42, 0.55))), rod((0, 0.08, -0.2), (0, 0.16, -0.2 - boom), 0.15, 0.06)]
    solids += [plate([(0.1, 0.05), (0.45, -0.12), (0.45, -0.25), (0.05, -0.15)], 0.08, (0, 0, -0.15 - boom), "x")]
    solids += [drum((0, r, 0), (0, r + 0.2, 0), 0.08)]
    count, turn = int(rng.choice([2, 3, 4, 4])), u(0, 90)
    for k in range(count):
        a = np.radians(turn + 360 / count * k)
        d = np.array([np.sin(a), 0, np.cos(a)])
        solids += [block(np.array([0, r + 0.2, 0]) + d * blade / 2, (0.11, 0.06, blade), 0.2, (0, np.degrees(a), 0))]
    solids += [drum((0.03, 0.2, -0.2 - boom), (0.12, 0.2, -0.2 - boom), u(0.16, 0.22))]
    down = -r - u(0.12, 0.2)
    solids += both(
        [
            rod((0.28, down, -0.35), (0.28, down, 0.5), 0.045),
            rod((0.15, -0.1, 0.25), (0.28, down, 0.25), 0.04),
            rod((0.15, -0.1, -0.1), (0.28, down, -0.1), 0.04),
        ]
    )
    return solids


def rocket(rng: Rng) -> list[Solid]:
    """Shape a rocket: a pointed body, fins, a nozzle, sometimes boosters."""
    u = rng.uniform
    r, high, nose = u(0.2, 0.34), u(1.0, 1.3), u(0.4, 0.6)
    if rng.random() < 0.5:
        solids = [ball((0, high * 0.55, 0), (r, high * 0.75, r))]
    else:
        solids = [drum((0, 0, 0), (0, high, 0), r), drum((0, high, 0), (0, high + nose, 0), r, 0.02)]
    solids += [drum((0, -0.15, 0), (0, 0.05, 0), r * 0.8, r * 0.45)]
    count, out = int(rng.choice([3, 4, 4])), r + u(0.2, 0.35)
    fin = np.array([(0.0, 0.5), (out, 0.05), (out, -0.2), (0.0, 0.05)])
    for k in range(count):
        solids += [plate(fin, 0.1, (0, 0, 0), "z", (0, 360 / count * k, 0))]
    if rng.random() < 0.4:
        solids += [drum((0, high * 0.65, r * 0.6), (0, high * 0.65, r * 1.15), 0.13)]
    if rng.random() < 0.25:
        solids += both(
            [
                drum((r * 1.5, 0, 0), (r * 1.5, high * 0.6, 0), r * 0.5),
                drum((r * 1.5, high * 0.6, 0), (r * 1.5, high * 0.85, 0), r * 0.5, 0.02),
            ]
        )
    return solids


def submarine(rng: Rng) -> list[Solid]:
    """Shape a submarine: a long round hull, a tower with a periscope, rudders and a propeller."""
    u = rng.uniform
    r, long = u(0.22, 0.32), u(0.75, 0.95)
    solids = [rod((0, 0, -long * 0.5), (0, 0, long - r), r), rod((0, 0, -long * 0.5), (0, 0, -long), r, 0.07)]
    tall, at = u(0.22, 0.36), u(0.0, 0.25)
    solids += [block((0, r + tall / 2 - 0.04, at), (r * 0.75, tall, u(0.3, 0.42)), u(0.2, 0.95))]
    solids += rods(
        [(0, r + tall - 0.1, at), (0, r + tall + u(0.12, 0.25), at), (0, r + tall + 0.2, at + 0.1)], [0.045] * 3
    )
    solids += both(block((r * 0.9, 0, long * 0.45), (0.3, 0.07, 0.16), 0.3)) + both(
        block((0.2, 0, -long), (0.36, 0.07, 0.16), 0.3)
    )
    solids += [block((0, 0.0, -long), (0.07, u(0.5, 0.65), 0.18), 0.3)]
    turn = u(0, 60)
    return solids + [block((0, 0, -long - 0.13), (0.4, 0.1, 0.06), 0.3, (0, 0, turn + 60 * k)) for k in range(3)]
