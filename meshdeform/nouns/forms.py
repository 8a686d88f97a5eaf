"""Draw a noun in forms that its family does not have: a bear on four legs, a bird that stands, any animal on four legs.

`FORMS` says of which families and forms the members of a noun may be; `drawn` draws one, with labels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from meshdeform.nouns.deformed import deformed
from meshdeform.nouns.families import KINDS, Part, Traits
from meshdeform.nouns.families.traits import Rng
from meshdeform.nouns.labels import LabelledMember, labelled, labelled_member, labelled_solids, solids_of
from meshdeform.nouns.upright import on_hind_legs, two_legged
from meshdeform.nouns.variants import (
    desk_chair,
    great_cat,
    office_chair,
    quadruped,
    standing_bear,
    standing_bird,
    standing_cat,
    standing_rabbit,
)
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, TABLE
from meshdeform.vocabulary.solids import SolidRange

__all__ = ["FORMS", "GENERAL", "drawn", "is_able", "other_kinds", "own_forms", "settable"]


_DRAWN: dict[str, tuple[Callable[[Rng, Traits], Part], str]] = {
    "quadruped": (quadruped, "body leg leg leg leg neck head nose ear ear tail"),
    "standing-bear": (standing_bear, "body leg leg leg leg neck head nose ear ear"),
    "great-cat": (great_cat, "body leg leg leg leg neck head nose ear ear tail"),
    "standing-cat": (standing_cat, "body leg leg leg leg neck head nose ear ear tail"),
    "office-chair": (office_chair, "seat back leg leg leg leg leg leg"),
    "desk-chair": (desk_chair, "seat back leg leg leg leg leg leg arm arm arm arm"),
    "standing-bird": (standing_bird, "body neck head beak tail wing wing leg leg foot foot"),
    "standing-rabbit": (standing_rabbit, "body head nose ear ear arm arm leg leg foot foot tail"),
}

_KINDS = {kind: (noun, draw) for noun, kinds in KINDS.items() for kind, draw in kinds.items()}

_FORMS: dict[str, tuple[str, ...]] = {
    **{noun: (noun, "quadruped") if "four-legged" in row.traits else (noun,) for noun, row in TABLE.items()},
    "bear": ("standing-bear", "quadruped", "bear"),
    "bird": ("bird", "standing-bird"),
    "cat": ("cat", "standing-cat", "great-cat", "quadruped"),
    "chair": ("chair", "office-chair", "armchair", "stool", "desk-chair"),
    "chicken": ("chicken", "standing-bird"),
    "duck": ("duck", "standing-bird"),
    "lion": ("lion", "great-cat", "quadruped"),
    "van": ("van", "truck"),
}
FORMS: dict[str, tuple[str, ...]] = {
    noun: forms if "plain" in TABLE[noun].traits else (*forms, *KINDS.get(noun, ())) for noun, forms in _FORMS.items()
}
"""The families, forms and kinds of the members by which parts are read. Those of plain nouns are read without their
kinds (`other_kinds`): among members of many, a plain dog lost its head and its neck."""
GENERAL = frozenset(("quadruped", "standing-bird", "great-cat", "standing-cat"))
"""Forms that several nouns share: how near they are says nothing of the noun."""
_TRAITS = {
    "desk-chair": ("back", "legs"),
    "office-chair": ("back", "legs"),
    "standing-bear": ("ears", "head", "legs"),
    "standing-bird": ("beak", "tail", "wings"),
    "standing-cat": ("ears", "head", "tail"),
    "standing-rabbit": ("ears", "head"),
}
"""The parts whose size a form can set."""
_UPRIGHT = {"upright-bear": "standing-bear", "upright-cat": "standing-cat"} | {
    f"upright-{noun}": noun for noun in ("cow", "deer", "dog", "elephant", "fox", "horse", "lion", "pig", "wolf")
}
"""Forms on their hind legs, and what is stood up."""
_ALSO = {
    "bear": ("upright-bear",),
    "bird": ("standing-bird",),
    "cat": ("standing-cat", "upright-cat"),
    "dragon": ("two-legged-dragon",),
    "rabbit": ("standing-rabbit",),
} | {noun: (form,) for form, noun in _UPRIGHT.items()}
"""Forms that look like a noun, and by which assets are not read."""


def other_kinds(noun: str) -> tuple[str, ...]:
    """Return the kinds by which an asset is known as a noun, while its parts are read without them."""
    return tuple(KINDS[noun]) if "plain" in TABLE[noun].traits else ()


def own_forms(noun: str, attributes: Iterable[Attribute]) -> tuple[str, ...]:
    """Return the family and the forms whose members look like a noun and can have the attributes."""
    wanted = tuple(attributes)
    own = [form for form in FORMS[noun] if form in _DRAWN and form not in GENERAL]
    others = (*own, *KINDS.get(noun, ()), *_ALSO.get(noun, ()))
    return (noun, *(form for form in others if is_able(form, wanted)))


def is_able(form: str, attributes: Iterable[Attribute]) -> bool:
    """Return whether members of a family or a form have attributes with which they are drawn."""
    return {attribute.part for attribute in attributes} - {"whole"} <= set(settable(form))


def settable(form: str) -> tuple[str, ...]:
    """Return the parts of a family or a form whose size can be set, by the alphabet."""
    base = _base(form)
    if form in _KINDS:
        return tuple(sorted(_settable(form)))
    return tuple(sorted(_TRAITS.get(base, ()) if base in _DRAWN else NOUNS[base]))


@cache
def _settable(kind: str) -> set[str]:
    """Return the parts whose size a kind draws."""
    traits = Traits()
    _KINDS[kind][1](np.random.default_rng(0), traits)
    return traits.asked


def _base(form: str) -> str:
    return "dragon" if form == "two-legged-dragon" else _UPRIGHT.get(form, form)


def drawn(
    form: str, attributes: Iterable[Attribute], rng: np.random.Generator, sizes: Mapping[str, float] | None = None
) -> LabelledMember:
    """Draw a labelled member of a family or a form; a form without parts of an attribute's name leaves it out.

    `sizes`: as for `Traits`.
    """
    wanted = tuple(attributes)
    base = _base(form)
    if base != form:
        return _stood(form, base, wanted, rng, sizes)
    traits = Traits(wanted, sizes)
    if form in _KINDS:
        noun, family = _KINDS[form]
        return replace(labelled(noun, deformed(family(rng, traits), wanted, rng)), noun=form)
    if form not in _DRAWN:
        return labelled_member(form, wanted, rng, traits)
    draw, names = _DRAWN[form]
    shape = deformed(draw(rng, traits), wanted, rng)
    return labelled_solids(form, shape, [(SolidRange(0, name),) for name in names.split()], solids_of(shape))


def _stood(
    form: str,
    base: str,
    attributes: tuple[Attribute, ...],
    rng: np.random.Generator,
    sizes: Mapping[str, float] | None,
) -> LabelledMember:
    """Draw a member on its hind legs; what is tall or fat is so as it stands."""
    member = drawn(base, [each for each in attributes if each.part != "whole"], rng, sizes)
    member = on_hind_legs(member, rng) if form in _UPRIGHT else two_legged(member)
    return replace(member, noun=form, verts=deformed(Part(member.verts, member.faces), attributes, rng).verts)
