"""Shape animals on four legs, from a common frame: body, legs, neck, head and muzzle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from training.judge.shapes.solids import Floats, Solid, ball, block, both, drum, hoop, plate, rod, rods

__all__ = [
    "bear", "camel", "cat", "cow", "crocodile", "deer", "dinosaur", "dog", "dragon", "elephant", "fox", "giraffe",
    "hedgehog", "horse", "lion", "mouse", "pig", "rabbit", "rhino", "sheep", "turtle", "wolf",
]  # fmt: skip

Rng = np.random.Generator


class _Frame(NamedTuple):
    """Solids of a beast, and where the rest goes: the head's middle and radius, the rump, and the body's height."""

    solids: list[Solid]
    head: Floats
    size: float
    rump: Floats
    back: float


def _frame(
    rng: Rng, *, length: float, girth: float, leg: float, thick: float, neck: float, head: float, muzzle: float,
    snout: float = 0.6, rise: float = 45.0,
) -> _Frame:  # fmt: skip
    """Draw a beast near the given sizes, between a slim one and a toy with a big head and short legs.

    `girth`, `thick` and `head` are radii, `muzzle` a length and `snout` its radius, both as shares of the head's;
    `rise` is the neck's angle above the horizon in degrees.
    """
    u, toy = rng.uniform, rng.uniform(0.0, 1.0)
    length, girth, neck = length * u(0.85, 1.1), girth * u(0.85, 1.15), neck * u(0.8, 1.15)
    head, leg, thick = head * (0.9 + 0.5 * toy), leg * (1.1 - 0.4 * toy), thick * (0.8 + 0.5 * toy)
    boxy, y, z = rng.random() < 0.3, leg + 0.8 * girth, length / 2
    if boxy:
        solids = [block((0, y, 0), (girth * 1.7, girth * 1.8, length + girth * 0.8), u(0.1, 0.8))]
    elif rng.random() < 0.4:
        solids = [ball((0, y, 0), (girth * u(0.85, 1.05), girth, z + girth * 0.8))]
    else:
        solids = [rod((0, y, -z * 0.8), (0, y + girth * u(-0.1, 0.2), z * 0.8), girth * u(0.85, 1.05), girth)]
    for at in (-z * u(0.75, 0.95), z * u(0.75, 0.95)):
        hip = np.array([girth * u(0.5, 0.65), y - 0.2 * girth, at])
        foot = np.array([hip[0] * u(0.9, 1.15), 0.0, at + u(-0.15, 0.15) * leg])
        if boxy and rng.random() < 0.7:
            solids += both(block((hip + foot) / 2, (2 * thick, hip[1], 2 * thick), 0.2))
        else:
            solids += both(rod(hip, foot + [0, thick * 0.8, 0], thick * u(1.0, 1.5), thick * 0.9))
    angle = np.radians(rise + u(-12.0, 12.0))
    start = np.array([0.0, y + 0.3 * girth, z])
    middle = start + neck * np.array([0.0, np.sin(angle), np.cos(angle)]) + [0, 0, 0.3 * head]
    solids += [rod(start, middle, max(0.62 * girth, 0.6 * head), 0.6 * head)]
    down = np.array([0.0, -u(0.2, 0.5), 1.0]) * head
    if boxy:
        solids += [block(middle, (head * 1.7, head * 1.7, head * 1.9), u(0.1, 0.8))]
        wide = 2 * snout * head
        solids += [block(middle + down * (0.6 + muzzle / 2), (wide, wide, head * (0.6 + muzzle)), 0.3)]
    else:
        solids += [ball(middle, head * np.array([u(0.8, 1.0), u(0.85, 1.0), u(0.9, 1.15)]))]
        solids += [rod(middle, middle + down * (0.5 + muzzle), 0.8 * head, snout * head)]
    return _Frame(solids, middle, head, np.array([0.0, y + 0.4 * girth, -z - 0.5 * girth]), y + girth)


def _ears(rng: Rng, f: _Frame, size: float, kind: str) -> list[Solid]:
    """Return two ears: pointed, round, hanging (flop) or out to the sides (side)."""
    r, h = f.size, size * f.size * rng.uniform(0.8, 1.25)
    root = f.head + r * np.array([0.55, 0.65, -0.1])
    if kind == "point":
        return both(drum(root - [0, 0.2 * r, 0], root + [0.25 * h, h, 0], 0.42 * r, 0.06 * r))
    if kind == "round":
        return both(ball(root + [0.2 * h, 0.4 * h, 0], (h * 0.8, h * 0.8, 0.35 * r)))
    if kind == "flop":
        return both(ball(root + [0.35 * r, -0.35 * h, 0], (0.25 * r, h * 0.85, 0.45 * r), (0, 0, 12)))
    return both(ball(root + [0.3 * r + 0.5 * h, -0.25 * r, 0], (h * 0.75, 0.3 * r, 0.22 * r), (0, 0, -10)))


def _tail(rng: Rng, f: _Frame, length: float, radius: float, angle: float, tuft: float = 0.0) -> list[Solid]:
    """Return a tail that leaves the rump `angle` degrees above the horizon and bends down or up."""
    at = np.radians(angle + rng.uniform(-15, 15))
    one = f.rump + 0.5 * length * np.array([0.0, np.sin(at), -np.cos(at)])
    turn = at + np.radians(rng.uniform(-35, 35))
    two = one + 0.5 * length * np.array([0.0, np.sin(turn), -np.cos(turn)])
    solids = rods([f.rump + [0, 0, 0.15], one, two], [radius * 1.1, radius, radius * 0.8])
    return [*solids, ball(two, tuft)] if tuft else solids


def bear(rng: Rng) -> list[Solid]:
    """Shape a bear on its four legs, or sitting like a toy."""
    u = rng.uniform
    if rng.random() < 0.6:
        f = _frame(rng, length=1.0, girth=0.48, leg=0.42, thick=0.17, neck=0.25, head=0.32, muzzle=0.75, snout=0.5,
                   rise=25.0)  # fmt: skip
        return [*f.solids, *_ears(rng, f, 0.4, "round"), ball(f.rump, 0.12)]
    wide, head = u(0.42, 0.55), u(0.36, 0.46)
    top = 0.55 + u(0.45, 0.6)
    solids = [ball((0, 0.5, 0), (wide, 0.58, wide * 0.9)), ball((0, top + 0.3 * head, 0.05), head)]
    solids += [ball((0, top + 0.15 * head, 0.05 + 0.9 * head), (0.45 * head, 0.36 * head, 0.45 * head))]
    solids += both(ball((0.72 * head, top + 1.05 * head, 0), (0.36 * head, 0.36 * head, 0.18 * head)))
    solids += both(rod((wide * 0.75, 0.8, 0.1), (wide * u(0.95, 1.35), u(0.35, 0.8), u(0.1, 0.4)), 0.15, 0.15))
    return solids + both(rod((wide * 0.5, 0.2, 0.2), (wide * u(0.7, 1.0), 0.17, u(0.6, 0.8)), 0.18, 0.2))


def camel(rng: Rng) -> list[Solid]:
    """Shape a camel with one hump or two, its neck bent like a swan's."""
    u = rng.uniform
    y, z = u(1.05, 1.25), u(0.5, 0.62)
    head = np.array([0, y + u(0.45, 0.7), z + u(0.55, 0.75)])
    solids = [ball((0, y, 0), (u(0.28, 0.36), u(0.3, 0.36), z + 0.15))]
    thick = u(0.07, 0.11)
    for at in (-z * 0.8, z * 0.8):
        solids += both(rod((0.18, y, at), (0.2, thick, at), thick * 1.3, thick))
    solids += rods([(0, y, z), (0, y - 0.1, z + 0.35), (0, head[1] - 0.1, head[2] - 0.1)], [0.22, 0.15, 0.12])
    solids += [rod(head, head + [0, -0.08, u(0.25, 0.35)], u(0.15, 0.18), 0.11)]
    solids += both(ball(head + [0.12, 0.16, -0.03], (0.05, 0.1, 0.05)))
    for at in [[0.0], [-0.3, 0.3]][int(rng.integers(2))]:
        top = np.array([0, y + u(0.45, 0.6), at])
        solids += [rod((0, y + 0.1, at), top, u(0.24, 0.3), u(0.1, 0.16))]
    return [*solids, rod((0, y + 0.1, -z - 0.1), (0, y - 0.45, -z - 0.25), 0.05, 0.06)]


