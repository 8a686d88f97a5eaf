"""Shape vessels, lights and an umbrella: solids of revolution and what is attached to them."""

from __future__ import annotations

import numpy as np

from training.judge.shapes.solids import Solid, ball, block, both, carved, drum, hoop, rod, rods, spun

__all__ = [
    "barrel", "bell", "bottle", "bowl", "bucket", "can", "candle", "goblet", "jar", "lamp", "mug", "pan", "plate",
    "potion", "teapot", "umbrella", "vase",
]  # fmt: skip

Rng = np.random.Generator


def _pot(outline: list[tuple[float, float]], wall: float, floor: float) -> list[Solid]:
    """Return a vessel of an outline of (radius, height) from foot to rim, hollow above `floor`."""
    points = np.array(outline)
    top = points[-1, 1]
    inner = points[points[:, 1] > floor + 1e-6] - [wall, 0.0]
    first = float(np.interp(floor, points[:, 1], points[:, 0])) - wall
    hollow = [(0.0, floor), (max(first, 0.02) * 0.9, floor), *map(tuple, inner), (inner[-1, 0], top + 0.2)]
    hollow += [(0.0, top + 0.2)]
    return [spun([(0, points[0, 1]), *outline, (0, top)]), carved(spun(hollow))]


def _curve(places: list[tuple[float, float]], count: int = 14) -> list[tuple[float, float]]:
    """Round an outline of (radius, height) through its places, evenly in height."""
    r, y = np.array(places).T
    at = np.linspace(y[0], y[-1], count)
    # A cubic through the places, by divided differences of the neighbours.
    slope = np.gradient(r, y)
    k = np.clip(np.searchsorted(y, at, side="right") - 1, 0, len(y) - 2)
    h = y[k + 1] - y[k]
    t = (at - y[k]) / h
    bent = (1 + 2 * t) * (1 - t) ** 2 * r[k] + t * (1 - t) ** 2 * h * slope[k]
    bent += t**2 * (3 - 2 * t) * r[k + 1] + t**2 * (t - 1) * h * slope[k + 1]
    return [(max(float(a), 0.03), float(b)) for a, b in zip(bent, at, strict=True)]


def bowl(rng: Rng) -> list[Solid]:
    """Shape a bowl: wide, open and low."""
    u = rng.uniform
    high, foot = u(0.35, 0.65), u(0.22, 0.4)
    return _pot(_curve([(foot, 0.0), (u(0.55, 0.75), high * 0.45), (u(0.75, 0.85), high)]), 0.08, 0.09)


def vase(rng: Rng) -> list[Solid]:
    """Shape a vase: belly, neck and flared lip, sometimes with two handles."""
    u = rng.uniform
    foot, belly, neck, lip, at = u(0.15, 0.26), u(0.3, 0.46), u(0.12, 0.22), u(0.2, 0.32), u(0.35, 0.6)
    solids = _pot(_curve([(foot, 0.0), (belly, at), (neck, 1.0), (max(lip, neck + 0.05), 1.2)], 20), 0.07, 0.1)
    if rng.random() < 0.3:
        solids += both(
            rods(
                [(neck, 1.0, 0), (neck + 0.22, 1.0, 0), (belly + 0.1, 0.75, 0), (belly * 0.85, at + 0.08, 0)],
                [0.04] * 4,
            )
        )
    return solids


def bottle(rng: Rng) -> list[Solid]:
    """Shape a bottle: a straight body, shoulders and a narrow neck."""
    u = rng.uniform
    r, body, neck, top = u(0.18, 0.28), u(0.55, 0.85), u(0.065, 0.1), 0.0
    top = body + u(0.45, 0.65)
    shoulder = body + u(0.1, 0.28)
    solids = [
        spun(
            [
                (0, 0),
                (r, 0),
                (r, body),
                (r * 0.8, body + 0.4 * (shoulder - body)),
                (neck, shoulder),
                (neck, top),
                (0, top),
            ]
        )
    ]
    solids += [drum((0, top - u(0.06, 0.14), 0), (0, top, 0), neck * 1.35)]
    return solids if rng.random() < 0.8 else [*solids, block((0, body * 0.5, 0), (1.7 * r, body, 1.7 * r), 0.1)]


