"""Build what buildings are put together from: walls with doors and windows under a roof, rings of columns, towers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.boards import Solids, block, spread
from meshdeform.nouns.families.buildings import arch, gable
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.parts import Part, extrude, lathe, moved, stretched, turned

ROOT2 = float(np.sqrt(2.0))


def roof_of(kind: str, width: float, depth: float, rise: float, level: float, eaves: float = 0.12) -> list[Part]:
    """Return a roof over a `width` by `depth` house whose walls end at a level.

    `kind`: "front" (its gable looks to +Z), "side" (its ridge runs along X), "hip", "flat" (a slab with a low wall),
    "shed" (one slope that falls to the back) or "gambrel" (a gable toward +Z with two slopes on each side).
    """
    if kind == "front":
        return [gable(width / 2 + eaves, rise, depth + 2 * eaves, [0, level + 0.05, 0])]
    if kind == "side":
        return [
            moved(turned(gable(depth / 2 + eaves, rise, width + 2 * eaves, [0, 0, 0]), 90, "y"), [0, level + 0.05, 0])
        ]
    if kind == "hip":
        profile = [(1.0, -0.06), (1.0, 0.02), (0.62, 0.5 * rise), (0.26, rise)]
        four = turned(lathe(profile, segments=4), 45, "y")
        return [moved(stretched(four, (width + 2 * eaves) / ROOT2, 1, (depth + 2 * eaves) / ROOT2), [0, level, 0])]
    if kind == "flat":
        slab = block([0, level - 0.02, 0], [width + 2 * eaves, 0.1 + 0.45 * rise, depth + 2 * eaves], 0.1)
        return [slab]
    half = (depth if kind == "shed" else width) / 2 + eaves
    if kind == "shed":
        outline = [(-half, -0.04), (half, -0.04), (half, 0.08), (-half, rise)]
        return [moved(turned(extrude(outline, width + 2 * eaves, bevel=0.03), -90, "y"), [0, level + 0.02, 0])]
    outline = [(-half, -0.06), (half, -0.06), (half, 0.02), (0.68 * half, 0.62 * rise), (0, rise)]
    outline += [(-0.68 * half, 0.62 * rise), (-half, 0.02)]
    return [moved(extrude(outline, depth + 2 * eaves, bevel=0.03), [0, level, 0])]


def panes(
    width: float, depth: float, low: float, high: float, columns: int, rows: int, *, door: float = 0.0,
    sides: tuple[int, ...] = (0, 90, 180, 270), share: tuple[float, float] = (0.5, 0.55),
) -> list[Part]:  # fmt: skip
    """Return rows of raised windows on the walls of a house; the lowest in front leave a door's width free; `sides` in degrees."""
    tall, windows = (high - low) / rows, []
    for turn in sides:
        across, out = (width, depth / 2) if turn in (0, 180) else (depth, width / 2)
        count = columns if turn in (0, 180) else max(1, round(columns * depth / width))
        wide = across / count
        size = [share[0] * wide, share[1] * tall, 0.08]
        pane = turned(block([0, (1 - share[1]) / 2 * tall, out], size, 0.2), turn, "y")
        right = [np.cos(np.radians(turn)), 0, -np.sin(np.radians(turn))]
        windows += [
            moved(pane, x * np.array(right) + [0, low + row * tall, 0])
            for row in range(rows)
            for x in spread((across - wide) / 2, count)
            if turn or row or abs(x) >= (door + share[0] * wide) / 2
        ]
    return windows


def house_of(
    size: tuple[float, float, float], roof: str, rise: float, *, door: tuple[float, float] = (0.3, 0.5),
    columns: int = 3, rows: int = 1, eaves: float = 0.12, arched: bool = False,
) -> Solids:  # fmt: skip
    """Return a house of (width, height, depth) whose door looks to +Z, with rows of windows all round."""
    width, wall, depth = size
    leaf = arch(*door, 0.12, [0, 0, depth / 2]) if arched else block([0, 0, depth / 2], [*door, 0.12], 0.15)
    return {
        "body": [block([0, 0, 0], size, 0.03, 4)],
        "roof": roof_of(roof, width, depth, rise, wall, eaves),
        "door": [leaf],
        "window": panes(width, depth, 0.1 * wall, 0.97 * wall, columns, rows, door=door[0]),
    }


def shaft(radius: float, top: float, bottom: float, sides: int, *, foot: float = 1.12) -> Part:
    """Return a slightly tapering upright body of 4 to 28 sides on the ground; four sides look to the axes."""
    rows = [
        (foot * radius, bottom),
        *((radius * (foot - (foot - 1) * t), bottom + (top - bottom) * t) for t in (0.33, 0.66, 1)),
    ]
    part = lathe(np.array(rows) * [ROOT2 if sides == 4 else 1, 1], segments=sides)
    return turned(part, 45, "y") if sides == 4 else part


def hat(radius: float, rise: float, level: float, sides: int, *, bow: float = 0.0) -> Part:
    """Return a pointed roof with eaves on as many sides as its tower; `bow` hollows its slopes, below 0 rounds them."""
    share = np.linspace(0, 1, 7)
    rows = np.stack([radius * (1 - share) ** (1 + bow) + 0.015, level + rise * share], 1)
    whole = np.concatenate([[[0.9 * radius, level - 0.05]], rows]) * [ROOT2 if sides == 4 else 1, 1]
    return turned(lathe(whole, segments=sides), 45, "y") if sides == 4 else lathe(whole, segments=sides)


def merlons(radius: float, level: float, count: int, sides: int, size: float = 0.16) -> list[Part]:
    """Return battlements on the top of a round or a square tower."""
    if sides != 4:
        return around(block([0, level, radius], [size, 1.3 * size, 0.8 * size]), count)
    row = [block([x, level, radius], [size, 1.3 * size, 0.8 * size]) for x in spread(radius, 3)[:2]]
    return [part for each in row for part in around(each, 4)]


def column_of(base: ArrayLike, height: float, thick: float) -> Part:
    """Return a column with a foot and a capital that stands on the middle `base` of its foot."""
    wall = [(1.35 * thick, 0.0), (1.35 * thick, 0.08), (1.05 * thick, 0.1), (0.9 * thick, height - 0.12)]
    return moved(lathe([*wall, (1.3 * thick, height - 0.05), (1.3 * thick, height)], segments=12), base)


def onion(radius: float, level: float, swell: float = 1.1) -> Part:
    """Return a dome that swells above its foot and ends in a point."""
    rows = [(0.86, 0.0), (0.97, 0.15), (1.0, 0.35), (0.94, 0.58), (0.76, 0.82), (0.48, 1.02), (0.22, 1.18), (0.06, 1.4)]
    return lathe([(radius * x, level + swell * radius * y) for x, y in rows], segments=18)
