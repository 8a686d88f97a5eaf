"""Draw what fills rooms: boxes with doors and drawers toward +Z, and smaller things."""

from __future__ import annotations

import numpy as np

from training.prior.families.dungeon import _arched, _around
from training.prior.families.kitchen import _open
from training.prior.families.parts import Part, box, disc, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from training.prior.families.traits import Rng, Traits

__all__ = [
    "book", "bookcase", "cone", "door", "fridge", "pillow", "sink", "stove", "toilet", "trashcan", "wardrobe",
]  # fmt: skip


def door(rng: Rng, _: Traits) -> Part:
    """Draw a door with a knob in its frame: with raised panels, or arched, of planks with iron bands."""
    wide, tall, deep = rng.uniform(0.8, 1.0), rng.uniform(1.6, 1.9), rng.uniform(0.26, 0.34)
    knob = ellipsoid([0.36 * wide, 0.47 * tall, 0.5 * deep + 0.02], 0.09, rings=8)
    if rng.random() < 0.4:
        parts = [_arched(wide + 0.3, tall + 0.15, 0.5 * wide, deep - 0.08), knob]
        parts += [moved(_arched(0.9 * wide / 4, tall * h, 0.02, 0.1), [x * wide, 0, 0.5 * deep - 0.04]) for x, h in ((-0.36, 0.78), (-0.12, 0.95), (0.12, 0.95), (0.36, 0.78))]
        bands = [box([-0.05 * wide, y * tall, 0.5 * deep], [0.85 * wide, 0.13, 0.16], round_by=0.2) for y in (0.2, 0.7)]
        return join([*parts, *bands])
    parts = [box([0, tall / 2, 0], [wide, tall, deep - 0.14], round_by=0.1), knob]
    parts += pair(box([wide / 2 + 0.06, tall / 2, 0], [0.17, tall, deep], round_by=0.15))
    parts += [box([0, tall + 0.06, 0], [wide + 0.34, 0.2, deep + 0.04], round_by=0.15)]
    rows = [(0.2, 0.28), (0.72, 0.42)] if rng.random() < 0.5 else [(0.17, 0.22), (0.5, 0.24), (0.83, 0.2)]
    for middle, share in rows:
        for z in (-1, 1):
            panel = box([0.24 * wide, middle * tall, z * (0.5 * deep - 0.09)], [0.36 * wide, share * tall, 0.13], round_by=0.48)
            parts += pair(panel)
    return join(parts)


def book(rng: Rng, _: Traits) -> Part:
    """Draw an upright closed book, its back toward -X with ribs, a shield on its cover; or an open book on a slope."""
    wide, tall, deep = rng.uniform(0.8, 1.0), rng.uniform(1.15, 1.35), rng.uniform(0.3, 0.46)
    if rng.random() < 0.35:
        bow = np.linspace(0, 1, 9)
        edge = [(wide * t, 0.3 * np.sin(np.pi * t**0.7) ** 0.8 + 0.12) for t in bow[1:]]
        leaf = extrude([(0.0, 0.0), (wide, 0.0), *edge[::-1], (0.0, 0.1)], tall, bevel=0.03)
        parts = [*pair(leaf), box([0, 0, 0], [2 * wide + 0.16, 0.1, tall + 0.14], round_by=0.3)]
        return turned(join(parts), rng.uniform(25, 60), "x")
    parts = [box([0.0, 0, 0], [wide - 0.06, tall - 0.12, deep - 0.1], round_by=0.03)]
    parts += [box([0.02, 0, z * (deep / 2 - 0.05)], [wide + 0.06, tall, 0.11], round_by=0.3) for z in (-1, 1)]
    back = limb([[-wide / 2, -tall / 2 + 0.06, 0], [-wide / 2, tall / 2 - 0.06, 0]], [[0.11, deep / 2], [0.11, deep / 2]], segments=20)
    ribs = [limb([[-wide / 2, y, 0], [-wide / 2, y + 0.02, 0]], [[0.13, deep / 2 + 0.03]] * 2, segments=20) for y in (-0.28 * tall, 0.28 * tall)]
    half = [box([0.05, y, deep / 2], [0.5 * wide, 0.1, 0.08], round_by=0.4) for y in (-0.3 * tall, -0.22 * tall)]
    return join([*parts, back, *ribs, *half, box([0.05, 0.15 * tall, deep / 2], [0.4 * wide, 0.4 * wide, 0.12], round_by=0.48)])


