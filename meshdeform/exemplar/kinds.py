"""What kind of thing a noun is: whether it lives, is built of level boards, or is turned on a lathe.

A word of somebody's own is what the noun is that it is like.
"""

from __future__ import annotations

from meshdeform.vocabulary.nouns import NOUN_GROUPS, ROUND, nouns_with
from meshdeform.words.in_use import like_of

__all__ = ["is_boxed", "is_built", "is_figure", "is_living", "is_tower", "is_turned"]

_LIVING = frozenset((*NOUN_GROUPS["animals"], *NOUN_GROUPS["figures"]))
_BUILT = nouns_with("built")
_BOXED = nouns_with("boxed")
_TOWERS = nouns_with("tower")


def is_living(noun: str) -> bool:
    """Return whether a noun is an animal or a figure, whose limbs turn and bend."""
    return like_of(noun) in _LIVING


def is_figure(noun: str) -> bool:
    """Return whether a noun stands upright, as people do."""
    return like_of(noun) in NOUN_GROUPS["figures"]


def is_built(noun: str) -> bool:
    """Return whether what is level and upright of a noun stays so."""
    return like_of(noun) in _BUILT


def is_boxed(noun: str) -> bool:
    """Return whether a noun is furniture of boards and boxes."""
    return like_of(noun) in _BOXED


def is_turned(noun: str) -> bool:
    """Return whether a noun is alike from all four sides."""
    return like_of(noun) in ROUND


def is_tower(noun: str) -> bool:
    """Return whether a noun is a tall body about one upright axis, known by its outline and not by its parts."""
    return like_of(noun) in _TOWERS
