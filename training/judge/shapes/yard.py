"""Shape what stands in castles, churchyards, stores and yards. It faces +Z; y = 0 is the ground."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import (
    Solid, around, ball, block, both, carved, drum, half_ball, hoop, plate, rod, rods, spun,
)  # fmt: skip

__all__ = [
    "bomb", "bone", "book", "coffin", "column", "cone", "crate", "crown", "door", "gravestone", "log", "sack", "scroll",
    "skull", "torch", "tower", "trashcan", "well",
]  # fmt: skip

Rng = np.random.Generator


def _slab(half: float, high: float, round_: float) -> np.ndarray:
    """Return the outline of an upright slab whose top is an arch; `round_` is 0 for flat and 1 for a half circle."""
    a = np.linspace(0, np.pi, 13)
    return np.array([(-half, 0), (half, 0), *np.stack([half * np.cos(a), high + half * round_ * (np.sin(a) - 1)], 1)])


def tower(rng: Rng) -> list[Solid]:
    """Shape a tower of a castle: round, square or with six sides, battlements or a pointed roof; or a wooden lookout."""
    u, sides = rng.uniform, int(rng.choice([0, 4, 6]))
    r, high = u(0.26, 0.38), u(0.9, 1.4)
    if rng.random() < 0.15:
        made = both([rod((1.1 * r, 0, z), (0.85 * r, high, 0.8 * z), 0.06) for z in (-r, r)]) + [block((0, high, 0), (2.4 * r, 0.1, 2.4 * r), 0)]
        made += [block((0, high + 0.2, 0), (2 * r, 0.36, 2 * r), 0), drum((0, high + 0.4, 0), (0, high + 0.85, 0), 1.3 * r, 0.02, sides=4)]
        return made + both(rods([(1.05 * r, 0.1, r), (0.9 * r, high * 0.9, -0.85 * r)], [0.045] * 2))
    made = [drum((0, 0, 0), (0, high, 0), r * u(1.0, 1.3), r, sides), drum((0, high - 0.05, 0), (0, high + 0.22, 0), r * u(1.1, 1.35), sides=sides)]
    wide, top = 1.2 * r, high + 0.22
    if rng.random() < 0.6:
        made += [carved(drum((0, high + 0.1, 0), (0, top + 0.2, 0), r * 0.9, sides=sides))]
        for way, degrees in around(int(rng.choice([2, 3, 4])), u(0, 1.5) * (sides != 4)):
            made += [carved(block((0, top, 0), (4 * r * abs(way[2]) + 0.13, 0.22, 4 * r * abs(way[2]) + 0.13) if sides == 4 else (0.15, 0.22, 4 * r), 0, (0, degrees, 0)))]
    else:
        made += [drum((0, top, 0), (0, top + u(0.4, 0.9), 0), wide * u(1.05, 1.25), 0.02, sides)]
    if rng.random() < 0.8:
        made += [carved(plate(_slab(0.1, 0.32, 1.0), 0.5, (0, 0, r * 1.15)))]
    return made + [carved(block(way * r * 1.05 + [0, y, 0], (0.09, 0.2, 0.2), 0, (0, turn, 0))) for y in (0.5 * high, 0.75 * high) for way, turn in around(4)]


def skull(rng: Rng) -> list[Solid]:
    """Shape a skull: a large crown, round holes for its eyes, a small one for its nose, teeth; some with crossed bones."""
    u = rng.uniform
    wide, eye = u(0.42, 0.5), u(0.14, 0.18)
    made = [ball((0, 0.62, -0.08), (wide, u(0.4, 0.48), u(0.48, 0.58))), block((0, 0.3, 0.2), (wide * u(1.0, 1.4), 0.34, 0.4), 0.7)]
    made += both(ball((0.72 * wide, 0.4, 0.14), (0.1, 0.07, 0.2)))
    made += [carved(s) for s in both(ball((wide * 0.46, 0.5, 0.46), (eye * u(0.85, 1.1), eye, 0.26)))]
    made += [carved(drum((0, 0.3, 0.4), (0, 0.44, 0.42), 0.08, 0.02, sides=3 if rng.random() < 0.5 else 0))]
    if rng.random() < 0.6:
        low = u(0.02, 0.08)
        made += [block((0, low, 0.16), (wide * 1.1, 0.16, 0.42), 0.6), carved(block((0, 0.15, 0.3), (wide * 1.3, 0.05, 0.4), 0))]
        made += both(rod((0.5 * wide, low, 0.1), (0.7 * wide, 0.45, -0.05), 0.07))
    for x in np.linspace(-0.55, 0.55, int(rng.integers(4, 7))) * wide * 0.8:
        made += [carved(block((x, 0.16, 0.42), (0.035, 0.14, 0.14), 0))]
    if rng.random() < 0.15:
        for s in (-1, 1):
            made += [rod((-0.65 * s, -0.45, 0), (0.65 * s, 0.1, 0), 0.07), *(ball((x * s, y, 0), 0.11) for x, y in ((-0.7, -0.42), (-0.6, -0.55), (0.7, 0.07), (0.6, 0.2)))]
    return made


def crown(rng: Rng) -> list[Solid]:
    """Shape a crown: a hollow band with teeth, lilies or balls on rods, upright or flared, sometimes vaulted."""
    u, count = rng.uniform, int(rng.integers(4, 9))
    r, high, flare = u(0.4, 0.5), u(0.3, 0.5), u(1.0, 1.3)
    band, kind = u(0.1, 0.2), int(rng.integers(3))
    made = [drum((0, 0, 0), (0, band if kind == 2 else high, 0), r, r * (1.0 if kind == 2 else flare)), carved(drum((0, -0.1, 0), (0, high + 0.1, 0), r - 0.07, r * flare - 0.07))]
    for way, degrees in around(count, 0.3):
        gap = np.pi * r * flare / count
        side = np.array([way[2], 0, -way[0]])
        if kind == 2:
            made += [drum(way * (r - 0.03), way * (r * flare - 0.03) + [0, high, 0], 0.11, 0.05), ball(way * r * flare + [0, high + 0.05, 0], u(0.07, 0.1))]
            continue
        notch = [(-gap * 0.85, high + 0.2), (gap * 0.85, high + 0.2), (0, band)] if kind else [(-0.75 * gap, high + 0.2), (0.75 * gap, high + 0.2), (0.4 * gap, band), (-0.4 * gap, band)]
        made += [carved(plate(notch, 0.5, way * r * flare, "z", (0, degrees, 0)))]
        tip = way * 0 + np.array([np.sin(np.radians(degrees) + np.pi / count), 0, np.cos(np.radians(degrees) + np.pi / count)])
        made += [ball(tip * (r * flare - 0.03) + side * 0 + [0, high, 0], u(0.06, 0.09))] if kind else []
    made += [hoop((0, 0.04, 0), r, 0.06, (90, 0, 0))]
    if rng.random() < 0.25:
        made += [*half_ball((0, 0.1, 0), (r * 0.85, high + 0.15, r * 0.85)), ball((0, high + 0.32, 0), 0.1)]
    return made


def gravestone(rng: Rng) -> list[Solid]:
    """Shape a gravestone: a slab with a round, flat or pointed head, a cross, or an obelisk, upright or leaning."""
    u, kind = rng.uniform, int(rng.integers(4))
    half, high, thick, lean = u(0.3, 0.42), u(0.75, 1.05), u(0.14, 0.24), (u(-12, 4), 0, u(-8, 8) * (rng.random() < 0.4))
    made = [block((0, 0.06, 0), (2 * half + u(0.1, 0.3), u(0.12, 0.2), thick + u(0.15, 0.3)), 0.1)]
    if kind == 0:
        arm = u(0.6, 0.75) * high
        made += [block((0, high / 2, 0), (0.2, high, thick), 0.1, lean), block((0, arm, 0), (1.6 * half, 0.2, thick), 0.1, lean)]
        return [*made, hoop((0, arm, 0), 0.24, 0.06)] if rng.random() < 0.4 else made
    if kind == 1 and rng.random() < 0.5:
        return [*made, drum((0, 0, 0), (0, high * 1.2, 0), 0.22, 0.14, 4), drum((0, high * 1.2, 0), (0, high * 1.2 + 0.16, 0), 0.14, 0.01, 4)]
    outline = _slab(half, high, u(0.7, 1.0) if kind == 2 else u(0.0, 0.5)) if kind != 3 else [(-half, 0), (half, 0), (half, 0.75 * high), (0, high), (-half, 0.75 * high)]
    made += [plate(outline, thick, (0, 0, 0), "z", lean)]
    mark = [block((0, 0.66 * high, thick / 2), (0.09, 0.3, 0.08), 0, lean), block((0, 0.7 * high, thick / 2), (0.24, 0.09, 0.08), 0, lean)]
    mark += [block((0, y * high, thick / 2), (1.2 * half, 0.05, 0.06), 0, lean) for y in (0.3, 0.42)]
    return made + ([carved(s) for s in mark] if rng.random() < 0.6 else mark)


def crate(rng: Rng) -> list[Solid]:
    """Shape a crate: panels sunk in a frame with one slanted board, a cross or boards beside each other; rarely open."""
    u = rng.uniform
    half = np.array([u(0.4, 0.55), u(0.3, 0.5), u(0.4, 0.5)])
    bar, sunk, kind = u(0.12, 0.18), u(0.04, 0.07), int(rng.integers(4))
    made = [block((0, 0, 0), 2 * half, 0)]
    for turn, a, b, c in ((0, 0, 1, 2), (90, 2, 1, 0), (180, 0, 1, 2), (270, 2, 1, 0)):
        s, k = np.sin(np.radians(turn)), np.cos(np.radians(turn))
        way = np.array([s, 0, k]) * half[c]
        width, tall = 2 * half[a] - 2 * bar, 2 * half[b] - 2 * bar
        if kind == 3:
            made += [carved(block(way + [0, y, 0], (2 * half[a] + 0.1, 0.05, 2 * sunk), 0, (0, turn, 0))) for y in (-half[1] / 3, half[1] / 3)]
            continue
        made += [carved(block(way, (width, tall, 2 * sunk), 0, (0, turn, 0)))]
        slant = np.degrees(np.arctan2(tall, width))
        for tilt in ((slant,), (slant, -slant), ())[kind]:
            # The board is turned in its own plane first, so it is made as an outline.
            c_, s_ = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
            long = np.hypot(width, tall) / 2
            board = [(x * c_ - y * s_, x * s_ + y * c_) for x, y in ((-long, -0.07), (long, -0.07), (long, 0.07), (-long, 0.07))]
            made += [plate(board, sunk, way * (1 - sunk / half[c] / 1.5), "z", (0, turn, 0))]
    if rng.random() < 0.2:
        return [*made, carved(block((0, half[1], 0), (2 * half[0] - 0.16, half[1] * 1.2, 2 * half[2] - 0.16), 0))]
    return [*made, carved(block((0, half[1], 0), (2 * half[0] - 2 * bar, 2 * sunk, 2 * half[2] - 2 * bar), 0))] if rng.random() < 0.6 else made


def column(rng: Rng) -> list[Solid]:
    """Shape a column: round, fluted or square, on a foot, with a plate, a cushion or scrolls on top; some are ruins."""
    u = rng.uniform
    r, high, kind = u(0.16, 0.26), u(0.9, 1.5), int(rng.integers(3))
    thin = r * u(0.8, 1.0)
    made = [drum((0, 0, 0), (0, high, 0), r, thin, sides=4 * (kind == 1))]
    if kind == 0:
        made += [carved(rod(way * r * 1.08 + [0, 0.2, 0], way * thin * 1.08 + [0, high - 0.1, 0], 0.045)) for way, _ in around(10)]
    foot = 1.5 * r
    made += [block((0, 0.05, 0), (2 * foot, u(0.1, 0.16), 2 * foot), 0), drum((0, 0.08, 0), (0, u(0.16, 0.24), 0), 1.25 * r, 1.1 * r)]
    if rng.random() < 0.2:
        return [*made, carved(block((0, high, 0), (3, u(0.2, 0.5), 3), 0, (u(-30, 30), 0, u(-35, 35))))]
    made += [drum((0, high - 0.14, 0), (0, high, 0), thin, foot * 0.9), block((0, high + 0.04, 0), (2 * foot + 0.06, 0.12, 2 * foot + 0.06), 0)]
    return made + both(drum((foot, high - 0.07, -foot), (foot, high - 0.07, foot), 0.12)) if rng.random() < 0.3 else made


def door(rng: Rng) -> list[Solid]:
    """Shape a door: a leaf with sunk or raised fields, of planks, or round above; a frame or none, a knob or a ring."""
    u = rng.uniform
    half, high, thick = u(0.26, 0.38), u(0.95, 1.25), u(0.14, 0.24)
    round_ = rng.random() < 0.35
    leaf = _slab(half, high, u(0.5, 1.0) if round_ else 0.0)
    made = [plate(leaf, thick)]
    if rng.random() < 0.6:
        made += [plate(leaf * [1.22, 1.1], thick * 1.8), carved(plate(leaf * [1, 1] - [0, 0.05], 3))] + made
    kind = int(rng.integers(3))
    for z in (-thick / 2, thick / 2):
        if kind == 0:
            made += [carved(block((x, 0.5, z), (0.035, 2, 0.4 * thick), 0)) for x in np.linspace(-half, half, 5)[1:-1]]
            made += [block((0, y * high, z), (1.9 * half, 0.1, 0.09), 0.2) for y in (0.2, 0.72)]
        else:
            rows = int(rng.integers(1, 4))
            for y in (np.arange(rows) + 0.5) / rows * 0.86 * high + 0.05:
                field = both(block((0.48 * half, y, z), (0.64 * half, 0.66 * high / rows, 0.4 * thick), 0.2))
                made += [carved(s) for s in field] if kind == 1 else field
    x, z = 0.8 * half * rng.choice([-1, 1]), thick / 2
    return [*made, ball((x, 0.47 * high, z + 0.04), 0.065) if rng.random() < 0.7 else hoop((x, 0.45 * high, z + 0.03), 0.09, 0.03)]


def book(rng: Rng) -> list[Solid]:
    """Shape a book: shut, upright, lying or leaning, with bands about its back; or open like a gull's wings."""
    u = rng.uniform
    wide, high, thick = u(0.36, 0.5), u(0.55, 0.7), u(0.1, 0.22)
    if rng.random() < 0.35:
        tilt, lean = u(4, 16), u(0, 55)
        made = both(block((wide + 0.01, 0.13, 0), (2 * wide - 0.06, u(0.12, 0.2), 2 * high - 0.08), u(0.2, 0.8), (0, 0, tilt)))
        made += both(block((wide, 0.03, 0), (2 * wide + 0.08, 0.06, 2 * high + 0.06), 0, (0, 0, tilt)))
        return [_tilted(s, lean) for s in made]
    lies = rng.random() < 0.35

    def put(centre: tuple[float, float, float], size: tuple[float, float, float], edge: float = 0.1) -> Solid:
        (x, y, z), (a, b, c) = centre, size
        return block((x, z, -y), (a, c, b), edge) if lies else block((x, y, z), (a, b, c), edge)

    made = [put((0.02, 0, 0), (2 * wide - 0.1, 2 * high - 0.1, 2 * thick), 0), put((-wide + 0.04, 0, 0), (0.1, 2 * high, 2 * thick + 0.1), 0.6)]
    made += [put((0, 0, z * (thick + 0.02)), (2 * wide, 2 * high, 0.07)) for z in (-1, 1)]
    if rng.random() < 0.6:
        made += [put((-wide + 0.02, y * high, 0), (0.16, 0.09, 2 * thick + 0.14), 0.5) for y in (-0.6, 0, 0.6)]
    if rng.random() < 0.6:
        made += [put((0.1, 0.2, thick + 0.05), (u(0.25, 0.5), u(0.25, 0.5), 0.06), 0.4), put((wide, 0, 0), (0.1, 0.14, 2 * thick + 0.1))]
    return made


