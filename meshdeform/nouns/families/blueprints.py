"""Draw members by blueprints: texts that name the numbers of a noun, or of a kind of it, and list its solids.

::

    # of the town                                       a remark
    taxi < car/saloon: w=.4~.45 r=wheels:.2 n=#2~4 a=?.3
    car/old-timer: ...                                  a kind of car
      body box 0,.5w+.1,0 2w,.3,1; ?a lamp drum .1 .05 w,.4,1/-1 z
        =1,2,1                                          deeper lines go on with the one above

A number is drawn between two (`w`), is the usual size of a part that a prompt can set (`r`), an integer (`n`), or 1 in
30 of 100 members and else 0 (`a`; 50 where it is a mere `?`). It may build on those before it: `.5w+.1`, `2*w*h`.

A solid is the part that it is, its shape with its numbers (`_SOLIDS`, `_PLACED`), and what is done with it in turn:
`^x20` turned about an axis, `*4y` four copies around one, `@x,y,z` moved, `=x,y,z` stretched, `<.2` narrower above,
`>.5` narrower ahead. A place may be several, `-1/1` or `-1:1:5` for five from one to the other. What is beside the
middle is drawn on both sides, unless `|` stands behind it. `?a` and `!a` before a part: of members whose number a is,
or is not, above 0. A blueprint based on another (`<`) has its numbers, some of them redefined, and its solids first.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from meshdeform.nouns.families.chassis import (
    arc,
    bar,
    block,
    cabin,
    drum,
    hull,
    shaped,
    shell,
    side,
    spoked,
    wheel,
    wing,
)
from meshdeform.nouns.families.parts import (
    Part,
    box,
    curved,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    mirrored,
    moved,
    named,
    plate,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["BLUEPRINTS", "Blueprint", "read_blueprints"]

_SIZES = (0.4, 0.55), (0.95, 1.05), (1.6, 1.8)
"""Lesser, plain and greater sizes of a part, as shares of the usual one."""
_BESIDE = 0.004
"""How far from the middle is beside it."""
_TERM = re.compile(r"([+-]?)(\d*\.?\d*)\*?([a-z]*)((?:\*[a-z]+)*)")


class _Draw:
    """The numbers of one member, and what its texts mean."""

    def __init__(self, rng: Rng, traits: Traits) -> None:
        self.rng, self.traits = rng, traits
        self.numbers: dict[str, float] = {}

    def number(self, text: str) -> float:
        """Return the value of `.5w+.1`, or one drawn between two, `.3~.4`."""
        low, between, high = text.partition("~")
        if between:
            return float(self.rng.uniform(self.number(low), self.number(high)))
        value, end = 0.0, 0
        while end < len(text):
            match = _TERM.match(text, end)
            if match is None or match.end() == end:
                raise ValueError(f"not a number: {text}")
            sign, factor, *names = match.groups()
            term = -1.0 if sign == "-" else 1.0
            for name in filter(None, "*".join(names).split("*")):
                term *= self.numbers[name]
            value, end = value + term * float(factor or 1), match.end()
        return value

    def define(self, name: str, text: str) -> None:
        """Draw a number of the member."""
        part, asked, usual = text.rpartition(":")
        if text[0] == "?":
            value = float(self.rng.random() < float(text[1:] or 0.5))
        elif text[0] == "#":
            low, high = text[1:].split("~")
            value = float(self.rng.integers(int(low), int(high) + 1))
        else:
            value = self.number(usual) * (self.traits.draw(self.rng, part, *_SIZES) if asked else 1)
        self.numbers[name] = value

    def point(self, text: str) -> list[float]:
        """Return the numbers of `x,y,z`."""
        return [self.number(each) for each in text.split(",")]

    def points(self, texts: Sequence[str]) -> list[list[float]]:
        """Return points; `o:z,y,radius,first,last` stands for those of an arc."""
        found: list[list[float]] = []
        for text in texts:
            found += arc(*self.point(text[2:])).tolist() if text.startswith("o:") else [self.point(text)]
        return found

    def places(self, text: str) -> Iterator[tuple[float, ...]]:
        """Return all places of `x,y,-1/1` or `x,y,-1:1:5`."""
        return product(*([*self._several(each)] for each in text.split(",")))

    def _several(self, text: str) -> list[float]:
        if ":" in text:
            first, last, count = text.split(":")
            return [float(at) for at in np.linspace(self.number(first), self.number(last), int(self.number(count)))]
        return [self.number(each) for each in text.split("/")]


def _path(draw: _Draw, texts: Sequence[str]) -> Part:
    """Return a tube through points of a place and a radius, or two radii, at each."""
    points = [draw.point(text) for text in texts]
    return limb([each[:3] for each in points], [(each[3], each[-1]) for each in points], segments=14, samples=3)


def _curve(draw: _Draw, radius: str, *texts: str) -> Part:
    return bar(draw.number(radius), curved([draw.point(text) for text in texts], samples=3))


_Made = Part | Sequence[Part] | Mapping[str, Sequence[Part]]
_SOLIDS: dict[str, Callable[..., _Made]] = {
    # radius (or radii), points
    "bar": lambda d, r, *p: bar(d.point(r), [d.point(each) for each in p]),
    "curve": _curve,
    # width, narrower above by, posts, outline of (z, y)
    "cab": lambda d, w, k, n, *p: cabin(d.points(p), d.number(w), d.number(k), int(d.number(n))),
    # depth, bevel, outline of (x, y)
    "face": lambda d, w, b, *p: extrude(d.points(p), d.number(w), bevel=d.number(b)),
    "hull": lambda d, *p: hull(*(d.number(each) for each in p)),
    "lathe": lambda d, n, *p: lathe([d.point(each) for each in p], segments=int(d.number(n))),
    "limb": lambda d, *p: _path(d, p),
    # thickness, outline of (x, z)
    "plan": lambda d, w, *p: plate(d.points(p), d.number(w), across="y"),
    "shell": lambda d, *p: shell(*(d.number(each) for each in p)),
    # width, bevel, outline of (z, y)
    "side": lambda d, w, b, *p: side(d.points(p), d.number(w), d.number(b)),
    # span, chord, sweep, taper, thickness, degrees
    "wing": lambda d, *p: wing(*(d.number(each) for each in p)),
}
_PLACED: dict[str, tuple[int, Callable[..., _Made]]] = {
    # a place, then: radii; size and how round; the same of many faces; radius, half width and axis; spokes
    "ball": (0, lambda d, r: ellipsoid([0, 0, 0], d.point(r), rings=8)),
    "box": (0, lambda d, s, r=".12": block([0, 0, 0], d.point(s), d.number(r))),
    "pad": (0, lambda d, s, r=".45": box([0, 0, 0], d.point(s), round_by=d.number(r), cells=5)),
    "drum": (2, lambda d, r, h, axis="x", n="16": drum(d.number(r), d.number(h), axis, int(d.number(n)))),
    "wheel": (2, lambda d, r, h: wheel(d.number(r), d.number(h))),
    "spoked": (2, lambda d, r, h, n="4": spoked(d.number(r), d.number(h), int(d.number(n)))),
}
"""Solids with a place, and after how many numbers it stands."""


@dataclass(frozen=True)
class Blueprint:
    """The family of a noun, or of a kind of it: its numbers, and the texts of its solids."""

    name: str
    numbers: tuple[tuple[str, str], ...]
    solids: tuple[str, ...]

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, rng: Rng, traits: Traits) -> Part:
        """Draw a member, as families do. A text that means nothing raises ValueError with the blueprint's name."""
        draw = _Draw(rng, traits)
        parts: dict[str, list[Part]] = {}
        text = ""
        try:
            for name, text in self.numbers:
                draw.define(name, text)
            for text in self.solids:
                words = text.split()
                wanted = words.pop(0) if words[0][0] in "?!" else ""
                if wanted and (draw.numbers[wanted[1:]] > 0) == (wanted[0] == "!"):
                    continue
                for part, solid in _solids(draw, words[0], words[1], words[2:]):
                    parts.setdefault(part, []).append(solid)
            return named(**parts)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{self.name}: {text}: {error}") from error


