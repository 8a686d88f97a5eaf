"""Draw what floats, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.chassis import Solids, bar, block, drum, share, side
from meshdeform.nouns.families.parts import Part, box, ellipsoid, lathe, limb, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["canoe", "hovercraft", "jetski", "raft", "ship"]


def hull(
    long: float,
    beam: float,
    depth: float,
    *,
    bow: float = 0.9,
    stern: float = 0.15,
    sheer: float = 0.12,
    keel: float = 0.5,
) -> Part:
    """Return a ship's hull with a flat deck at height `depth`, half its length and its beam given.

    `bow` and `stern` say how far it narrows to its ends, `sheer` by how much the ends rise, `keel` how far it narrows
    downward.
    """
    x, y, z = box([0, 0, 0], [2, 2, 2], round_by=0.06, cells=10).verts.T
    ahead, behind, up = np.clip(z, 0, 1), np.clip(-z, 0, 1), (y + 1) / 2
    plan = (1 - bow * ahead**2.6) * (1 - stern * behind**3)
    flare = 1 - keel * (1 - up) ** 1.5
    height = depth * up + sheer * (ahead**2 + 0.4 * behind**2) * (0.3 + 0.7 * up)
    rake = 0.12 * long * ahead * up
    shape = np.column_stack([x * beam * plan * flare, height, z * long + rake])
    return box([0, 0, 0], [2, 2, 2], round_by=0.06, cells=10)._replace(verts=shape)


def open_boat(long: float, beam: float, depth: float, *, rise: float, transom: bool = False) -> Part:
    """Return a boat's shell, open above, pointed at both ends or cut off behind; its ends rise."""
    wall = [(0.25, 0.0), (0.7, 0.12), (0.92, 0.5), (1.0, 1.0), (0.93, 1.0), (0.84, 0.5), (0.6, 0.24), (0.2, 0.2)]
    shell = lathe(wall, segments=32)
    x, y, z = shell.verts.T
    reach = np.hypot(x, z)
    turn = np.arctan2(x, z)
    across = np.sign(x) * np.abs(np.sin(turn)) ** 1.5 * reach
    across = np.where(
        (z < 0) & transom, np.sign(x) * np.abs(np.sin(turn)) ** 0.35 * reach * (1 + 0.25 * np.minimum(z, 0)), across
    )
    along = np.where((z < 0) & transom, 0.8 * z, z)
    lift = rise * np.abs(along) ** 3 * (0.4 + 0.6 * y)
    return shell._replace(verts=np.column_stack([across * beam, y * depth + lift, along * long]))


def ship(rng: Rng, traits: Traits) -> Part:
    """Draw a sailing ship: a deep hull with a raised stern, two or three masts of square sails, a bowsprit."""
    sail = traits.draw(rng, "sail", (0.4, 0.55), (0.95, 1.05), (1.4, 1.6))
    long, beam, depth = share(rng, 0.85, 0.95), share(rng, 0.26, 0.31), share(rng, 0.3, 0.36)
    high = share(rng, 0.18, 0.28)
    castle = [(-1.0 * long, 0.6 * depth), (-1.08 * long, depth + high + 0.06), (-0.55 * long, depth + high - 0.04),
              (-0.5 * long, 0.6 * depth)]  # fmt: skip
    fore = [
        (0.56 * long, 0.8 * depth),
        (0.54 * long, depth + 0.14),
        (0.92 * long, depth + 0.2),
        (0.86 * long, 0.8 * depth),
    ]
    solids: Solids = {
        "body": [hull(long, beam, depth, sheer=0.16, keel=0.6), side(castle, 1.75 * beam), side(fore, 0.9 * beam),
                 *pair(block([0.97 * beam, depth + 0.01, -0.05], [0.05, 0.09, 1.2 * long]))],
        "mast": [bar([0, depth + 0.1, 0.9 * long], [0, depth + 0.34, 1.45 * long], radius=0.035)],
        "sail": [],
    }  # fmt: skip
    for z, size in ((0.05, 1.0), (0.58, 0.84), (-0.62, 0.72))[: int(rng.integers(2, 4))]:
        top = depth + 1.15 * size
        solids["mast"].append(bar([0, 0.6 * depth, z * long], [0, top + 0.12, z * long], radius=(0.045, 0.03)))
        for low, tall, wide in ((0.22, 0.42, 0.44), (0.68, 0.34, 0.34)):
            spar, half, drop = depth + size * (low + tall), size * wide, size * tall * sail
            cloth = box([0, 0, 0], [2 * half * sail, drop, 0.05], round_by=0.3, cells=5)
            u = cloth.verts[:, :2] / [half * sail, drop / 2]
            belly = 0.16 * size * (1 - u[:, 0] ** 2) * (1 - 0.5 * u[:, 1] ** 2)
            cloth = cloth._replace(verts=cloth.verts + np.column_stack([0 * belly, 0 * belly, belly]))
            solids["sail"].append(moved(cloth, [0, spar - drop / 2, z * long + 0.03]))
            solids["mast"].append(bar([-half, spar, z * long], [half, spar, z * long], radius=0.025))
    return named(**solids)