def _panel(x: float, y: float, front: float, width: float, height: float, thick: float = 0.13) -> Part:
    """Return a raised panel with soft edges on a front."""
    return box([x, y, front], [width, height, thick], round_by=0.45)


def _grip(x: float, y: float, front: float, long: float, axis: int) -> Part:
    """Return a bar to pull at, `long` along x (0) or y (1)."""
    half = np.eye(3)[axis] * long / 2
    return limb([np.array([x, y, front]) - half, np.array([x, y, front]) + half], [0.06, 0.06], segments=10)


def _spout(y: float, z: float, reach: float, rise: float) -> list[Part]:
    """Return a tap that stands at height `y` and reaches forward, with a knob at each side."""
    bow = [[0, y, z], [0, y + rise, z], [0, y + rise + 0.06, z + 0.5 * reach], [0, y + 0.7 * rise, z + reach]]
    return [limb(bow, [0.075, 0.07, 0.07, 0.07], segments=10), *pair(ellipsoid([0.24, y + 0.06, z], [0.09, 0.1, 0.09], rings=8))]


def wardrobe(rng: Rng, _: Traits) -> Part:
    """Draw a wardrobe: a tall broad case with a heavy cornice, two long doors over a row of drawers, on bun feet."""
    wide, tall, deep = rng.uniform(0.95, 1.25), rng.uniform(1.6, 1.9), rng.uniform(0.5, 0.62)
    front, low, bow = deep / 2, rng.uniform(0.36, 0.46), rng.random() < 0.5
    parts = [box([0, tall / 2 + 0.08, 0], [wide, tall, deep], round_by=0.04)]
    parts += [box([0, 0.14, 0.02], [wide + 0.12, 0.14, deep + 0.1], round_by=0.3), box([0, tall + 0.1, 0.02], [wide + 0.2, 0.17, deep + 0.16], round_by=0.3)]
    if bow:
        parts += [moved(_arched(0.8 * wide, 0.3, 0.24, deep), [0, tall + 0.1, 0])]
    door = tall - low - 0.12
    parts += pair(_panel(0.25 * wide, low + 0.1 + door / 2, front, 0.44 * wide, door))
    parts += pair(_panel(0.25 * wide, 0.12 + (low + 0.1) / 2, front, 0.44 * wide, low - 0.16))
    parts += pair(_grip(0.07 * wide, low + 0.1 + door / 2, front + 0.1, 0.24, 1)) + pair(ellipsoid([0.25 * wide, low / 2 + 0.17, front + 0.08], 0.07, rings=8))
    return join([*parts, *(part for z in (-1, 1) for part in pair(ellipsoid([0.42 * wide, 0.05, z * 0.4 * deep], [0.1, 0.08, 0.1], rings=8)))])


def bookcase(rng: Rng, _: Traits) -> Part:
    """Draw a bookcase, open in front, with rows of books of all heights on its boards."""
    wide, deep, rows = rng.uniform(0.9, 1.25), rng.uniform(0.4, 0.5), int(rng.integers(3, 5))
    row = rng.uniform(0.4, 0.48)
    tall = rows * row + 0.1
    parts = [box([0, tall / 2, -deep / 2 + 0.06], [wide, tall, 0.12], round_by=0.1), *pair(box([wide / 2, tall / 2, 0], [0.13, tall, deep]))]
    for k in range(rows + 1):
        parts.append(box([0, 0.05 + k * row, 0], [wide + 0.1 * (k in (0, rows)), 0.11, deep], round_by=0.2))
        x = -wide / 2 + 0.08
        while k < rows:
            thick, high = rng.uniform(0.09, 0.15), row * rng.uniform(0.5, 0.8)
            if x + thick > wide / 2 - rng.choice([0.08, 0.2, 0.4]):
                break
            parts.append(box([x + thick / 2, 0.1 + k * row + high / 2, 0.02], [0.95 * thick, high, deep - rng.uniform(0.06, 0.16)], round_by=0.2, cells=4))
            x += thick
    return join(parts)