def cat(rng: Rng) -> list[Solid]:
    """Shape a cat that stands or sits, its tail up."""
    u = rng.uniform
    if rng.random() < 0.55:
        f = _frame(rng, length=0.95, girth=0.25, leg=0.42, thick=0.075, neck=0.24, head=0.25, muzzle=0.35, snout=0.45,
                   rise=60.0)  # fmt: skip
        tail = _tail(rng, f, u(0.6, 0.95), 0.065, u(35, 75))
        return [*f.solids, *_ears(rng, f, 0.75, "point"), *tail]
    head, top = u(0.27, 0.36), u(0.95, 1.15)
    solids = rods([(0, 0.32, -0.15), (0, top - 0.1, 0.12)], [u(0.33, 0.4), 0.22])
    solids += [ball((0, top + 0.5 * head, 0.18), (head * 1.05, head * 0.9, head * 0.9))]
    solids += [ball((0, top + 0.3 * head, 0.18 + 0.8 * head), (0.4 * head, 0.3 * head, 0.3 * head))]
    solids += both(
        drum((0.55 * head, top + 1.0 * head, 0.15), (0.75 * head, top + u(1.8, 2.0) * head, 0.12), 0.14, 0.02)
    )
    solids += both(rod((0.13, 0.65, 0.2), (0.14, 0.08, 0.35), 0.11, 0.09))
    solids += both(ball((0.3, 0.2, 0.02), (0.15, 0.22, 0.28)))
    side = u(0.5, 0.7)
    return solids + rods([(0, 0.1, -0.45), (side, 0.08, -0.3), (side, 0.08, 0.2)], [0.08, 0.08, 0.07])


