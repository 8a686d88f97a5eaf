"""Shape clothing, as if worn by nobody. It faces +Z."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, around, ball, block, both, carved, drum, half_ball, hoop, rod, rods

__all__ = ["backpack", "boot", "dress", "glove", "hat", "helmet", "shirt", "trousers"]

Rng = np.random.Generator


def backpack(rng: Rng) -> list[Solid]:
    """Shape a backpack: a soft box with a flap, pockets, a loop, and two straps behind."""
    u = rng.uniform
    wide, high, deep = u(0.36, 0.46), u(0.48, 0.62), u(0.2, 0.28)
    solids = [block((0, 0, 0), (2 * wide, 2 * high, 2 * deep), u(0.6, 0.95))]
    solids += [ball((0, high * 0.75, 0), (wide * 0.95, 0.35, deep * 0.95))]
    solids += [block((0, -high * 0.4, deep), (1.4 * wide, 0.8 * high, 0.24), 0.6)]
    solids += [block((0, -high * 0.08, deep + 0.04), (1.5 * wide, 0.14, 0.26), 0.5)]
    solids += both(block((wide, -high * 0.45, 0), (0.18, 0.7 * high, 0.3), 0.7)) if rng.random() < 0.6 else []
    solids += [hoop((0, high + 0.12, -deep * 0.3), 0.11, 0.045)]
    solids += both(
        rods(
            [
                (0.14, high * 0.8, -deep),
                (0.2, high * 0.4, -deep - 0.2),
                (0.26, -high * 0.4, -deep - 0.17),
                (0.28, -high * 0.85, -deep),
            ],
            [0.06] * 4,
        )
    )
    if rng.random() < 0.4:
        solids += [drum((-wide, high + 0.16, 0), (wide, high + 0.16, 0), 0.16)]
    return solids


def boot(rng: Rng) -> list[Solid]:
    """Shape a boot: shaft, foot, sole and heel; its toe points forward."""
    u = rng.uniform
    r, high, foot = u(0.2, 0.27), u(0.5, 1.0), u(0.45, 0.6)
    top = r * u(1.0, 1.25)
    solids = [drum((0, 0.15, -0.05), (0, high, -0.08), r * 0.95, top)]
    solids += [rods([(0, 0.2, 0), (0, 0.17, foot)], [r * 0.9, r * u(0.6, 0.8)])[0]]
    heel = u(0.05, 0.16)
    solids += [block((0, 0.03, foot * 0.42), (r * 1.6, 0.1, foot + r * 1.6), 0.9)]
    solids += [block((0, -heel / 2, -0.08), (r * 1.6, heel + 0.08, r * 1.5), 0.3)]
    if rng.random() < 0.6:
        solids += [hoop((0, high - 0.04, -0.08), top, 0.055, (90, 0, 0))]
    return [*solids, carved(drum((0, high - 0.2, -0.08), (0, high + 0.3, -0.08), top * 0.72))]


def dress(rng: Rng) -> list[Solid]:
    """Shape an empty dress: a bodice with straps or sleeves, a waist and a wide skirt."""
    u = rng.uniform
    waist, hem, skirt, chest = u(0.15, 0.2), u(0.42, 0.65), u(0.75, 1.05), u(0.2, 0.26)
    solids = [drum((0, 0, 0), (0, skirt, 0), hem, waist)]
    if rng.random() < 0.6:
        solids += [
            rod(way * hem * 0.93 + [0, 0.05, 0], way * waist + [0, skirt, 0], 0.09, 0.03) for way, _ in around(9)
        ]
    top = skirt + u(0.36, 0.45)
    solids += [drum((0, skirt - 0.02, 0), (0, top, 0), waist, chest)]
    match int(rng.integers(3)):
        case 0:
            solids += both(rod((chest * 0.7, top, 0), (chest * 0.55, top + 0.17, 0), 0.045))
        case 1:
            solids += both(ball((chest + 0.08, top - 0.05, 0), u(0.13, 0.19)))
        case _:
            solids += both(drum((chest * 0.8, top - 0.1, 0), (chest + u(0.25, 0.4), top - u(0.3, 0.5), 0), 0.12, 0.09))
    return [*solids, carved(ball((0, top + 0.03, 0), (chest * 0.65, 0.12, chest * 0.6)))]


def glove(rng: Rng) -> list[Solid]:
    """Shape a glove that points upward: a palm, four fingers and a thumb, a cuff."""
    u = rng.uniform
    wide, r = u(0.27, 0.34), u(0.075, 0.1)
    solids = [block((0, 0.32, 0), (2 * wide, 0.6, 0.26), u(0.6, 0.95))]
    solids += [drum((0, -0.3, 0), (0, 0.1, 0), wide * u(0.85, 1.15), wide * 0.72)]
    if rng.random() < 0.25:
        solids += [ball((0, 0.62, 0), (wide * 0.98, u(0.4, 0.5), 0.15))]
    else:
        spread = u(0.0, 0.25)
        for s, long in zip(np.linspace(-1, 1, 4), (0.34, 0.46, 0.5, 0.42), strict=True):
            root = np.array([s * (wide - r), 0.55, 0])
            solids += [rod(root, root + [s * spread * 0.6, long * u(0.9, 1.1), 0], r * 1.05, r * 0.95)]
    side = rng.choice([-1.0, 1.0])
    solids += rods(
        [(side * wide * 0.7, 0.2, 0), (side * (wide + 0.17), 0.42, 0.03), (side * (wide + u(0.18, 0.28)), 0.62, 0.05)],
        [0.12, 0.1, 0.09],
    )
    return [*solids, hoop((0, -0.26, 0), wide * 0.9, 0.07, (90, 0, 0))] if rng.random() < 0.5 else solids


def hat(rng: Rng) -> list[Solid]:
    """Shape a hat with a brim: a top hat, a bowler, a cone or a dented one."""
    u = rng.uniform
    r, high, brim = u(0.28, 0.36), u(0.3, 0.6), u(0.52, 0.75)
    solids = [drum((0, 0, 0), (0, 0.07, 0), brim)]
    match int(rng.integers(4)):
        case 0:
            solids += [drum((0, 0, 0), (0, high + 0.1, 0), r, r * u(0.9, 1.1))]
        case 1:
            solids = [*half_ball((0, 0.03, 0), (r * 1.05, high, r * 1.05)), *solids]
        case 2:
            solids += [drum((0, 0, 0), (0, high * 2, 0), r, 0.03)]
        case _:
            solids += [drum((0, 0, 0), (0, high, 0), r * 1.05, r * 0.85)]
            solids += [carved(ball((0, high + 0.06, 0), (0.1, 0.18, r)))]
    return [*solids, drum((0, 0.05, 0), (0, 0.15, 0), r * 1.1)] if rng.random() < 0.6 else solids


def helmet(rng: Rng) -> list[Solid]:
    """Shape a helmet: a knight's with a visor, one with horns, a crest, or a rider's."""
    u = rng.uniform
    r, neck, kind = u(0.42, 0.5), u(0.3, 0.5), int(rng.integers(4))
    solids = [ball((0, 0, 0), (r, r * u(1.0, 1.15), r * u(1.0, 1.15)))]
    if kind == 3:
        solids += [carved(block((0, -0.6, 0), (3, 0.7, 3), 0)), carved(ball((0, -0.25, 0), r * 0.85))]
        return [*solids, carved(block((0, -0.05, r), (1.5 * r, 0.4, 0.7), 0.6))]
    solids += [drum((0, -neck - 0.1, 0), (0, 0, 0), r * u(0.85, 1.05), r)]
    if kind == 0:
        solids += [drum((0, -0.02, r * 0.5), (0, -0.12, r + u(0.2, 0.35)), r * 0.85, 0.06)]
    solids += both(carved(block((0.2, 0.05, r + 0.03), (0.28, 0.08, 0.35), 0)))
    solids += [carved(block((0, -0.25, r + 0.02), (0.08, 0.5, 0.16), 0))]
    if kind == 1:
        solids += both(
            rods([(r * 0.8, 0.15, 0), (r + 0.25, 0.2, 0), (r + 0.32, u(0.45, 0.65), 0.03)], [0.12, 0.09, 0.04])
        )
    else:
        solids += [ball((0, r * 0.85, -0.1), (0.07, u(0.25, 0.38), r * 0.9))]
    return [*solids, carved(drum((0, -2, 0), (0, -neck + 0.05, 0), r * 0.75))]


def shirt(rng: Rng) -> list[Solid]:
    """Shape an empty shirt: trunk, collar, and sleeves spread or hanging."""
    u = rng.uniform
    wide, high, deep, sleeve, r = u(0.32, 0.42), u(0.75, 0.95), u(0.24, 0.34), u(0.25, 0.65), u(0.13, 0.17)
    solids = [block((0, high / 2, 0), (2 * wide, high, deep), 0.5)]
    drop = np.radians(u(5, 60))
    root = np.array([wide - 0.06, high - r - 0.02, 0])
    solids += both(
        drum(root, root + (sleeve + 0.12) * np.array([np.cos(drop), -np.sin(drop), 0]), r, r * u(0.85, 1.15))
    )
    solids += [carved(ball((0, high + 0.02, 0.05), (0.15, u(0.08, 0.2), deep * 0.45)))]
    if rng.random() < 0.5:
        solids += [carved(block((0, high * 0.45, deep / 2), (0.05, high, 0.06), 0))]
        solids += both(block((0.11, high, 0.06), (0.2, 0.1, deep * 0.8), 0.3, (0, 0, -25)))
    return [*solids, carved(block((0, 0, 0), (1.7 * wide, 0.1, deep * 0.6), 0.5))]


def trousers(rng: Rng) -> list[Solid]:
    """Shape empty trousers: a waistband and two legs."""
    u = rng.uniform
    wide, leg, apart, r = u(0.28, 0.36), u(0.4, 1.0), u(0.0, 0.15), u(0.15, 0.19)
    solids = [block((0, 0.1, 0), (2 * wide, 0.4, 0.34), 0.6), block((0, 0.27, 0), (2 * wide + 0.04, 0.1, 0.38), 0.6)]
    solids += both(drum((wide * 0.5, 0.1, 0), (wide * 0.55 + apart, -leg, 0), r, r * u(0.65, 1.15)))
    solids += [carved(block((0, 0.34, 0), (1.6 * wide, 0.14, 0.2), 0.5))]
    solids += both(carved(drum((wide * 0.55 + apart, -leg - 0.1, 0), (wide * 0.55 + apart, -leg + 0.06, 0), r * 0.5)))
    return solids
