"""Read names of nodes, materials and joints: "LeftForeArm.001" is an arm, on the left. Pure Python.

The last noun of a name says what it is, and words before it only which: a BackLeg is no back, and a NeckTie no neck.
"""

from __future__ import annotations

import itertools
import re
from functools import lru_cache

from meshdeform.plain.vocabulary import PART_OF, singular

_SIDES = {
    **dict.fromkeys(("left", "l", "lt"), ("left",)),
    **dict.fromkeys(("right", "r", "rt"), ("right",)),
    **dict.fromkeys(("front", "fore"), ("front",)),
    **dict.fromkeys(("rear", "back", "hind"), ("rear",)),
    "fl": ("left", "front"), "fr": ("right", "front"),
    **dict.fromkeys(("rl", "bl"), ("left", "rear")),
    **dict.fromkeys(("rr", "br"), ("right", "rear")),
}  # fmt: skip
_AT_THE_FRONT = frozenset({"bonnet", "hood", "windshield", "headlight", "headlamp"})
"""Nouns of what is at the front of a vehicle."""
_WHICH = frozenset({*_SIDES, "top", "bottom", "upper", "lower", "up", "low", "mid", "middle", "inner", "outer"})
_PREFIXES = re.compile(r"^(upper|lower|front|back|rear|fore|hind|left|right|up|low|mid)(?=[a-z]{3})")
JOINTS = {
    word: part
    for part, words in {
        "leg": "upleg upperleg lowerleg ff ffb", "thigh": "thigh", "shin": "shin calf", "foot": "foot ankle",
        "toe": "toe ball", "arm": "arm elbow", "forearm": "forearm", "hand": "hand wrist",
        "finger": "finger index pinky thumb", "shoulder": "shoulder clavicle", "hip": "hip pelvis",
        "belly": "spine torso abdomen chest waist", "eye": "eye eyebrow", "jaw": "jaw mouth tongue",
    }.items()
    for word in words.split()
}  # fmt: skip
"""The parts of words that only joints have; those of `PART_OF` are others."""
_OF_ANOTHER = frozenset({
    "tie", "band", "bag", "strap", "ring", "glove", "cover", "cap", "guard", "plate", "pad", "rest", "light", "lamp",
    "mirror", "handle", "hole", "frame", "brace", "piece", "gear", "phone", "set", "board", "stool", "belt", "arch",
    "well", "house", "box", "pack", "wear",
})  # fmt: skip
"""Nouns that make another thing of the part before them."""


_SEGMENTS = {
    "thigh": (("upper", "leg"), ("up", "leg")),
    "shin": (("lower", "leg"), ("low", "leg")),
    "forearm": (("fore", "arm"), ("lower", "arm"), ("low", "arm")),
}
"""How rigs name parts of limbs by two words."""


@lru_cache(maxsize=4096)
def tokens(name: str) -> tuple[str, ...]:
    """Return the words of a name: "LeftForeArm.001" has "left", "fore", "arm", and "l-frontleg" has "front", "leg"."""
    found = []
    for written in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name):
        word = written.lower()
        while (prefix := _PREFIXES.match(word)) and noun_part(word[prefix.end() :]) and word not in JOINTS:
            found.append(prefix[1])
            word = word[prefix.end() :]
        if found and found[-1] + word in PART_OF:  # a BackRest
            word = found.pop() + word
        found.append(singular(word))
    return tuple(found)


def is_word(token: str) -> bool:
    """Return whether a token of a name is a word, and no "Sm" or "Btn"."""
    return len(token) > 2 and bool(set(token) & set("aeiouy"))


def noun_part(word: str) -> str | None:
    """Return the part that a word of a name means, or None."""
    return JOINTS.get(singular(word)) or PART_OF.get(singular(word))


def sides_of(name: str) -> tuple[str, ...]:
    """Return the sides that a name tells: "wheel_FL" is left and front."""
    words = tokens(name)
    after = [*words[1:], ""][: len(words)]
    found = [
        side
        for word, following in zip(words, after, strict=True)
        if (word, following) != ("fore", "arm")
        for side in _SIDES.get(word, ())
    ]
    if _AT_THE_FRONT & set(words) or {"head", "light"} <= set(words):
        found.append("front")
    return tuple(dict.fromkeys(found))


def part_of(name: str) -> str | None:
    """Return the part that everybody knows and that a name says it is; None if it says another thing, or nothing."""
    words = tokens(name)
    nouns = [index for index, word in enumerate(words) if word not in _WHICH and noun_part(word)]
    if not nouns and all(word in _WHICH for word in words):  # a "Back" that is nothing else is one, and no "HatTop"
        nouns = [index for index, word in enumerate(words) if PART_OF.get(word)]
    if not nouns or any(word in _OF_ANOTHER and noun_part(word) is None for word in words[nouns[-1] + 1 :]):
        return None
    return noun_part(words[nouns[-1]])


def means(name: str, part: str) -> bool:
    """Return whether a part of a sentence, in the singular, is what a name calls its own."""
    if part_of(name) == part:
        return True
    words, asked = tokens(name), part.split()
    if any(pair in itertools.pairwise(words) for pair in _SEGMENTS.get(part, ())):
        return True
    if not set(asked) <= set(words):
        return False
    # "bigger tie" means a NeckTie; "upper arm" means an arm that is the upper one.
    last = [word for word in words if word not in _WHICH][-1:]
    return words == tuple(asked) or list(last) == asked[-1:]
