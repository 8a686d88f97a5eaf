"""List the words of the builtin prior: nouns, attributes, parts and their synonyms.

`grammar.py` parses prompts with these tables. The order of nouns, adjectives and parts numbers the tokens, so a change
here requires new weights (a file of weights names its vocabulary).
"""

from __future__ import annotations

NOUNS: dict[str, tuple[str, ...]] = {
    "airplane": ("wings",),
    "anvil": (),
    "apple": ("stem",),
    "armchair": ("back",),
    "arrow": (),
    "astronaut": (),
    "axe": ("blade", "handle"),
    "backpack": (),
    "balloon": (),
    "banana": (),
    "banner": (),
    "barrel": (),
    "bathtub": (),
    "bear": ("ears", "head", "legs"),
    "bed": ("back",),
    "bell": ("handle",),
    "bench": ("legs",),
    "bird": ("beak", "tail", "wings"),
    "boat": ("sail",),
    "bomb": (),
    "bone": (),
    "book": (),
    "bookcase": (),
    "boot": ("heel",),
    "bottle": ("neck",),
    "bowl": (),
    "bread": (),
    "bridge": (),
    "bucket": (),
    "burger": (),
    "bus": ("wheels",),
    "bush": (),
    "butterfly": ("wings",),
    "cabinet": ("legs",),
    "cactus": ("arms",),
    "cake": (),
    "camel": ("humps", "legs", "neck"),
    "camera": ("lens",),
    "campfire": (),
    "can": (),
    "candle": (),
    "cannon": (),
    "car": (),
    "carrot": ("leaves",),
    "castle": ("tower",),
    "cat": ("ears", "head", "tail"),
    "chair": ("back", "legs"),
    "chest": (),
    "chicken": ("head", "legs", "tail"),
    "church": ("roof", "tower"),
    "cloud": (),
    "coffin": (),
    "coin": (),
    "column": (),
    "cone": (),
    "cookie": (),
    "corn": ("leaves",),
    "cow": ("horns", "legs", "tail"),
    "crab": ("claws", "legs"),
    "crate": (),
    "crocodile": ("legs", "nose", "tail"),
    "crossbow": (),
    "crown": (),
    "crystal": (),
    "cupcake": (),
    "deer": ("horns", "legs", "neck"),
    "desk": ("legs",),
    "dinosaur": ("head", "legs", "neck", "tail"),
    "dog": ("ears", "head", "legs", "tail"),
    "dolphin": ("fins", "nose"),
    "door": (),
    "dragon": ("head", "neck", "tail", "wings"),
    "dress": ("sleeves",),
    "duck": ("head", "neck"),
    "dumbbell": ("handle",),
    "elephant": ("ears", "legs", "trunk"),
    "fish": ("fins", "tail"),
    "flag": (),
    "flower": ("head", "leaves", "stem"),
    "fox": (),
    "fridge": (),
    "frog": ("eyes", "legs"),
    "ghost": ("arms",),
    "giraffe": ("head", "legs", "neck"),
    "glove": (),
    "goblet": ("stem",),
    "gravestone": (),
    "guitar": ("neck",),
    "hammer": ("handle", "head"),
    "hat": ("brim",),
    "heart": (),
    "hedgehog": ("nose", "spikes"),
    "helicopter": ("tail",),
    "helmet": (),
    "horse": ("head", "legs", "neck", "tail"),
    "hotdog": (),
    "house": ("roof",),
    "icecream": (),
    "igloo": (),
    "jar": (),
    "key": (),
    "knife": (),
    "lamp": ("shade", "stem"),
    "lantern": (),
    "lighthouse": (),
    "lion": ("legs", "mane", "tail"),
    "log": (),
    "monkey": ("arms", "ears", "tail"),
    "motorcycle": ("wheels",),
    "mountain": (),
    "mouse": ("ears", "tail"),
    "mug": (),
    "mushroom": ("cap", "stem"),
    "octopus": ("arms", "head"),
    "owl": ("ears", "eyes", "wings"),
    "palm": ("leaves", "trunk"),
    "pan": (),
    "pear": (),
    "penguin": ("head", "wings"),
    "person": ("arms", "head", "legs"),
    "piano": ("legs",),
    "pig": ("ears", "legs", "nose"),
    "pillow": (),
    "pine": ("trunk",),
    "pineapple": ("leaves",),
    "pistol": (),
    "plant": (),
    "plate": (),
    "pot": (),
    "potion": (),
    "pumpkin": ("stem",),
    "rabbit": ("ears", "head"),
    "rhino": ("horns", "legs"),
    "rifle": (),
    "robot": ("arms", "head", "legs"),
    "rock": (),
    "rocket": ("fins",),
    "rover": (),
    "sack": (),
    "scroll": (),
    "shark": ("fins", "tail"),
    "sheep": ("head", "legs"),
    "shelf": (),
    "shield": (),
    "ship": (),
    "shirt": ("sleeves",),
    "sign": (),
    "sink": (),
    "skull": (),
    "skyscraper": (),
    "snail": ("head", "shell"),
    "snake": ("head",),
    "snowman": ("head", "nose"),
    "sofa": ("back",),
    "spaceship": (),
    "spider": ("head", "legs"),
    "stairs": (),
    "star": (),
    "stool": ("legs",),
    "stove": (),
    "strawberry": ("leaves",),
    "streetlight": (),
    "submarine": ("tower",),
    "swan": ("head", "neck", "wings"),
    "sword": ("blade", "handle"),
    "table": ("legs",),
    "tank": ("gun",),
    "target": (),
    "teapot": ("spout",),
    "television": ("stem",),
    "tent": (),
    "toilet": (),
    "torch": (),
    "tower": (),
    "tractor": ("wheels",),
    "train": ("wheels",),
    "trashcan": (),
    "tree": ("trunk", "crown"),
    "trousers": ("legs",),
    "truck": ("wheels",),
    "turtle": ("head", "neck"),
    "umbrella": ("handle",),
    "van": (),
    "vase": ("neck",),
    "wardrobe": (),
    "well": (),
    "whale": ("tail",),
    "windmill": ("sail",),
    "wolf": (),
}
"""Every noun with the parts whose size a prompt can set."""

