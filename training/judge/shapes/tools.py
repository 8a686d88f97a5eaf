"""Shape tools, arms and other things for the hand."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, carved, drum, hoop, plate, rod, rods

__all__ = ["anvil", "axe", "camera", "chest", "dumbbell", "guitar", "hammer", "shield", "sword"]

Rng = np.random.Generator


def anvil(rng: Rng) -> list[Solid]:
    """Shape an anvil: a thick face with a horn, a waist and a spread foot."""
    u = rng.uniform
    face, high, horn, wide = u(0.35, 0.45), u(0.55, 0.7), u(0.4, 0.6), u(0.16, 0.22)
    solids = [block((0, high, 0), (2 * wide, 0.26, 2 * face), 0.1)]
    solids += [drum((0, high + 0.02, face - 0.05), (0, high + 0.06, face + horn), wide * 0.95, 0.04)]
    solids += [drum((0, 0.1, -0.03), (0, high, -0.03), wide * 0.95, wide * 0.75, sides=4)]
    solids += [block((0, 0.09, -0.03), (u(2.6, 3.2) * wide, 0.2, 1.7 * face), 0.2)]
    solids += [drum((0, 0.15, -0.03), (0, 0.4, -0.03), wide * 1.4, wide * 0.7, sides=4)]
    return [*solids, block((0, high + 0.06, -face - 0.1), (1.6 * wide, 0.14, 0.3), 0.1)]


def axe(rng: Rng) -> list[Solid]:
    """Shape an upright axe with one blade or two."""
    u = rng.uniform
    high, r, out, edge = u(1.2, 1.5), u(0.05, 0.075), u(0.38, 0.5), u(0.28, 0.4)
    y, bow = high - 0.28, u(0.0, 0.12)
    blade = [(0.0, -0.13), (out * 0.5, -0.18), (out, -edge), (out + bow, 0.0), (out, edge * 0.9), (out * 0.5, 0.16)]
    blade += [(0.0, 0.13)]
    solids = [rod((0, 0, 0), (0, high, 0), r * 1.2, r), plate(blade, u(0.09, 0.14), (0, y, 0))]
    solids += [block((0, y, 0), (0.2, 0.28, 0.2), 0.2)]
    if rng.random() < 0.35:
        solids += both(plate(blade, 0.1, (0, y, 0)))
    else:
        solids += [block((-0.15, y, 0), (0.2, 0.2, 0.14), 0.2)]
    return solids


def hammer(rng: Rng) -> list[Solid]:
    """Shape an upright hammer: a mallet, a sledge or one with a claw."""
    u = rng.uniform
    high, r, half, thick = u(1.0, 1.35), u(0.05, 0.08), u(0.25, 0.38), u(0.11, 0.18)
    y = high - thick
    solids = [rod((0, 0, 0), (0, high, 0), r * 1.25, r)]
    match int(rng.integers(3)):
        case 0:
            solids += [drum((-half, y, 0), (half, y, 0), thick)]
        case 1:
            solids += [block((0, y, 0), (2 * half, 2 * thick, 2 * thick), 0.2)]
        case _:
            solids += [drum((0, y, 0), (half, y, 0), thick * 0.7), drum((half - 0.1, y, 0), (half + 0.03, y, 0), thick)]
            solids += [
                rods([(0, y, z), (-half * 0.6, y + 0.05, z), (-half, y - 0.15, 2 * z)], [thick * 0.7, 0.07, 0.04])[k]
                for z in (-0.05, 0.05)
                for k in (0, 1)
            ]
    return solids


def sword(rng: Rng) -> list[Solid]:
    """Shape a sword that points upward: blade, guard, grip and pommel."""
    u = rng.uniform
    long, wide, grip, guard = u(1.0, 1.3), u(0.07, 0.13), u(0.25, 0.36), u(0.2, 0.36)
    blade = [(-wide, 0), (wide, 0), (wide * u(0.8, 1.0), long - 0.2), (0, long), (-wide * 0.9, long - 0.2)]
    solids = [plate(blade, 0.08, (0, 0, 0)), block((0, 0, 0), (2 * guard, 0.1, 0.13), 0.5)]
    return [*solids, drum((0, -grip, 0), (0, 0, 0), 0.06), ball((0, -grip - 0.03, 0), u(0.08, 0.11))]


def shield(rng: Rng) -> list[Solid]:
    """Shape a shield: pointed below, round, or long; bulged, with a rim and a boss or a cross."""
    u = rng.uniform
    wide, high, thick = u(0.45, 0.55), u(0.55, 0.75), u(0.1, 0.16)
    if rng.random() < 0.65:
        half = [(0.0, -high), (wide * 0.55, -high * 0.5), (wide * 0.95, 0.0), (wide, high * 0.6)]
        half += [(wide * 0.95, high * 0.75), (0.0, high * u(0.75, 0.9))]
        outline = np.array(half + [(-x, y) for x, y in half[-2:0:-1]])
        solids = [plate(outline, thick, (0, 0, 0)), ball((0, 0.1, 0), (wide * 0.8, high * 0.65, thick * 1.2))]
        solids += [carved(plate(outline * 0.85, 0.06, (0, 0, thick / 2)))] if rng.random() < 0.5 else []
    else:
        solids = [drum((0, 0, -thick / 2), (0, 0, thick / 2), 0.6), hoop((0, 0, thick / 3), 0.56, 0.06)]
        solids += [ball((0, 0, thick / 2), (0.5, 0.5, 0.1))]
    if rng.random() < 0.5:
        return [*solids, ball((0, 0.05, thick), (0.15, 0.15, 0.13))]
    solids += [block((0, 0.05, thick), (0.12, 1.3 * high, 0.08), 0)]
    return [*solids, block((0, 0.2, thick), (1.6 * wide, 0.12, 0.08), 0)]


def dumbbell(rng: Rng) -> list[Solid]:
    """Shape a dumbbell that lies along x: two weights on a bar."""
    u = rng.uniform
    half, r, bar, kind = u(0.35, 0.6), u(0.24, 0.36), u(0.07, 0.1), int(rng.integers(3))
    solids = [drum((-half, 0, 0), (half, 0, 0), bar)]
    if kind == 0:
        return solids + both(ball((half, 0, 0), r))
    if kind == 1:
        return solids + both(drum((half - 0.05, 0, 0), (half + u(0.2, 0.4), 0, 0), r, sides=6))
    return solids + both(
        [
            drum((half, 0, 0), (half + 0.11, 0, 0), r),
            drum((half + 0.14, 0, 0), (half + 0.25, 0, 0), r * 0.75),
            drum((half, 0, 0), (half + 0.32, 0, 0), bar),
        ]
    )


def camera(rng: Rng) -> list[Solid]:
    """Shape a camera: a box with a lens, a hump or a flash, a button and a grip."""
    u = rng.uniform
    wide, high, deep, r, out = u(0.5, 0.65), u(0.32, 0.42), u(0.16, 0.24), u(0.2, 0.28), u(0.15, 0.5)
    solids = [block((0, 0, 0), (2 * wide, 2 * high, 2 * deep), u(0.1, 0.5))]
    solids += [drum((0, -0.03, deep), (0, -0.03, deep + out), r, r * u(0.85, 1.1))]
    solids += [carved(drum((0, -0.03, deep + out - 0.08), (0, -0.03, deep + out + 0.2), r * 0.65))]
    solids += [drum((wide * 0.65, high, 0), (wide * 0.65, high + 0.09, 0), 0.09)]
    solids += (
        [block((0, high + 0.06, 0), (0.36, 0.22, 1.5 * deep), 0.3)]
        if rng.random() < 0.6
        else [block((-wide * 0.6, high, 0), (0.26, 0.16, 0.2), 0.2)]
    )
    return [*solids, block((-wide + 0.1, -0.02, deep), (0.18, 1.6 * high, 0.14), 0.7)] if rng.random() < 0.5 else solids


def chest(rng: Rng) -> list[Solid]:
    """Shape a treasure chest: a box under a curved lid with bands and a lock, closed or open."""
    u = rng.uniform
    wide, deep, high, lid = u(0.5, 0.65), u(0.3, 0.38), u(0.36, 0.46), u(0.7, 1.0)
    solids = [block((0, high / 2, 0), (2 * wide, high, 2 * deep), 0)]
    cover = [(deep * np.cos(a), lid * deep * np.sin(a)) for a in np.linspace(0, np.pi, 11)]
    shape = np.array([(y, z) for z, y in cover])
    if rng.random() < 0.7:
        solids += [plate(shape, 2 * wide, (0, high + 0.01, 0), "x")]
        solids += [plate(shape * 1.1, 0.11, (x, high + 0.01, 0), "x") for x in (-0.75 * wide, 0.75 * wide)]
        solids += [carved(block((0, high, deep), (3, 0.04, 0.08), 0))]
        solids += [block((0, high - 0.02, deep), (0.2, 0.24, 0.12), 0.2)]
    else:
        solids += [carved(block((0, high, 0), (2 * wide - 0.16, 0.4, 2 * deep - 0.16), 0))]
        solids += [ball((0, high - 0.05, 0), (wide - 0.1, 0.16, deep - 0.1))]
        solids += [plate(shape + [0, deep], 2 * wide, (0, high, -deep), "x", (-u(60, 95), 0, 0))]
    return solids + both(block((0.75 * wide, high / 2, 0), (0.11, high, 2 * deep + 0.08), 0))


def guitar(rng: Rng) -> list[Solid]:
    """Shape an upright guitar: a waisted body with a hole or horns, a neck and a head."""
    u = rng.uniform
    r, waist, thick, neck = u(0.34, 0.42), u(0.28, 0.33), u(0.14, 0.22), u(0.7, 0.9)
    solids = [drum((0, 0, -thick / 2), (0, 0, thick / 2), r), drum((0, 0.46, -thick / 2), (0, 0.46, thick / 2), waist)]
    solids += [block((0, 0.25, 0), (0.45, 0.4, thick), 0.1)]
    solids += [block((0, 0.7 + neck / 2, thick * 0.3), (0.12, neck, 0.09), 0.2)]
    solids += [block((0, 0.75 + neck, thick * 0.25), (0.2, 0.26, 0.08), 0.2)]
    if rng.random() < 0.6:
        solids += [
            carved(drum((0, 0.32, 0), (0, 0.32, 0.5), 0.13)),
            block((0, -0.06, thick / 2), (0.3, 0.07, 0.08), 0.2),
        ]
    else:
        solids += both(rod((0.2, 0.5, 0), (u(0.22, 0.3), u(0.75, 0.9), 0), 0.1, 0.05))
        solids += [block((0, 0.1, thick / 2), (0.28, 0.1, 0.07), 0)]
    return solids + both([ball((0.14, 0.68 + neck + d, thick * 0.25), 0.045) for d in (0.0, 0.1)])
