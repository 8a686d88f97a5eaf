"""Shape what stands in castles, churchyards, stores and yards. It faces +Z; y = 0 is the ground."""

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
    plate,
    rod,
    rods,
)  # fmt: skip

__all__ = [
    "bone", "column", "cone", "crate", "crown", "crystal", "door", "gravestone", "log", "scroll", "skull", "torch",
]  # fmt: skip

Rng = np.random.Generator


def _slab(half: float, high: float, round_: float) -> np.ndarray:
    """Return the outline of an upright slab whose top is an arch; `round_` is 0 for flat and 1 for a half circle."""
    a = np.linspace(0, np.pi, 13)
    return np.array([(-half, 0), (half, 0), *np.stack([half * np.cos(a), high + half * round_ * (np.sin(a) - 1)], 1)])


def skull(rng: Rng) -> list[Solid]:
    """Shape a skull: a large crown, holes for eyes and nose, teeth; some with crossed bones."""
    u = rng.uniform
    wide, eye = u(0.42, 0.5), u(0.14, 0.18)
    solids = [ball((0, 0.62, -0.08), (wide, u(0.4, 0.48), u(0.48, 0.58)))]
    solids += [block((0, 0.3, 0.2), (wide * u(1.0, 1.4), 0.34, 0.4), 0.7)]
    solids += both(ball((0.72 * wide, 0.4, 0.14), (0.1, 0.07, 0.2)))
    solids += both(carved(ball((wide * 0.46, 0.5, 0.46), (eye * u(0.85, 1.1), eye, 0.26))))
    solids += [carved(drum((0, 0.3, 0.4), (0, 0.44, 0.42), 0.08, 0.02, sides=3 if rng.random() < 0.5 else 0))]
    if rng.random() < 0.6:
        low = u(0.02, 0.08)
        solids += [block((0, low, 0.16), (wide * 1.1, 0.16, 0.42), 0.6)]
        solids += [carved(block((0, 0.15, 0.3), (wide * 1.3, 0.05, 0.4), 0))]
        solids += both(rod((0.5 * wide, low, 0.1), (0.7 * wide, 0.45, -0.05), 0.07))
    for x in np.linspace(-0.55, 0.55, int(rng.integers(4, 7))) * wide * 0.8:
        solids += [carved(block((x, 0.16, 0.42), (0.035, 0.14, 0.14), 0))]
    if rng.random() < 0.15:
        for s in (-1, 1):
            solids += [rod((-0.65 * s, -0.45, 0), (0.65 * s, 0.1, 0), 0.07)]
            solids += [*(ball((x * s, y, 0), 0.11) for x, y in ((-0.7, -0.42), (-0.6, -0.55), (0.7, 0.07), (0.6, 0.2)))]
    return solids


def crown(rng: Rng) -> list[Solid]:
    """Shape a crown: a hollow band with teeth, lilies or balls on rods, upright or flared, sometimes vaulted."""
    u, count = rng.uniform, int(rng.integers(4, 9))
    r, high, flare = u(0.4, 0.5), u(0.3, 0.5), u(1.0, 1.3)
    band, kind = u(0.1, 0.2), int(rng.integers(3))
    solids = [drum((0, 0, 0), (0, band if kind == 2 else high, 0), r, r * (1.0 if kind == 2 else flare))]
    solids += [carved(drum((0, -0.1, 0), (0, high + 0.1, 0), r - 0.07, r * flare - 0.07))]
    for way, degrees in around(count, 0.3):
        gap = np.pi * r * flare / count
        if kind == 2:
            solids += [drum(way * (r - 0.03), way * (r * flare - 0.03) + [0, high, 0], 0.11, 0.05)]
            solids += [ball(way * r * flare + [0, high + 0.05, 0], u(0.07, 0.1))]
            continue
        wide, floor = (0.85 * gap, 0.0) if kind else (0.75 * gap, 0.4 * gap)
        notch = [(-wide, high + 0.2), (wide, high + 0.2), (floor, band), (-floor, band)]
        solids += [carved(plate(notch, 0.5, way * r * flare, "z", (0, degrees, 0)))]
        if kind:
            tip = np.radians(degrees) + np.pi / count
            away = r * flare - 0.03
            solids += [ball((away * np.sin(tip), high, away * np.cos(tip)), u(0.06, 0.09))]
    solids += [hoop((0, 0.04, 0), r, 0.06, (90, 0, 0))]
    if rng.random() < 0.25:
        solids += [*half_ball((0, 0.1, 0), (r * 0.85, high + 0.15, r * 0.85)), ball((0, high + 0.32, 0), 0.1)]
    return solids