def steamer(rng: Rng, traits: Traits) -> Part:
    """Draw a liner: a long hull, white decks in steps with rows of windows, one to four funnels, masts."""
    long, beam, depth = share(rng, 1.05, 1.2), share(rng, 0.2, 0.25), share(rng, 0.2, 0.26)
    decks, funnels = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    solids: Solids = {
        "body": [hull(long, beam, depth, sheer=0.08, keel=0.35)], "window": [],
        "mast": [bar([0, depth, z * long], [0, depth + 0.6, z * long], radius=0.025) for z in (0.72, -0.8)],
    }  # fmt: skip
    level = depth
    for deck in range(decks):
        half, wide = (0.62 - 0.1 * deck) * long, (0.86 - 0.12 * deck) * beam
        solids["body"].append(block([0, level + 0.06, -0.08 * long], [2 * wide, 0.16, 2 * half]))
        solids["window"].append(block([0, level + 0.08, -0.08 * long], [2 * wide + 0.03, 0.05, 1.86 * half], 0.05))
        level += 0.14
    solids["cabin"] = [block([0, level + 0.06, 0.36 * long], [1.3 * beam, 0.16, 0.2])]
    lean = share(rng, 0, 0.12)
    for z in np.linspace(-0.4, 0.2, funnels) * long if funnels > 1 else [-0.1]:
        solids.setdefault("chimney", []).append(limb([[0, level - 0.05, z], [0, level + share(rng, 0.3, 0.34), z - lean]],
                                                     [[0.085, 0.1], [0.085, 0.1]], segments=14))  # fmt: skip
    return named(**solids)


def freighter(rng: Rng, traits: Traits) -> Part:
    """Draw a freighter: a long low hull loaded with rows of containers, a tall bridge behind, a funnel."""
    long, beam, depth = share(rng, 1.1, 1.3), share(rng, 0.23, 0.28), share(rng, 0.22, 0.28)
    solids: Solids = {"body": [hull(long, beam, depth, sheer=0.1, keel=0.2, bow=0.85)], "load": []}
    for z in np.linspace(-0.42, 0.6, 6) * long:
        tall = 0.1 * int(rng.integers(1, 4))
        narrow = 1.0 if z < 0.4 * long else 0.7
        for x in (-0.56, 0.0, 0.56):
            solids["load"].append(
                block([x * beam * narrow, depth + tall / 2, z], [0.52 * beam * narrow, tall, 0.19 * long])
            )
    high = share(rng, 0.42, 0.52)
    solids["cabin"] = [block([0, depth + high / 2, -0.72 * long], [1.3 * beam, high, 0.2]),
                       block([0, depth + high, -0.71 * long], [2 * beam, 0.1, 0.2])]  # fmt: skip
    solids["window"] = [block([0, depth + high + 0.01, -0.68 * long], [1.9 * beam, 0.05, 0.17])]
    solids["chimney"] = [block([0, depth + high / 2, -0.86 * long], [0.16, 1.2 * high, 0.14], 0.3)]
    solids["mast"] = [bar([0, depth, 0.86 * long], [0, depth + 0.36, 0.86 * long], radius=0.025)]
    return named(**solids)