def fridge(rng: Rng, _: Traits) -> Part:
    """Draw a fridge with a small door over a large one or the other way round, or two side by side; some are round."""
    wide, tall, deep = rng.uniform(0.8, 0.95), rng.uniform(1.5, 1.8), rng.uniform(0.7, 0.8)
    kind, soft, front = rng.integers(3), rng.choice([0.05, 0.24]), deep / 2
    parts = [box([0, tall / 2 + 0.04, -0.04], [wide, tall, deep - 0.08], round_by=soft), box([0, 0.05, -0.04], [0.9 * wide, 0.12, 0.8 * deep])]
    if kind == 2:
        parts += pair(_panel(0.25 * wide, tall / 2 + 0.06, front - 0.03, 0.49 * wide, tall - 0.14, 0.18))
        return join([*parts, *pair(_grip(0.07, 0.55 * tall, front + 0.1, 0.7, 1)), _panel(-0.26 * wide, 0.62 * tall, front + 0.06, 0.2, 0.32)])
    split = tall * (0.66 if kind else 0.36)
    for low, high in ((0.1, split), (split + 0.03, tall)):
        parts += [_panel(0, (low + high) / 2, front - 0.02, wide - 0.01, high - low, 0.2), _grip(-0.36 * wide, split + (0.24 if low > 0.1 else -0.24), front + 0.12, 0.3, 1)]
    return join(parts)


def stove(rng: Rng, _: Traits) -> Part:
    """Draw a kitchen stove: four burners on top, a row of knobs over an oven door with a window and a bar."""
    wide, tall, deep = rng.uniform(0.9, 1.05), rng.uniform(0.9, 1.05), rng.uniform(0.8, 0.92)
    front = deep / 2
    parts = [box([0, tall / 2, 0], [wide, tall, deep], round_by=0.04), box([0, tall, 0], [wide + 0.08, 0.11, deep + 0.08], round_by=0.3)]
    for x in (-0.25, 0.25):
        parts += [moved(lathe([(0.19, 0.0), (0.19, 0.09), (0.13, 0.1), (0.12, 0.05), (0.05, 0.05), (0.05, 0.09)]), [x * wide, tall + 0.04, z * deep]) for z in (-0.25, 0.25)]
    parts += [moved(turned(disc(0.075, 0.0, 0.13, edge=0.02), 90, "x"), [x * wide, 0.88 * tall, front]) for x in np.linspace(-0.38, 0.38, int(rng.integers(4, 6)))]
    parts += [_panel(0, 0.48 * tall, front, 0.86 * wide, 0.56 * tall), _panel(0, 0.42 * tall, front + 0.05, 0.56 * wide, 0.26 * tall, 0.14)]
    parts += [_grip(0, 0.68 * tall, front + 0.14, 0.7 * wide, 0), _panel(0, 0.1 * tall, front, 0.86 * wide, 0.13 * tall)]
    if rng.random() < 0.6:
        parts += [box([0, tall + 0.17, -front + 0.06], [wide, 0.34, 0.13], round_by=0.25)]
    return join(parts)