def gravestone(rng: Rng) -> list[Solid]:
    """Shape a gravestone: a slab with a round, flat or pointed head, a cross, or an obelisk, upright or leaning."""
    u, kind = rng.uniform, int(rng.integers(4))
    half, high, thick = u(0.3, 0.42), u(0.75, 1.05), u(0.14, 0.24)
    lean = (u(-12, 4), 0, u(-8, 8) * (rng.random() < 0.4))
    solids = [block((0, 0.06, 0), (2 * half + u(0.1, 0.3), u(0.12, 0.2), thick + u(0.15, 0.3)), 0.1)]
    if kind == 0:
        arm = u(0.6, 0.75) * high
        solids += [block((0, high / 2, 0), (0.2, high, thick), 0.1, lean)]
        solids += [block((0, arm, 0), (1.6 * half, 0.2, thick), 0.1, lean)]
        return [*solids, hoop((0, arm, 0), 0.24, 0.06)] if rng.random() < 0.4 else solids
    if kind == 1 and rng.random() < 0.5:
        solids += [drum((0, 0, 0), (0, high * 1.2, 0), 0.22, 0.14, 4)]
        return [*solids, drum((0, high * 1.2, 0), (0, high * 1.2 + 0.16, 0), 0.14, 0.01, 4)]
    outline = np.array([(-half, 0), (half, 0), (half, 0.75 * high), (0, high), (-half, 0.75 * high)])
    if kind != 3:
        outline = _slab(half, high, u(0.7, 1.0) if kind == 2 else u(0.0, 0.5))
    solids += [plate(outline, thick, (0, 0, 0), "z", lean)]
    mark = [block((0, 0.66 * high, thick / 2), (0.09, 0.3, 0.08), 0, lean)]
    mark += [block((0, 0.7 * high, thick / 2), (0.24, 0.09, 0.08), 0, lean)]
    mark += [block((0, y * high, thick / 2), (1.2 * half, 0.05, 0.06), 0, lean) for y in (0.3, 0.42)]
    return solids + ([carved(s) for s in mark] if rng.random() < 0.6 else mark)


def crate(rng: Rng) -> list[Solid]:
    """Shape a crate: panels sunk in a frame with a slanted board or a cross, or plain boards; rarely open."""
    u = rng.uniform
    half = np.array([u(0.4, 0.55), u(0.3, 0.5), u(0.4, 0.5)])
    bar, sunk, kind = u(0.12, 0.18), u(0.04, 0.07), int(rng.integers(4))
    solids = [block((0, 0, 0), 2 * half, 0)]
    for turn, a, c in ((0, 0, 2), (90, 2, 0), (180, 0, 2), (270, 2, 0)):
        way = np.array([np.sin(np.radians(turn)), 0, np.cos(np.radians(turn))]) * half[c]
        width, tall = 2 * half[a] - 2 * bar, 2 * half[1] - 2 * bar
        if kind == 3:
            for y in (-half[1] / 3, half[1] / 3):
                solids += [carved(block(way + [0, y, 0], (2 * half[a] + 0.1, 0.05, 2 * sunk), 0, (0, turn, 0)))]
            continue
        solids += [carved(block(way, (width, tall, 2 * sunk), 0, (0, turn, 0)))]
        end = np.array([width, tall]) / 2
        side = np.array([-tall, width]) / np.hypot(width, tall) * 0.07
        board = np.array([-end - side, end - side, end + side, -end + side])
        for flip in ((1,), (1, -1), ())[kind]:
            solids += [plate(board * [1, flip], sunk, way * (1 - sunk / half[c] / 1.5), "z", (0, turn, 0))]
    if rng.random() < 0.2:
        return [*solids, carved(block((0, half[1], 0), (2 * half[0] - 0.16, half[1] * 1.2, 2 * half[2] - 0.16), 0))]
    lid = carved(block((0, half[1], 0), (2 * half[0] - 2 * bar, 2 * sunk, 2 * half[2] - 2 * bar), 0))
    return [*solids, lid] if rng.random() < 0.6 else solids


def column(rng: Rng) -> list[Solid]:
    """Shape a column: round, fluted or square, on a foot, with a plate, a cushion or scrolls on top; some are ruins."""
    u = rng.uniform
    r, high, kind = u(0.16, 0.26), u(0.9, 1.5), int(rng.integers(3))
    thin = r * u(0.8, 1.0)
    solids = [drum((0, 0, 0), (0, high, 0), r, thin, sides=4 * (kind == 1))]
    if kind == 0:
        for way, _ in around(10):
            solids += [carved(rod(way * r * 1.08 + [0, 0.2, 0], way * thin * 1.08 + [0, high - 0.1, 0], 0.045))]
    foot = 1.5 * r
    solids += [block((0, 0.05, 0), (2 * foot, u(0.1, 0.16), 2 * foot), 0)]
    solids += [drum((0, 0.08, 0), (0, u(0.16, 0.24), 0), 1.25 * r, 1.1 * r)]
    if rng.random() < 0.2:
        return [*solids, carved(block((0, high, 0), (3, u(0.2, 0.5), 3), 0, (u(-30, 30), 0, u(-35, 35))))]
    solids += [drum((0, high - 0.14, 0), (0, high, 0), thin, foot * 0.9)]
    solids += [block((0, high + 0.04, 0), (2 * foot + 0.06, 0.12, 2 * foot + 0.06), 0)]
    scrolls = both(drum((foot, high - 0.07, -foot), (foot, high - 0.07, foot), 0.12))
    return solids + scrolls if rng.random() < 0.3 else solids


