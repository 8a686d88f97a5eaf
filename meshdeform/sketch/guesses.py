"""Guess what a drawing shows: families with their parameters, and so meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from meshdeform.assets.drawing import read_drawing
from meshdeform.requests.sketches import Value
from meshdeform.sketch.families import FAMILIES, family_of, member_glb
from meshdeform.sketch.looking import look, read_weights

SURE = 0.85
"""Probability of the first guess from which on it is sure; docs/sketch.md has what this threshold tells."""


@dataclass(frozen=True)
class Guess:
    """One reading of a drawing."""

    family: str
    probability: float  # that the drawing shows this family and none of the others
    values: dict[str, Value]  # all parameters of the family

    @classmethod
    def of(cls, family: str, probability: float, values: Mapping[str, object]) -> Self:
        """Return a guess with checked parameters; those left out have their default.

        Raises
        ------
        ParameterError
            There is no such family, a name is unknown, or a value is out of range.
        """
        return cls(family, probability, family_of(family).checked(values))

    def glb(self) -> bytes:
        """Return the mesh as `member_glb` does."""
        return member_glb(self.family, self.values)


def guess(data: bytes, *, family: str = "") -> list[Guess]:
    """Return what a drawing may show, the likeliest first.

    Parameters
    ----------
    data : bytes
        A PNG, JPEG or WebP with dark lines on a bright page, or the reverse.
    family : str
        The only family to consider. Default: all, of which the first three are returned.

    Raises
    ------
    DrawingError
        The picture is no line drawing.
    ParameterError
        There is no such family.
    ModelError
        The package's weights are missing or damaged.
    """
    if family:
        family_of(family)
    seen = look(read_drawing(data), read_weights())
    probabilities = seen.probabilities.tolist()
    names = list(FAMILIES)
    order = sorted(range(len(names)), key=lambda index: -probabilities[index])
    wanted = [index for index in order if not family or names[index] == family][:3]
    found = []
    for index in wanted:
        name = names[index]
        values = FAMILIES[name].values(seen.shares[name], seen.options[name])
        found.append(Guess(name, round(probabilities[index], 4), values))
    return found


def is_unsure(found: Sequence[Guess], *, family: str = "") -> bool:
    """Return whether a drawing may be of none of the families; never if its `family` was named."""
    return not family and found[0].probability < SURE