NOUN_GROUPS: dict[str, tuple[str, ...]] = {
    name: tuple(nouns.split())
    for name, nouns in {
        "animals": (
            "bear bird butterfly camel cat chicken cow crab crocodile deer dinosaur dog dolphin duck "
            "elephant fish fox frog giraffe hedgehog horse lion monkey mouse octopus owl penguin pig rabbit "
            "rhino shark sheep snail snake spider swan turtle whale wolf"
        ),
        "figures": "astronaut dragon ghost person robot snowman",
        "vehicles": (
            "airplane balloon boat bus car helicopter motorcycle rocket rover ship spaceship submarine tank "
            "tractor train truck van"
        ),
        "furniture": (
            "armchair bathtub bed bench bookcase cabinet chair desk fridge lamp piano pillow shelf sink sofa "
            "stool stove table television toilet wardrobe"
        ),
        "buildings": (
            "bridge castle church column door gravestone house igloo lighthouse sign skyscraper stairs "
            "streetlight tent tower well windmill"
        ),
        "plants and food": (
            "apple banana bread burger bush cactus cake carrot cookie corn cupcake flower hotdog icecream "
            "mushroom palm pear pine pineapple plant pumpkin strawberry tree"
        ),
        "rocks and weather": "campfire cloud crystal log mountain rock",
        "vessels and tools": (
            "anvil arrow axe barrel bell bomb bottle bowl bucket camera can candle cannon chest cone crate "
            "crossbow dumbbell goblet guitar hammer jar key knife lantern mug pan pistol plate pot potion "
            "rifle sack shield sword target teapot torch trashcan vase"
        ),
        "clothes and other things": (
            "backpack banner bone book boot coffin coin crown dress flag glove hat heart helmet scroll shirt skull "
            "star trousers umbrella"
        ),
    }.items()
}
"""The nouns by kind, for people who choose one."""