def cow(rng: Rng) -> list[Solid]:
    """Shape a cow with horns, ears out to the sides and an udder."""
    f = _frame(rng, length=1.2, girth=0.42, leg=0.5, thick=0.12, neck=0.35, head=0.25, muzzle=0.9, snout=0.68,
               rise=35.0)  # fmt: skip
    r, out, up = f.size, rng.uniform(0.5, 1.1), rng.uniform(0.3, 0.9)
    root = f.head + r * np.array([0.4, 0.75, -0.1])
    tip = root + r * np.array([0.2 + out, up, 0.2])
    solids = f.solids
    solids += both(rods([root, (root + tip) / 2 + [0.15 * r, -0.1 * r, 0], tip], [0.2 * r, 0.16 * r, 0.1 * r]))
    solids += _ears(rng, f, 0.55, "side")
    return [*solids, ball((0, f.back - 0.95, -0.35), (0.2, 0.16, 0.2)), *_tail(rng, f, 0.65, 0.05, -75.0, 0.08)]


def crocodile(rng: Rng) -> list[Solid]:
    """Shape a crocodile: flat and long, with a long mouth, a thick tail and a ragged back."""
    u = rng.uniform
    wide, y = u(0.22, 0.32), u(0.18, 0.26)
    tail, mouth, gape = u(1.0, 1.4), u(0.6, 0.85), u(0.0, 0.2)
    solids = [ball((0, y, 0), (wide, u(0.16, 0.22), 0.65)), ball((0, y + 0.03, 0.65), (0.2, 0.15, 0.25))]
    side = u(-0.3, 0.3)
    solids += rods([(0, y, -0.4), (0.5 * side, y, -0.4 - tail / 2), (side, y * 0.8, -0.4 - tail)], [0.18, 0.12, 0.05])
    solids += [block((0, y - 0.04, 0.75 + mouth / 2), (0.24, 0.09, mouth), 0.5)]
    solids += [block((0, y + 0.06 + gape / 2, 0.75 + mouth / 2), (0.22, 0.09, mouth), 0.5, (-60 * gape, 0, 0))]
    solids += both(ball((0.1, y + 0.17, 0.65), 0.07))
    for at in (-0.35, 0.4):
        solids += both(rods([(0.15, y, at), (wide + 0.22, y, at), (wide + 0.25, 0.04, at + 0.08)], [0.09, 0.08, 0.06]))
    for at in np.linspace(-0.4 - 0.7 * tail, 0.4, 9):
        solids += [drum((0, y + 0.05, at), (0, y + 0.28 - 0.1 * (at < -0.5), at), 0.09, 0.01, sides=4)]
    return solids