def goblet(rng: Rng) -> list[Solid]:
    """Shape a goblet: foot, stem and cup, of metal or of glass."""
    u = rng.uniform
    foot, stem, start, wide = u(0.22, 0.32), u(0.055, 0.1), u(0.4, 0.58), u(0.24, 0.36)
    cup = _curve([(stem, start), (wide, start + 0.25), (wide * u(0.8, 1.15), 1.05)], 12)
    solids = _pot([(foot, 0.0), (foot, 0.05), (foot * 0.4, 0.1), (stem, 0.16), *cup], 0.06, start + 0.1)
    return [*solids, ball((0, start * u(0.5, 0.75), 0), stem + u(0.03, 0.08))] if rng.random() < 0.5 else solids


def bell(rng: Rng) -> list[Solid]:
    """Shape a bell: a flared hollow cup with a handle, a loop or a beam, and a clapper."""
    u = rng.uniform
    lip, waist, high = u(0.42, 0.55), u(0.2, 0.27), u(0.65, 0.85)
    outline = [(lip, 0.0), (lip * 0.82, 0.1), (waist * 1.15, 0.5 * high), (waist, 0.8 * high), (waist * 0.75, high)]
    hollow = [(0, -0.1), (lip - 0.08, -0.1), (lip * 0.82 - 0.08, 0.1), (waist, 0.5 * high), (waist * 0.6, 0.75 * high)]
    hollow += [(0, 0.75 * high)]
    solids = [spun([(0, 0), *outline, (0, high)]), carved(spun(hollow)), rod((0, high, 0), (0, 0.1, 0), 0.04)]
    solids += [ball((0, 0.03, 0), 0.11)]
    if rng.random() < 0.5:
        solids += [drum((0, high, 0), (0, high + u(0.35, 0.6), 0), 0.07, 0.09)]
    else:
        solids += [hoop((0, high + 0.1, 0), 0.13, 0.05)]
    return solids


def bucket(rng: Rng) -> list[Solid]:
    """Shape a bucket: a tapered open pail with a rim and an arched handle, raised or lowered."""
    u = rng.uniform
    foot, top, high = u(0.28, 0.34), u(0.4, 0.48), u(0.65, 0.85)
    solids = _pot([(foot, 0.0), (top, high - 0.06), (top + 0.04, high - 0.06), (top + 0.04, high)], 0.08, 0.1)
    tilt = np.radians(rng.choice([90.0, u(20, 70), -10.0]))
    path = []
    for a in np.linspace(0, np.pi, 11):
        path.append(
            (top + 0.03) * np.array([np.cos(a), np.sin(a) * np.sin(tilt), np.sin(a) * np.cos(tilt)])
            + [0, high - 0.08, 0]
        )
    return solids + rods(path, [0.04] * 11) + both(ball((top + 0.03, high - 0.08, 0), 0.07))


def barrel(rng: Rng) -> list[Solid]:
    """Shape a barrel: bulging staves with hoops, upright or lying."""
    u = rng.uniform
    r, high, bulge = u(0.3, 0.38), u(0.45, 0.6), u(1.2, 1.35)
    side = [(r * (1 + (bulge - 1) * (1 - s * s)), high * s) for s in np.linspace(-1, 1, 11)]
    solids = [spun([(0, -high), *side, (0, high)])]
    for s in (-0.85, -0.4, 0.4, 0.85):
        wide = r * (1 + (bulge - 1) * (1 - s * s)) + 0.035
        solids += [drum((0, high * s - 0.05, 0), (0, high * s + 0.05, 0), wide)]
    return [*solids, *(carved(drum((0, y - 0.06, 0), (0, y + 0.06, 0), r * 0.82)) for y in (-high, high))]


