"""Declare the parameters of the procedural families that a drawing can show. Without numpy.

Sizes are proportions: each family has one length that is fixed (the height of a vase is 1), because a drawing does not
tell how large a thing is. `meshdeform.kinds.sketch.families` makes the shapes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from pydantic import Field, model_validator

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
class FamilyParameters:
    """The parameters of shapes of one kind."""

    name: str  # the noun, such as `chair`
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
                    f"A {self.name} has no parameter {name!r}.", advice=f"Its parameters: {', '.join(known)}."
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


_ALL = (
    FamilyParameters(
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
    ),
    FamilyParameters(
        "table",
        (
            Number("depth", 0.45, 1.0, 0.7),
            Number("height", 0.3, 0.9, 0.6),
            Number("top_thickness", 0.02, 0.09, 0.04),
            Number("leg_thickness", 0.03, 0.1, 0.05),
            Number("inset", 0.0, 0.18, 0.04),
        ),
        (Choice("top", ("rectangle", "oval")), Choice("legs", ("four", "column", "sides"))),
    ),
    FamilyParameters(
        "vase",
        (
            Number("foot", 0.1, 0.28, 0.18),
            Number("belly", 0.2, 0.45, 0.3),
            Number("belly_height", 0.25, 0.6, 0.4),
            Number("neck", 0.06, 0.2, 0.1),
            Number("lip", 0.08, 0.3, 0.16),
        ),
        (Choice("handles", ("none", "one", "two")),),
    ),
    FamilyParameters(
        "goblet",
        (
            Number("bowl", 0.15, 0.36, 0.25),
            Number("bowl_height", 0.35, 0.6, 0.45),
            Number("opening", 0.6, 1.25, 0.9),
            Number("stem", 0.012, 0.05, 0.025),
            Number("foot", 0.15, 0.34, 0.24),
        ),
        (Choice("stem_shape", ("plain", "knob")),),
    ),
    FamilyParameters(
        "lamp",
        (
            Number("shade_height", 0.2, 0.45, 0.3),
            Number("shade_top", 0.08, 0.28, 0.16),
            Number("shade_bottom", 0.2, 0.42, 0.3),
            Number("pole", 0.01, 0.04, 0.02),
            Number("base_radius", 0.14, 0.32, 0.2),
        ),
        (Choice("shade", ("cone", "dome")), Choice("base", ("disc", "tripod"))),
    ),
    FamilyParameters(
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
    ),
)

SKETCH_FAMILIES: dict[str, FamilyParameters] = {each.name: each for each in _ALL}
"""Families that can be drawn, by name, in the order of the network's outputs."""


def sketch_family(name: str) -> FamilyParameters:
    """Return the parameters of a family.

    Raises ParameterError: there is none of that name.
    """
    if name not in SKETCH_FAMILIES:
        raise ParameterError(f"There is no family {name!r}.", advice=f"The families: {', '.join(SKETCH_FAMILIES)}.")
    return SKETCH_FAMILIES[name]


class Sketch(StrictModel):
    """A shape of a procedural family: what a drawing shows, or in place of one."""

    family: str = Field(
        description="Family of the drawing: " + ", ".join(SKETCH_FAMILIES) + ".",
        examples=["vase"],
        json_schema_extra={"enum": list(SKETCH_FAMILIES)},
    )
    values: dict[str, float | str] = Field(
        default_factory=dict,
        max_length=32,
        description="Parameters of the family by name ([Sketches](sketch.md#families)). Default: as the drawing shows "
        "them; without a drawing, those of the family.",
        examples=[{"lip": 0.2, "handles": "two"}],
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        try:
            sketch_family(self.family).checked(self.values)
        except ParameterError as error:
            raise ValueError(" ".join(filter(None, (error.detail, error.advice_text)))) from error
        return self
