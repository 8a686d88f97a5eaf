"""Declare shapes of nouns by their sliders. Without numpy; `meshdeform.kinds.sketch.shapes` makes the shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import Field

from meshdeform.errors import ParameterError
from meshdeform.requests.declaration import StrictModel

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
class Sliders:
    """The parameters of the shapes of a noun."""

    noun: str
    numbers: tuple[Number, ...]
    choices: tuple[Choice, ...]

    def defaults(self) -> dict[str, Value]:
        """Return the default of each parameter."""
        numbers: dict[str, Value] = {each.name: each.default for each in self.numbers}
        return numbers | {each.name: each.default for each in self.choices}

    def checked(self, values: Mapping[str, object]) -> dict[str, Value]:
        """Return all parameters: those given, and the defaults of the others.

        Raises ParameterError: a name is unknown, a number is out of its range or not finite, or a choice is none of its
        options.
        """
        known: dict[str, Number | Choice] = {each.name: each for each in self.numbers}
        known |= {each.name: each for each in self.choices}
        result = self.defaults()
        for name, value in values.items():
            about = known.get(name)
            if about is None:
                raise ParameterError(
                    f"A {self.noun} has no slider {name!r}.", advice=f"Its sliders: {', '.join(known)}."
                )
            result[name] = _number(about, value) if isinstance(about, Number) else _choice(about, value)
        return result


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


class Sketch(StrictModel):
    """A shape of a noun: what a drawing shows, or in place of one."""

    noun: str = Field(max_length=64, description="What it is ([Nouns](nouns.md)).", examples=["vase"])
    values: dict[str, float | str] = Field(
        default_factory=dict,
        max_length=32,
        description="Its sliders by name ([Sketches](sketch.md#sliders)). Default of each: as the noun is.",
        examples=[{"neck": 0.5, "height": 1.2}],
    )