def canoe(rng: Rng, traits: Traits) -> Part:
    """Draw a canoe: a slim shell, open above, whose pointed ends rise, with thwarts and a paddle; or a closed kayak."""
    long, beam, depth = share(rng, 1.0, 1.15), share(rng, 0.2, 0.26), share(rng, 0.18, 0.24)
    kayak = rng.random() < 0.3
    rise = share(rng, 0.05, 0.1) if kayak else share(rng, 0.14, 0.24)
    solids: Solids = {"body": [open_boat(long, beam, depth, rise=rise)]}
    solids["seat"] = [block([0, 0.72 * depth, z * long], [1.5 * beam, 0.05, 0.14]) for z in (-0.42, 0.0, 0.4)]
    if kayak:
        deck = ellipsoid([0, 0, 0], [0.92 * beam, 0.36 * depth, 0.96 * long], rings=12)
        tip = np.sqrt(np.clip(1 - (deck.verts[:, 2] / long) ** 2, 0, 1))
        lift = rise * np.abs(deck.verts[:, 2] / long) ** 3
        solids["canopy"] = [deck._replace(verts=deck.verts * np.column_stack([0.3 + 0.7 * tip, 0 * tip + 1, 0 * tip + 1])
                                          + np.column_stack([0 * lift, lift + 0.86 * depth, 0 * lift]))]  # fmt: skip
        ring = lathe([(0.14, 0), (0.16, 0.1), (0.13, 0.1), (0.11, 0.02)], segments=16)
        solids["seat"] = [moved(ring._replace(verts=ring.verts * [0.7, 0.6, 1.0]), [0, 1.16 * depth, -0.1])]
    if kayak or rng.random() < 0.6:
        solids["handle"] = [each for each in (
            bar([-0.62, depth + 0.06, 0.2], [0.62, depth + 0.16, 0.1], radius=0.026),
            *(ellipsoid([s * 0.66, depth + 0.11 + s * 0.05, 0.15 - 0.05 * s], [0.13, 0.02, 0.07], rings=6) for s in (-1, 1)))]  # fmt: skip
    return named(**solids)


def raft(rng: Rng, traits: Traits) -> Part:
    """Draw a raft: logs side by side, tied with cross beams, often with a mast, a sail or a tent."""
    long, logs = share(rng, 0.7, 0.85), int(rng.integers(6, 9))
    girth, wide = 0.6 / logs, 0.56
    solids: Solids = {"body": []}
    for x in np.linspace(-wide, wide, logs):
        ends = share(rng, 0.9, 1.05) * long
        solids["body"].append(limb([[x, girth, -ends], [x, girth, ends]], [1.12 * girth] * 2, segments=12, samples=1))
    solids["frame"] = [
        bar([-wide - 0.1, 2 * girth, z * long], [wide + 0.1, 2 * girth, z * long], radius=0.06)
        for z in (-0.7, 0.0, 0.7)
    ]
    if rng.random() < 0.7:
        size = share(rng, 0.8, 1.0)
        solids["mast"] = [bar([0, girth, 0.1], [0, 1.25 * size + 0.1, 0.1], radius=0.045),
                          bar([-0.44 * size, 1.2 * size, 0.12], [0.44 * size, 1.2 * size, 0.12], radius=0.03)]  # fmt: skip
        solids["sail"] = [box([0, 0.8 * size + 0.02, 0.17], [0.8 * size, 0.72 * size, 0.05], round_by=0.4, cells=4)]
    solids["handle"] = [bar([0, 0.5, -0.8 * long], [0, 0.05, -long - 0.4], radius=0.035)]
    return named(**solids)