def candle(rng: Rng) -> list[Solid]:
    """Shape a candle with a flame, in a holder with a ring or on a stand."""
    u = rng.uniform
    r, high, plate_r = u(0.1, 0.18), u(0.5, 0.8), u(0.3, 0.4)
    solids = [drum((0, 0.05, 0), (0, high, 0), r), rod((0, high, 0), (0, high + 0.1, 0), 0.035)]
    solids += [ball((0, high + 0.17, 0), 0.085), drum((0, high + 0.2, 0), (0, high + 0.4, 0), 0.075, 0.01)]
    solids += [drum((0, 0, 0), (0, 0.08, 0), plate_r * 0.85, plate_r), drum((0, 0.03, 0), (0, 0.2, 0), r + 0.05)]
    if rng.random() < 0.5:
        solids += [hoop((plate_r + 0.08, 0.1, 0), 0.12, 0.045)]
    elif rng.random() < 0.5:
        solids += [drum((0, -0.4, 0), (0, 0.03, 0), 0.08), drum((0, -0.5, 0), (0, -0.4, 0), 0.3, 0.15)]
    return solids


def lamp(rng: Rng) -> list[Solid]:
    """Shape a lamp: a table or a floor lamp with a conical shade, or a desk lamp with a bent arm."""
    u = rng.uniform
    low, high, wide = u(0.45, 1.2), u(0.3, 0.45), u(0.32, 0.45)
    if rng.random() < 0.75:
        solids = [drum((0, 0, 0), (0, 0.07, 0), u(0.22, 0.3)), drum((0, 0, 0), (0, low + 0.2, 0), u(0.045, 0.07))]
        if rng.random() < 0.4:
            solids += [ball((0, 0.22, 0), (0.2, 0.24, 0.2))]
        solids += [drum((0, low, 0), (0, low + high, 0), wide, wide * u(0.4, 0.85))]
        solids += [carved(drum((0, low - 0.1, 0), (0, low + high * 0.7, 0), wide - 0.06, wide * 0.45))]
        return [*solids, drum((0, 0.05, 0), (0, low + high * 0.9, 0), 0.05)]
    elbow, hand = np.array([0, u(0.5, 0.65), -0.3]), np.array([0, u(0.85, 1.0), 0.15])
    solids = [
        drum((0, 0, 0), (0, 0.08, 0), 0.27),
        *rods([(0, 0, 0), elbow, hand], [0.05, 0.05, 0.05]),
        ball(elbow, 0.08),
    ]
    return [*solids, drum(hand + [0, 0.05, 0], hand + [0, -0.22, 0.2], 0.1, 0.24)]


def teapot(rng: Rng) -> list[Solid]:
    """Shape a teapot: a round body with a lid, a spout and an ear."""
    u = rng.uniform
    r, high = u(0.38, 0.46), u(0.3, 0.44)
    solids = [ball((0, high, 0), (r, high, r)), drum((0, 0, 0), (0, 0.1, 0), r * 0.65)]
    solids += [ball((0, 1.75 * high, 0), (r * 0.55, 0.13, r * 0.55)), ball((0, 1.75 * high + 0.16, 0), 0.085)]
    tip = np.array([r + u(0.28, 0.4), high * u(1.6, 2.1), 0])
    solids += rods([(r * 0.7, high * 0.7, 0), (r + 0.14, high * 0.95, 0), tip], [0.16, 0.1, 0.065])
    if rng.random() < 0.75:
        ear = u(0.16, 0.24)
        solids += [hoop((-r - ear * 0.5, high * 1.1, 0), ear, 0.05)]
    else:
        solids += [hoop((0, high * 1.6, 0), r * 0.9, 0.045)]
    return [_turned(s) for s in solids] if rng.random() < 0.5 else solids


def _turned(solid: Solid) -> Solid:
    """Turn a solid by a quarter about +Y, so that what was at +X is at +Z."""
    low, high = solid.low, solid.high
    return Solid(
        lambda p: solid.field(np.stack([p[:, 2], p[:, 1], -p[:, 0]], 1)),
        np.array([-high[2], low[1], low[0]]), np.array([-low[2], high[1], high[0]]), solid.hole,
    )  # fmt: skip


