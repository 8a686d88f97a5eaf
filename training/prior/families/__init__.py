"""Draw members of the families, which are functions that generate a random mesh for every noun of the grammar.

`member(noun, attributes, rng)` is the interface of the dataset; the same generator state gives the same mesh. Importing
this needs numpy but no torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.teaching.deformed import deformed
from training.prior.families import (
    animals,
    beasts,
    buildings,
    clothing,
    creatures,
    figures,
    food,
    furniture,
    household,
    plants,
    small,
    swimmers,
    things,
    tools,
    vehicles,
    wheeled,
    winged,
)
from training.prior.families.parts import Part
from training.prior.families.traits import Traits

__all__ = ["FAMILIES", "Family", "Part", "Traits", "member"]

Family = Callable[[np.random.Generator, Traits], Part]

FAMILIES: dict[str, Family] = {
    "airplane": vehicles.airplane,
    "anvil": tools.anvil,
    "apple": food.apple,
    "armchair": furniture.armchair,
    "axe": tools.axe,
    "backpack": clothing.backpack,
    "balloon": vehicles.balloon,
    "banana": food.banana,
    "barrel": tools.barrel,
    "bathtub": furniture.bathtub,
    "bear": figures.bear,
    "bed": furniture.bed,
    "bell": household.bell,
    "bench": furniture.bench,
    "bird": winged.bird,
    "boat": vehicles.boat,
    "boot": clothing.boot,
    "bottle": household.bottle,
    "bowl": household.bowl,
    "bucket": tools.bucket,
    "burger": food.burger,
    "bus": wheeled.bus,
    "butterfly": winged.butterfly,
    "cabinet": furniture.cabinet,
    "cactus": plants.cactus,
    "cake": food.cake,
    "camel": beasts.camel,
    "camera": tools.camera,
    "candle": tools.candle,
    "car": vehicles.car,
    "carrot": plants.carrot,
    "castle": buildings.castle,
    "cat": creatures.cat,
    "chair": furniture.chair,
    "chest": tools.chest,
    "chicken": winged.chicken,
    "church": buildings.church,
    "corn": food.corn,
    "cow": beasts.cow,
    "crab": small.crab,
    "crocodile": beasts.crocodile,
    "cupcake": food.cupcake,
    "deer": beasts.deer,
    "desk": furniture.desk,
    "dinosaur": animals.dinosaur,
    "dog": animals.dog,
    "dolphin": swimmers.dolphin,
    "dragon": winged.dragon,
    "dress": clothing.dress,
    "duck": creatures.duck,
    "dumbbell": tools.dumbbell,
    "elephant": animals.elephant,
    "fish": swimmers.fish,
    "flower": plants.flower,
    "frog": small.frog,
    "ghost": figures.ghost,
    "giraffe": animals.giraffe,
    "glove": clothing.glove,
    "goblet": household.goblet,
    "guitar": things.guitar,
    "hammer": tools.hammer,
    "hat": things.hat,
    "heart": things.heart,
    "hedgehog": beasts.hedgehog,
    "helicopter": vehicles.helicopter,
    "helmet": clothing.helmet,
    "horse": animals.horse,
    "house": things.house,
    "igloo": buildings.igloo,
    "lamp": household.lamp,
    "lighthouse": buildings.lighthouse,
    "lion": beasts.lion,
    "monkey": figures.monkey,
    "motorcycle": wheeled.motorcycle,
    "mouse": beasts.mouse,
    "mushroom": plants.mushroom,
    "octopus": creatures.octopus,
    "owl": winged.owl,
    "palm": plants.palm,
    "pear": plants.pear,
    "penguin": creatures.penguin,
    "person": figures.person,
    "piano": furniture.piano,
    "pig": animals.pig,
    "pine": plants.pine,
    "pineapple": plants.pineapple,
    "pumpkin": food.pumpkin,
    "rabbit": creatures.rabbit,
    "rhino": beasts.rhino,
    "robot": figures.robot,
    "rocket": vehicles.rocket,
    "shark": swimmers.shark,
    "sheep": beasts.sheep,
    "shield": tools.shield,
    "shirt": clothing.shirt,
    "skyscraper": buildings.skyscraper,
    "snail": small.snail,
    "snake": small.snake,
    "snowman": things.snowman,
    "sofa": furniture.sofa,
    "spider": small.spider,
    "star": things.star,
    "stool": furniture.stool,
    "strawberry": food.strawberry,
    "submarine": vehicles.submarine,
    "swan": winged.swan,
    "sword": tools.sword,
    "table": furniture.table,
    "tank": wheeled.tank,
    "teapot": tools.teapot,
    "television": furniture.television,
    "tent": buildings.tent,
    "tractor": wheeled.tractor,
    "train": wheeled.train,
    "tree": plants.tree,
    "trousers": clothing.trousers,
    "truck": wheeled.truck,
    "turtle": creatures.turtle,
    "umbrella": household.umbrella,
    "vase": household.vase,
    "whale": creatures.whale,
    "windmill": buildings.windmill,
}
"""The family of each noun; the keys are those of `grammar.NOUNS`."""


def member(noun: str, attributes: Iterable[Attribute], rng: np.random.Generator) -> Part:
    """Draw a random member of a family with the given attributes.

    Returns
    -------
    Part
        Closed parts, oriented outward, +Y up, facing +Z, centred, farthest vertex at distance 1.
    """
    wanted = tuple(attributes)
    return deformed(FAMILIES[noun](rng, Traits(wanted)), wanted, rng)