def door(rng: Rng) -> list[Solid]:
    """Shape a door: a leaf with sunk or raised fields, of planks, or round above; a frame or none, a knob or a ring."""
    u = rng.uniform
    half, high, thick = u(0.26, 0.38), u(0.95, 1.25), u(0.14, 0.24)
    round_ = rng.random() < 0.35
    leaf = _slab(half, high, u(0.5, 1.0) if round_ else 0.0)
    solids = [plate(leaf, thick)]
    if rng.random() < 0.6:
        solids += [plate(leaf * [1.22, 1.1], thick * 1.8), carved(plate(leaf * [1, 1] - [0, 0.05], 3))] + solids
    kind = int(rng.integers(3))
    for z in (-thick / 2, thick / 2):
        if kind == 0:
            solids += [
                carved(block((x, 0.5, z), (0.035, 2, 0.4 * thick), 0)) for x in np.linspace(-half, half, 5)[1:-1]
            ]
            solids += [block((0, y * high, z), (1.9 * half, 0.1, 0.09), 0.2) for y in (0.2, 0.72)]
        else:
            rows = int(rng.integers(1, 4))
            for y in (np.arange(rows) + 0.5) / rows * 0.86 * high + 0.05:
                field = both(block((0.48 * half, y, z), (0.64 * half, 0.66 * high / rows, 0.4 * thick), 0.2))
                solids += [carved(s) for s in field] if kind == 1 else field
    x, z = 0.8 * half * rng.choice([-1, 1]), thick / 2
    ring = hoop((x, 0.45 * high, z + 0.03), 0.09, 0.03)
    return [*solids, ball((x, 0.47 * high, z + 0.04), 0.065) if rng.random() < 0.7 else ring]


