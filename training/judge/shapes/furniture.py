"""Shape furniture. It faces +Z; y = 0 is the floor."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, carved, drum, plate, rod, rods

__all__ = [
    "armchair", "bathtub", "bed", "bench", "bookcase", "cabinet", "chair", "desk", "fridge", "piano", "pillow",
    "sofa", "stool", "table", "television", "toilet",
]  # fmt: skip

Rng = np.random.Generator


def _legs(rng: Rng, wide: float, deep: float, high: float) -> list[Solid]:
    """Return four legs under a plate of half sides `wide` and `deep`: square, round, tapered or spread."""
    thick, spread = rng.uniform(0.045, 0.09), rng.choice([0.0, rng.uniform(0.0, 0.12)])
    kind, solids = int(rng.integers(3)), []
    x, z = wide - thick - 0.02, deep - thick - 0.02
    for front in (-1.0, 1.0):
        top, foot = (x, high, front * z), (x + spread, 0.0, front * (z + spread))
        if kind == 0:
            solids += both(drum(foot, top, thick, sides=4))
        else:
            solids += both(drum(foot, top, thick * (0.6 if kind == 1 else 1.0), thick))
    return solids


def armchair(rng: Rng) -> list[Solid]:
    """Shape an armchair: as wide as deep, with thick arms, a back and a cushion."""
    return _couch(rng, rng.uniform(0.24, 0.34))


def _couch(rng: Rng, half: float) -> list[Solid]:
    u, soft = rng.uniform, rng.uniform(0.1, 0.9)
    seat, deep, arm, thick = u(0.28, 0.4), u(0.34, 0.42), u(0.5, 0.65), u(0.14, 0.22)
    back = u(0.75, 1.05)
    solids = [block((0, seat / 2 + 0.05, 0), (2 * half + thick, seat - 0.1, 2 * deep), 0.2)]
    count = max(1, round(half / 0.3))
    for k in range(count):
        x = half * ((2 * k + 1) / count - 1)
        solids += [block((x, seat + 0.03, 0.05), (2 * half / count - 0.02, 0.16, 2 * deep - 0.1), soft)]
    solids += [block((0, back / 2 + 0.05, -deep), (2 * half + thick, back - 0.1, 0.2), soft, (-u(0, 10), 0, 0))]
    if rng.random() < 0.6:
        solids += both(block((half + thick / 2, arm / 2 + 0.05, 0), (thick, arm - 0.1, 2 * deep + 0.05), soft))
    else:
        x = half + thick / 2
        solids += both(block((x, arm / 2, 0), (thick * 0.8, arm, 2 * deep), 0.1))
        solids += both(drum((x, arm, -deep), (x, arm, deep + 0.04), thick * 0.65))
    for z in (-0.8 * deep, 0.8 * deep):
        solids += both(drum((half, -0.05, z), (half, 0.15, z), 0.05))
    return solids


def sofa(rng: Rng) -> list[Solid]:
    """Shape a sofa for two, three or four."""
    return _couch(rng, rng.uniform(0.6, 1.0))


def bathtub(rng: Rng) -> list[Solid]:
    """Shape a bathtub: a long hollow with a rolled rim, on feet or on the floor, with a tap."""
    u = rng.uniform
    wide, long, high = u(0.34, 0.42), u(0.7, 0.85), u(0.42, 0.52)
    y = 0.08
    if rng.random() < 0.6:
        shell = [ball((0, y + high, z), (wide, high, wide * 1.1)) for z in np.linspace(wide - long, long - wide, 4)]
        solids = [*shell, carved(block((0, y + high + 0.5, 0), (3, 1.0, 3), 0))]
        solids += [
            carved(ball((0, y + high, z), (wide - 0.08, high - 0.08, wide)))
            for z in np.linspace(wide - long, long - wide, 4)
        ]
        rim = [block((0, y + high - 0.02, 0), (2 * wide + 0.12, 0.08, 2 * long + 0.1), 0.9)]
        solids = (
            solids[:4]
            + [solids[4]]
            + rim
            + solids[5:]
            + [carved(block((0, y + high, 0), (2 * wide - 0.2, 0.3, 2 * long - 0.28), 0.9))]
        )
    else:
        solids = [block((0, high / 2, 0), (2 * wide, high, 2 * long), 0.3)]
        solids += [carved(block((0, high, 0), (2 * wide - 0.16, 2 * high - 0.2, 2 * long - 0.16), 0.8))]
        y = 0.0
    if y:
        for z in (-0.6 * long, 0.6 * long):
            solids += both(rod((wide * 0.6, 0.2, z), (wide * 0.75, 0.0, z * 1.1), 0.09, 0.06))
    if rng.random() < 0.6:
        solids += rods([(0, high, -long), (0, high + 0.25, -long), (0, high + 0.22, -long + 0.2)], [0.05] * 3)
    return solids


def bed(rng: Rng) -> list[Solid]:
    """Shape a bed: mattress, a headboard, a lower footboard, pillows and legs. Its foot is in front."""
    u = rng.uniform
    wide, long, high, head = u(0.4, 0.7), u(0.85, 1.0), u(0.25, 0.36), u(0.6, 0.95)
    solids = [block((0, high - 0.1, 0), (2 * wide, 0.16, 2 * long), 0)]
    solids += [block((0, high + 0.06, 0), (1.9 * wide, 0.2, 1.92 * long), 0.7)]
    solids += [block((0, head / 2, -long), (2 * wide + 0.06, head, 0.1), 0.3)]
    if rng.random() < 0.7:
        solids += [block((0, high * 0.8, long), (2 * wide + 0.06, u(0.9, 1.2) * 1.6 * high, 0.09), 0.3)]
    count = 2 if wide > 0.5 else 1
    for k in range(count):
        x = wide * 0.95 * ((2 * k + 1) / count - 1)
        solids += [block((x, high + 0.2, -0.72 * long), (1.5 * wide / count, 0.16, 0.34), 0.95)]
    for z in (-long + 0.06, long - 0.06):
        solids += both(drum((wide - 0.06, 0, z), (wide - 0.06, high, z), 0.06, sides=4))
    if rng.random() < 0.5:
        solids += [block((0, high + 0.1, 0.3 * long), (2 * wide + 0.03, 0.22, 1.25 * long), 0.5)]
    return solids


def bench(rng: Rng) -> list[Solid]:
    """Shape a park bench of boards on two supports, mostly with a back."""
    u = rng.uniform
    half, seat, deep = u(0.7, 0.95), u(0.36, 0.44), u(0.2, 0.26)
    solids = [block((0, seat, z), (2 * half, 0.08, 0.13), 0.2) for z in np.linspace(-deep, deep, 3)]
    if rng.random() < 0.75:
        for k in range(2):
            y = seat + 0.2 + 0.2 * k
            solids += [block((0, y, -deep - 0.08 - 0.05 * k), (2 * half, 0.13, 0.08), 0.2, (-12, 0, 0))]
        solids += both(rod((half * 0.8, seat - 0.1, -deep), (half * 0.8, seat + 0.48, -deep - 0.16), 0.05))
    if rng.random() < 0.5:
        solids += both(block((half * 0.8, seat / 2, 0), (0.1, seat, 2 * deep + 0.1), 0.1))
    else:
        for z in (-deep, deep):
            solids += both(block((half * 0.8, seat / 2, z), (0.1, seat, 0.1), 0.1))
    return solids


def cabinet(rng: Rng) -> list[Solid]:
    """Shape a cupboard: a tall box with doors, knobs and drawers, on short legs or a plinth."""
    u = rng.uniform
    wide, high, deep, leg = u(0.32, 0.5), u(0.8, 1.3), u(0.2, 0.28), u(0.08, 0.18)
    solids = [block((0, leg + high / 2, 0), (2 * wide, high, 2 * deep), 0)]
    solids += [block((0, leg + high, 0), (2 * wide + 0.1, 0.08, 2 * deep + 0.08), 0.2)]
    solids += (
        [*_legs(rng, wide, deep, leg + 0.05)]
        if rng.random() < 0.7
        else [block((0, leg / 2, 0), (1.9 * wide, leg, 1.8 * deep), 0)]
    )
    split = leg + high * rng.choice([0.0, u(0.25, 0.4)])
    solids += [carved(block((0, (split + leg + high) / 2, deep), (0.05, high + leg - split - 0.1, 0.08), 0))]
    if split > leg:
        solids += [carved(block((0, y, deep), (1.85 * wide, 0.05, 0.08), 0)) for y in (split, (split + leg) / 2)]
    solids += both(
        carved(
            block(
                (0.5 * wide, (split + leg + high) / 2 + 0.02, deep), (0.62 * wide, (high + leg - split) * 0.72, 0.06), 0
            )
        )
    )
    return solids + both(ball((0.12, (split + leg + high) / 2, deep + 0.03), 0.055))


def chair(rng: Rng) -> list[Solid]:
    """Shape a chair: with a panel, bars or a hoop for a back, four legs, sometimes arms or one column on a cross."""
    u = rng.uniform
    wide, deep, seat, back, thick = u(0.24, 0.32), u(0.23, 0.3), u(0.38, 0.5), u(0.4, 0.65), u(0.06, 0.1)
    lean, solids = u(0, 0.12), [block((0, seat, 0), (2 * wide, thick, 2 * deep), u(0, 0.9))]
    if rng.random() < 0.2:
        solids = [drum((0, seat - thick / 2, 0), (0, seat + thick / 2, 0), wide)]
    top = seat + back
    match int(rng.integers(3)):
        case 0:
            solids += [
                block(
                    (0, seat + back / 2, -deep - lean / 2 + 0.03),
                    (2 * wide * u(0.8, 1.0), back + 0.05, 0.075),
                    u(0, 0.9),
                    (-np.degrees(np.arctan2(lean, back)), 0, 0),
                )
            ]
        case 1:
            solids += both(rod((wide - 0.04, seat, -deep + 0.04), (wide - 0.04, top, -deep - lean), 0.045))
            solids += [
                block((0, seat + back * s, -deep + 0.04 - lean * s), (2 * wide - 0.05, 0.1, 0.06), 0.2)
                for s in np.linspace(0.4, 0.95, int(rng.integers(2, 4)))
            ]
        case _:
            solids += both(rod((wide - 0.04, seat, -deep + 0.04), (wide - 0.04, top, -deep - lean), 0.045)) + [
                block((0, top, -deep - lean), (2 * wide, 0.11, 0.07), 0.4)
            ]
            solids += [
                rod((x, seat, -deep + 0.04), (x, top, -deep - lean), 0.035) for x in np.linspace(-wide, wide, 5)[1:-1]
            ]
    if rng.random() < 0.75:
        solids += _legs(rng, wide, deep, seat)
    else:
        solids += [drum((0, 0.1, 0), (0, seat, 0), 0.06)]
        for k in range(5):
            a = 2 * np.pi * k / 5
            solids += [rod((0, 0.12, 0), (0.3 * np.sin(a), 0.04, 0.3 * np.cos(a)), 0.05, 0.04)]
    if rng.random() < 0.3:
        solids += both(
            rods(
                [(wide, seat, deep * 0.7), (wide + 0.02, seat + 0.22, deep * 0.7), (wide, seat + 0.22, -deep)],
                [0.04] * 3,
            )
        )
    return solids


def desk(rng: Rng) -> list[Solid]:
    """Shape a desk: a top on drawers at one side or both, a panel behind."""
    u = rng.uniform
    wide, deep, high = u(0.7, 0.9), u(0.32, 0.42), u(0.6, 0.72)
    solids = [block((0, high, 0), (2 * wide, 0.08, 2 * deep), 0.2)]
    solids += [block((0, high * 0.65, -deep + 0.06), (1.9 * wide, high * 0.6, 0.07), 0)]
    wing = u(0.22, 0.3)
    for side in [[-1.0], [1.0], [-1.0, 1.0]][int(rng.integers(3))]:
        x = side * (wide - wing - 0.03)
        solids += [block((x, high / 2 + 0.03, 0), (2 * wing, high - 0.06, 1.9 * deep), 0)]
        solids += [carved(block((x, high * s, 0.95 * deep), (1.9 * wing, 0.045, 0.08), 0)) for s in (0.34, 0.62)]
        solids += [ball((x, high * s, 0.98 * deep), 0.045) for s in (0.22, 0.49, 0.78)]
    for z in (-deep + 0.08, deep - 0.08):
        solids += both(block((wide - 0.08, high / 2, z), (0.09, high, 0.09), 0))
    return solids


def stool(rng: Rng) -> list[Solid]:
    """Shape a stool: a round or square seat on spread legs with rungs, or on a column."""
    u = rng.uniform
    r, high, count = u(0.24, 0.32), u(0.45, 0.95), int(rng.choice([3, 4, 4]))
    square = rng.random() < 0.3
    solids = [
        block((0, high, 0), (1.8 * r, 0.1, 1.8 * r), 0.4)
        if square
        else drum((0, high - 0.06, 0), (0, high + 0.06, 0), r)
    ]
    if rng.random() < 0.2:
        return [*solids, drum((0, 0.05, 0), (0, high, 0), 0.06), drum((0, 0, 0), (0, 0.07, 0), 0.26, 0.2)]
    out, rung = u(1.0, 1.4) * r, high * u(0.25, 0.45)
    for k in range(count):
        a, b = 2 * np.pi * (k + 0.5) / count, 2 * np.pi * (k + 1.5) / count
        d, e = np.array([np.sin(a), 0, np.cos(a)]), np.array([np.sin(b), 0, np.cos(b)])
        solids += [rod(d * out, d * 0.75 * r + [0, high, 0], 0.05)]
        solids += [rod(d * 0.9 * out + [0, rung, 0], e * 0.9 * out + [0, rung, 0], 0.035)]
    return solids


def table(rng: Rng) -> list[Solid]:
    """Shape a table: a square, long or round top on four legs or on a column."""
    u = rng.uniform
    wide, deep, high, thick = u(0.55, 0.95), u(0.4, 0.6), u(0.4, 0.75), u(0.07, 0.11)
    if rng.random() < 0.35:
        r = u(0.5, 0.7)
        solids = [drum((0, high - thick, 0), (0, high, 0), r)]
        if rng.random() < 0.6:
            return [*solids, drum((0, 0.05, 0), (0, high, 0), u(0.06, 0.12)), drum((0, 0, 0), (0, 0.1, 0), 0.36, 0.2)]
        return solids + _legs(rng, r * 0.75, r * 0.75, high - thick)
    solids = [block((0, high - thick / 2, 0), (2 * wide, thick, 2 * deep), 0.1)]
    if rng.random() < 0.4:
        solids += [block((0, high - thick - 0.05, 0), (1.8 * wide, 0.12, 1.8 * deep), 0)]
    return solids + _legs(rng, wide, deep, high - thick / 2)


def television(rng: Rng) -> list[Solid]:
    """Shape a television: a flat screen on a foot, or an old deep set with an aerial."""
    u = rng.uniform
    wide, high = u(0.6, 0.8), u(0.35, 0.48)
    if rng.random() < 0.6:
        low = u(0.12, 0.25)
        solids = [block((0, low + high, 0), (2 * wide, 2 * high, 0.12), 0.2)]
        solids += [carved(block((0, low + high, 0.08), (1.84 * wide, 1.8 * high, 0.09), 0))]
        solids += [block((0, low / 2 + 0.05, -0.02), (u(0.1, 0.25), low + 0.15, 0.08), 0.2)]
        return [*solids, block((0, 0.03, 0), (u(0.5, 0.8), 0.07, 0.34), 0.4)]
    wide, high = u(0.5, 0.6), u(0.38, 0.45)
    solids = [block((0, 0.12 + high, 0), (2 * wide, 2 * high, 0.6), 0.3)]
    solids += [carved(block((-0.1, 0.12 + high, 0.32), (1.4 * wide, 1.6 * high, 0.12), 0.6))]
    solids += [
        drum((wide * 0.78, 0.12 + high * s, 0.25), (wide * 0.78, 0.12 + high * s, 0.36), 0.07) for s in (1.0, 1.45)
    ]
    solids += both(rod((0.03, 0.1 + 2 * high, 0), (0.35, 0.5 + 2 * high, 0), 0.04))
    return solids + both([drum((0.35, 0, z), (0.33, 0.15, z), 0.05) for z in (-0.2, 0.2)])


def piano(rng: Rng) -> list[Solid]:
    """Shape a piano: upright with a shelf of keys, or a grand with its lid raised."""
    u = rng.uniform
    if rng.random() < 0.65:
        wide, high = u(0.6, 0.75), u(0.85, 1.05)
        solids = [block((0, high / 2, -0.1), (2 * wide, high, 0.34), 0.1)]
        solids += [block((0, high * 0.55, 0.2), (2 * wide, 0.14, 0.4), 0.1)]
        solids += [block((0, high, -0.1), (2 * wide + 0.08, 0.07, 0.4), 0.2)]
        solids += [carved(block((0, high * 0.55 + 0.09, 0.26), (1.8 * wide, 0.1, 0.22), 0))]
        solids += [
            block((x, high * 0.55 + 0.05, 0.24), (0.06, 0.07, 0.13), 0)
            for x in np.linspace(-0.8 * wide, 0.8 * wide, 10)
        ]
        return (
            solids
            + both(drum((wide - 0.08, 0, 0.32), (wide - 0.08, high * 0.5, 0.32), 0.06))
            + [block((0, 0.05, 0.05), (2 * wide, 0.1, 0.5), 0)]
        )
    high, lift = u(0.5, 0.6), u(30, 45)
    case = [(-0.6, 0.55), (-0.6, -0.75), (-0.25, -0.85), (0.05, -0.6), (0.25, -0.15), (0.6, 0.0), (0.6, 0.55)]
    turned = np.array(case)[:, ::-1]
    solids = [plate(turned, 0.24, (0, high, 0), "y"), block((0, high - 0.02, 0.62), (1.2, 0.14, 0.3), 0.1)]
    lid = plate(turned - [0, -0.6], 0.07, (-0.6, high + 0.14, -0.02), "y", (0, 0, lift))
    solids += [lid, *both(drum((0.45, 0, 0.45), (0.45, high, 0.45), 0.07))]
    solids += [drum((-0.3, 0, -0.6), (-0.3, high, -0.6), 0.07)]
    return [*solids, rod((0.4, high, -0.05), (0.25, high + 0.55, -0.05), 0.035)]


def bookcase(rng: Rng) -> list[Solid]:
    """Shape a bookcase: a hollow case, narrow or broad, with boards and books, or without."""
    u = rng.uniform
    wide, row, rows, deep = u(0.32, 0.6), u(0.26, 0.34), int(rng.integers(3, 6)), u(0.13, 0.2)
    high = rows * row
    solids = [block((0, high / 2, 0), (2 * wide, high + 0.06, 2 * deep), 0)]
    solids += [
        carved(block((0, (k + 0.5) * row, 0.08), (2 * wide - 0.12, row - 0.06, 2 * deep), 0)) for k in range(rows)
    ]
    for k in range(rows):
        x, full = -wide + 0.06, rng.random() < 0.85
        while full and x < wide * u(0.3, 0.95) - 0.1:
            thick, tall = u(0.04, 0.1), u(0.6, 0.88) * (row - 0.06)
            size = (thick * 0.9, tall, 2 * deep - u(0.06, 0.16))
            solids += [block((x + thick / 2, k * row + 0.03 + tall / 2, -0.02), size, 0.2)]
            x += thick + 0.1 * (rng.random() < 0.08)
    lid = block((0, high + 0.04, 0), (2 * wide + 0.1, 0.07, 2 * deep + 0.06), 0.2)
    return [*solids, lid] if rng.random() < 0.5 else solids


def fridge(rng: Rng) -> list[Solid]:
    """Shape a fridge: a high block with a seam between its doors and upright grips; a rounded one of old; a larder."""
    u = rng.uniform
    wide, high, deep = u(0.32, 0.42), u(1.0, 1.3), u(0.3, 0.38)
    solids = [block((0, high / 2 + 0.05, 0), (2 * wide, high, 2 * deep), u(0.0, 0.5))]
    solids += [block((0, 0.05, 0), (1.8 * wide, 0.1, 1.7 * deep), 0)]
    kind, z = int(rng.integers(3)), deep + 0.05
    if kind == 2:
        solids += [carved(block((0, high / 2 + 0.05, deep), (0.04, high, 0.1), 0))]
        solids += [*both(block((0.08, 0.55 * high, z), (0.06, u(0.3, 0.6), 0.08), 0.5))]
        tap = carved(block((-0.5 * wide, 0.65 * high, deep), (0.2, 0.24, 0.12), 0.1))
        return [*solids, tap] if rng.random() < 0.5 else solids
    seam, x = high * (u(0.25, 0.4) if kind else u(0.6, 0.75)), 0.75 * wide * rng.choice([-1, 1])
    solids += [carved(block((0, seam + 0.05, deep), (3 * wide, 0.045, 0.14), 0))]
    for low, top in ((0.05, seam), (seam + 0.05, high)):
        long = u(0.3, 0.6) * (top - low)
        y = (low + top) / 2 if rng.random() < 0.5 else (top - long / 2 - 0.08 if top == seam else low + long / 2 + 0.08)
        solids += [block((x, y, z), (0.06, long, 0.09), 0.5)]
    return solids


def toilet(rng: Rng) -> list[Solid]:
    """Shape a toilet: a bowl on a waist or boxed in, a ring of a seat, a lid up, down or none, a cistern behind."""
    u = rng.uniform
    wide, long, high = u(0.26, 0.32), u(0.34, 0.44), u(0.42, 0.52)
    solids = [block((0, 0.2, -0.1), (0.36, 0.4, 0.6), 0.3)]
    if rng.random() < 0.7:
        solids = [drum((0, 0, -0.05), (0, high, 0), u(0.14, 0.2), 0.24)]
    solids += [
        ball((0, high, 0.08), (wide, u(0.25, 0.36), long)),
        block((0, high - 0.15, -long), (0.36, 0.3, 0.3), 0.3),
    ]
    solids += [
        carved(block((0, high + 0.5, 0), (3, 1.0, 3), 0)),
        ball((0, high, 0.08), (wide + 0.03, 0.05, long + 0.03)),
    ]
    lid, tank = int(rng.integers(3)), u(0.35, 0.5)
    if lid != 1:
        solids += [carved(ball((0, high + 0.02, 0.08), (wide - 0.08, 0.24, long - 0.1)))]
    solids += [ball((0, high + long, 0.02 - long), (wide, long, 0.06), (-8, 0, 0))] if lid == 0 else []
    solids += [ball((0, high + 0.03, 0.08), (wide + 0.02, 0.07, long + 0.02))] if lid == 1 else []
    z = -long - u(0.1, 0.2)
    solids += [block((0, high + tank / 2, z), (u(0.5, 0.66), tank, 0.24), u(0.1, 0.5))]
    solids += [block((0, high + tank, z), (0.68, 0.07, 0.3), 0.4)]
    lever = rod((-0.22, high + 0.8 * tank, z + 0.14), (-0.1, high + 0.8 * tank, z + 0.16), 0.04)
    return [*solids, lever if rng.random() < 0.5 else drum((0, high + tank, z), (0, high + tank + 0.07, z), 0.07)]


def pillow(rng: Rng) -> list[Solid]:
    """Shape a pillow: a plump square or oblong cushion with pointed corners, lying or leaning, or a roll."""
    u = rng.uniform
    wide, high, thick = u(0.5, 0.75), u(0.4, 0.5), u(0.14, 0.24)
    lean, pinch = (-90.0 if rng.random() < 0.3 else -u(0, 35)), u(0.05, 0.2)
    if rng.random() < 0.1:
        return [rod((-wide, 0, 0), (wide, 0, 0), thick), *both(ball((wide + thick, 0, 0), 0.06))]
    x = np.linspace(-1, 1, 9)
    side = np.stack([wide * x, -high * (1 - pinch * (1 - x * x))], 1)
    next_ = np.stack([wide * (1 - pinch * (1 - x * x)), high * x], 1)
    rim = np.concatenate([side[:-1], next_[:-1], -side[:-1], -next_[:-1]])
    solids = [plate(rim, 0.1, (0, 0, 0), "z", (lean, 0, 0))]
    solids += [block((0, 0, 0), (1.86 * wide, 1.86 * high, 2 * thick), 1.0, (lean, 0, 0))]
    return [*solids, ball((0, 0, 0), (wide * 0.9, high * 0.9, thick * 1.25), (lean, 0, 0))]