def toilet(rng: Rng, _: Traits) -> Part:
    """Draw a toilet: a foot, an oval bowl with its seat, the lid up or down, a tank with a button behind."""
    wide, long, high = rng.uniform(0.4, 0.46), rng.uniform(0.52, 0.62), rng.uniform(0.62, 0.74)
    rows = [(0.62, 0.0), (0.6, 0.08), (0.45, 0.25), (0.55, 0.5), (0.95, 0.82), (1.0, 0.9), (1.08, 0.92), (1.08, 1.0)]
    bowl = _open(np.array(rows) * [1, high], 0.34, 0.45 * high, segments=36)
    parts = [Part(bowl.verts * [wide, 1, long], bowl.faces), box([0, 0.62 * high, -long], [0.7 * wide, 0.6 * high, 0.5])]
    back, tank = -long - 0.14, rng.uniform(0.5, 0.66)
    parts += [box([0, high + tank / 2, back], [2 * wide, tank, 0.36], round_by=0.15), box([0, high + tank, back], [2 * wide + 0.1, 0.13, 0.44], round_by=0.3)]
    parts += [disc(0.07, high + tank, high + tank + 0.11, edge=0.02)]
    parts[-1] = moved(parts[-1], [0, 0, back])
    lid = disc(1.0, -0.045, 0.045)
    if rng.random() < 0.6:
        oval = turned(Part(lid.verts * [wide * 1.02, 1, long * 0.95], lid.faces), 80, "x")
        return join([*parts, moved(oval, [0, high + 0.92 * long, back + 0.33])])
    return join([*parts, moved(Part(lid.verts * [wide * 1.1, 1.2, long * 1.1], lid.faces), [0, high + 0.06, 0])])


def sink(rng: Rng, _: Traits) -> Part:
    """Draw a wash basin on a pedestal, or a kitchen sink let into a cupboard, with a tap behind."""
    wide, deep, high = rng.uniform(0.6, 0.7), rng.uniform(0.44, 0.52), rng.uniform(0.85, 1.1)
    if rng.random() < 0.6:
        bowl = _open([(0.3, high - 0.36), (0.7, high - 0.26), (0.97, high - 0.08), (1.02, high)], 0.2, high - 0.2, segments=36)
        x, y, z = bowl.verts.T
        parts = [Part(np.stack([x * wide, y, np.maximum(z, -0.85) * deep], 1), bowl.faces)]
        parts += [lathe([(0.3, 0.0), (0.27, 0.08), (0.17, 0.2), (0.17, high - 0.45), (0.28, high - 0.25)])]
        parts += [box([0, high, -deep], [1.7 * wide, 0.16, 0.24], round_by=0.3)]
        return join([*parts, *_spout(high + 0.05, -deep, 0.4, rng.uniform(0.22, 0.32))])
    parts = [box([0, high / 2 - 0.06, 0], [2 * wide, high - 0.12, 2 * deep], round_by=0.03)]
    parts += pair(box([wide - 0.13, high, 0], [0.3, 0.28, 2 * deep + 0.08], round_by=0.2))
    parts += [box([0, high, z], [2 * wide, 0.28, size], round_by=0.2) for z, size in ((deep - 0.04, 0.16), (-deep + 0.1, 0.3))]
    parts += pair(_panel(0.5 * wide, 0.44 * high, deep, 0.86 * wide, 0.68 * high)) + pair(ellipsoid([0.16, 0.6 * high, deep + 0.08], 0.07, rings=8))
    return join([*parts, *_spout(high + 0.1, 0.1 - deep, 0.5, rng.uniform(0.3, 0.45))])