def deer(rng: Rng) -> list[Solid]:
    """Shape a deer with branching antlers and a short tail."""
    f = _frame(rng, length=1.0, girth=0.27, leg=0.75, thick=0.065, neck=0.55, head=0.17, muzzle=1.1, snout=0.5,
               rise=62.0)  # fmt: skip
    u, r = rng.uniform, f.size
    up, out = u(0.4, 0.7), u(0.2, 0.45)
    root = f.head + r * np.array([0.35, 0.7, -0.2])
    mid = root + [out * 0.6, up * 0.5, -0.1]
    tip = root + [out, up, u(-0.15, 0.1)]
    horn = rods([root, mid, tip], [0.05, 0.045, 0.035])
    horn += [rod(mid, mid + [0.03, up * 0.45, 0.2], 0.04, 0.03), rod(mid, mid + [0.25, up * 0.3, -0.05], 0.04, 0.03)]
    return [*f.solids, *both(horn), *_ears(rng, f, 0.7, "side"), *_tail(rng, f, 0.18, 0.07, 20.0)]


def dinosaur(rng: Rng) -> list[Solid]:
    """Shape a long-necked dinosaur."""
    f = _frame(rng, length=1.0, girth=0.42, leg=0.42, thick=0.14, neck=1.0, head=0.16, muzzle=0.8, snout=0.65,
               rise=60.0)  # fmt: skip
    return [*f.solids, *_tail(rng, f, rng.uniform(1.0, 1.5), 0.17, -15.0)] + rods(
        [f.rump + [0, 0, 0.3], f.rump + [0, -0.15, -0.5]], [0.33, 0.2]
    )


def dog(rng: Rng) -> list[Solid]:
    """Shape a dog with a long muzzle, ears that hang or stand, and a raised tail."""
    f = _frame(rng, length=0.95, girth=0.28, leg=0.48, thick=0.085, neck=0.3, head=0.25, muzzle=0.95, snout=0.5,
               rise=55.0)  # fmt: skip
    kind = "flop" if rng.random() < 0.6 else "point"
    return [*f.solids, *_ears(rng, f, 0.7, kind), *_tail(rng, f, rng.uniform(0.35, 0.6), 0.06, 45.0)]


def dragon(rng: Rng) -> list[Solid]:
    """Shape a dragon: a beast with a long neck and tail, spread wings, horns and a ridge."""
    u = rng.uniform
    f = _frame(rng, length=0.85, girth=0.35, leg=0.4, thick=0.12, neck=0.65, head=0.22, muzzle=1.0, snout=0.6,
               rise=62.0)  # fmt: skip
    solids = [*f.solids, *_tail(rng, f, u(0.9, 1.3), 0.13, -5.0, 0.12)]
    span, top = u(0.9, 1.3), f.back - 0.1
    wing = np.array([(0.4, 0.0), (0.35, span), (-0.25, span * 0.9), (-0.2, span * 0.65), (-0.65, span * 0.5),
                     (-0.4, span * 0.25), (-0.5, 0.0)])  # fmt: skip
    solids += both(plate(wing, 0.09, (0.05, top, 0), "y", (0, 0, u(25, 60))))
    solids += both(
        rod(f.head + f.size * np.array([0.4, 0.5, -0.3]), f.head + f.size * np.array([0.7, 1.5, -1.2]), 0.06, 0.03)
    )
    return solids + [
        drum((0, f.back - 0.1, at), (0, f.back + 0.16, at - 0.08), 0.1, 0.01) for at in (-0.35, -0.1, 0.15)
    ]


