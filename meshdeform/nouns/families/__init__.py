"""Draw members of the families, which are functions that generate a random mesh for a noun.

`member(noun, attributes, rng)` is the interface of the dataset; the same generator state gives the same mesh. Importing
this needs numpy but no torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from types import ModuleType

import numpy as np

from meshdeform.nouns.deformed import deformed
from meshdeform.nouns.families.blueprints import BLUEPRINTS
from meshdeform.nouns.families.parts import Part
from meshdeform.nouns.families.sketches import SKETCHED_KINDS, SKETCHES
from meshdeform.nouns.families.traits import Traits
from meshdeform.vocabulary.grammar import Attribute

__all__ = ["FAMILIES", "KINDS", "Family", "Part", "Traits", "member"]

Family = Callable[[np.random.Generator, Traits], Part]

_SUBJECTS = (
    "animal_kinds animals beasts birds breeds bridges buildings characters clothing creatures dungeon figure_kinds "
    "figures food furniture hoofed household insects kitchen marine monsters movers plants prowlers reptiles rooms "
    "sitters small swimmers things tools vehicles wheeled winged"
)


def _kinds_of(module: ModuleType) -> Mapping[str, tuple[Family, ...]]:
    kinds: Mapping[str, tuple[Family, ...]] = getattr(module, "KINDS", {})
    return kinds


_MODULES = [import_module(f"{__name__}.{subject}") for subject in _SUBJECTS.split()]
_WRITTEN: dict[str, Family] = {name: getattr(module, name) for module in _MODULES for name in module.__all__}
_BY_BLUEPRINT = {title: each for title, each in BLUEPRINTS.items() if "/" not in title}
FAMILIES: dict[str, Family] = dict(sorted((_WRITTEN | SKETCHES | _BY_BLUEPRINT).items()))
"""The family of each noun that has one, by the alphabet."""
KINDS: dict[str, dict[str, Family]] = {
    noun: {draw.__name__.replace("_", "-"): draw for module in _MODULES for draw in _kinds_of(module).get(noun, ())}
    | {kind: draw for (of, kind), draw in SKETCHED_KINDS.items() if of == noun}
    | {title.split("/")[1]: each for title, each in BLUEPRINTS.items() if title.startswith(f"{noun}/")}
    for noun in FAMILIES
}
"""Other kinds of a noun, by name: a `steam-train` is a kind of train. A module lists its kinds in its own `KINDS`."""


def member(noun: str, attributes: Iterable[Attribute], rng: np.random.Generator) -> Part:
    """Draw a random member of a family with the given attributes.

    Returns
    -------
    Part
        Closed parts, oriented outward, +Y up, facing +Z, centred, farthest vertex at distance 1.
    """
    names = tuple(attributes)
    return deformed(FAMILIES[noun](rng, Traits(names)), names, rng)
