"""The combinations of a noun and an attribute that the builtin prior is never trained on.

A prior that has seen "tall vase" and "pinched dog" may know what a pinched vase is: pairs that no training picture
shows, alone or beside another attribute, measure that. Which pairs these are is a hash of their names, so the
list stays as it is when words are added.

The weights that ship are warm-started from the first edition, which was trained on every pair of its own words. A
held-out pair of old words is therefore only unseen by the second stage of the training; a pair with a new noun
or a new attribute, of which more are held out, has never been in any training picture (`unseen_pairs`).

Free of torch and numpy, as the grammar is.
"""

from __future__ import annotations

import hashlib

from meshdeform.priors.builtin.grammar import ATTRIBUTES, NOUNS, Attribute
from meshdeform.priors.builtin.vocabulary import SECOND_EDITION

__all__ = ["attributes_of", "held_out_pairs", "is_held_out", "unseen_pairs"]

_SHARE_OLD, _SHARE_NEW = 0.09, 0.2
_FEWEST_NOUNS = 5
"""A part that fewer nouns have is learned from all of them."""


def attributes_of(noun: str) -> tuple[Attribute, ...]:
    """Every attribute that a prompt can give a noun, in canonical order."""
    return tuple(attribute for attribute in ATTRIBUTES if attribute.part in ("whole", *NOUNS[noun]))


def is_held_out(noun: str, attribute: Attribute) -> bool:
    """Whether no training picture shows this noun with this attribute."""
    if attribute.part != "whole" and sum(attribute.part in parts for parts in NOUNS.values()) < _FEWEST_NOUNS:
        return False
    digest = hashlib.sha256(f"{noun}: {attribute}".encode()).digest()
    share = _SHARE_NEW if _is_new(noun, attribute) else _SHARE_OLD
    return int.from_bytes(digest[:4]) < share * 2**32


def held_out_pairs() -> tuple[tuple[str, Attribute], ...]:
    """All pairs that `draw_prompt` never draws, by noun."""
    return tuple(
        (noun, attribute) for noun in NOUNS for attribute in attributes_of(noun) if is_held_out(noun, attribute)
    )


def unseen_pairs() -> tuple[tuple[str, Attribute], ...]:
    """The held-out pairs that the first edition could not say either: no training picture ever showed them."""
    return tuple(pair for pair in held_out_pairs() if _is_new(*pair))


def _is_new(noun: str, attribute: Attribute) -> bool:
    return not SECOND_EDITION.isdisjoint((noun, attribute.degree, attribute.part))