def elephant(rng: Rng) -> list[Solid]:
    """Shape an elephant: heavy, with ears like plates, a trunk and tusks."""
    u = rng.uniform
    f = _frame(rng, length=0.85, girth=0.52, leg=0.5, thick=0.17, neck=0.25, head=0.33, muzzle=0.2, snout=0.7,
               rise=30.0)  # fmt: skip
    r = f.size
    ear = ball(
        f.head + r * np.array([1.15, 0.1, -0.35]), (r * u(0.7, 0.9), r * u(0.9, 1.15), 0.09), (0, u(-40, -10), 0)
    )
    start, curl = f.head + r * np.array([0, -0.3, 0.9]), u(-0.2, 0.4)
    low = max(start[1] - u(0.5, 0.75), 0.12)
    trunk = rods([start, (0, (start[1] + low) / 2, start[2] + 0.22), (0, low, start[2] + 0.25),
                  (0, low + max(curl, 0.0), start[2] + 0.45)], [0.17, 0.13, 0.1, 0.08])  # fmt: skip
    tusk = rod(start + [0.17, -0.05, 0], start + [0.2, -0.25, 0.35], 0.06, 0.04)
    return [*f.solids, *both(ear), *trunk, *both(tusk), *_tail(rng, f, 0.4, 0.05, -70.0)]


def giraffe(rng: Rng) -> list[Solid]:
    """Shape a giraffe: a very long neck, long legs and two knobs on the head."""
    f = _frame(rng, length=0.8, girth=0.28, leg=0.95, thick=0.07, neck=1.25, head=0.15, muzzle=1.1, snout=0.6,
               rise=72.0)  # fmt: skip
    knob = rod(f.head + [0.06, 0.1, -0.05], f.head + [0.08, 0.1 + 1.2 * f.size, -0.05], 0.035, 0.045)
    return [*f.solids, *both(knob), *_ears(rng, f, 0.6, "side"), *_tail(rng, f, 0.45, 0.045, -70.0)]


def hedgehog(rng: Rng) -> list[Solid]:
    """Shape a hedgehog: a dome of spikes with a pointed snout."""
    u = rng.uniform
    r, high, snout = u(0.5, 0.6), u(0.45, 0.58), u(0.3, 0.5)
    solids = [ball((0, 0.35, 0), (r, high, 0.7)), rod((0, 0.28, 0.5), (0, 0.24, 0.72 + snout), 0.26, 0.08)]
    solids += [ball((0, 0.25, 0.75 + snout), 0.08), *both(ball((0.17, 0.45, 0.68), (0.1, 0.1, 0.06)))]
    for at in (-0.3, 0.35):
        solids += both(ball((0.28, 0.02, at), (0.12, 0.1, 0.16)))
    long, rows = u(0.14, 0.28), int(rng.integers(4, 7))
    for k, around in enumerate(np.linspace(-95, 95, 2 * rows - 1)):
        for along in np.linspace(-75, 35, rows) + (9 if k % 2 else 0):
            a, b = np.radians(around), np.radians(along)
            d = np.array([np.sin(a) * np.cos(b), np.cos(a) * np.cos(b), np.sin(b)])
            root = np.array([0, 0.35, 0]) + d * [r, high, 0.7]
            solids += [drum(root - 0.08 * d, root + long * (d + [0, 0, -0.35]), 0.09, 0.01)]
    return solids


