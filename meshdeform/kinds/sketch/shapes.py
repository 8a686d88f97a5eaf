"""Make shapes of nouns by sliders: kind, variant, pose, the sizes of parts, and the three sides of the whole.

Words of somebody's own (`meshdeform.words`) are shapes of theirs, with fewer sliders.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from meshdeform.assets import Primitive, build_glb
from meshdeform.errors import ParameterError
from meshdeform.kinds.sketch.sliders import Choice, Number, Sliders
from meshdeform.nouns.forms import drawn, own_forms, settable
from meshdeform.nouns.labels import LabelledMember
from meshdeform.nouns.poses import POSES, posed
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS, SYNONYMS
from meshdeform.vocabulary.solids import PART_NAMES
from meshdeform.words.in_use import own_word, parts_to_set, words_in_use
from meshdeform.words.members import word_member

__all__ = ["PLAIN", "VARIANTS", "described", "known_noun", "nouns", "shape", "shape_glb", "sliders_of"]

VARIANTS = 8
"""Members of each kind that there are to choose among."""
PLAIN = "plain"
"""The pose that a kind is drawn in, also where it cannot take another one."""
_SIDES = ("width", "height", "depth")
_LOW, _HIGH = 0.5, 2.0
_NOTED = 1 / 3
"""Size from which on a part of a word is longer or shorter: it has no sizes between."""


def nouns() -> list[str]:
    """Return all nouns that have shapes, words of somebody's own first."""
    own = [each.noun for each in words_in_use()]
    return own + [each for each in sorted(NOUNS) if each not in own]


def known_noun(name: str) -> str:
    """Return the noun of a name.

    Raises
    ------
    ParameterError
        There is none of that name.
    """
    plain = name.strip().lower().replace(" ", "-")
    if own_word(plain) is not None or plain in NOUNS:
        return plain
    if plain not in SYNONYMS:
        raise ParameterError(f"There is no noun {name!r}.", advice="See docs/nouns.md for those that there are.")
    return SYNONYMS[plain]


@lru_cache(maxsize=1024)
def _sliders(noun: str) -> Sliders:
    forms = own_forms(noun, ())
    poses = POSES.get(noun, ())
    parts = sorted({part for form in forms for part in settable(form)})
    choices = [Choice("kind", forms), Choice("variant", tuple(str(number + 1) for number in range(VARIANTS)))]
    if poses:
        choices.append(Choice("pose", (PLAIN, *poses)))
    return Sliders(noun, _numbers(parts), tuple(choices))


def _numbers(parts: list[str]) -> tuple[Number, ...]:
    sides = [Number(side, _LOW, _HIGH, 1.0) for side in _SIDES]
    return (*sides, *(Number(part, -1.0, 1.0, 0.0) for part in parts))


def sliders_of(noun: str) -> Sliders:
    """Return the sliders of a noun; those of parts go from -1, the least, to 1, those of sides are factors."""
    word = own_word(noun)
    if word is None:
        return _sliders(noun)
    count = tuple(str(number + 1) for number in range(len(word.sources)))
    return Sliders(noun, _numbers(sorted(parts_to_set(word))), (Choice("variant", count),))


def described(noun: str, values: Mapping[str, object]) -> list[dict[str, object]]:
    """Return the sliders of a noun with their values, defaults, and ranges or options, as documents have them."""
    sliders = sliders_of(noun)
    every = sliders.checked(values)
    found: list[dict[str, object]] = [
        {"name": each.name, "value": every[each.name], "default": each.default, "options": list(each.options)}
        for each in sliders.choices
    ]
    for number in sliders.numbers:
        about = {"default": number.default, "minimum": number.low, "maximum": number.high}
        found.append({"name": number.name, "value": every[number.name], **about})
    return found


def shape(noun: str, values: Mapping[str, object]) -> LabelledMember:
    """Return a shape with the parts of its faces; sliders left out have their default.

    Raises
    ------
    ParameterError
        A name is unknown, or a value is out of range.
    """
    every = sliders_of(noun).checked(values)
    variant = int(every["variant"])
    sizes = {name: float(value) for name, value in every.items() if name in PARTS}
    word = own_word(noun)
    if word is None:
        member = drawn(str(every["kind"]), (), np.random.default_rng([variant, 71]), sizes)
        pose = every.get("pose", PLAIN)
        if pose in POSES.get(str(every["kind"]), ()):
            member = posed(member, str(pose), np.random.default_rng([variant, 73]))
    else:
        noted = [Attribute(part, PARTS[part][size > 0]) for part, size in sizes.items() if abs(size) > _NOTED]
        member = word_member(word, variant - 1, noted)
    return member.moved(member.verts * [float(every[side]) for side in _SIDES])


def shape_glb(noun: str, values: Mapping[str, object]) -> bytes:
    """Return a shape as a GLB, a node for each of its parts; raises as `shape`."""
    made = shape(noun, values)
    nodes = []
    for label in np.unique(made.labels):
        used, faces = np.unique(made.faces[made.labels == label], return_inverse=True)
        nodes.append(Primitive(made.verts[used], faces.reshape(-1, 3), name=PART_NAMES[label], material=noun))
    return build_glb(nodes)
