"""List the words of prompts besides nouns and looks: adjectives, degrees of parts, fillers and their synonyms."""

from __future__ import annotations

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
    "horn": "horns", "antlers": "horns", "antler": "horns", "bill": "beak", "hump": "humps", "claw": "claws",
    "pincers": "claws", "wheel": "wheels", "tyres": "wheels", "tires": "wheels", "sleeve": "sleeves",
    "towers": "tower", "spire": "tower", "steeple": "tower", "turret": "tower", "turrets": "tower", "cannon": "gun",
    "spines": "spikes", "quills": "spikes", "spike": "spikes", "eye": "eyes", "heels": "heel", "sails": "sail",
}  # fmt: skip
LENGTHWISE = {"big": "long", "small": "short"}
SIZEWISE = {"long": "big", "short": "small"}
JOINING = frozenset({"and", "with", "has", "having", "that", "which", "but"})
FILLERS = JOINING | {"a", "an", "the", "is", "are", "its", "his", "her", "their", "my", "this", "of", "some", "one"}
INTENSIFIERS = frozenset(("very", "really", "extremely", "super", "quite", "rather", "slightly", "extra"))
"""Words for how much, which a prompt cannot say."""
_NUMBERS = "two three four five six seven eight nine ten twelve dozen several many few both pair couple"
NUMBERS = frozenset(_NUMBERS.split())
_PAIRS = "fries glasses grapes headphones scissors stairs trousers"
PAIRS = frozenset(_PAIRS.split())
"""Nouns in the plural that are one thing."""
_SURFACES = (
    "red blue green yellow purple pink black white grey gray brown beige golden gold silver bronze copper metal"
    " metallic steel wooden wood plastic glass marble leather rubber paper rusty shiny glossy matte painted colorful"
    " colourful striped spotted dirty transparent textured"
)
SURFACES = frozenset(_SURFACES.split())
"""Colours, materials and finishes, which an asset keeps."""

OPPOSITES = tuple(
    frozenset(words)
    for words in (("tall", "short"), ("tall", "flat"), ("thin", "fat"), ("thin", "wide"), ("fat", "pinched"))
)
"""Adjectives that contradict each other."""