def umbrella(rng: Rng) -> list[Solid]:
    """Shape an open umbrella: a scalloped canopy over a stick with a crook."""
    u = rng.uniform
    r, high, stick, crook = u(0.65, 0.8), u(0.28, 0.42), u(0.8, 1.05), u(0.08, 0.13)
    solids = [ball((0, 0, 0), (r, high, r)), carved(ball((0, -0.09, 0), (r, high, r)))]
    solids += [carved(block((0, -1, 0), (4, 2, 4), 0))]
    for k in range(8):
        a = k * np.pi / 4
        solids += [carved(ball((r * 1.03 * np.sin(a), -0.02, r * 1.03 * np.cos(a)), (0.2, 0.1, 0.2)))]
    solids += [rod((0, high + 0.1, 0), (0, -stick, 0), 0.045)]
    path = [np.array([crook * (1 - np.cos(a)), -stick - crook * np.sin(a), 0]) for a in np.linspace(0, np.pi * 1.1, 7)]
    return solids + rods(path, [0.05] * 7)


def _ear(rng: Rng, r: float, low: float, high: float) -> list[Solid]:
    """Return a handle at +X or -X of a wall of radius `r`: a ring, a square bow, or a filled ear."""
    out, middle, half = rng.uniform(0.12, 0.3), (low + high) / 2, (high - low) / 2
    thick = rng.uniform(0.045, 0.075)
    kind = int(rng.integers(3))
    if kind == 0:
        ear = [hoop((r, middle, 0), half, thick)]
    elif kind == 1:
        ear = rods([(r - 0.05, high, 0), (r + out, high, 0), (r + out, low, 0), (r - 0.05, low, 0)], [thick] * 4)
    else:
        ear = [ball((r, middle, 0), (out + 0.05, half, thick))]
    return ear if rng.random() < 0.5 else both(ear)[len(ear) :]


def mug(rng: Rng) -> list[Solid]:
    """Shape a mug with one ear: upright, bellied, or a low cup on a saucer."""
    u, cup = rng.uniform, rng.random() < 0.3
    r, high = u(0.36, 0.46), u(0.45, 0.6) if cup else u(0.7, 1.0)
    foot = r * (u(0.5, 0.7) if cup else u(0.85, 1.1))
    outline = [(r, 0.0), (r, high)]
    if cup or rng.random() < 0.5:
        outline = _curve([(foot, 0.0), (r * u(0.92, 1.1), 0.5 * high), (r, high)])
    solids = _ear(rng, 0.95 * r, 0.2 * high, 0.85 * high) + _pot(outline, u(0.05, 0.09), 0.1)
    return [*solids, drum((0, -0.05, 0), (0, 0.04, 0), 0.5, 0.68)] if cup and rng.random() < 0.5 else solids


def pan(rng: Rng) -> list[Solid]:
    """Shape a pan: shallow and round, with a long handle to some side, rarely with two short ones."""
    u = rng.uniform
    r, high = u(0.46, 0.56), u(0.1, 0.22)
    solids = _pot([(r * u(0.75, 0.95), 0.0), (r, high)], 0.06, 0.06)
    if rng.random() < 0.2:
        return solids + both(hoop((r + 0.04, high - 0.03, 0), 0.13, 0.045, (90, 0, 0)))
    end = np.array([r + u(0.6, 0.9), high + u(-0.05, 0.25), 0])
    solids += [rod((r - 0.03, high - 0.05, 0), end, 0.045, 0.07)]
    solids += [rod(0.45 * end + [0.55 * r, 0.5 * high, 0], end, 0.05, 0.08)]
    turns = int(rng.choice([0, 0, 1, 2, 3]))
    for _ in range(turns):
        solids = [_turned(s) for s in solids]
    return solids


