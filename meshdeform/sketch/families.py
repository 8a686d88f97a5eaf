"""Declare the procedural families that a drawing can show: named parameters, their ranges and defaults.

Sizes are proportions: each family has one length that is fixed (the height of a vase is 1), because a drawing does not
tell how large a thing is. +Y is up and +Z the front. Importing this needs numpy alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from meshdeform.errors import ParameterError
from meshdeform.sketch import generators
from meshdeform.sketch.solids import Floats, Solid

__all__ = ["FAMILIES", "Choice", "Family", "Number", "Value", "family_of"]

Value = float | str
"""A value of a parameter: a number, or the name of a choice."""


@dataclass(frozen=True)
class Number:
    """A continuous parameter: its name, its range and its default."""

    name: str
    low: float
    high: float
    default: float


@dataclass(frozen=True)
class Choice:
    """A discrete parameter: its name and its values, of which the first is the default."""

    name: str
    options: tuple[str, ...]

    @property
    def default(self) -> str:
        """The first option."""
        return self.options[0]


@dataclass(frozen=True)
class Family:
    """Shapes of one kind.

    Attributes
    ----------
    name : str
        The noun, such as `chair`.
    numbers, choices : tuples
        Its parameters.
    make : callable
        Returns the solids of a member by name; it gets all numbers and choices by name.
    """

    name: str
    numbers: tuple[Number, ...]
    choices: tuple[Choice, ...]
    make: Callable[[Mapping[str, float], Mapping[str, str]], dict[str, Solid]]

    def defaults(self) -> dict[str, Value]:
        """Return the default of each parameter."""
        numbers: dict[str, Value] = {each.name: each.default for each in self.numbers}
        return numbers | {each.name: each.default for each in self.choices}

    def checked(self, values: Mapping[str, object]) -> dict[str, Value]:
        """Return all parameters: those given, and the defaults of the others.

        Raises
        ------
        ParameterError
            A name is unknown, a number is out of its range or not finite, or a choice is none of its options.
        """
        known: dict[str, Number | Choice] = {each.name: each for each in self.numbers}
        known |= {each.name: each for each in self.choices}
        result = self.defaults()
        for name, value in values.items():
            about = known.get(name)
            if about is None:
                raise ParameterError(
                    f"A {self.name} has no parameter {name!r}.", advice=f"Its parameters: {', '.join(known)}."
                )
            result[name] = _number(about, value) if isinstance(about, Number) else _choice(about, value)
        return result

    def solids(self, values: Mapping[str, object]) -> dict[str, Solid]:
        """Return the closed solids of a member by name; as for `checked`, and parameters left out have their default.

        Raises
        ------
        ParameterError
            As for `checked`.
        """
        every = self.checked(values)
        numbers = {each.name: float(every[each.name]) for each in self.numbers}
        return self.make(numbers, {each.name: str(every[each.name]) for each in self.choices})

    def draw(self, random: np.random.Generator) -> dict[str, Value]:
        """Return a member's parameters, each drawn evenly from its range or its options."""
        numbers: dict[str, Value] = {each.name: float(random.uniform(each.low, each.high)) for each in self.numbers}
        return numbers | {each.name: str(random.choice(each.options)) for each in self.choices}

    def shares(self, values: Mapping[str, object]) -> Floats:
        """Return the numbers as shares of their ranges (N,), 0 to 1."""
        every = self.checked(values)
        return np.array([(float(every[each.name]) - each.low) / (each.high - each.low) for each in self.numbers])

    def indices(self, values: Mapping[str, object]) -> list[int]:
        """Return the index of each choice's option."""
        every = self.checked(values)
        return [each.options.index(str(every[each.name])) for each in self.choices]

    def values(self, shares: Floats, indices: list[int]) -> dict[str, Value]:
        """Return the parameters of shares and indices; shares beyond their range are put to its end."""
        result: dict[str, Value] = {}
        for each, share in zip(self.numbers, shares, strict=True):
            result[each.name] = round(each.low + (each.high - each.low) * min(max(float(share), 0.0), 1.0), 4)
        return result | {each.name: each.options[index] for each, index in zip(self.choices, indices, strict=True)}


