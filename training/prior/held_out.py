"""Choose the combinations of noun and attribute that are held out of the builtin prior's training.

A prior that has seen "tall vase" and "pinched dog" may be able to draw a pinched vase. Pairs that no training picture
shows, alone or with another attribute, measure this. They are chosen by a hash of their names, so adding words does not
change the choice.

The shipped weights are warm-started from older editions, and the first was trained on every pair of its own words. A
held-out pair of its words is therefore unseen only in the later stages of the training; a pair with a word that was new
in its edition is in no training picture at all. An edition holds out every pair that the one before held out.

Needs neither torch nor numpy, like the grammar.
"""

from __future__ import annotations

import hashlib

from meshdeform.priors.builtin.vocabulary import NOUNS, PRIOR_ATTRIBUTES
from meshdeform.vocabulary.lookup import Attribute

__all__ = ["attributes_of", "held_out_pairs", "is_held_out"]

SECOND_EDITION = frozenset({"bell", "guitar", "octopus", "pig", "pineapple", "umbrella", "pinched", "handle"})
"""Words that the first edition of the weights lacked; without them, the token order is that of the first edition."""

THIRD_EDITION = frozenset({
    "anvil", "apple", "armchair", "axe", "backpack", "balloon", "banana", "barrel", "bathtub", "bear", "bed", "bench",
    "bird", "boot", "bucket", "burger", "bus", "butterfly", "cabinet", "cake", "camel", "camera", "candle", "castle",
    "chest", "chicken", "church", "corn", "cow", "crab", "crocodile", "cupcake", "deer", "desk", "dolphin", "dragon",
    "dress", "dumbbell", "flower", "frog", "ghost", "glove", "hammer", "hedgehog", "helicopter", "helmet", "igloo",
    "lighthouse", "lion", "monkey", "motorcycle", "mouse", "owl", "palm", "person", "piano", "pine", "pumpkin",
    "rhino", "robot", "shark", "sheep", "shield", "shirt", "skyscraper", "snail", "snake", "spider", "stool",
    "strawberry", "submarine", "swan", "sword", "tank", "teapot", "television", "tent", "tractor", "train",
    "trousers", "truck", "windmill", "beak", "blade", "claws", "eyes", "gun", "heel", "horns", "humps", "lens",
    "mane", "shell", "sleeves", "spikes", "spout", "tower", "wheels",
})  # fmt: skip
"""Words that the second edition lacked."""

FOURTH_EDITION = frozenset({
    "bone", "bookcase", "bread", "can", "column", "cone", "crate", "crown", "crystal", "door", "fox", "fridge",
    "gravestone", "hotdog", "jar", "log", "mug", "pan", "pillow", "plate", "potion", "scroll", "skull", "toilet",
    "torch", "van", "wolf",
})  # fmt: skip
"""Words that the third edition lacked: nouns without parts."""

_SHARE, _SHARE_SECOND = 0.09, 0.2
"""Share of the pairs that is held out; larger with words of the second edition, which has few new ones."""
_FEWEST_NOUNS = 5
"""No pair is held out for parts of fewer nouns than this."""


def attributes_of(noun: str) -> tuple[Attribute, ...]:
    """Return every attribute that a noun can have, in canonical order."""
    return tuple(attribute for attribute in PRIOR_ATTRIBUTES if attribute.part in ("whole", *NOUNS[noun]))


def is_held_out(noun: str, attribute: Attribute) -> bool:
    """Return whether this noun with this attribute is held out of the training."""
    if attribute.part != "whole" and _nouns_with(attribute.part, noun) < _FEWEST_NOUNS:
        return False
    digest = hashlib.sha256(f"{noun}: {attribute}".encode()).digest()
    share = _SHARE_SECOND if _words(noun, attribute) & SECOND_EDITION else _SHARE
    return int.from_bytes(digest[:4]) < share * 2**32


def held_out_pairs() -> tuple[tuple[str, Attribute], ...]:
    """Return all pairs that `draw_prompt` never draws, by noun."""
    return tuple(
        (noun, attribute) for noun in NOUNS for attribute in attributes_of(noun) if is_held_out(noun, attribute)
    )


def _nouns_with(part: str, noun: str) -> int:
    """Count the nouns with a part in the edition in which `noun` was new, or in the second."""
    third = noun in THIRD_EDITION
    return sum(part in parts for other, parts in NOUNS.items() if third or other not in THIRD_EDITION)


def _words(noun: str, attribute: Attribute) -> set[str]:
    return {noun, attribute.degree, attribute.part}
