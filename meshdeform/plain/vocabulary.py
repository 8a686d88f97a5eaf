"""List the words of changes: adjectives, verbs, measures, parts, amounts and units. Pure Python."""

from __future__ import annotations

import re

ADJECTIVES = {
    word: (operation.lstrip("-"), operation.startswith("-"))
    for operation, words in {
        "tall": "tall",
        "-tall": "squat stubby flat flattened squashed",
        "-short": "short stumpy",
        "high": "high lofty",
        "-high": "low",
        "long": "long elongated stretched",
        "deep": "deep",
        "-deep": "shallow",
        "wide": "wide broad",
        "-wide": "narrow",
        "fat": "fat chubby plump obese stout thick round heavy bulky",
        "-fat": "thin slim slender skinny lean slight",
        "big": "big large huge giant great",
        "-big": "small little tiny",
        "steep": "steep",
        "tapered": "tapered pointed tapering pointy",
        "twisted": "twisted spiral twisting",
        "leaning": "leaning tilted slanted sloping",
        "bent": "bent curved crooked bowed",
        "pinched": "pinched waisted cinched hourglass",
    }.items()
    for word in words.split()
}
"""The operation of each adjective, and whether it is the lesser one."""

VERBS = {
    "lengthen": "long", "elongate": "long", "stretch": "long", "shorten": "-short", "flatten": "-tall",
    "widen": "wide", "broaden": "wide", "fatten": "fat", "thicken": "fat", "slim": "-fat", "enlarge": "big",
    "grow": "big", "enlarged": "big", "shrink": "-big", "twist": "twisted", "bend": "bent", "taper": "tapered",
    "lean": "leaning", "tilt": "leaning", "pinch": "pinched", "heighten": "tall", "deepen": "deep", "raise": "raise",
    "lift": "raise", "elevate": "raise", "drop": "-raise", "narrow": "-wide", "scale": "big", "resize": "big",
}  # fmt: skip
MORE, LESS = frozenset({"increase", "extend"}), frozenset({"decrease", "reduce"})
"""Verbs that say whether there is to be more or less of what follows."""
COMMANDS = frozenset({"add", "remove", "delete", "move", "rotate", "turn", "open", "close", "make", "increase"})
"""Verbs that a change in plain words begins with, of which most are not understood."""
MEASURES = {
    "height": "tall", "width": "wide", "breadth": "wide", "length": "long", "depth": "deep", "size": "big",
    "thickness": "fat",
}  # fmt: skip

SIDES = {
    "left": "left", "right": "right", "front": "front", "fore": "front", "rear": "rear", "back": "rear", "hind": "rear",
}  # fmt: skip
"""The side that each word names, before the noun of a part."""
SIDES |= {
    **dict.fromkeys(("middle", "mid", "centre", "center", "central"), "middle"),
    "§upper": "upper",
    "§lower": "lower",
}
"""Rows likewise; "upper" and "lower" are marked where they are no part of a name, as in "upper arm"."""

_IRREGULAR = {
    "lens": "lens",
    "feet": "foot",
    "leaves": "leaf",
    "shelves": "shelf",
    "teeth": "tooth",
    "calves": "calf",
    "hooves": "hoof",
}
PART_OF = {
    word: part
    for part, words in {
        "leg": "leg limb", "arm": "arm tentacle armrest", "head": "head skull", "neck": "neck", "tail": "tail",
        "ear": "ear",
        "hand": "hand paw fist", "foot": "foot hoof shoe boot", "wing": "wing flipper", "fin": "fin",
        "horn": "horn antler", "tusk": "tusk", "nose": "nose snout muzzle", "beak": "beak bill", "eye": "eye",
        "hair": "hair", "mane": "mane", "hump": "hump", "spike": "spike spine quill", "crest": "crest comb",
        "trunk": "trunk", "wheel": "wheel tyre tire", "seat": "seat", "top": "top tabletop", "back": "back backrest",
        "roof": "roof", "door": "door", "window": "window", "handle": "handle grip", "stem": "stem stalk pole",
        "body": "body", "belly": "belly torso chest waist abdomen tummy stomach", "base": "base bottom", "lid": "lid",
        "leaf": "leaf",
        "spout": "spout", "crown": "crown foliage canopy", "tower": "tower turret spire", "claw": "claw pincer",
        "finger": "finger", "shell": "shell", "cap": "cap", "hip": "hip", "shoulder": "shoulder", "branch": "branch",
        "chimney": "chimney", "thigh": "thigh", "shin": "shin calf", "forearm": "forearm", "toe": "toe",
        "bonnet": "bonnet hood", "cabin": "cabin cab", "bumper": "bumper", "exhaust": "exhaust smokestack",
        "fork": "fork",
        "track": "track", "gun": "gun cannon", "mast": "mast", "sail": "sail", "propeller": "propeller propellor",
        "rotor": "rotor", "blade": "blade", "shade": "shade lampshade", "drawer": "drawer", "shelf": "shelf",
        "knob": "knob", "mattress": "mattress", "footboard": "footboard", "brim": "brim", "sole": "sole",
        "heel": "heel", "sleeve": "sleeve", "collar": "collar", "strap": "strap", "pocket": "pocket",
        "basket": "basket",
    }.items()
    for word in words.split()
}  # fmt: skip
_PLURALS = {
    "foot": "feet", "branch": "branches", "leg": "legs", "arm": "arms", "hand": "hands", "ear": "ears", "wing": "wings",
    "fin": "fins", "horn": "horns", "eye": "eyes", "wheel": "wheels", "door": "doors", "window": "windows",
    "claw": "claws", "finger": "fingers", "shoulder": "shoulders", "hip": "hips", "thigh": "thighs", "shin": "shins",
    "forearm": "forearms", "toe": "toes", "tusk": "tusks", "hump": "humps", "spike": "spikes", "track": "tracks",
    "sail": "sails", "blade": "blades", "drawer": "drawers", "shelf": "shelves", "knob": "knobs", "sleeve": "sleeves",
    "strap": "straps", "pocket": "pockets", "tower": "towers", "leaf": "leaves", "rotor": "rotors",
    "propeller": "propellers",
}  # fmt: skip
PART_NAMES = {part: _PLURALS.get(part, part) for part in PART_OF.values()}
"""The parts that words name on any asset, in the singular, each as it is called where an asset has it."""

