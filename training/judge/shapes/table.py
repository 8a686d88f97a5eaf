"""Read shapes from tables: sizes drawn from ranges, then solids in the words of `solids`.

A noun begins at the start of a line, `mug: h=.6~.9; drum 0,0,0 0,h,0 .3; hoop .3,h/2,0 .2 .05`, and goes on in lines
that are indented. Statements are parted by `;` or by a new line, their words by spaces:

    name=value       draw a size or a place; `a~b`: between the two, `a±b`: around a, `pick(a,b)`: one of them
    name?=value      the same where the name has no value yet
    ball a,b,c r     a solid; lists of places are `a,b:c,d`, completed by their mirror image after `%`
    [one | other]    one design of several, each of statements
    _frame a=1       the statements of the paragraph `_frame`, with the sizes of here; its own are known afterwards

before which may stand, for each solid that they make: `pair` (and its mirror image in x = 0), `hole`, `?.3` (in three
draws of ten; `?` in half), `at` PLACE, `turn` DEGREES, `size` FACTOR, `ring` COUNT (about +Y), `row` COUNT STEP; the
last two count `K` from 0. Values are expressions of Python without spaces; `sin` and `cos` take degrees.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from training.judge.shapes import solids
from training.judge.shapes.solids import Solid, both, carved, moved, rods

Statement = list[Any]
"""Words, of which the last may be a group: a list of designs, which are lists of statements."""


class Table:
    """The shapes of a text, by noun."""

    def __init__(self, text: str) -> None:
        paragraphs = re.split(r"^([\w-]+):", re.sub(r"#.*", "", text), flags=re.MULTILINE)
        names = paragraphs[1::2]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"More than one paragraph of {', '.join(sorted(twice))}; keep one of each.")
        self._groups = {name: _parsed(body) for name, body in zip(names, paragraphs[2::2], strict=True)}

    @property
    def nouns(self) -> list[str]:
        """Return the paragraphs that are not frames."""
        return [name for name in self._groups if not name.startswith("_")]

    def shape(self, noun: str, rng: np.random.Generator) -> list[Solid]:
        """Draw a noun's solids; a mistake in its paragraph raises ValueError."""
        scope = {
            "u": rng.uniform, "pick": lambda *of: of[int(rng.integers(len(of)))], "random": rng.random,
            "sin": lambda a: np.sin(np.radians(a)), "cos": lambda a: np.cos(np.radians(a)),
            "abs": abs, "max": max, "min": min,
        }  # fmt: skip
        try:
            return self._made([self._groups[noun]], scope)
        except (ArithmeticError, AttributeError, LookupError, NameError, SyntaxError, TypeError, ValueError) as error:
            raise ValueError(f"The table's {noun}: {error}") from error

    def _made(self, words: Statement, scope: dict[str, Any]) -> list[Solid]:
        """Return what a statement makes."""
        match words:
            case [list() as designs]:
                return [solid for statement in scope["pick"](*designs) for solid in self._made(statement, scope)]
            case [str() as name, *rest] if name.startswith("?"):
                return self._made(rest, scope) if scope["random"]() < float(name[1:] or 0.5) else []
            case ["pair", *rest]:
                return both(self._made(rest, scope))
            case ["hole", *rest]:
                return [carved(solid) for solid in self._made(rest, scope)]
            case ["at" | "turn" | "size" as name, amount, *rest]:
                value = _value(amount, scope)
                return [moved(solid, **{name: value}) for solid in self._made(rest, scope)]
            case ["ring", count, *rest]:
                number = _value(count, scope)
                return list(self._copies(rest, scope, "turn", [(0.0, 360.0 * k / number, 0.0) for k in range(number)]))
            case ["row", count, step, *rest]:
                number, by = _value(count, scope), np.asarray(_value(step, scope))
                return list(self._copies(rest, scope, "at", [(k - (number - 1) / 2) * by for k in range(number)]))
            case [str() as name, *sizes] if name.startswith("_"):
                _assign(sizes, scope)
                return self._made([self._groups[name]], scope)
            case [str() as name, *_] if "=" in name:
                _assign(words, scope)
                return []
            case [str() as name, *arguments] if name in _WORDS:
                made = _WORDS[name](*(_value(argument, scope) for argument in arguments))
                return [made] if isinstance(made, Solid) else list(made)
        raise ValueError(f"no statement begins with {words[0]!r}; the module's docstring lists those that there are.")

    def _copies(self, words: Statement, scope: dict[str, Any], way: str, places: list[Any]) -> Iterator[Solid]:
        """Draw a statement once for each place."""
        for k, place in enumerate(places):
            scope["K"] = k
            yield from (moved(solid, **{way: place}) for solid in self._made(words, scope))