def _number(about: Number, value: object) -> float:
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else float("nan")
    except ValueError:
        number = float("nan")
    if not about.low <= number <= about.high:
        raise ParameterError(
            f"{about.name} is {value!r}, but it must be a number from {about.low:g} to {about.high:g}.",
            advice=f"Its default is {about.default:g}.",
        )
    return number


def _choice(about: Choice, value: object) -> str:
    if value not in about.options:
        raise ParameterError(f"{about.name} is {value!r}, but it must be one of: {', '.join(about.options)}.")
    return str(value)


def family_of(name: str) -> Family:
    """Return the family of a name.

    Raises
    ------
    ParameterError
        There is none of that name.
    """
    if name not in FAMILIES:
        raise ParameterError(f"There is no family {name!r}.", advice=f"The families: {', '.join(FAMILIES)}.")
    return FAMILIES[name]


_ALL = (
    Family(
        "chair",
        (
            Number("width", 0.36, 0.64, 0.46),
            Number("depth", 0.36, 0.6, 0.46),
            Number("back_height", 0.3, 0.75, 0.5),
            Number("lean", 0.0, 0.2, 0.06),
            Number("seat_thickness", 0.02, 0.1, 0.04),
            Number("leg_thickness", 0.02, 0.06, 0.035),
        ),
        (
            Choice("legs", ("four", "column", "sides")),
            Choice("back", ("panel", "slats", "rungs")),
            Choice("arms", ("no", "yes")),
        ),
        generators.chair,
    ),
    Family(
        "table",
        (
            Number("depth", 0.45, 1.0, 0.7),
            Number("height", 0.3, 0.9, 0.6),
            Number("top_thickness", 0.02, 0.09, 0.04),
            Number("leg_thickness", 0.03, 0.1, 0.05),
            Number("inset", 0.0, 0.18, 0.04),
        ),
        (Choice("top", ("rectangle", "oval")), Choice("legs", ("four", "column", "sides"))),
        generators.table,
    ),
    Family(
        "vase",
        (
            Number("foot", 0.1, 0.28, 0.18),
            Number("belly", 0.2, 0.45, 0.3),
            Number("belly_height", 0.25, 0.6, 0.4),
            Number("neck", 0.06, 0.2, 0.1),
            Number("lip", 0.08, 0.3, 0.16),
        ),
        (Choice("handles", ("none", "one", "two")),),
        generators.vase,
    ),
    Family(
        "goblet",
        (
            Number("bowl", 0.15, 0.36, 0.25),
            Number("bowl_height", 0.35, 0.6, 0.45),
            Number("opening", 0.6, 1.25, 0.9),
            Number("stem", 0.012, 0.05, 0.025),
            Number("foot", 0.15, 0.34, 0.24),
        ),
        (Choice("stem_shape", ("plain", "knob")),),
        generators.goblet,
    ),
    Family(
        "lamp",
        (
            Number("shade_height", 0.2, 0.45, 0.3),
            Number("shade_top", 0.08, 0.28, 0.16),
            Number("shade_bottom", 0.2, 0.42, 0.3),
            Number("pole", 0.01, 0.04, 0.02),
            Number("base_radius", 0.14, 0.32, 0.2),
        ),
        (Choice("shade", ("cone", "dome")), Choice("base", ("disc", "tripod"))),
        generators.lamp,
    ),
    Family(
        "airplane",
        (
            Number("body", 0.06, 0.15, 0.1),
            Number("span", 0.45, 1.2, 0.85),
            Number("sweep", -0.05, 0.6, 0.25),
            Number("chord", 0.2, 0.6, 0.32),
            Number("taper", 0.2, 0.9, 0.55),
            Number("fin", 0.18, 0.42, 0.3),
        ),
        (
            Choice("engines", ("under_wings", "none", "propeller")),
            Choice("wings", ("low", "high")),
            Choice("tail", ("cross", "v")),
        ),
        generators.airplane,
    ),
)

FAMILIES: dict[str, Family] = {each.name: each for each in _ALL}
"""The families by name, in the order of the network's outputs."""