def _tilted(solid: Solid, degrees: float) -> Solid:
    """Turn a solid about the x axis, so that what lies faces +Z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    middle, half = (solid.low + solid.high) / 2, (solid.high - solid.low) / 2
    reach = np.abs(matrix) @ half
    return Solid(lambda p: solid.field(p @ matrix), matrix @ middle - reach, matrix @ middle + reach, solid.hole)


def torch(rng: Rng) -> list[Solid]:
    """Shape a burning torch: a stick or a cone in the hand, a wrapped, iron or basket head, a flame of drops."""
    u = rng.uniform
    thick, high, head = u(0.05, 0.09), u(0.6, 0.95), u(0.12, 0.18)
    solids = [drum((0, 0, 0), (0, high, 0), thick * u(0.4, 1.0), thick)]
    solids += [drum((0, high - 0.1, 0), (0, high + 0.1, 0), thick, head)]
    solids += [drum((0, high + 0.1, 0), (0, high + u(0.15, 0.3), 0), head)]
    solids += [hoop((0, high + y, 0), head, 0.035, (90, 0, 0)) for y in (0.08, 0.2)[: int(rng.integers(3))]]
    base, tall, lean = high + 0.26, u(0.45, 0.75), np.array([u(-0.08, 0.08), 0, u(-0.08, 0.08)])
    flame = [np.array([0, base, 0]), lean + [0, base + 0.22 * tall, 0], np.array([0, base + tall, 0])]
    solids += rods(flame, [head * 0.8, head * u(0.9, 1.25), 0.02])
    for way, _ in around(int(rng.integers(0, 5)), u(0, 3)):
        tip = way * 1.5 * head + [0, base + u(0.4, 0.7) * tall, 0]
        solids += [rod(way * 0.7 * head + [0, base + 0.1, 0], tip, head * 0.5, 0.02)]
    return solids


def bone(rng: Rng) -> list[Solid]:
    """Shape a bone: a shaft with double knobs at its ends, as dogs get it; lying along X, slanted or upright."""
    u, tilt = rng.uniform, np.radians(rng.choice([0.0, rng.uniform(-60, 60), 90.0], p=[0.6, 0.25, 0.15]))
    long, thick, knob = u(0.45, 0.65), u(0.075, 0.13), u(0.12, 0.18)
    axis, side = np.array([np.cos(tilt), np.sin(tilt), 0]), np.array([-np.sin(tilt), np.cos(tilt), 0])
    solids = [rod(-long * axis, long * axis, thick)]
    for end in (-1, 1):
        for up in (-0.8 * knob * side, 0.8 * knob * side):
            solids += [rod(end * long * 0.8 * axis, end * (long + 0.3 * knob) * axis + up, thick, knob)]
    return solids


def log(rng: Rng) -> list[Solid]:
    """Shape a log along Z or X, straight or bent, with stubs of branches; its ends are sunk within the bark."""
    u = rng.uniform
    long, r, bend = u(0.55, 0.9), u(0.16, 0.28), u(-0.08, 0.08)
    axis = np.array([0.0, 0, 1]) if rng.random() < 0.75 else np.array([1.0, 0, 0])
    up = np.array([0, bend, 0])
    solids = [drum(-long * axis, up, r * u(0.9, 1.1), r), drum(up, long * axis, r, r * u(0.85, 1.0))]
    for _ in range(int(rng.integers(0, 4))):
        root = axis * long * u(-0.7, 0.7)
        way = np.cross(axis, [0, 1, 0]) * u(-1, 1) + [0, u(0.2, 1), 0] + axis * u(-0.4, 0.4)
        solids += [drum(root, root + way / np.linalg.norm(way) * (r + u(0.1, 0.2)), 0.08, 0.07)]
    rings = [carved(drum(s * long * axis, s * (long - 0.04) * axis, 0.75 * r)) for s in (-1, 1)]
    return solids + rings if rng.random() < 0.6 else solids


def scroll(rng: Rng) -> list[Solid]:
    """Shape a scroll: a sheet between two rolls, hung or on the floor, or rolled up with a ribbon."""
    u, kind = rng.uniform, rng.random()
    wide, high, r = u(0.3, 0.42), u(0.35, 0.6), u(0.07, 0.12)
    if kind < 0.25:
        solids = [drum((-wide, r, 0), (wide, r, 0), r * 1.2), hoop((u(-0.05, 0.05), r, 0), r * 1.2, 0.04, (0, 90, 0))]
        return solids + both(rod((wide, r, 0), (wide + u(0.0, 0.15), r, 0), 0.04))
    solids = [block((0, 0, -r * 0.5), (2 * wide - 0.05, 2 * high, 0.06), 0)]
    for y in (high, -high)[: 2 if rng.random() < 0.85 else 1]:
        end = np.array([0, y, 0])
        solids += [drum(end - [wide, 0, 0], end + [wide, 0, 0], r)]
        solids += both(rods([end, end + [wide + 0.16, 0, 0]], [0.04, 0.04]))
        solids += both(ball(end + [wide + 0.16, 0, 0], u(0.05, 0.08)))
    return [_tilted(solid, -90) for solid in solids] if kind < 0.45 else solids


def cone(rng: Rng) -> list[Solid]:
    """Shape a traffic cone: a slim cone on a square or round foot, with or without rings."""
    u = rng.uniform
    r, high, foot = u(0.2, 0.28), u(0.65, 0.95), u(0.3, 0.4)
    base = drum((0, 0, 0), (0, 0.09, 0), foot)
    if rng.random() < 0.75:
        base = block((0, 0.05, 0), (2 * foot, u(0.06, 0.13), 2 * foot), 0.2)
    solids = [base, drum((0, 0.05, 0), (0, high, 0), r, u(0.03, 0.07))]
    if rng.random() < 0.5:
        for y in (0.35, 0.65)[: int(rng.integers(1, 3))]:
            low, top = (y - 0.08), (y + 0.08)
            wide = [r * (1.05 - 0.85 * level) + 0.02 for level in (low, top)]
            solids += [drum((0, low * high, 0), (0, top * high, 0), wide[0], wide[1])]
    return solids


def crystal(rng: Rng) -> list[Solid]:
    """Shape a gem with a flat table, or a cluster of pointed prisms of uneven height."""
    u = rng.uniform
    if rng.random() < 0.4:
        r, sides = u(0.5, 0.7), int(rng.choice([4, 6, 8]))
        return [drum((0, -0.7, 0), (0, 0, 0), 0.01, r, sides), drum((0, 0, 0), (0, u(0.2, 0.35), 0), r, 0.6 * r, sides)]
    solids = []
    for k in range(int(rng.integers(3, 8))):
        way, high = around(7, u(0, 1))[k][0], u(0.4, 0.9) + 0.4 * (k == 0)
        foot, tip, r = way * 0.18, way * (0.18 + 0.35 * high * (k > 0)) + [0, high, 0], u(0.09, 0.17)
        neck = foot + 0.7 * (tip - foot)
        solids += [drum(foot, neck, r, r, 5), drum(neck, tip, r, 0.01, 5)]
    return solids