def hovercraft(rng: Rng, traits: Traits) -> Part:
    """Draw a hovercraft: a fat rubber skirt about a flat deck, a cabin ahead, one or two propellers in rings behind."""
    long, wide, tall = share(rng, 0.8, 0.92), share(rng, 0.42, 0.5), share(rng, 0.24, 0.3)
    skirt = box([0, tall / 2, 0], [2 * wide, tall, 2 * long], round_by=0.5, cells=8)
    narrow = 1 - 0.35 * np.clip(skirt.verts[:, 2] / long, 0, 1) ** 2
    skirt = skirt._replace(verts=skirt.verts * np.column_stack([narrow, 0 * narrow + 1, 0 * narrow + 1]))
    cab = [(-0.2, tall), (-0.16, tall + 0.36), (0.28, tall + 0.36), (0.52, tall)]
    fans, radius = (1, 0.34) if rng.random() < 0.4 else (2, 0.24)
    z, y = -0.72 * long, tall + radius
    solids: Solids = {
        "skirt": [skirt],
        "body": [block([0, tall, -0.04], [1.66 * wide, 0.1, 1.75 * long])],
        "cabin": [side(cab, 1.1 * wide, bevel=0.06)],
        "window": [side([(-0.1, tall + 0.16), (-0.08, tall + 0.3), (0.22, tall + 0.3), (0.32, tall + 0.16)], 1.14 * wide),
                   side([(0.0, tall + 0.16), (0.0, tall + 0.31), (0.35, tall + 0.31), (0.45, tall + 0.16)], 0.9 * wide)],
        "rotor": [], "propeller": [],
    }  # fmt: skip
    ring = lathe([(0.84 * radius, 0.02), (0.9 * radius, 0.1), (radius, 0.1), (radius, -0.1), (0.9 * radius, -0.1), (0.84 * radius, -0.02)],
                 segments=22)  # fmt: skip
    for x in (0.0,) if fans == 1 else (-0.52 * wide, 0.52 * wide):
        solids["propeller"].append(moved(turned(ring, 90, "x"), [x, y, z]))
        solids["rotor"] += [
            moved(turned(block([0, 0, 0], [1.7 * radius, 0.08, 0.08]), turn, "z"), [x, y, z]) for turn in (30, 120)
        ]
        solids["rotor"].append(drum(0.06, 0.14, [x, y, z], "z", 10))
        solids.setdefault("tail", []).append(block([x, y, z - 0.22], [0.04, 1.5 * radius, 0.16]))
        solids["body"].append(block([x, tall + 0.08, z - 0.05], [0.14, 0.24, 0.42]))
    return named(**solids)


def jetski(rng: Rng, traits: Traits) -> Part:
    """Draw a jet ski: a short pointed hull, a saddle, handlebars on a raised hood."""
    long, beam = share(rng, 0.7, 0.8), share(rng, 0.26, 0.31)
    bow = hull(long, beam, 0.24, sheer=0.1, keel=0.55, bow=0.85)
    hood = [(-0.06, 0.18), (0.02, 0.5), (0.2, 0.56), (0.86 * long, 0.32), (0.92 * long, 0.2)]
    saddle = [(-0.95 * long, 0.2), (-0.9 * long, 0.4), (-0.5 * long, 0.44), (-0.2, 0.4), (0.06, 0.48), (0.08, 0.2)]
    top, x = np.array([0, 0.58, 0.14]), share(rng, 0.28, 0.34)
    return named(
        body=[bow, side(hood, 1.1 * beam, bevel=0.3)],
        seat=[side(saddle, 0.8 * beam, bevel=0.3)],
        handle=[*pair(bar(top - [0, 0.08, -0.02], top, top + [x, 0.08, -0.1], radius=(0.05, 0.04, 0.04))),
                *pair(bar(top + [0.6 * x, 0.05, -0.06], top + [1.05 * x, 0.085, -0.105], radius=0.05))],
        bumper=pair(block([0.95 * beam, 0.24, -0.1], [0.06, 0.07, 1.5 * long], 0.4)),
        exhaust=[drum(0.07, 0.08, [0, 0.13, -long - 0.04], "z", 12)],
    )  # fmt: skip
