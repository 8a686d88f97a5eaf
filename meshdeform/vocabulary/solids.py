"""Name the closed solids of which the members of each family consist.

A family names its solids as it draws them (`families.parts.named`), or joins them always in the same order, and then
one line a noun names them all::

    name       one solid                 body/9/neck    one solid whose faces from its 9th ring on are a neck
    name*4     the next four             name*          the next ones as long as they have as many faces as the first

Layouts of a noun whose kinds differ stand one after the other, divided by `|`; the first that all solids fit counts.

A solid is made of rings, from the first point of its profile, path or depth to the last (`families/parts.py`); its
faces between rings k and k + 1 are in ring k.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from meshdeform.vocabulary.nouns import TABLE

__all__ = [
    "CARRIED_BY",
    "LAYOUTS",
    "PART_NAMES",
    "SolidRange",
    "layout",
    "parent_of",
    "part_label",
    "parts_of",
    "pieces_of",
    "usual_parts_of",
]

_ON_LEGS = "body leg*4"

LAYOUTS: dict[str, str] = {
    "anvil": "base body*2 horn body",
    "apple": "body stem leaf",
    "axe": "blade handle",
    "balloon": "body rope basket*2",
    "banana": "body stem",
    "barrel": "body hoop*4",
    "bathtub": "body leg*4 tap",
    "bell": "body clapper*2 handle*2",
    "bird": "body neck head beak tail wing*2",
    "boat": "body mast sail",
    "bone": "body knob*4",
    "bookcase": (
        "back body*2 shelf book* shelf book* shelf book* shelf"
        " | back body*2 shelf book* shelf book* shelf book* shelf book* shelf"
    ),
    "boot": "shaft foot sole heel",
    "bottle": "body/11/neck",
    "bowl": "body",
    "bread": "body | body cut*4",
    "bucket": "body handle*3",
    "burger": "bun patty cheese lettuce bun seed*9",
    "butterfly": "body head feeler*2 wing*4",
    "cake": "plate body*2 icing*2 candle*5",
    "camel": f"{_ON_LEGS} hump*2 neck head ear*2 tail",
    "camera": "body finder lens grip button*2",
    "can": "body",
    "candle": "dish body handle body*5 wick flame",
    "car": "body cabin wheel*4",
    "carrot": "body leaf*4",
    "castle": "tower*28 body*13 door*3 keep",
    "cat": "body*2 leg*2 foot*2 head nose ear*2 tail eye*2",
    "chest": "body lid lid body lid body lock",
    "chicken": "body neck head crest*3 beak wattle tail*3 wing*2 leg*2 foot*6",
    "column": "body base | body base top | body base top*3",
    "cone": "base body",
    "corn": "body stem leaf*4",
    "cow": f"{_ON_LEGS} body neck head nose ear*2 horn*2 tail*2",
    "crab": "body eye*4 leg*6 arm*2 claw*6",
    "crate": "body frame*12 plank*",
    "crocodile": "body tail head nose*2 eye*2 leg*4 spike*7",
    "crown": "body/5/point/10/body jewel* | body/5/point/10/body jewel* cap*6",
    "crystal": "body | base body*",
    "cupcake": "base cream cherry",
    "deer": f"{_ON_LEGS} neck head ear*2 horn*6 tail",
    "dinosaur": "leg*4 tail/20/body/36/neck head",
    "dog": f"{_ON_LEGS} neck head nose ear*2 tail",
    "dolphin": "body nose*2 eye*2 fin tail*2 fin*2",
    "door": "body knob body*4 band*2 | body knob frame*3 panel*",
    "dragon": f"{_ON_LEGS} neck head horn*2 eye*2 tail*2 spike*4 wing*2",
    "dress": "skirt/12/body body sleeve*2 bow*2",
    "elephant": f"{_ON_LEGS} head trunk ear*2 tusk*2 tail",
    "fish": "body tail*2 fin*4 eye*2",
    "flower": "stem head* leaf*2",
    "fox": f"{_ON_LEGS} neck head nose head*2 ear*2 tail",
    "fridge": "body base door handle door handle | body base door*2 handle*2 panel",
    "frog": "body head eye*2 leg*6 foot*12",
    "ghost": "body eye*2 mouth arm*2",
    "giraffe": f"{_ON_LEGS} neck head horn*2 tail",
    "glove": "body finger*4 thumb cuff",
    "goblet": "base/4/stem/10/body",
    "gravestone": "base body cross*2 line*2 | base cross*2 base | base cross*3 base",
    "guitar": "body bridge hole neck head peg*6",
    "hat": "body/1/brim/5/body",
    "heart": "body",
    "hedgehog": "body spike*23 nose*2 eye*2 foot*4",
    "helmet": "body base body*3 plume",
    "horse": f"{_ON_LEGS} neck head ear*2 tail",
    "hotdog": "bun*2 sausage sauce",
    "igloo": "body door",
    "jar": "body/13/neck/15/lid | body/13/neck/15/lid lid",
    "lion": f"{_ON_LEGS} neck mane head nose ear*2 tail*2",
    "log": "body branch",
    "monkey": "body head nose eye*2 ear*2 arm*2 hand*2 leg*2 foot*2 tail",
    "mouse": "body head nose ear*2 foot*4 tail",
    "mug": "body handle*2",
    "mushroom": "stem/4/cap",
    "octopus": "body head*2 eye*2 arm*8",
    "owl": "body head eye*4 beak ear*2 wing*2 foot*4 tail",
    "palm": "trunk leaf* nut*3",
    "pan": "body handle",
    "pear": "body stem",
    "person": "body neck head nose arm*2 hand*2 leg*2 foot*2",
    "pig": f"{_ON_LEGS} head nose ear*2 tail",
    "pillow": "body | body button*2",
    "pine": "trunk crown*",
    "pineapple": "body leaf*11",
    "potion": "body/13/neck/19/lid",
    "pumpkin": "body stem",
    "rhino": f"{_ON_LEGS} head horn*2 ear*2 tail",
    "rocket": "body/10/nose fin*4",
    "scroll": "roller band body seal | body text*3 roller*2",
    "shark": "body tail*2 fin*4 eye*2",
    "sheep": "body*24 leg*4 head*2 ear*2",
    "shield": "body rim cross*2 boss",
    "shirt": "body*2 sleeve*2 collar*3 body button*3",
    "skull": "body*2 cheek*2 tooth*4 | body*2 cheek*2 tooth*4 jaw tooth*3",
    "skyscraper": "body*27 top*9 mast",
    "snail": "body shell*2 head*2 eye*4",
    "snake": "body/70/neck body head*2 eye*2",
    "spider": "body*2 head eye*2 fang*2 leg*8",
    "star": "body",
    "strawberry": "body stem leaf*6",
    "submarine": "body tower periscope fin*4 propeller*5 window*8",
    "swan": "body tail neck head beak wing*2",
    "sword": "blade guard handle*2",
    "teapot": "body lid*2 spout handle*2",
    "tent": "body*3 door*2 pole*5",
    "toilet": "body*2 tank*2 button lid",
    "torch": (
        "handle/3/head head*2 flame*5 | handle/3/head head*2 handle*2 flame*5"
        " | handle/3/head head flame*5 | handle/3/head head handle*2 flame*5"
    ),
    "trousers": "body belt leg*2 belt body pocket*2",
    "truck": "body load cabin*3 bumper cabin*4 load*5 wheel*6 lamp*2",
    "turtle": "shell*2 leg*4 neck head tail",
    "umbrella": "canopy handle canopy",
    "van": "body window body roof window* wheel*4 bumper*2 lamp*2",
    "vase": "body/11/neck",
    "wolf": f"{_ON_LEGS} neck head nose mane*6 ear*2 tail",
}
"""The parts of the solids of each noun, in the order in which its family joins them."""

_CARRIES = {
    "arm": "claw hand shield staff weapon",
    "axle": "sail",
    "body": "bridge hole tower wick",
    "door": "knob",
    "head": (
        "beak beard cheek crest ear eye fang feeler flame hair halo hat horn jaw mane mouth nose peg plume tooth trunk"
        " tusk visor wattle"
    ),
    "icing": "candle",
    "leg": "foot heel sole",
    "neck": "head lid",
    "roof": "chimney",
    "sleeve": "cuff",
    "stem": "leaf shade",
    "tower": "cross lantern periscope",
    "trunk": "crown nut stem",
    "turret": "gun",
}
CARRIED_BY: dict[str, str] = {part: above for above, parts in _CARRIES.items() for part in parts.split()}
"""The part with which another moves, if the noun has it."""


class SolidRange(NamedTuple):
    """Faces of one solid from a ring on that are of one part."""

    ring: int
    part: str


def part_label(part: str) -> str:
    """Return the label of a part that a prompt names: `leg` of `legs`."""
    irregular = {"leaves": "leaf", "lens": "lens"}
    return irregular.get(part, part.removesuffix("s"))


def parent_of(part: str, present: Sequence[str]) -> str | None:
    """Return the part, among those present, with which another moves: the body in the end; None of a body."""
    above = CARRIED_BY.get(part)
    while above is not None and above not in present:
        above = CARRIED_BY.get(above)
    if above is None and part != "body" and "body" in present:
        return "body"
    return above


def layout(noun: str, face_counts: Sequence[int]) -> list[tuple[SolidRange, ...]]:
    """Return the pieces of each solid of a member, by the numbers of faces of its solids.

    Raises
    ------
    ValueError
        No layout of the noun has so many solids.
    """
    for line in LAYOUTS[noun].split("|"):
        pieces = _fitted(line.split(), face_counts)
        if pieces is not None:
            return pieces
    raise ValueError(f"no layout of {noun} has {len(face_counts)} solids")


def _fitted(words: Sequence[str], face_counts: Sequence[int]) -> list[tuple[SolidRange, ...]] | None:
    """Return the pieces of each solid in one layout, or None if it has another number of solids."""
    pieces: list[tuple[SolidRange, ...]] = []
    for word in words:
        name, star, times = word.partition("*")
        if len(pieces) >= len(face_counts):
            return None
        count = int(times or 1)
        if star and not times:
            rest = face_counts[len(pieces) :]
            count = next((k for k, faces in enumerate(rest) if faces != rest[0]), len(rest))
        pieces += [pieces_of(name)] * count
    return pieces if len(pieces) == len(face_counts) else None


def pieces_of(word: str) -> tuple[SolidRange, ...]:
    """Return the pieces of one solid: `base/4/stem` is a base, and a stem from its 4th ring on."""
    names, rings = word.split("/")[::2], word.split("/")[1::2]
    return tuple(SolidRange(int(ring), name) for ring, name in zip(["0", *rings], names, strict=True))


_NAMES: dict[str, list[frozenset[str]]] = {
    noun: [
        frozenset(piece.part for word in line.split() for piece in pieces_of(word.partition("*")[0]))
        for line in lines.split("|")
    ]
    for noun, lines in LAYOUTS.items()
} | {
    noun: [
        frozenset(name.rstrip("?") for name in row.solids),
        frozenset(name for name in row.solids if not name.endswith("?")),
    ]
    for noun, row in TABLE.items()
    if row.solids
}
"""The parts of members of each noun, by the ways in which they differ."""
PART_NAMES: tuple[str, ...] = tuple(sorted(frozenset().union(*(names for own in _NAMES.values() for names in own))))
"""Every part, by the alphabet; labels of faces are places in this list."""


def parts_of(noun: str) -> frozenset[str]:
    """Return the parts that members of a noun have; none if there is no such noun."""
    return frozenset().union(*_NAMES.get(noun, []))


def usual_parts_of(noun: str) -> frozenset[str]:
    """Return the parts that all members of a noun have; none if there is no such noun."""
    own = _NAMES.get(noun, [])
    return own[0].intersection(*own) if own else frozenset()