def horse(rng: Rng) -> list[Solid]:
    """Shape a horse with a long head, a mane and a hanging tail."""
    f = _frame(rng, length=1.1, girth=0.3, leg=0.75, thick=0.08, neck=0.62, head=0.19, muzzle=1.6, snout=0.6,
               rise=52.0)  # fmt: skip
    solids = [*f.solids, *_ears(rng, f, 0.7, "point")]
    solids += rods([f.rump + [0, 0.05, 0.1], f.rump + [0, -0.15, -0.25], f.rump + [0, -0.75, -0.3]], [0.09, 0.12, 0.07])
    start = np.array([0.0, f.back, f.head[2] - 0.55])
    solids += [ball(start + s * (f.head + [0, 0.12, -0.12] - start), (0.07, 0.17, 0.17)) for s in np.linspace(0, 1, 6)]
    return solids


def lion(rng: Rng) -> list[Solid]:
    """Shape a lion: its mane a thick collar around the face, its tail with a tuft."""
    u = rng.uniform
    f = _frame(rng, length=1.05, girth=0.3, leg=0.48, thick=0.1, neck=0.3, head=0.25, muzzle=0.6, snout=0.55,
               rise=50.0)  # fmt: skip
    r = f.size
    wide = r * u(1.5, 1.9)
    mane = [ball(f.head + [0, -0.1 * r, -0.35 * r], (wide, wide * u(1.0, 1.15), r * u(0.6, 0.9)))]
    if rng.random() < 0.5:
        mane += [hoop(f.head + [0, 0, -0.2 * r], wide * 0.75, r * 0.4)]
    return [*f.solids, *mane, *_ears(rng, f, 0.35, "round"), *_tail(rng, f, u(0.7, 0.9), 0.05, 10.0, 0.11)]


def mouse(rng: Rng) -> list[Solid]:
    """Shape a mouse: a drop with huge round ears, a pointed nose and a long thin tail."""
    u = rng.uniform
    wide, long, ear = u(0.32, 0.42), u(0.5, 0.65), u(0.22, 0.33)
    nose = np.array([0, u(0.25, 0.35), long + u(0.4, 0.55)])
    solids = [ball((0, 0.36, 0), (wide, u(0.34, 0.42), long)), rod((0, 0.4, long * 0.6), nose, 0.28, 0.07)]
    solids += [ball(nose, 0.09)]
    solids += both(ball((ear * 0.95, 0.62 + 0.6 * ear, long * 0.6), (ear, ear, 0.08), (0, u(-25, 25), 0)))
    for at in (-0.3, 0.35):
        solids += both(ball((wide * 0.65, 0.06, at), (0.11, 0.09, 0.17)))
    side, up = u(-0.5, 0.5), u(0.05, 0.5)
    solids += rods(
        [(0, 0.2, -long * 0.9), (side, 0.1, -long - 0.45), (0.3 * side, up, -long - 0.9)], [0.08, 0.06, 0.05]
    )
    return solids


def pig(rng: Rng) -> list[Solid]:
    """Shape a pig: a barrel on short legs with a flat snout and a small tail."""
    f = _frame(rng, length=0.85, girth=0.45, leg=0.32, thick=0.12, neck=0.25, head=0.32, muzzle=0.3, snout=0.5,
               rise=25.0)  # fmt: skip
    r = f.size
    snout = drum(f.head + [0, -0.2 * r, 0.5 * r], f.head + [0, -0.25 * r, r * rng.uniform(1.35, 1.7)], 0.45 * r)
    kind = "point" if rng.random() < 0.6 else "flop"
    curl = hoop(f.rump + [0, 0.0, -0.1], 0.1, 0.045, (0, 90, 0))
    return [*f.solids, snout, *_ears(rng, f, 0.55, kind), curl]