def _parsed(body: str) -> list[list[Statement]]:
    """Return the designs of a text."""
    marks = iter([*re.findall(r"[\[\];|]|[^\s\[\];|]+", body.replace("\n", " ; ")), "]"])
    designs = _designs(marks)
    if next(marks, None):
        raise ValueError(f"A bracket too many in {body.strip()[:60]!r}.")
    return designs


def _designs(marks: Iterator[str]) -> list[list[Statement]]:
    """Read designs to the bracket that closes them."""
    designs: list[list[Statement]] = [[]]
    statement: Statement = []
    for mark in marks:
        if mark not in (";", "|", "]"):
            statement.append(_designs(marks) if mark == "[" else mark)
            continue
        designs[-1] += [statement] if statement else []
        designs += [[]] if mark == "|" else []
        statement = []
        if mark == "]":
            return designs
    raise ValueError("A bracket of the table is not closed.")


def _assign(words: Statement, scope: dict[str, Any]) -> None:
    """Give names the values that words like `a=1` and `b?=2` have for them."""
    for word in words:
        name, text = word.split("=", 1)
        if not (name.endswith("?") and name[:-1] in scope):
            value = _value(text, scope)
            scope[name.rstrip("?")] = np.asarray(value, float) if isinstance(value, tuple) else value


def _value(text: str, scope: dict[str, Any]) -> Any:
    """Return what a text stands for."""
    values = [eval(_code(part), {"__builtins__": {}}, scope) for part in text.lstrip("%").split(":")]  # noqa: S307
    if text.startswith("%"):
        values += [(-across, *rest) for across, *rest in values[::-1]]
    return values if len(values) > 1 else values[0]


@cache
def _code(text: str) -> CodeType:
    """Compile an expression, its ranges written as draws."""
    text = re.sub(r"([\w.]+)~([\w.]+)", r"u(\1,\2)", re.sub(r"(?<=[\w.)])±", "+±", text))
    return compile(re.sub(r"±([\w.]+)", r"u(-\1,\1)", text), "table", "eval")


def _rods(path: list[Any], radii: Any) -> list[Solid]:
    """Return a chain of rods."""
    return rods(path, np.broadcast_to(np.asarray(radii, float), len(path)).tolist())


def _plate(axis: str) -> Callable[..., Solid]:
    """Return the word that makes plates across an axis: outlines of (x, y), of (z, y) across x, of (x, z) across y."""

    def word(outline: list[Any], thick: float, centre: ArrayLike = (0, 0, 0), turn: Any = (0, 0, 0)) -> Solid:
        return solids.plate(np.asarray(outline, float)[:, :: 1 if axis == "z" else -1], thick, centre, axis, turn)

    return word


_WORDS: dict[str, Callable[..., Solid | list[Solid]]] = {
    **{word: getattr(solids, word) for word in ("ball", "block", "rod", "drum", "spun", "hoop", "arc")},
    "rods": _rods, "plate": _plate("z"), "platex": _plate("x"), "platey": _plate("y"),
}  # fmt: skip
