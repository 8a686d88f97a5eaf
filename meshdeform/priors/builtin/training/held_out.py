"""Choose the combinations of noun and attribute that are held out of the builtin prior's training.

A prior that has seen "tall vase" and "pinched dog" may be able to draw a pinched vase. Pairs that no training picture
shows, alone or with another attribute, measure this. They are chosen by a hash of their names, so adding words does not
change the choice.

The shipped weights are warm-started from the first edition, which was trained on every pair of its own words. A
held-out pair of old words is therefore unseen only in the second stage of the training; a pair with a new noun or a new
attribute (more of these are held out) is in no training picture at all (`unseen_pairs`).

Needs neither torch nor numpy, like the grammar.
"""

from __future__ import annotations

import hashlib

from meshdeform.priors.builtin.grammar import ATTRIBUTES, NOUNS, Attribute
from meshdeform.priors.builtin.vocabulary import SECOND_EDITION

__all__ = ["attributes_of", "held_out_pairs", "is_held_out", "unseen_pairs"]

_SHARE_OLD, _SHARE_NEW = 0.09, 0.2
_FEWEST_NOUNS = 5
"""No pair is held out for parts of fewer nouns than this."""


def attributes_of(noun: str) -> tuple[Attribute, ...]:
    """Return every attribute that a noun can have, in canonical order."""
    return tuple(attribute for attribute in ATTRIBUTES if attribute.part in ("whole", *NOUNS[noun]))


def is_held_out(noun: str, attribute: Attribute) -> bool:
    """Return whether this noun with this attribute is held out of the training."""
    if attribute.part != "whole" and sum(attribute.part in parts for parts in NOUNS.values()) < _FEWEST_NOUNS:
        return False
    digest = hashlib.sha256(f"{noun}: {attribute}".encode()).digest()
    share = _SHARE_NEW if _is_new(noun, attribute) else _SHARE_OLD
    return int.from_bytes(digest[:4]) < share * 2**32


def held_out_pairs() -> tuple[tuple[str, Attribute], ...]:
    """Return all pairs that `draw_prompt` never draws, by noun."""
    return tuple(
        (noun, attribute) for noun in NOUNS for attribute in attributes_of(noun) if is_held_out(noun, attribute)
    )


def unseen_pairs() -> tuple[tuple[str, Attribute], ...]:
    """Return the held-out pairs outside the first edition's vocabulary, which no training picture ever showed."""
    return tuple(pair for pair in held_out_pairs() if _is_new(*pair))


def _is_new(noun: str, attribute: Attribute) -> bool:
    return not SECOND_EDITION.isdisjoint((noun, attribute.degree, attribute.part))
