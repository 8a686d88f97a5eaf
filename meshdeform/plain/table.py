"""Say what each word does to each kind of part: one table, which `docs/plain.md` shows. Pure Python.

A row is a kind of part, a column an operation, and the entry the direction in which the part grows, in its own axes:

    up        +Y                         side    from side to side of the asset
    front     along its front            level   side and front
    along     the part's own axis        girth   both directions across it
    axle      of a wheel                 all     all three
    place     it is moved up, as it is   shape   the whole is twisted, bent, ...

What the table lacks is refused, with what the kind has. Some words mean another operation of their kind: `READ_AS`.
"""

from __future__ import annotations

WHOLE = "whole"
"""The part of a change of everything."""

SHAPES = frozenset({"tapered", "twisted", "leaning", "bent", "pinched"})
"""Operations whose factor is a strength, 1 as usual, and no ratio of lengths."""

TABLE: dict[str, dict[str, str]] = {
    WHOLE: {
        "tall": "up", "wide": "side", "deep": "front", "long": "along", "big": "all", "fat": "girth",
        **dict.fromkeys(sorted(SHAPES), "shape"),
    },
    "leg": {"long": "along", "fat": "girth", "big": "all"},
    "arm": {"long": "along", "fat": "girth", "big": "all"},
    "neck": {"long": "along", "fat": "girth", "big": "all"},
    "tail": {"long": "along", "fat": "girth", "big": "all"},
    "limb": {"long": "along", "fat": "girth", "big": "all", "tall": "up", "wide": "side", "deep": "front"},
    "head": {"big": "all", "tall": "up", "wide": "side", "deep": "front", "fat": "level"},
    "hand": {"big": "all", "long": "along", "fat": "girth", "tall": "up", "wide": "side"},
    "belly": {"fat": "girth", "wide": "side"},
    "shoulder": {"wide": "side", "big": "all"},
    "wheel": {"big": "all", "wide": "axle"},
    "slab": {"tall": "up", "wide": "side", "deep": "front", "long": "along", "big": "level", "high": "place"},
    "back": {"tall": "up", "wide": "side", "fat": "front"},
    "roof": {"tall": "up", "wide": "side", "deep": "front", "big": "all"},
    "base": {"fat": "level"},
    "thing": {"big": "all", "tall": "up", "wide": "side", "deep": "front", "long": "along", "fat": "girth"},
}  # fmt: skip
"""The direction of each operation on each kind of part."""

_LONG_THINGS = (
    "ear", "horn", "tusk", "nose", "beak", "finger", "wing", "fin", "handle", "stem", "branch", "trunk", "spout",
    "spike", "mast", "gun", "blade", "exhaust", "fork", "leaf",
)  # fmt: skip
KINDS = {
    "leg": "leg", "arm": "arm", "neck": "neck", "tail": "tail", "head": "head", "belly": "belly", "wheel": "wheel",
    "seat": "slab", "top": "slab", "back": "back", "roof": "roof", "base": "base",
    **dict.fromkeys(("shoulder", "hip"), "shoulder"),
    **dict.fromkeys(("hand", "foot", "eye", "hair", "claw"), "hand"),
    **dict.fromkeys(_LONG_THINGS, "limb"),
    **dict.fromkeys(("thigh", "shin", "forearm", "upper arm", "lower arm", "upper leg", "lower leg", "toe"), "limb"),
}  # fmt: skip
"""The kind of each part that has a row; any other is a `thing`."""

READ_AS: dict[str, dict[str, str]] = {
    WHOLE: {"high": "tall", "short": "tall"},
    **{kind: {"tall": "long", "short": "long", "wide": "fat"} for kind in ("leg", "arm", "neck", "tail")},
    **{kind: {"short": "long"} for kind in ("limb", "hand", "thing")},
    "head": {"short": "tall"},
    "belly": {"big": "fat"},
    "shoulder": {"fat": "wide"},
    "wheel": {"fat": "wide", "tall": "big", "short": "big"},
    "slab": {"fat": "tall", "short": "long"},
    "back": {"long": "tall", "short": "tall", "big": "tall", "high": "tall"},
    "roof": {"high": "tall", "short": "tall", "steep": "tall", "fat": "tall"},
    "base": {"wide": "fat", "big": "fat"},
}
"""Operations that another word stands for: the "tall legs" of the left are long ones."""

_USUAL_OPERATION = {"leg": "long", "arm": "long", "neck": "long", "tail": "long", "belly": "fat", "back": "tall"}

OF_PARTS = {
    "long": ("longer", "shorter"), "big": ("bigger", "smaller"), "tall": ("taller", "flatter"),
    "wide": ("wider", "narrower"), "fat": ("thicker", "thinner"), "deep": ("deeper", "shallower"),
    "high": ("higher", "lower"),
}  # fmt: skip
"""The operations on parts, each with the words for more and for less of it."""


def kind_of(part: str) -> str:
    """Return the kind of a part, `thing` of a name that only the file knows."""
    return WHOLE if part == WHOLE else KINDS.get(part, "thing")


def meaning(operation: str, part: str) -> str:
    """Return the operation that a word for one stands for on a part; an empty one is what an amount alone means."""
    kind = kind_of(part)
    operation = operation or _USUAL_OPERATION.get(kind, "big")
    return READ_AS.get(kind, {}).get(operation, operation)


def direction(operation: str, part: str) -> str | None:
    """Return the direction of an operation on a part; None if the table lacks it."""
    return TABLE[kind_of(part)].get(operation)


def possible(part: str) -> list[str]:
    """Return the words for more of what the kind of a part has: "longer", "thicker"."""
    return [OF_PARTS[each][0] for each in OF_PARTS if each in TABLE[kind_of(part)]]