_TURNED = (
    "apple balloon barrel bell bottle bowl bucket cactus cake candle carrot corn cupcake goblet lamp lighthouse "
    "mushroom pear pine pineapple pumpkin rocket stool strawberry table tent tree umbrella vase"
)
TURNED = frozenset(_TURNED.split())
"""The nouns of what is alike from all four sides."""

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
    "beak": LENGTH,
    "blade": LENGTH,
    "brim": SIZE,
    "cap": SIZE,
    "claws": SIZE,
    "crown": SIZE,
    "ears": SIZE,
    "eyes": SIZE,
    "fins": SIZE,
    "gun": LENGTH,
    "handle": LENGTH,
    "head": SIZE,
    "heel": LENGTH,
    "horns": LENGTH,
    "humps": SIZE,
    "leaves": LENGTH,
    "legs": LENGTH,
    "lens": LENGTH,
    "mane": SIZE,
    "neck": LENGTH,
    "nose": LENGTH,
    "roof": SIZE,
    "sail": SIZE,
    "shade": SIZE,
    "shell": SIZE,
    "sleeves": LENGTH,
    "spikes": LENGTH,
    "spout": LENGTH,
    "stem": LENGTH,
    "tail": LENGTH,
    "tower": LENGTH,
    "trunk": LENGTH,
    "wheels": SIZE,
    "wings": SIZE,
}
"""Every part with its two degrees, the lesser and the greater."""

