"""Build what furniture is put together from: blocks, bars, legs, fronts with doors and drawers, seats."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Array, Part, box, lathe, moved, pair, stretched, turned

Solids = dict[str, list[Part]]
"""Solids by the names of their parts, as `parts.named` takes them."""


def block(base: ArrayLike, size: ArrayLike, soft: float = 0.05, cells: int = 2) -> Part:
    """Return a box of full side lengths `size` that stands on the middle `base` of its foot."""
    sides = np.asarray(size, float)
    return box(np.asarray(base, float) + [0, sides[1] / 2, 0], sides, round_by=soft, cells=cells)


def bar(start: ArrayLike, end: ArrayLike, thick: float, segments: int = 8) -> Part:
    """Return a straight round bar of radius `thick` between two points, beyond which its blunt ends reach."""
    foot, way = np.asarray(start, float), np.subtract(end, start)
    length, blunt = float(np.linalg.norm(way)), 0.7 * thick
    rod = lathe(
        [(blunt, -blunt), (thick, 0), (thick, length / 2), (thick, length), (blunt, length + blunt)], segments=segments
    )
    up = way / length
    side = np.cross([0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0], up)
    side /= np.linalg.norm(side)
    return Part(foot + rod.verts @ np.stack([-side, up, np.cross(up, side)]), rod.faces)


def roundel(centre: ArrayLike, radius: float, thick: float, axis: str = "z", segments: int = 20) -> Part:
    """Return a round plate, its rims cut off, whose thickness lies along an axis."""
    edge = min(0.25 * thick, 0.1 * radius)
    half = thick / 2
    flat = lathe(
        [(radius - edge, -half), (radius, edge - half), (radius, half - edge), (radius - edge, half)], segments=segments
    )
    return moved({"x": turned(flat, 90, "z"), "y": flat, "z": turned(flat, 90, "x")}[axis], centre)


def spread(half: float, count: int) -> Array:
    """Return evenly spaced places from -`half` to `half`."""
    return np.linspace(-half, half, count) if count > 1 else np.zeros(1)


def posts(
    x: float, z: float, bottom: float, top: float, thick: float, *, square: bool = False, splay: float = 0.0
) -> list[Part]:
    """Return four posts under (+-x, +-z) from a bottom to a top, round or square; their feet stand `splay` wider."""
    if square:
        one = [block([x, bottom, side], [2 * thick, top - bottom, 2 * thick]) for side in (z, -z)]
    else:
        feet = [(side, side + np.sign(side) * splay) for side in (z, -z)]
        one = [bar([x + splay, bottom + thick, foot], [x, top, side], thick) for side, foot in feet]
    return [part for each in one for part in pair(each)]


def fronts(
    width: float, low: float, high: float, z: float, rows: Iterable[tuple[float, str, int]], grip: str = "knob"
) -> Solids:
    """Return raised doors and drawers with grips on a front at depth `z`, in rows from above: (share, part, columns)."""
    solids: Solids = {}
    level = high
    for share, part, columns in rows:
        tall, wide = share * (high - low), width / columns
        level -= tall
        for number, x in enumerate(spread((width - wide) / 2, columns)):
            at = [x, level + 0.02, z]
            solids.setdefault(part, []).append(block(at, [wide - 0.04, tall - 0.04, 0.1], 0.2, 3))
            if grip != "none" and part != "panel":
                side = 0.0 if part == "drawer" else (0.5 - 0.12 / wide) * wide * (-1) ** (number % 2)
                middle = np.array([x + side, level + tall / 2, z + 0.09])
                solids.setdefault(grip, []).append(_grip(middle, part, grip, min(wide, tall)))
    return solids


def _grip(middle: Array, part: str, grip: str, room: float) -> Part:
    """Return a knob, or a bar to pull at: level on a drawer, upright on a door."""
    if grip == "knob":
        return bar(middle - [0, 0, 0.03], middle, 0.045, 6)
    half = (np.array([0.22, 0, 0]) if part == "drawer" else np.array([0, 0.22, 0])) * room
    return bar(middle - half, middle + half, 0.03, 6)


def case(
    size: tuple[float, float, float], legs: float, rows: Iterable[tuple[float, str, int]], *, grip: str = "knob",
    top: float = 0.05, square: bool = True,
) -> Solids:  # fmt: skip
    """Return a case of (width, height, depth) on four legs, its top wider by `top`, with `fronts` toward +Z."""
    width, height, depth = size
    solids = fronts(width - 0.04, legs + 0.03, legs + height - 0.03, depth / 2, rows, grip)
    solids["body"] = [block([0, legs, 0], size, 0.04, 3)]
    if top:
        solids["top"] = [block([0, legs + height - 0.01, 0.02], [width + 2 * top, 0.09, depth + 2 * top], 0.2)]
    if legs > 0:
        solids["leg"] = posts(width / 2 - 0.08, depth / 2 - 0.08, 0.0, legs + 0.04, 0.06, square=square)
    return solids


def slats(half: float, low: float, high: float, z: float, count: int, thick: float, lean: float = 0.0) -> list[Part]:
    """Return upright bars side by side from -half to half, whose tops lie `lean` farther back."""
    one = bar([0, low, z], [0, high, z - lean], thick, 6)
    return [moved(one, [x, 0, 0]) for x in spread(half, count)]


def chair_of(
    width: float, depth: float, height: float, rise: float, *, back: str = "solid", arms: bool = False,
    legs: str = "square", thick: float = 0.07, slab: float = 0.12, lean: float = 0.08,
) -> Solids:  # fmt: skip
    """Return a chair facing +Z.

    Parameters
    ----------
    width, depth, height, rise
        Sizes of the seat, its level, and by how much the back rises above it.
    back : str
        "solid", "slats" (upright), "rungs" (level), "round" (an oval pad) or "none".
    legs : str
        "square", "round", "splayed" or "none".
    """
    rear, top = -depth / 2 + thick, height + slab + rise
    solids: Solids = {"seat": [block([0, height, 0], [width, slab, depth], 0.3, 4)]}
    if legs != "none":
        splay = 0.12 * (legs == "splayed")
        inset = thick + 0.4 * splay
        solids["leg"] = posts(
            width / 2 - inset, depth / 2 - inset, 0, height + 0.02, thick, square=legs == "square", splay=splay
        )
    solids["back"] = _back(back, width, height + 0.5 * slab, top, rear, thick, lean)
    if arms:
        level, side = height + slab + 0.36 * min(rise, 0.8), width / 2 - 0.5 * thick
        front = bar([side, height, depth / 2 - 2 * thick], [side, level, depth / 2 - 2 * thick], 0.7 * thick)
        rest = box([side, level, 0], [1.8 * thick, thick, depth - thick], round_by=0.4, cells=3)
        solids["arm"] = [*pair(front), *pair(rest)]
    return {name: own for name, own in solids.items() if own}


def _back(kind: str, width: float, low: float, top: float, rear: float, thick: float, lean: float) -> list[Part]:
    """Return the solids of a chair's back."""
    half = width / 2 - thick
    sides = [*pair(bar([half, low, rear], [half, top, rear - lean], thick))]
    rail = [bar([-half, top, rear - lean], [half, top, rear - lean], 1.15 * thick)]
    if kind == "slats":
        return [*sides, *rail, *slats(0.62 * half, low, top, rear, 4, 0.55 * thick, lean)]
    if kind == "rungs":
        levels = [(share, low + share * (top - low)) for share in (0.35, 0.68, 0.98)]
        return [
            *sides,
            *(box([0, y, rear - lean * s], [2 * half, 2.4 * thick, 0.8 * thick], cells=3) for s, y in levels),
        ]
    if kind == "round":
        tall = (top - low) / 2
        oval = stretched(roundel([0, 0, 0], 1.0, 1.4 * thick), width / 2, 0.9 * tall, 1.0)
        stems = pair(bar([0.4 * half, low, rear], [0.4 * half, low + tall, rear - lean], 0.7 * thick))
        return [*stems, moved(oval, [0, low + 1.1 * tall, rear - lean])]
    if kind == "solid":
        slab = box([0, 0, 0], [width, top - low, 1.7 * thick], round_by=0.3, cells=4)
        tilted = turned(slab, -np.degrees(np.arctan2(lean, top - low)), "x")
        return [moved(tilted, [0, (low + top) / 2, rear - 0.5 * lean])]
    return []