def _tilted(solid: Solid, degrees: float) -> Solid:
    """Turn a solid about the x axis, so that what lies faces +Z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    middle, half = (solid.low + solid.high) / 2, (solid.high - solid.low) / 2
    reach = np.abs(matrix) @ half
    return Solid(lambda p: solid.field(p @ matrix), matrix @ middle - reach, matrix @ middle + reach, solid.hole)


def well(rng: Rng) -> list[Solid]:
    """Shape a well: a ring of stones or a square of logs, posts, a roof with two slopes or a beam with a bucket."""
    u = rng.uniform
    r, high, top = u(0.4, 0.5), u(0.3, 0.5), u(0.95, 1.2)
    sides = int(rng.choice([0, 0, 4, 6, 8]))
    made = [drum((0, 0, 0), (0, high, 0), r, sides=sides), drum((0, high - 0.08, 0), (0, high + 0.02, 0), r + 0.06, sides=sides)]
    made += [carved(drum((0, high - 0.25, 0), (0, high + 0.2, 0), r - 0.13, sides=sides))]
    if rng.random() < 0.6:
        for row, y in enumerate(np.arange(0.0, high, 0.15)):
            made += [carved(hoop((0, y, 0), r, 0.02, (90, 0, 0)))] if not sides else []
            made += [carved(block(way * r + [0, y + 0.075, 0], (0.04, 0.13, 0.06), 0, (0, turn, 0))) for way, turn in around(9, 0.35 * row)] if not sides else []
    made += both(drum((r * 0.95, 0, 0), (r * 0.95, top, 0), 0.06, sides=4 * (rng.random() < 0.6)))
    made += [rod((-r - 0.12, 0.72 * top, 0), (r + 0.12, 0.72 * top, 0), u(0.04, 0.08)), rod((0, 0.72 * top, 0), (0, high + 0.1, 0), 0.03), drum((0, high, 0), (0, high + 0.16, 0), 0.1, 0.13)]
    if rng.random() < 0.8:
        rise, over = u(0.25, 0.4), u(0.1, 0.25)
        roof = [(r + over, top - 0.12), (0, top + rise), (-r - over, top - 0.12), (-r - over, top - 0.2), (0, top + rise - 0.14), (r + over, top - 0.2)]
        made += [plate(np.array(roof)[:, ::-1], 2 * r + 0.35, (0, 0, 0), "x")] if rng.random() < 0.75 else [plate(roof, 2 * r, (0, 0, 0))]
    return made


def torch(rng: Rng) -> list[Solid]:
    """Shape a burning torch: a stick or a cone in the hand, a wrapped, iron or basket head, a flame of drops."""
    u = rng.uniform
    thick, high, head = u(0.05, 0.09), u(0.6, 0.95), u(0.12, 0.18)
    made = [drum((0, 0, 0), (0, high, 0), thick * u(0.4, 1.0), thick)]
    made += [drum((0, high - 0.1, 0), (0, high + 0.1, 0), thick, head), drum((0, high + 0.1, 0), (0, high + u(0.15, 0.3), 0), head)]
    made += [hoop((0, high + y, 0), head, 0.035, (90, 0, 0)) for y in (0.08, 0.2)[: int(rng.integers(3))]]
    base, tall, lean = high + 0.26, u(0.45, 0.75), np.array([u(-0.08, 0.08), 0, u(-0.08, 0.08)])
    made += rods([(0, base, 0), lean + [0, base + 0.22 * tall, 0], (0, base + tall, 0)], [head * 0.8, head * u(0.9, 1.25), 0.02])
    for way, _ in around(int(rng.integers(0, 5)), u(0, 3)):
        made += [rod(way * 0.7 * head + [0, base + 0.1, 0], way * 1.5 * head + [0, base + u(0.4, 0.7) * tall, 0], head * 0.5, 0.02)]
    return made


def bomb(rng: Rng) -> list[Solid]:
    """Shape a bomb: a ball with a neck and a curved fuse; a bundle of sticks; or one that falls, with fins."""
    u, kind = rng.uniform, rng.random()
    if kind < 0.15:
        made = [drum((x, 0, z), (x, u(0.8, 0.9), z), 0.15) for x, z in ((-0.15, 0), (0.15, 0), (0, 0.26))]
        return [*made, hoop((0, 0.45, 0.09), 0.3, 0.06, (90, 0, 0)), *rods([(0, 0.8, 0.1), (0, 1.05, 0.1), (0.12, 1.15, 0.1)], [0.04] * 3)]
    if kind < 0.3:
        made = [ball((0, 0.5, 0), (0.26, 0.55, 0.26)), drum((0, 0.8, 0), (0, 1.3, 0), 0.17, 0.1)]
        return made + [plate([(0.05, 1.0), (0.3, 1.2), (0.3, 1.4), (0.05, 1.4)], 0.06, (0, 0, 0), "z", (0, turn, 0)) for _, turn in around(4)]
    r, side = u(0.42, 0.5), rng.choice([-1, 1])
    neck = np.array([u(0.0, 0.35) * side, 0.9 * r, u(-0.1, 0.2)])
    way = neck / np.linalg.norm(neck)
    tip = way * (r + 0.3) + [0.25 * side, u(0.0, 0.15), 0]
    made = [ball((0, 0, 0), r), drum(way * r * 0.9, way * (r + 0.1), u(0.12, 0.18)), *rods([way * r, way * (r + 0.22), tip], [0.045] * 3)]
    if rng.random() < 0.6:
        made += [ball(tip, 0.08), *(rod(tip, tip + 0.16 * np.array([np.cos(a), np.sin(a), 0]), 0.04, 0.01) for a in np.arange(6) * np.pi / 3)]
    return made


def bone(rng: Rng) -> list[Solid]:
    """Shape a bone: a shaft with double knobs at its ends, as dogs get it; lying along X, slanted or upright."""
    u, tilt = rng.uniform, np.radians(rng.choice([0.0, rng.uniform(-60, 60), 90.0], p=[0.6, 0.25, 0.15]))
    long, thick, knob = u(0.45, 0.65), u(0.075, 0.13), u(0.12, 0.18)
    axis, side = np.array([np.cos(tilt), np.sin(tilt), 0]), np.array([-np.sin(tilt), np.cos(tilt), 0])
    made = [rod(-long * axis, long * axis, thick)]
    for end in (-1, 1):
        made += [rod(end * long * 0.8 * axis, end * (long + 0.3 * knob) * axis + s * 0.8 * knob * side, thick, knob) for s in (-1, 1)]
    return made


def coffin(rng: Rng) -> list[Solid]:
    """Shape a coffin: six-sided, lying or leaned upright, shut with a raised lid or a cross, rarely open; or a casket."""
    u = rng.uniform
    wide, long, deep = u(0.26, 0.36), u(0.75, 0.95), u(0.26, 0.4)
    stands, open_ = rng.random() < 0.25, rng.random() < 0.12
    rim = np.array([(-0.6, -1), (0.6, -1), (0.5, -1), (1, u(0.35, 0.55)), (0.6, 1), (-0.6, 1), (-1, 0.45)]) * [wide, long]
    turn = (0, 0, 0) if stands else (-90, 0, 0)

    def put(outline: np.ndarray, low: float, high: float) -> Solid:
        return plate(outline, high - low, (0, 0, (low + high) / 2) if stands else (0, (low + high) / 2, 0), "z", turn)

    if rng.random() < 0.2:
        lid = u(0.15, 0.25)
        return [block((0, 0.2, 0), (2 * wide, 0.4, 2 * long), 0.1), block((0, 0.4, 0), (2 * wide + 0.08, 2 * lid, 2 * long + 0.08), 0.7), *both(rod((wide + 0.05, 0.25, -0.7 * long), (wide + 0.05, 0.25, 0.7 * long), 0.04))]
    made = [put(rim, 0, deep)]
    if open_:
        return [*made, carved(put(rim * 0.72, 0.12, deep + 0.2))]
    made += [put(rim * [1.12, 1.05], deep, deep + u(0.06, 0.1))]
    if rng.random() < 0.6:
        return [*made, put(np.array([(-0.05, -0.6), (0.05, -0.6), (0.05, 0.7), (-0.05, 0.7)]) * [1, long], deep, deep + 0.15), put(np.array([(-0.2, 0.3), (0.2, 0.3), (0.2, 0.42), (-0.2, 0.42)]) * [1, long], deep, deep + 0.15)]
    return [*made, put(rim * 0.7, deep, deep + u(0.14, 0.2))]


def log(rng: Rng) -> list[Solid]:
    """Shape a log along Z or X, straight or bent, with stubs of branches; its ends are sunk within the bark."""
    u = rng.uniform
    long, r, bend = u(0.55, 0.9), u(0.16, 0.28), u(-0.08, 0.08)
    axis = np.array([0.0, 0, 1]) if rng.random() < 0.75 else np.array([1.0, 0, 0])
    up = np.array([0, bend, 0])
    made = [drum(-long * axis, up, r * u(0.9, 1.1), r), drum(up, long * axis, r, r * u(0.85, 1.0))]
    for k in range(int(rng.integers(0, 4))):
        root = axis * long * u(-0.7, 0.7)
        way = np.cross(axis, [0, 1, 0]) * u(-1, 1) + [0, u(0.2, 1), 0] + axis * u(-0.4, 0.4)
        made += [drum(root, root + way / np.linalg.norm(way) * (r + u(0.1, 0.2)), 0.08, 0.07)]
    rings = [carved(drum(s * long * axis, s * (long - 0.04) * axis, 0.75 * r)) for s in (-1, 1)]
    return made + rings if rng.random() < 0.6 else made


def sack(rng: Rng) -> list[Solid]:
    """Shape a sack: round below, laced under an ear of cloth; or a pile of lying ones; or open and full."""
    u, kind = rng.uniform, rng.random()
    r, high = u(0.36, 0.46), u(0.6, 0.85)
    if kind < 0.2:
        return [block((x, y, 0), (0.8, 0.34, 0.55), 0.9, (0, u(-20, 20), u(-6, 6))) for x, y in [(0, 0.17), (0.75, 0.17), (0.38, 0.45)][: int(rng.choice([1, 3]))]]
    made = [ball((0, 0.6 * r, 0), (r, 0.8 * r, r * u(0.75, 1.0))), ball((u(-0.1, 0.1), 0.95 * r, u(-0.05, 0.05)), 0.85 * r)]
    made += [drum((0, r, 0), (0, high, 0), r * 0.85, 0.34 * r if kind < 0.8 else 0.85 * r), carved(block((0, -0.5, 0), (3, 1.05, 3), 0))]
    if kind < 0.8:
        ear = high + u(0.16, 0.28)
        made += [hoop((0, high, 0), 0.3 * r, 0.045, (90, 0, 0)), drum((0, high, 0), (0, ear, 0), 0.26 * r, u(0.45, 0.7) * r)]
        made += [carved(rod(way * 0.5 * r + [0, high + 0.06, 0], way * 0.75 * r + [0, ear + 0.06, 0], 0.06)) for way, _ in around(5, u(0, 3))]
        return made + [carved(rod(way * 0.34 * r + [0, high - 0.04, 0], way * 0.95 * r + [0, 1.1 * r, 0], 0.05, 0.02)) for way, _ in around(6, u(0, 3))]
    made += [hoop((0, high, 0), r * 0.85, 0.07, (90, 0, 0)), carved(drum((0, high - 0.1, 0), (0, high + 0.2, 0), r * 0.75))]
    return made + [ball((0.15 * np.sin(k), high - 0.08, 0.15 * np.cos(k)), 0.16) for k in (0, 2, 4)]


def scroll(rng: Rng) -> list[Solid]:
    """Shape a scroll: a sheet hung between two rolls, one rolled up with a ribbon, or one half unrolled on the floor."""
    u, kind = rng.uniform, rng.random()
    wide, high, r = u(0.3, 0.42), u(0.35, 0.6), u(0.07, 0.12)
    if kind < 0.25:
        made = [drum((-wide, r, 0), (wide, r, 0), r * 1.2), hoop((u(-0.05, 0.05), r, 0), r * 1.2, 0.04, (0, 90, 0))]
        return made + both(rod((wide, r, 0), (wide + u(0.0, 0.15), r, 0), 0.04))
    flat = kind < 0.45
    ends = [np.array([0, r, -high]), np.array([0, r, high])] if flat else [np.array([0, -high, 0]), np.array([0, high, 0])]
    made = [block((0, 0.03, 0) if flat else (0, 0, -r * 0.5), (2 * wide - 0.05, 0.06, 2 * high) if flat else (2 * wide - 0.05, 2 * high, 0.06), 0)]
    for end in ends if rng.random() < 0.85 else ends[:1]:
        made += [drum(end - [wide, 0, 0], end + [wide, 0, 0], r)]
        made += both(rods([end, end + [wide + 0.16, 0, 0]], [0.04, 0.04])) + both(ball(end + [wide + 0.16, 0, 0], u(0.05, 0.08)))
    return made


def cone(rng: Rng) -> list[Solid]:
    """Shape a traffic cone: a slim cone with a hollow tip on a square or round foot, with rings that stand out or not."""
    u = rng.uniform
    r, high, foot = u(0.2, 0.28), u(0.65, 0.95), u(0.3, 0.4)
    base = block((0, 0.05, 0), (2 * foot, u(0.06, 0.13), 2 * foot), 0.2) if rng.random() < 0.75 else drum((0, 0, 0), (0, 0.09, 0), foot)
    made = [base, drum((0, 0.05, 0), (0, high, 0), r, u(0.03, 0.07))]
    if rng.random() < 0.5:
        for y in (0.35, 0.65)[: int(rng.integers(1, 3))]:
            made += [drum((0, (y - 0.08) * high, 0), (0, (y + 0.08) * high, 0), r * (1.05 - 0.85 * (y - 0.08)) + 0.02, r * (1.05 - 0.85 * (y + 0.08)) + 0.02)]
    return made


def trashcan(rng: Rng) -> list[Solid]:
    """Shape a trash can: of ribbed metal with a lid and ears, a bin on wheels, one with a pedal, or an open basket."""
    u, kind = rng.uniform, int(rng.integers(4))
    r, high = u(0.28, 0.36), u(0.65, 0.9)
    if kind == 1:
        side = [(0.1, -0.8 * r), (0.1, 0.75 * r), (high, r), (high + 0.08, r), (high + u(0.12, 0.2), -0.9 * r), (high, -r)]
        made = [plate(side, 1.9 * r, (0, 0, 0), "x"), plate([(high, 1.15 * r), (high + 0.07, 1.15 * r), (high + 0.2, -r), (high + 0.1, -1.1 * r)], 2.2 * r, (0, 0, 0), "x")]
        return [*made, rod((-0.8 * r, high, -1.2 * r), (0.8 * r, high, -1.2 * r), 0.045), *both(drum((0.8 * r, 0.12, -0.8 * r), (1.05 * r, 0.12, -0.8 * r), 0.13))]
    made = [drum((0, 0, 0), (0, high, 0), r * u(0.75, 1.0), r), hoop((0, high, 0), r, 0.035, (90, 0, 0))]
    if kind == 3:
        return [*made, carved(drum((0, 0.15, 0), (0, high + 0.2, 0), 0.7 * r, r - 0.05)), *[carved(rod(way * r + [0, 0.12, 0], way * r + [0, high - 0.12, 0], 0.03)) for way, _ in around(12)]]
    made += half_ball((0, high, 0), (r * 1.05, u(0.1, 0.3), r * 1.05))[:1]
    if kind == 2:
        return [*made, block((0, 0.05, r), (0.2, 0.06, 0.2), 0.3), drum((0, high - 0.03, 0), (0, high + 0.03, 0), r * 1.08)]
    made += [rod(way * r * 0.95 + [0, 0.1, 0], way * r + [0, high - 0.1, 0], 0.03) for way, _ in around(14)]
    return made + both(hoop((r, 0.75 * high, 0), 0.09, 0.035, (0, 0, 0))) + [hoop((0, high + 0.22, 0), 0.1, 0.04)]