def trashcan(rng: Rng, _: Traits) -> Part:
    """Draw a ribbed dustbin with a domed lid, a smooth one with a flap lid, or a bin on two wheels, its lid slanted."""
    wide, tall, kind = rng.uniform(0.44, 0.52), rng.uniform(1.0, 1.25), rng.integers(3)
    if kind == 2:
        tub = box([0, 0, 0], [2 * wide, tall, 2 * wide], round_by=0.06)
        taper = 0.86 + 0.24 * tub.verts[:, 1:2] / tall
        parts = [moved(Part(tub.verts * np.concatenate([taper, np.ones_like(taper), taper], 1), tub.faces), [0, tall / 2 + 0.08, 0])]
        parts += [moved(turned(box([0, 0, 0], [2.2 * wide, 0.16, 2.25 * wide], round_by=0.4), 6, "x"), [0, tall + 0.12, 0]), _grip(0, tall + 0.1, -1.22 * wide, 1.5 * wide, 0)]
        return join([*parts, *pair(moved(turned(disc(0.17, -0.08, 0.08), 90, "z"), [0.72 * wide, 0.17, -0.8 * wide]))])
    side = [(wide * (0.86 + 0.14 * t), 0.04 + (tall - 0.04) * t) for t in np.linspace(0, 1, 6)]
    body = lathe([(0.86 * wide, 0.0), *side], segments=64)
    x, y, z = body.verts.T
    rib = 1 - 0.08 * (np.cos(16 * np.arctan2(x, z)) < 0) * ((y > 0.1 * tall) & (y < 0.9 * tall)) * (kind == 0)
    lid = [(wide + 0.08, tall), (wide + 0.08, tall + 0.08), (wide, tall + 0.12)]
    dome = [(wide * np.cos(t), tall + 0.12 + (0.2 if kind == 0 else 0.42) * np.sin(t)) for t in np.linspace(0.2, 1.5, 6)]
    parts = [Part(np.stack([x * rib, y, z * rib], 1), body.faces), lathe([*lid, *dome])]
    if kind == 1:
        return join([*parts, moved(turned(box([0, 0, 0], [0.9 * wide, 0.32, 0.2], round_by=0.3), -35, "x"), [0, tall + 0.3, 0.72 * wide])])
    bow = [[-0.16, tall + 0.25, 0], [-0.12, tall + 0.44, 0], [0.12, tall + 0.44, 0], [0.16, tall + 0.25, 0]]
    grips = pair(limb([[wide, 0.76 * tall, -0.15], [wide + 0.13, 0.7 * tall, 0], [wide, 0.76 * tall, 0.15]], [0.07] * 3))
    return join([*parts, limb(bow, [0.065] * 4, segments=10), *grips])


def cone(rng: Rng, _: Traits) -> Part:
    """Draw a traffic cone: a square foot and a slim blunt cone with a raised band."""
    foot, tall, wide = rng.uniform(0.46, 0.56), rng.uniform(1.05, 1.4), rng.uniform(0.28, 0.34)
    share = np.array([0.0, 0.05, 0.3, 0.36, 0.37, 0.66, 0.67, 0.75, 0.97, 1.0])
    wall = np.stack([wide * (1 - share) + 0.08 + 0.035 * ((share > 0.365) & (share < 0.665)), 0.12 + tall * share], 1)
    return join([box([0, 0.07, 0], [2 * foot, 0.15, 2 * foot], round_by=0.25), lathe([(wide + 0.16, 0.1), *wall])])


def pillow(rng: Rng, _: Traits) -> Part:
    """Draw a pillow that leans back: a swollen cushion with drawn-out corners, square or broad, with or without a button."""
    wide, tall, puff = rng.uniform(0.75, 1.0), rng.uniform(0.6, 0.75), rng.uniform(0.28, 0.4)
    part = box([0, 0, 0], [2, 2, 0.2], round_by=0.5, cells=20)
    x, y, z = part.verts.T
    full = 1 + puff / 0.1 * np.clip((1 - x**2) * (1 - y**2), 0, 1) ** 0.5
    # The sides are drawn in between the corners.
    parts = [Part(np.stack([wide * x * (0.86 + 0.14 * y**2), tall * y * (0.86 + 0.14 * x**2), z * full], 1), part.faces)]
    if rng.random() < 0.5:
        parts += [ellipsoid([0, 0, z * (puff + 0.1)], [0.13, 0.13, 0.06], rings=8) for z in (-1, 1)]
    return turned(join(parts), -rng.uniform(8, 30), "x")
