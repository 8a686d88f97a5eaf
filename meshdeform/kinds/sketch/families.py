"""Make the shapes of the procedural families that a drawing can show. +Y is up and +Z the front.

Their parameters are declared in `meshdeform.requests.sketches`. Importing this needs numpy alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from meshdeform.assets import Primitive, build_glb
from meshdeform.errors import ParameterError
from meshdeform.kinds.sketch import generators
from meshdeform.kinds.sketch.solids import Floats, Solid
from meshdeform.requests.sketches import SKETCH_FAMILIES, FamilyParameters, Value

_Make = Callable[[Mapping[str, float], Mapping[str, str]], dict[str, Solid]]


@dataclass(frozen=True)
class Family(FamilyParameters):
    """Shapes of one kind."""

    make: _Make  # returns the solids of a member by name; it gets all numbers and choices by name

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


def member_glb(family: str, values: Mapping[str, object]) -> bytes:
    """Return a member of a family as a GLB, with one node for each of its closed solids.

    Parameters
    ----------
    values : mapping
        Parameters by name; those left out have their default.

    Raises
    ------
    ParameterError
        A name is unknown, or a value is out of range.
    """
    solids = family_of(family).solids(values)
    parts = [Primitive(s.verts, s.faces, name=name, material=family) for name, s in solids.items()]
    return build_glb(parts)


_MAKES: dict[str, _Make] = {
    "chair": generators.chair,
    "table": generators.table,
    "vase": generators.vase,
    "goblet": generators.goblet,
    "lamp": generators.lamp,
    "airplane": generators.airplane,
}

FAMILIES: dict[str, Family] = {
    each.name: Family(each.name, each.numbers, each.choices, _MAKES[each.name]) for each in SKETCH_FAMILIES.values()
}
"""The families by name, in the order of the network's outputs."""
