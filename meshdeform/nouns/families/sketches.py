"""Draw the families that are sketched in tables, `sketched/*.txt`: simple things, each a few solids of few sizes.

A sketch is a line with the name of a noun, or `noun/kind` for another kind of it, and its sizes; then lines of solids::

    toaster: w 1 1.3, h .62 .85, a=handle .1 .2
      body box 0 .5h 0, w h .6, .3; foot drum .36w 0 .2, .07 .06 | quad

A size is a letter with its range; `a=handle` is the one that a prompt sets by the handle. A number is a sum of products
of numbers and sizes: `.5h+.1`, `-2wh`. A solid is the name of its part (of several, as in `families.parts.divided`),
its shape, and groups of numbers; behind bars, what is done to it in turn. A line that ends with a comma goes on:

==================================  ==========================================================================
box X Y Z, W H D, R                 a box about a point; R: its rounding, .2 if left out; `brick` has fewer faces
drum X Y Z, R H                     a cylinder H to both sides of a point, along Y; `drumx`, `drumz`
ball X Y Z, R [RY RZ]               an ellipsoid
hoop X Y Z, R T [TALL]              a ring of thickness T in the plane of X and Y, TALL times as high as wide
rod X Y Z R [D], X Y Z R [D], ...   straight rods through points; R: half its width along X, D: half its other one
tube X Y Z R, X Y Z R, ...          the same, bent smoothly
lathe R Y, R Y, ...                 a surface of revolution; `turn`: of a smooth profile; `lathe6`: of six sides
cup WALL FLOOR, R Y, R Y, ...       a vessel that is hollow down to FLOOR; `vase`: of a smooth profile; `cup4` ...
plate T [PUFF], X Y, X Y, ...       a plate of thickness T that faces +Z; `blob`: of a smooth outline
keys X Y Z, ROWS COLUMNS, W D H     rows of keys about a point
slab X Y Z, W H D, R                a box on a point, R .1 if left out, of few faces; `block`: of more
bar X Y Z, X Y Z, R                 a straight round bar between two points, of few faces
arch X Y Z, W H T                   a plate on a point that faces +Z, T thick, its top half a circle
gable X Y Z, W H D                  a roof on a level, its gable toward +Z; `ridge`, `hip`, `gambrel`, `slope`
pair, flip, quad                    with its mirror image in x, in z, in both
around N [DEGREES]                  N of them evenly around Y
row N X Y Z                         N of them, each moved on by as much
x, y, z DEGREES                     turned about an axis
at X Y Z; by X Y Z                  moved; stretched
==================================  ==========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from importlib.resources import files
from itertools import pairwise

import numpy as np

from meshdeform.nouns.families.boards import bar, block
from meshdeform.nouns.families.buildings import arch
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.kitchen import vessel
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    box,
    curved,
    divided,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    moved,
    named,
    pair,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import roof_of

__all__ = ["SKETCHED_KINDS", "SKETCHES", "read"]

Groups = list[list[float]]

_TERM = re.compile(r"([+-]?)(\d*\.?\d*)([a-z]*)")


def _number(text: str, sizes: dict[str, float]) -> float:
    """Return a sum of products of numbers and sizes."""
    terms = [
        (-1 if sign == "-" else 1) * float(factor or 1) * float(np.prod([sizes[letter] for letter in letters]))
        for sign, factor, letters in _TERM.findall(text)
        if factor or letters
    ]
    return sum(terms)


def _drum(axis: str, groups: Groups) -> Part:
    centre, (radius, half) = groups
    cut = 0.25 * min(radius, half)
    side = lathe([(radius - cut, -half), (radius, cut - half), (radius, half - cut), (radius - cut, half)], segments=20)
    return moved(turned(side, 0 if axis == "y" else 90, "z" if axis == "x" else "x"), centre)


def _hoop(groups: Groups) -> Part:
    centre, (radius, thick, *tall) = groups
    turn = np.linspace(0, 2 * np.pi, 21)
    ring = np.c_[radius * np.sin(turn), (tall or [1.0])[0] * radius * np.cos(turn), 0 * turn]
    return moved(limb(ring, np.full(21, thick), segments=8, samples=1), centre)


def _rod(smooth: bool, groups: Groups) -> Part:
    knots = np.array([[*group, group[3]] if len(group) == 4 else group for group in groups])
    if smooth:
        knots = curved(knots, samples=3)
    way = knots[1, :3] - knots[0, :3]
    if abs(way[2]) > 0.9 * np.linalg.norm(way):  # there `limb` takes the radius along Y first
        knots = knots[:, [0, 1, 2, 4, 3]]
    return limb(knots[:, :3], np.maximum(knots[:, 3:], 0.01), segments=10, samples=1 if smooth else 2)


def _profile(smooth: bool, groups: Groups) -> Array:
    """Return (radius, height) along a profile; a smooth one keeps its ends."""
    points: Array = curved(groups, samples=3) if smooth else np.asarray(groups, float)
    return np.maximum(points, [0.004 if smooth else 0.0, -np.inf])


def _plate(smooth: bool, groups: Groups) -> Part:
    rim: Array = np.asarray(groups[1:], float)
    if smooth:
        rim = curved(np.concatenate([rim[-2:], rim, rim[:3]]), samples=4)[8:-12]
    after = np.roll(rim, -1, axis=0)
    clockwise = float((rim[:, 0] * after[:, 1] - rim[:, 1] * after[:, 0]).sum()) < 0
    return extrude(rim[::-1] if clockwise else rim, groups[0][0], bevel=0.15, puff=(*groups[0], 0.0)[1])


def _keys(groups: Groups) -> Part:
    centre, (rows, columns), (wide, deep, high) = groups
    x, z = (np.arange(count) / count + 0.5 / count - 0.5 for count in (columns, rows))
    size = [0.75 * wide / columns, high, 0.75 * deep / rows]
    key = box(centre, size, round_by=0.0, cells=1)
    return join([moved(key, [wide * a, 0, deep * b]) for b in z for a in x])


def _roof(kind: str, groups: Groups) -> Part:
    base, (width, rise, depth) = groups
    return moved(roof_of(kind, width, depth, rise), base)


def _slab(cells: int, groups: Groups) -> Part:
    return block(groups[0], groups[1], groups[2][0] if len(groups) > 2 else 0.1, cells)


def _box(cells: int, groups: Groups) -> Part:
    return box(groups[0], groups[1], round_by=groups[2][0] if len(groups) > 2 else 0.2, cells=cells)


_SHAPES: dict[str, Callable[[Groups], Part]] = {
    "arch": lambda groups: arch(groups[1][0], groups[1][1], groups[1][2], groups[0]),
    "ball": lambda groups: ellipsoid(*groups, rings=8),
    "bar": lambda groups: bar(groups[0], groups[1], groups[2][0]),
    "blob": partial(_plate, True),
    "block": partial(_slab, 4),
    "box": partial(_box, 4),
    "brick": partial(_box, 2),
    "drum": partial(_drum, "y"),
    "drumx": partial(_drum, "x"),
    "drumz": partial(_drum, "z"),
    "hoop": _hoop,
    "keys": _keys,
    "plate": partial(_plate, False),
    **{kind: partial(_roof, kind) for kind in ("gable", "gambrel", "hip", "ridge", "slope")},
    "rod": partial(_rod, False),
    "slab": partial(_slab, 2),
    "tube": partial(_rod, True),
}


def _shape(name: str, groups: Groups) -> Part:
    form, sides = name.rstrip("0123456789"), name.lstrip("abcdefghijklmnopqrstuvwxyz")
    if form in ("lathe", "turn"):
        return _of_sides(lathe(_profile(form == "turn", groups), segments=24), sides)
    if form in ("cup", "vase"):
        wall, floor = groups[0]
        return _of_sides(vessel(_profile(form == "vase", groups[1:]), wall, floor, segments=24), sides)
    return _SHAPES[name](groups)


def _of_sides(part: Part, sides: str) -> Part:
    """Press a surface of revolution flat on as many sides as are given; a corner is at +Z."""
    if not sides:
        return part
    x, y, z = part.verts.T
    half = np.pi / int(sides)
    flat = np.cos(half) / np.cos(np.arctan2(x, z) % (2 * half) - half)
    return part._replace(verts=np.stack([x * flat, y, z * flat], 1))


def _flipped(part: Part) -> Part:
    return part._replace(verts=part.verts * [1, 1, -1], faces=part.faces[:, ::-1].copy())


def _changed(parts: list[Part], name: str, numbers: Sequence[float]) -> list[Part]:
    """Return parts after one of the words behind bars."""
    if name in ("flip", "quad"):
        parts = [each for part in parts for each in (part, _flipped(part))]
    if name in ("pair", "quad"):
        return [each for part in parts for each in pair(part)]
    if name == "around":
        return [each for part in parts for each in around(part, int(numbers[0]), *numbers[1:])]
    if name == "row":
        step = np.asarray(numbers[1:])
        return [moved(part, number * step) for part in parts for number in range(int(numbers[0]))]
    if name in ("x", "y", "z"):
        return [turned(part, numbers[0], name) for part in parts]
    if name == "at":
        return [moved(part, numbers) for part in parts]
    return [stretched(part, *numbers) for part in parts] if name == "by" else parts


def _solid(text: str, sizes: dict[str, float]) -> dict[str, list[Part]]:
    """Return the solids of one entry by the name of their part."""
    first, *changes = (piece.split() for piece in text.split("|"))
    part, shape = first[:2]
    groups: Groups = [[]]
    for word in first[2:]:
        groups[-1].append(_number(word.rstrip(","), sizes))
        if word.endswith(","):
            groups.append([])
    solid = _shape(shape, groups)
    parts = [divided(solid, part)] if "/" in part else [solid]
    for name, *words in changes:
        parts = _changed(parts, name, [_number(word, sizes) for word in words])
    return {part: parts}


def _family(head: str, body: Sequence[str]) -> Callable[[Rng, Traits], Part]:
    """Return the family of a sketch."""
    ranges = [piece.split() for piece in head.split(",") if piece.strip()]
    entries = "\n".join(body).replace(",\n", ", ").replace("\n", ";").split(";")

    def draw(rng: Rng, traits: Traits) -> Part:
        """Draw a member: each size from its range, by the prompt or at random, then the solids."""
        sizes: dict[str, float] = {}
        for letter, low, high in ranges:
            least, most, (name, _, part) = float(low), float(high), letter.partition("=")
            lesser, greater = (0.3 * least, 0.42 * least), (1.7 * most, 2.0 * most)
            sizes[name] = traits.draw(rng, part, lesser, (least, most), greater) if part else rng.uniform(least, most)
        return join([named(**_solid(entry, sizes)) for entry in entries])

    return draw


def read(text: str) -> dict[str, Callable[[Rng, Traits], Part]]:
    """Return the families of a table by `noun` or `noun/kind`.

    Raises
    ------
    KeyError, ValueError
        As they are drawn: a shape or a part that there is not, or groups of too few numbers.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    starts = [k for k, line in enumerate(lines) if not line.startswith(" ")] + [len(lines)]
    sketches = {}
    for start, end in pairwise(starts):
        name, _, head = lines[start].partition(":")
        sketches[name] = _family(head, lines[start + 1 : end])
    return sketches


_ALL = {
    name: family
    for path in sorted(files(__package__).joinpath("sketched").iterdir(), key=str)
    if path.name.endswith(".txt")
    for name, family in read(path.read_text(encoding="utf-8")).items()
}
SKETCHES = {name: family for name, family in _ALL.items() if "/" not in name}
"""The families that are sketched, by noun."""
SKETCHED_KINDS = {
    (noun, kind): _ALL[f"{noun}/{kind}"] for noun, _, kind in (name.partition("/") for name in _ALL) if kind
}
"""Other kinds of nouns, by noun and kind."""