def _solids(draw: _Draw, part: str, kind: str, words: list[str]) -> Iterator[tuple[str, Part]]:
    """Return the solids of one text with the names of their parts."""
    ends = next((k for k, word in enumerate(words) if word[0] in "^*@=<>|"), len(words))
    own, after = words[:ends], words[ends:]
    if kind in _PLACED:
        at, make = _PLACED[kind]
        after.insert(0, "@" + own.pop(at))
    else:
        make = _SOLIDS[kind]
    made = make(draw, *own)
    several = {part: [made] if isinstance(made, Part) else made} if not isinstance(made, Mapping) else made
    for name, solids in several.items():
        for solid in solids:
            for each in _done(draw, solid, after):
                yield name, each
                middle = (each.verts[:, 0].min() + each.verts[:, 0].max()) / 2
                if abs(middle) > _BESIDE and "|" not in after:
                    yield name, mirrored(each)


def _done(draw: _Draw, solid: Part, words: Sequence[str]) -> list[Part]:
    """Return what becomes of a solid: several where there are several places."""
    solids = [solid]
    for word in words:
        sign, rest = word[0], word[1:]
        if sign == "^":
            solids = [turned(each, draw.number(rest[1:]), rest[0]) for each in solids]
        elif sign == "*":
            count = int(draw.number(rest[:-1]))
            solids = [join([turned(each, k * 360 / count, rest[-1]) for k in range(count)]) for each in solids]
        elif sign == "@":
            solids = [moved(each, place) for each in solids for place in draw.places(rest)]
        elif sign == "=":
            solids = [stretched(each, *draw.point(rest)) for each in solids]
        elif sign in "<>":
            solids = [shaped(each, 1 if sign == "<" else 2, draw.number(rest)) for each in solids]
    return solids


def read_blueprints(text: str) -> dict[str, Blueprint]:
    """Read blueprints, by `noun` or `noun/kind`; those with a star are only the base of others."""
    found: dict[str, Blueprint] = {}
    text = re.sub(r"\n {4,}", " ", re.sub(r"(?m)^#.*\n?", "", text))
    for entry in re.split(r"\n(?=\S)", text):
        head, *lines = entry.strip().splitlines()
        title, _, numbers = head.partition(":")
        title, _, base = (each.strip() for each in title.partition("<"))
        basis = found[base] if base else Blueprint("", (), ())
        own = dict(basis.numbers) | dict(each.split("=", 1) for each in numbers.split())
        solids = [each.strip() for line in lines for each in line.split(";") if each.strip()]
        found[title] = Blueprint(title.rpartition("/")[2], tuple(own.items()), (*basis.solids, *solids))
    return {title: each for title, each in found.items() if not title.startswith("*")}


BLUEPRINTS: dict[str, Blueprint] = {
    title: each
    for path in sorted((Path(__file__).parent / "blueprints").glob("*.txt"))
    for title, each in read_blueprints(path.read_text(encoding="utf-8")).items()
}
"""All blueprints, by the noun, or by the noun and the kind: `car/saloon`."""
