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
from meshdeform.nouns.families import parts
from meshdeform.nouns.families.parts import Part
from meshdeform.nouns.families.sketches import SKETCHES
from meshdeform.nouns.families.traits import Traits
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS

__all__ = ["FAMILIES", "KINDS", "Family", "Part", "Traits", "member"]

Family = Callable[[np.random.Generator, Traits], Part]

_SUBJECTS = (
    "animal_kinds animals beasts birds breeds buildings characters clothing dungeon figure_kinds figures food "
    "furniture household insects kitchen marine reptiles small tools vehicles wildlife winged"
)
_MODULES = [import_module(f"{__name__}.{subject}") for subject in _SUBJECTS.split()]


def _kinds_of(module: ModuleType) -> Mapping[str, tuple[Family, ...]]:
    kinds: Mapping[str, tuple[Family, ...]] = getattr(module, "KINDS", {})
    return kinds


_DRAWN: dict[str, Family] = {
    **{
        name: draw
        for module in _MODULES
        for name, draw in vars(module).items()
        if name in NOUNS and draw is not vars(parts).get(name)
    },
    **{
        f"{noun}/{draw.__name__.replace('_', '-')}": draw
        for module in _MODULES
        for noun, kinds in _kinds_of(module).items()
        for draw in kinds
    },
    **SKETCHES,
}
"""All families by `noun` or `noun/kind`."""
FAMILIES: dict[str, Family] = {noun: _DRAWN[noun] for noun in sorted(_DRAWN) if "/" not in noun}
"""The family of each noun that has one, by the alphabet."""
KINDS: dict[str, dict[str, Family]] = {noun: {} for noun in FAMILIES}
"""Other kinds of a noun, by name: a `steam-train` is a kind of train. A module lists its kinds in its own `KINDS`."""
for _noun, _, _kind in (title.partition("/") for title in _DRAWN):
    if _kind and _noun in KINDS:
        KINDS[_noun][_kind] = _DRAWN[f"{_noun}/{_kind}"]


def member(noun: str, attributes: Iterable[Attribute], rng: np.random.Generator) -> Part:
    """Draw a random member of a family with the given attributes.

    Returns
    -------
    Part
        Closed parts, oriented outward, +Y up, facing +Z, centred, farthest vertex at distance 1.
    """
    names = tuple(attributes)
    return deformed(FAMILIES[noun](rng, Traits(names)), names, rng)
