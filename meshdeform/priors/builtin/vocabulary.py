"""List the words of the builtin prior: nouns, attributes, parts and their synonyms.

`grammar.py` parses prompts with these tables. The order of nouns, adjectives and parts numbers the tokens, so a change
here requires new weights (a file of weights names its vocabulary).
"""

from __future__ import annotations

__all__ = [
    "ADJECTIVES",
    "ADJECTIVE_SYNONYMS",
    "DEGREE_SYNONYMS",
    "FILLERS",
    "LENGTH",
    "LENGTHWISE",
    "NOUNS",
    "NOUN_SYNONYMS",
    "OPPOSITES",
    "PARTS",
    "PART_SYNONYMS",
    "SECOND_EDITION",
    "SIZE",
    "SIZEWISE",
]

NOUNS: dict[str, tuple[str, ...]] = {
    "airplane": ("wings",),
    "bell": ("handle",),
    "boat": ("sail",),
    "bottle": ("neck",),
    "bowl": (),
    "cactus": ("arms",),
    "car": (),
    "carrot": ("leaves",),
    "cat": ("ears", "head", "tail"),
    "chair": ("back", "legs"),
    "dinosaur": ("head", "legs", "neck", "tail"),
    "dog": ("ears", "head", "legs", "tail"),
    "duck": ("head", "neck"),
    "elephant": ("ears", "legs", "trunk"),
    "fish": ("fins", "tail"),
    "giraffe": ("head", "legs", "neck"),
    "goblet": ("stem",),
    "guitar": ("neck",),
    "hat": ("brim",),
    "heart": (),
    "horse": ("head", "legs", "neck", "tail"),
    "house": ("roof",),
    "lamp": ("shade", "stem"),
    "mushroom": ("cap", "stem"),
    "octopus": ("arms", "head"),
    "pear": (),
    "penguin": ("head", "wings"),
    "pig": ("ears", "legs", "nose"),
    "pineapple": ("leaves",),
    "rabbit": ("ears", "head"),
    "rocket": ("fins",),
    "snowman": ("head", "nose"),
    "sofa": ("back",),
    "star": (),
    "table": ("legs",),
    "tree": ("trunk", "crown"),
    "turtle": ("head", "neck"),
    "umbrella": ("handle",),
    "vase": ("neck",),
    "whale": ("tail",),
}
"""Every noun with the parts whose size a prompt can set."""

ADJECTIVES: dict[str, str] = {
    "tall": "stretched upward",
    "short": "pressed downward",
    "thin": "slim all round",
    "fat": "thick all round, most at half height",
    "wide": "stretched from side to side",
    "long": "stretched from front to back",
    "flat": "pressed to a slab",
    "twisted": "turned about its upright axis",
    "leaning": "sheared to one side",
    "bent": "curved to one side",
    "tapered": "growing thinner toward the top",
    "pinched": "narrow at half height",
}
"""Attributes of the whole shape, valid for every noun, with their effects."""

LENGTH, SIZE = ("short", "long"), ("small", "big")
PARTS: dict[str, tuple[str, str]] = {
    "arms": LENGTH,
    "back": LENGTH,
    "brim": SIZE,
    "cap": SIZE,
    "crown": SIZE,
    "ears": SIZE,
    "fins": SIZE,
    "handle": LENGTH,
    "head": SIZE,
    "leaves": LENGTH,
    "legs": LENGTH,
    "neck": LENGTH,
    "nose": LENGTH,
    "roof": SIZE,
    "sail": SIZE,
    "shade": SIZE,
    "stem": LENGTH,
    "tail": LENGTH,
    "trunk": LENGTH,
    "wings": SIZE,
}
"""Every part with its two degrees, the lesser and the greater."""

NOUN_SYNONYMS = {
    "aeroplane": "airplane", "plane": "airplane", "jet": "airplane", "aircraft": "airplane",
    "handbell": "bell", "sailboat": "boat", "ship": "boat", "yacht": "boat",
    "flask": "bottle", "cup": "bowl", "dish": "bowl", "basin": "bowl",
    "automobile": "car", "kitten": "cat", "kitty": "cat", "seat": "chair",
    "dino": "dinosaur", "sauropod": "dinosaur", "brontosaurus": "dinosaur", "diplodocus": "dinosaur",
    "puppy": "dog", "hound": "dog", "bird": "duck", "duckling": "duck",
    "goldfish": "fish", "chalice": "goblet", "wineglass": "goblet", "ukulele": "guitar",
    "sunhat": "hat", "fedora": "hat", "pony": "horse", "foal": "horse", "home": "house", "hut": "house",
    "cottage": "house", "toadstool": "mushroom", "piglet": "pig", "hog": "pig", "ananas": "pineapple",
    "bunny": "rabbit", "hare": "rabbit", "spaceship": "rocket", "missile": "rocket",
    "couch": "sofa", "settee": "sofa", "starfish": "star", "desk": "table", "tortoise": "turtle",
    "parasol": "umbrella", "brolly": "umbrella", "urn": "vase",
}  # fmt: skip
ADJECTIVE_SYNONYMS = {
    "high": "tall", "low": "short", "squat": "short", "stubby": "short",
    "slim": "thin", "slender": "thin", "skinny": "thin", "narrow": "thin", "lean": "thin",
    "chubby": "fat", "plump": "fat", "thick": "fat", "stout": "fat", "round": "fat",
    "broad": "wide", "elongated": "long", "stretched": "long",
    "flattened": "flat", "squashed": "flat", "spiral": "twisted", "twisting": "twisted",
    "tilted": "leaning", "slanted": "leaning", "sloping": "leaning",
    "curved": "bent", "crooked": "bent", "bowed": "bent", "pointed": "tapered", "tapering": "tapered",
    "waisted": "pinched", "cinched": "pinched", "hourglass": "pinched",
}  # fmt: skip
DEGREE_SYNONYMS = {
    "long": "long", "tall": "long", "high": "long",
    "short": "short", "low": "short", "stubby": "short",
    "big": "big", "large": "big", "huge": "big", "giant": "big", "wide": "big", "broad": "big",
    "small": "small", "little": "small", "tiny": "small", "narrow": "small",
}  # fmt: skip
PART_SYNONYMS = {
    "arm": "arms", "tentacle": "arms", "tentacles": "arms", "branch": "arms", "branches": "arms",
    "backrest": "back", "top": "cap", "foliage": "crown", "canopy": "crown",
    "ear": "ears", "fin": "fins", "leaf": "leaves", "leg": "legs", "lampshade": "shade",
    "wing": "wings", "flippers": "wings", "stalk": "stem", "face": "head",
    "handles": "handle", "grip": "handle", "shaft": "handle", "snout": "nose",
}  # fmt: skip
LENGTHWISE = {"big": "long", "small": "short"}
SIZEWISE = {"long": "big", "short": "small"}
FILLERS = frozenset({"a", "an", "the", "and", "with", "has", "having", "that", "its", "very", "of", "some", "one"})

OPPOSITES = tuple(
    frozenset(words)
    for words in (("tall", "short"), ("tall", "flat"), ("thin", "fat"), ("thin", "wide"), ("fat", "pinched"))
)
"""Adjectives that contradict each other."""

SECOND_EDITION = frozenset({"bell", "guitar", "octopus", "pig", "pineapple", "umbrella", "pinched", "handle"})
"""Words that the first edition of the weights lacked; without them, the token order is that of the first edition."""