def rabbit(rng: Rng) -> list[Solid]:
    """Shape a rabbit that crouches or sits up, with long ears and a ball for a tail."""
    u = rng.uniform
    ear, head, apart = u(0.5, 0.85), u(0.24, 0.32), u(0.1, 0.2)
    if rng.random() < 0.5:
        solids = [ball((0, 0.4, -0.15), (u(0.33, 0.4), u(0.38, 0.46), 0.55)), ball((0, 0.12, 0.3), (0.22, 0.12, 0.28))]
        at = np.array([0, 0.72, 0.45])
        solids += both(ball((0.3, 0.25, -0.3), (0.16, 0.25, 0.3)))
        solids += [ball((0, 0.38, -0.72), 0.15), rod((0, 0.4, 0.2), at, 0.25, 0.18)]
    else:
        solids = [ball((0, 0.48, 0), (u(0.34, 0.44), 0.52, u(0.32, 0.4))), ball((0, 0.2, -0.42), 0.15)]
        at = np.array([0, 1.05 + 0.3 * head, 0.06])
        solids += both(ball((0.24, 0.1, 0.25), (0.14, 0.1, 0.3)))
        solids += both(rod((0.27, 0.75, 0.2), (u(0.15, 0.45), u(0.5, 0.8), 0.4), 0.1, 0.09))
    solids += [ball(at, (head, head * 0.9, head * 1.05)), ball(at + [0, -0.1, 0.8 * head], (0.14, 0.11, 0.12))]
    tilt = u(-0.5, 0.3)
    tip = at + [apart + u(0.05, 0.25), head + ear, tilt * ear - 0.05]
    solids += both(
        rods([at + [apart * 0.8, head * 0.6, -0.05], (at + tip) / 2 + [0.06, 0.2, 0], tip], [0.07, 0.1, 0.06])
    )
    return solids


def rhino(rng: Rng) -> list[Solid]:
    """Shape a rhino: heavy and low-headed, with one horn or two on its nose."""
    u = rng.uniform
    f = _frame(rng, length=1.1, girth=0.45, leg=0.4, thick=0.14, neck=0.3, head=0.27, muzzle=1.2, snout=0.62, rise=8.0)
    r = f.size
    nose = f.head + r * np.array([0, 0.1, 1.45])
    solids = [*f.solids, drum(nose - [0, 0.1, 0.1], nose + [0, u(0.4, 0.65), u(0.05, 0.25)], 0.15, 0.02)]
    if rng.random() < 0.6:
        solids += [drum(nose + [0, 0, -0.85 * r], nose + [0, u(0.22, 0.32), -0.8 * r], 0.1, 0.02)]
    return [*solids, *_ears(rng, f, 0.5, "point"), *_tail(rng, f, 0.35, 0.05, -60.0)]


def sheep(rng: Rng) -> list[Solid]:
    """Shape a sheep: a cloud of wool on thin legs with a bare long face."""
    u = rng.uniform
    leg, wide, long = u(0.3, 0.45), u(0.38, 0.48), u(0.55, 0.7)
    y = leg + 0.35
    solids = [ball((0, y, 0), (wide, 0.38, long))]
    size = u(0.15, 0.22)
    for _ in range(34):
        d = rng.normal(size=3)
        d /= np.linalg.norm(d)
        solids += [ball(np.array([0, y, 0]) + d * [wide * 0.85, 0.34, long * 0.9], size * u(0.85, 1.15))]
    thick = u(0.07, 0.1)
    for at in (-0.55 * long, 0.55 * long):
        solids += both(rod((0.22, y - 0.1, at), (0.22, thick, at), thick))
    head = np.array([0, y + u(0.15, 0.3), long + 0.2])
    solids += [rod(head, head + [0, -0.2, u(0.15, 0.22)], 0.18, 0.12), ball(head + [0, 0.17, -0.08], u(0.15, 0.2))]
    return solids + both(ball(head + [0.25, 0.0, -0.02], (0.15, 0.06, 0.07), (0, 0, -20)))