NOUN_SYNONYMS = {
    "aeroplane": "airplane", "plane": "airplane", "jet": "airplane", "aircraft": "airplane", "handbell": "bell",
    "sailboat": "boat", "yacht": "boat", "flask": "bottle", "dish": "bowl",
    "basin": "bowl", "automobile": "car", "kitten": "cat", "kitty": "cat", "seat": "chair", "dino": "dinosaur",
    "sauropod": "dinosaur", "brontosaurus": "dinosaur", "diplodocus": "dinosaur", "puppy": "dog", "hound": "dog",
    "duckling": "duck", "goldfish": "fish", "chalice": "goblet", "wineglass": "goblet", "ukulele": "guitar",
    "sunhat": "hat", "fedora": "hat", "pony": "horse", "foal": "horse", "home": "house", "hut": "house",
    "cottage": "house", "toadstool": "mushroom", "piglet": "pig", "hog": "pig", "ananas": "pineapple",
    "bunny": "rabbit", "hare": "rabbit", "missile": "rocket", "couch": "sofa",
    "settee": "sofa", "starfish": "star", "tortoise": "turtle", "parasol": "umbrella", "brolly": "umbrella",
    "urn": "vase", "recliner": "armchair", "tub": "bathtub", "bath": "bathtub", "bunk": "bed", "cot": "bed",
    "pew": "bench", "cupboard": "cabinet", "dresser": "cabinet", "sideboard": "cabinet",
    "bureau": "desk", "footstool": "stool", "tv": "television", "monitor": "television",
    "screen": "television", "coach": "bus", "minibus": "bus", "chopper": "helicopter", "motorbike": "motorcycle",
    "scooter": "motorcycle", "moped": "motorcycle", "lorry": "truck", "pickup": "truck", "locomotive": "train",
    "engine": "train", "panzer": "tank", "parrot": "bird", "sparrow": "bird", "robin": "bird", "pigeon": "bird",
    "crow": "bird", "eagle": "bird", "moth": "butterfly", "dromedary": "camel", "hen": "chicken",
    "rooster": "chicken", "cock": "chicken", "chick": "chicken", "bull": "cow", "ox": "cow", "calf": "cow",
    "cattle": "cow", "alligator": "crocodile", "croc": "crocodile", "stag": "deer", "reindeer": "deer", "elk": "deer",
    "moose": "deer", "porpoise": "dolphin", "toad": "frog", "porcupine": "hedgehog", "lioness": "lion",
    "ape": "monkey", "chimpanzee": "monkey", "gorilla": "monkey", "rat": "mouse", "rhinoceros": "rhino",
    "lamb": "sheep", "ram": "sheep", "serpent": "snake", "cobra": "snake", "tarantula": "spider", "goose": "swan",
    "grizzly": "bear", "teddy": "bear", "phantom": "ghost", "human": "person", "man": "person", "woman": "person",
    "boy": "person", "girl": "person", "child": "person", "figure": "person", "android": "robot",
    "fortress": "castle", "chapel": "church", "cathedral": "church", "beacon": "lighthouse", "highrise": "skyscraper",
    "marquee": "tent", "mill": "windmill", "hamburger": "burger", "cheeseburger": "burger", "maize": "corn",
    "muffin": "cupcake", "gateau": "cake", "gourd": "pumpkin", "hatchet": "axe", "tomahawk": "axe", "ax": "axe",
    "cask": "barrel", "keg": "barrel", "pail": "bucket", "barbell": "dumbbell", "mallet": "hammer", "saber": "sword",
    "kettle": "teapot", "rucksack": "backpack", "knapsack": "backpack", "shoe": "boot", "gown": "dress",
    "frock": "dress", "mitten": "glove", "tshirt": "shirt", "sweater": "shirt", "jumper": "shirt",
    "pants": "trousers", "jeans": "trousers", "slacks": "trousers", "sunflower": "flower", "daisy": "flower",
    "tulip": "flower", "rose": "flower", "fir": "pine", "spruce": "pine", "conifer": "pine",
    "spaceman": "astronaut", "cosmonaut": "astronaut", "pennant": "banner", "grenade": "bomb", "novel": "book",
    "tome": "book", "bookshelf": "bookcase", "loaf": "bread", "baguette": "bread", "shrub": "bush", "hedge": "bush",
    "bonfire": "campfire", "tin": "can", "casket": "coffin", "pillar": "column", "biscuit": "cookie", "box":
    "crate", "parcel": "crate", "gem": "crystal", "jewel": "crystal", "gate": "door", "refrigerator": "fridge",
    "freezer": "fridge", "tombstone": "gravestone", "headstone": "gravestone", "dagger": "knife", "cleaver":
    "knife", "hill": "mountain", "volcano": "mountain", "cup": "mug", "frypan": "pan", "skillet": "pan", "cushion":
    "pillow", "handgun": "pistol", "revolver": "pistol", "houseplant": "plant", "saucepan": "pot", "cauldron":
    "pot", "elixir": "potion", "shotgun": "rifle", "musket": "rifle", "stone": "rock", "boulder": "rock", "bag":
    "sack", "pouch": "sack", "parchment": "scroll", "galleon": "ship", "frigate": "ship", "signpost": "sign",
    "washbasin": "sink", "cranium": "skull", "starship": "spaceship", "spacecraft": "spaceship", "staircase":
    "stairs", "steps": "stairs", "oven": "stove", "cooker": "stove", "streetlamp": "streetlight", "lamppost":
    "streetlight", "bullseye": "target", "lavatory": "toilet", "watchtower": "tower", "dustbin": "trashcan", "bin":
    "trashcan", "minivan": "van", "ambulance": "van", "closet": "wardrobe", "armoire": "wardrobe",
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
    "horn": "horns", "antlers": "horns", "antler": "horns", "bill": "beak", "hump": "humps", "claw": "claws",
    "pincers": "claws", "wheel": "wheels", "tyres": "wheels", "tires": "wheels", "sleeve": "sleeves",
    "towers": "tower", "spire": "tower", "steeple": "tower", "turret": "tower", "turrets": "tower", "cannon": "gun",
    "spines": "spikes", "quills": "spikes", "spike": "spikes", "eye": "eyes", "heels": "heel", "sails": "sail",
}  # fmt: skip
LENGTHWISE = {"big": "long", "small": "short"}
SIZEWISE = {"long": "big", "short": "small"}
FILLERS = frozenset({"a", "an", "the", "and", "with", "has", "having", "that", "its", "very", "of", "some", "one"})

OPPOSITES = tuple(
    frozenset(words)
    for words in (("tall", "short"), ("tall", "flat"), ("thin", "fat"), ("thin", "wide"), ("fat", "pinched"))
)
"""Adjectives that contradict each other."""