FILLERS = frozenset({
    "a", "an", "the", "its", "it", "it's", "is", "are", "be", "this", "that", "these", "those", "make", "made", "let",
    "give", "please", "have", "has", "having", "get", "of", "to", "in", "more", "version", "one", "some", "them", "by",
    "factor", "look", "looks", "looking", "into", "become", "and", "as", "with", "him", "her", "his", "hers", "their",
    "he", "she", "they", "my", "your", "our", "me", "we", "i", "want", "should", "for", "can", "you", "than", "so",
    "each", "every", "all", "both",
})  # fmt: skip
STUFFS = frozenset({
    "addon", "glow", "plaster", "snow", "cloth", "printable", "standardmaterial", "shader", "lambert", "phong", "blinn",
    "negro", "color", "colors", "mtl", "tex", "img", "layer", "lod", "low", "high", "poly", "lowpoly",
    "material", "materials", "mat", "main", "default", "base", "colour", "texture", "atlas", "metal",
    "metallic", "steel", "iron", "gold", "silver", "brass", "wood", "wooden", "stone", "rock", "brick", "glass",
    "plastic", "rubber", "leather", "fabric", "paper", "concrete", "paint", "skin", "black", "white",
    "grey", "gray", "red", "green", "blue", "yellow", "orange", "brown", "pink", "purple", "violet", "cyan",
    "beige", "dark", "light", "bright", "mesh", "object", "node", "group", "root", "scene", "cube", "box", "sphere",
    "cylinder", "plane", "circle", "cone", "torus", "geometry", "model", "polygon", "part", "element",
})  # fmt: skip
"""Words in the names of nodes and materials that say of what something is made, or nothing."""
DETERMINERS = frozenset({"a", "an", "the", "its", "his", "her", "their"})
SLIGHT = frozenset({"slightly", "bit", "somewhat"})
STRONG = frozenset({"much", "very", "way", "far", "lot", "really", "extremely"})

FRACTION = {"half": 0.5, "third": 1 / 3, "quarter": 0.25, "fourth": 0.25, "fifth": 0.2, "tenth": 0.1}
COUNT = {"a": 1.0, "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0}
TIMES = {"twice": 2.0, "double": 2.0, "doubled": 2.0, "thrice": 3.0, "triple": 3.0, "half": 0.5, "halved": 0.5}
UNITS = {
    name: metres
    for metres, names in {
        1.0: "m metre metres meter meters", 0.01: "cm centimetre centimetres centimeter centimeters",
        0.001: "mm millimetre millimetres millimeter millimeters", 0.0254: "inch inches", 0.3048: "ft foot feet",
    }.items()
    for name in names.split()
}  # fmt: skip
"""Metres of each unit of length."""
_NUMBER = r"(?:\d+(?:[.,]\d+)?|\b(?:one|two|three|four|five))"
_UNIT = "|".join(sorted(UNITS, key=len, reverse=True))
AMOUNTS = re.compile(
    rf"(?P<to>\bto\s+)?(?P<percent>\d+(?:[.,]\d+)?)\s*(?:%|per\s?cent\b)"
    rf"|(?P<length_to>\bto\s+)?(?P<length>\d+(?:[.,]\d+)?)\s*(?P<unit>{_UNIT})\b"
    rf"|(?P<count>{_NUMBER})(?P<half>\s+and\s+a\s+half)?\s*(?:x\b|times\b)"
    rf"|\bby\s+(?:a\s+factor\s+of\s+)(?P<factor>{_NUMBER})"
    rf"|(?P<by>\bby\s+)?\b(?P<many>a|one|two|three)\s+(?P<part>half|third|quarter|fourth|fifth|tenth)s?\b"
    rf"|(?P<by_half>\bby\s+half\b)"
    rf"|\b(?P<word>twice|doubled?|thrice|triple|half|halved)\b"
)
"""The amounts of a sentence."""


def singular(word: str) -> str:
    """Return the singular of a noun that may be a plural."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if word.endswith("s") and not word.endswith("ss") and len(word) > 3:
        for stem in (word[:-2] if word.endswith(("ches", "shes", "xes")) else "", word[:-1]):
            if stem:
                return stem
    return word


def adjective(word: str) -> tuple[str, bool, bool] | None:
    """Return the operation of an adjective or a verb, whether it is the lesser one, and whether it compares."""
    if word in ADJECTIVES:
        return (*ADJECTIVES[word], False)
    if word in VERBS:
        return VERBS[word].lstrip("-"), VERBS[word].startswith("-"), True
    for ending in ("er", "est"):
        if word.endswith(ending):
            base = word.removesuffix(ending)
            stems = [base, base + "e", base[:-1] + "y" if base.endswith("i") else "", base[:-1]]
            for stem in filter(None, stems):
                if stem in ADJECTIVES and (stem != base[:-1] or base[-1:] == base[-2:-1]):
                    return (*ADJECTIVES[stem], True)
    return None


def number(text: str) -> float:
    """Return what a numeral says."""
    return COUNT[text] if text in COUNT else float(text.replace(",", "."))