def turtle(rng: Rng) -> list[Solid]:
    """Shape a turtle: a dome with a rim, a head on a neck and four flat feet."""
    u = rng.uniform
    wide, long, high = u(0.6, 0.75), u(0.7, 0.9), u(0.32, 0.52)
    solids = [ball((0, 0.2, 0), (wide, high, long)), ball((0, 0.2, 0), (wide * 1.12, 0.1, long * 1.1))]
    head = np.array([0, u(0.3, 0.5), long + u(0.25, 0.4)])
    solids += [rod((0, 0.2, long * 0.7), head, 0.13, 0.13), ball(head, (0.17, 0.16, 0.21))]
    for at, out in ((0.55, 0.45), (-0.55, -0.4)):
        if rng.random() < 0.5:
            solids += both(
                ball((wide * 1.0, 0.1, long * (at + out * 0.5)), (0.3, 0.08, 0.17), (0, 40 * np.sign(at), 0))
            )
        else:
            solids += both(rod((wide * 0.65, 0.2, long * at), (wide * 0.85, -0.1, long * (at + 0.2 * out)), 0.17, 0.14))
    return [*solids, rod((0, 0.15, -long), (0, 0.1, -long - 0.25), 0.09, 0.03)]


def fox(rng: Rng) -> list[Solid]:
    """Shape a fox that stands or sits: a narrow muzzle, large upright ears, a tail as thick as its body."""
    u = rng.uniform
    tail, pale = u(0.55, 0.8), u(0.13, 0.19)
    if rng.random() < 0.65:
        f = _frame(rng, length=0.8, girth=0.21, leg=0.34, thick=0.06, neck=0.22, head=0.22, muzzle=1.0, snout=0.2,
                   rise=50.0)  # fmt: skip
        way = np.radians(u(-35, 45))
        tip = f.rump + tail * np.array([0, np.sin(way), -np.cos(way)])
        solids = [*f.solids, *_ears(rng, f, 1.15, "point")]
        return solids + rods([f.rump, 0.45 * f.rump + 0.55 * tip, tip], [0.07, pale, 0.03])
    head = u(0.25, 0.32)
    at = np.array([0, u(0.95, 1.1), 0.2])
    solids = [
        rod((0, 0.28, -0.15), at - [0, 0.2, 0.05], u(0.28, 0.34), 0.17),
        ball(at, (head * 1.1, head * 0.85, head)),
    ]
    solids += [rod(at + [0, -0.1 * head, 0.4 * head], at + [0, -0.4 * head, 1.7 * head], 0.5 * head, 0.05)]
    solids += both(drum(at + [0.5 * head, 0.4 * head, 0], at + [0.85 * head, u(1.5, 1.9) * head, 0], 0.42 * head, 0.02))
    solids += both(rod((0.12, 0.6, 0.18), (0.13, 0.08, 0.32), 0.1, 0.08))
    solids += both(ball((0.26, 0.16, 0.02), (0.13, 0.18, 0.26)))
    side = rng.choice([-1.0, 1.0])
    return solids + rods([(0, 0.12, -0.4), (0.5 * side, 0.16, -0.3), (0.6 * side, 0.2, 0.3)], [0.1, pale, 0.04])


def wolf(rng: Rng) -> list[Solid]:
    """Shape a wolf: a deep chest and a mane, long legs, a strong muzzle, short ears, a full tail held low."""
    u = rng.uniform
    f = _frame(rng, length=1.05, girth=0.27, leg=0.66, thick=0.075, neck=0.38, head=0.22, muzzle=1.15, snout=0.42,
               rise=u(15, 75))  # fmt: skip
    chest = np.array([0, f.back - 0.2, 0.45])
    solids = [*f.solids, rod(chest, 0.35 * chest + 0.65 * f.head, u(0.3, 0.36), u(0.2, 0.26))]
    solids += [*_ears(rng, f, 0.65, "point")]
    for k in range(4):
        place = chest + (f.head - chest) * k / 4
        solids += both(drum(place + [0.16, 0, 0], place + [u(0.3, 0.36), -0.15, -0.18], 0.13, 0.02))
    low = f.rump + [0, -u(0.55, 0.7), -u(0.1, 0.35)]
    return solids + rods([f.rump, 0.5 * (f.rump + low) - [0, 0, 0.1], low], [0.07, u(0.1, 0.13), 0.03])
