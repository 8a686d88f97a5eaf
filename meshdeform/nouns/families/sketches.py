"""Draw the families that are sketched in tables, `sketched/*.txt`: things that are a few solids of few sizes.

A sketch is the name of a noun, or `noun/kind` for another kind of it, and its sizes; then solids behind semicolons. It
goes on in lines that begin with a space::

    toaster: w 1 1.3, h .62 .85, a=handle .1 .2; body box 0 .5h 0, w h .6, .3; foot drum .36w 0 .2, .07 .06 | quad
    toaster/wide-toaster < toaster: w 1.5 1.8, n chance .3; knob ball .5w .3h .1, .05 | if n

A size is a letter with its range; `a=handle` is the one that a prompt sets by the handle, where four more numbers are
the ranges of a short and of a long one: lesser, usual, greater. `n whole 2 4` is 2, 3 or 4,
`n chance .3` is 1 in 30 of 100 members and else 0, and `x 2w+.1` is that. A number is a sum of products of numbers and
sizes before it: `.5h+.1`, `-2wh`. A solid is the name of its part (of several, as in `families.parts.divided`), its
shape, and groups of numbers; behind bars, what is done to it in turn. A sketch `< another` has its sizes, some of them
its own, and its solids first; a name with a star is only such a base.

==================================  ==========================================================================
box X Y Z, W H D, R                 a box about a point; R: its rounding, .2 if left out; `brick` has fewer faces,
                                    `board` few and a rounding of .12, `cube` more and one of .25
drum X Y Z, R H                     a cylinder H to both sides of a point, along Y; `drumx`, `drumz`
ball X Y Z, R [RY RZ]               an ellipsoid; `orb`, `orb8`: of 14 rings, of 8
hoop X Y Z, R T [TALL]              a ring of thickness T in the plane of X and Y, TALL times as high as wide
rod X Y Z R [D], X Y Z, ...         straight rods through points; R: half its width along X, D: half its other one,
                                    as at the point before if left out
tube X Y Z R, X Y Z R, ...          the same, bent smoothly; `limb`, `limb10`: straight, of 16 sides, of 10
lathe R Y, R Y, ...                 a surface of revolution; `turn`: of a smooth profile; `lathe6`: of six sides;
                                    `spin`, `spin40`: of 28 corners around, of 40
cup WALL FLOOR, R Y, R Y, ...       a vessel that is hollow down to FLOOR; `vase`: of a smooth profile; `cup4` ...
plate T [PUFF], X Y, X Y, ...       a plate of thickness T that faces +Z; `blob`: of a smooth outline
side W [BEVEL], Z Y, Z Y, ...       a solid W wide with a side view; its bevel is .06 of W if left out
  X Y R FROM TO                     in an outline: an arc about a point, between two angles in degrees
keys X Y Z, ROWS COLUMNS, W D H     rows of keys about a point
slab X Y Z, W H D, R                a box on a point, R .1 if left out, of few faces; `block`: of more
bar X Y Z, X Y Z, R                 a straight round bar between two points, of few faces
arch X Y Z, W H T                   a plate on a point that faces +Z, T thick, its top half a circle
gable X Y Z, W H D                  a roof on a level, its gable toward +Z; `ridge`, `hip`, `gambrel`, `slope`
wheel X Y Z, R H                    a wheel along X, `tyre` another; `spoked X Y Z, R H N` has N spokes right across
cab W SHARE N, Z Y, Z Y, ...        a cabin with a `window` all around and N posts, narrower above by a share
wing SPAN CHORD SWEEP TAPER T RISE  a left wing whose root begins at the origin; its tip is SWEEP behind, TAPER of its
                                    chord, and RISE degrees up
hull L B D, BOW STERN SHEER KEEL    a ship's hull, L and B half its length and beam, its deck at D; its ends rise by
                                    SHEER; it narrows by shares to BOW, STERN and KEEL
shell L B D, RISE STERN             an open boat; its ends rise, and it is pointed behind unless STERN is 1
pair, flip, quad                    with its mirror image in x, in z, in both
around N [DEGREES]                  N of them evenly around Y; `aroundx`, `aroundz`
row N X Y Z                         N of them, each moved on by as much; `row N, X Y Z, X Y Z`: from place to place
x, y, z DEGREES                     turned about an axis
at X Y Z; by X Y Z                  moved, to each of several places if more follow; stretched
taper SHARE; taperz SHARE           narrower along X, above or ahead
if A; unless A                      only in members whose size A is, or is not, above 0
==================================  ==========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from importlib.resources import files

import numpy as np

from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.parts import Part, divided, join, moved, named, pair, stretched, turned
from meshdeform.nouns.families.sketch_solids import Groups, solid, tapered
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["SKETCHES", "read"]

_TERM = re.compile(r"([+-]?)(\d*\.?\d*)([a-z]*)")


def _number(text: str, sizes: dict[str, float]) -> float:
    """Return a sum of products of numbers and sizes."""
    terms = [term for term in _TERM.findall(text) if any(term[1:])]
    if not terms or "".join(map("".join, terms)) != text:
        raise ValueError("not a number")
    return sum(
        (-1 if sign == "-" else 1) * float(factor or 1) * float(np.prod([sizes[letter] for letter in letters]))
        for sign, factor, letters in terms
    )


def _groups(words: Sequence[str], sizes: dict[str, float]) -> Groups:
    """Return the numbers of words; a comma ends a group."""
    groups: Groups = [[]]
    for word in words:
        groups[-1].append(_number(word.rstrip(","), sizes))
        if word.endswith(","):
            groups.append([])
    return groups


def _size(words: Sequence[str], part: str, sizes: dict[str, float], rng: Rng, traits: Traits) -> float:
    """Draw a size by its words, or by what the prompt says of a part."""
    kind = words[0] if words[0] in ("whole", "chance") else ""
    numbers = [_number(word, sizes) for word in words[bool(kind) :]]
    if part and len(numbers) == 6:
        return traits.draw(rng, part, (numbers[0], numbers[1]), (numbers[2], numbers[3]), (numbers[4], numbers[5]))
    least, most = (numbers * 2)[:2]
    if kind:
        return float(rng.integers(int(least), int(most) + 1) if kind == "whole" else rng.random() < least)
    if part:
        return traits.draw(rng, part, (0.3 * least, 0.42 * least), (least, most), (1.7 * most, 2.0 * most))
    return rng.uniform(least, most) if len(words) > 1 else least


def _flipped(part: Part) -> Part:
    return part._replace(verts=part.verts * [1, 1, -1], faces=part.faces[:, ::-1].copy())


def _around(axis: str, part: Part, groups: Groups) -> list[Part]:
    return around(part, int(groups[0][0]), (*groups[0], 0.0)[1], axis)


def _turned(axis: str, part: Part, groups: Groups) -> list[Part]:
    return [turned(part, groups[0][0], axis)]


def _row(part: Part, groups: Groups) -> list[Part]:
    count = int(groups[0][0])
    if len(groups) > 1:
        return [moved(part, place) for place in np.linspace(groups[1], groups[2], count)]
    return [moved(part, number * np.asarray(groups[0][1:])) for number in range(count)]


_CHANGES: dict[str, Callable[[Part, Groups], list[Part]]] = {
    "around": partial(_around, "y"),
    "aroundx": partial(_around, "x"),
    "aroundz": partial(_around, "z"),
    "at": lambda part, groups: [moved(part, place) for place in groups],
    "by": lambda part, groups: [stretched(part, *groups[0])],
    "flip": lambda part, _: [part, _flipped(part)],
    "if": lambda part, groups: [part] if groups[0][0] > 0 else [],
    "pair": lambda part, _: pair(part),
    "quad": lambda part, _: [each for own in (part, _flipped(part)) for each in pair(own)],
    "row": _row,
    "taper": lambda part, groups: [tapered(part, 1, groups[0][0])],
    "taperz": lambda part, groups: [tapered(part, 2, groups[0][0])],
    "unless": lambda part, groups: [] if groups[0][0] > 0 else [part],
    **{axis: partial(_turned, axis) for axis in "xyz"},
}
"""What the words behind bars make of a solid."""


def _entry(text: str, sizes: dict[str, float]) -> list[Part]:
    """Return the solids of one entry with the labels of their parts."""
    (part, shape, *numbers), *changes = (piece.split() for piece in text.split("|"))
    first = solid(shape, _groups(numbers, sizes))
    parts = [divided(first, part) if "/" in part else named(**{part: first})]
    for name, *words in changes:
        groups = _groups(words, sizes)
        parts = [each for one in parts for each in _CHANGES[name](one, groups)]
    return parts


class _Sketch:
    """The family of a sketch: its sizes by their letters, and the texts of its solids."""

    def __init__(self, name: str, sizes: dict[str, tuple[str, list[str]]], entries: list[str]) -> None:
        self.name, self.sizes, self.entries = name, sizes, entries

    def __call__(self, rng: Rng, traits: Traits) -> Part:
        """Draw a member: each size from its range, by the prompt or at random, then the solids."""
        sizes: dict[str, float] = {}
        text = ""
        try:
            for text, (part, words) in self.sizes.items():
                sizes[text] = _size(words, part, sizes, rng, traits)
            solids = []
            for text in self.entries:
                solids += _entry(text, sizes)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{self.name}: {text.strip()}: {error}") from error
        return join(solids)


def read(text: str) -> dict[str, Callable[[Rng, Traits], Part]]:
    """Return the families of a table by `noun` or `noun/kind`.

    A family raises ValueError with its name where its text means nothing: a shape, a part or a size that there is not,
    or groups of other numbers.
    """
    sketches: dict[str, _Sketch] = {}
    for line in re.sub(r"\n +", " ", re.sub(r"(?m)^(#.*)?\n", "", text)).splitlines():
        title, _, rest = line.partition(":")
        name, _, base = (each.strip() for each in title.partition("<"))
        head, *solids = rest.split(";")
        basis = sketches[base] if base else _Sketch("", {}, [])
        own = (piece.split() for piece in head.split(",") if piece.strip())
        sizes = {word.split("=")[0]: (word.partition("=")[2], words) for word, *words in own}
        sketches[name] = _Sketch(name, basis.sizes | sizes, basis.entries + solids)
    return {name: sketch for name, sketch in sketches.items() if not name.startswith("*")}


SKETCHES = {
    name: family
    for path in sorted(files(__package__).joinpath("sketched").iterdir(), key=str)
    if path.name.endswith(".txt")
    for name, family in read(path.read_text(encoding="utf-8")).items()
}
"""The families that are sketched, by `noun` or `noun/kind`."""