def jar(rng: Rng) -> list[Solid]:
    """Shape a jar: a wide body, a short neck nearly as wide, a screw lid, a stopper or a knob on a lid."""
    u = rng.uniform
    r, high, neck = u(0.34, 0.46), u(0.65, 1.0), u(0.7, 0.85)
    side = [(r * 0.9, 0.0), (r, 0.06), (r, high - 0.1)]
    if rng.random() >= 0.5:
        side = _curve([(r * 0.75, 0.0), (r * 1.12, 0.55 * high), (r * 0.85, high)])
    solids = [spun([(0, 0), *side, (neck * r, high), (neck * r, high + 0.1), (0, high + 0.1)])]
    lid, top = neck * r + u(0.02, 0.07), high + u(0.2, 0.3)
    solids += [drum((0, high + 0.07, 0), (0, top, 0), lid)]
    if rng.random() < 0.4:
        solids += [ball((0, top, 0), (lid * 0.9, 0.09, lid * 0.9)), ball((0, top + 0.13, 0), 0.09)]
    return solids


def can(rng: Rng) -> list[Solid]:
    """Shape a can: of a drink with a drawn-in top and a tab, or of food with rims and rings; sometimes open."""
    u = rng.uniform
    r, high = u(0.3, 0.38), u(0.75, 1.1)
    if rng.random() < 0.5:
        side = [(r * 0.8, 0), (r, 0.09), (r, high - 0.12), (r * 0.82, high), (r * 0.82, high + 0.03)]
        solids = [spun([(0, 0), *side, (0, high + 0.03)])]
        solids += [carved(drum((0, high - 0.02, 0), (0, high + 0.2, 0), r * 0.72))]
        return [*solids, block((0, high - 0.01, 0.06), (0.12, 0.03, 0.2), 0.3)]
    high *= u(0.6, 1.0)
    solids = [drum((0, 0, 0), (0, high, 0), r * 1.1)]
    solids += [carved(drum((0, high - u(0.05, 0.3), 0), (0, high + 0.2, 0), r * 0.98))]
    for y in np.linspace(0.0, high, int(rng.choice([2, 5, 7]))):
        solids += [hoop((0, y, 0), r * 1.1, 0.04, (90, 0, 0))]
    return solids


def plate(rng: Rng) -> list[Solid]:
    """Shape a plate: round, flat and wide with a raised rim, or square."""
    u = rng.uniform
    rim, high = u(0.1, 0.2), u(0.08, 0.16)
    if rng.random() < 0.15:
        inner = 1.2 - 2 * rim
        return [block((0, high / 2, 0), (1.2, high, 1.2), 0.4), carved(block((0, high, 0), (inner, high, inner), 0.4))]
    return _pot([(0.4, 0.0), (0.6 - rim, 0.02), (0.6, high), (0.6, high + 0.05)], u(0.05, rim), 0.05)


def potion(rng: Rng) -> list[Solid]:
    """Shape a flask of a potion: a round, drop-like, conical or cornered body, a narrow neck, a lip and a stopper."""
    u = rng.uniform
    r, neck, top = u(0.32, 0.4), u(0.09, 0.14), u(0.98, 1.15)
    drop = _curve([(0.6 * r, 0.0), (r * 1.1, 0.2), (0.6 * r, 0.5), (neck, 0.75)])
    kind, sides = int(rng.integers(4)), int(rng.integers(4, 7))
    solids = [
        [ball((0, r, 0), r)],
        [spun([(0, 0), *drop, (0, 0.75)])],
        [drum((0, 0, 0), (0, 0.75, 0), 1.15 * r, neck)],
        [drum((0, 0, 0), (0, 0.5, 0), r * 0.9, r, sides=sides), drum((0, 0.5, 0), (0, 0.68, 0), r, neck)],
    ][kind]
    solids += [drum((0, 0.3, 0), (0, top, 0), neck), hoop((0, top - u(0.0, 0.12), 0), neck + 0.02, 0.05, (90, 0, 0))]
    return (
        [*solids, drum((0, top, 0), (0, top + u(0.08, 0.16), 0), neck * 0.8, neck)] if rng.random() < 0.75 else solids
    )
