"""Draw members of the families, which are functions that generate a random mesh for every noun of the grammar.

`member(noun, attributes, rng)` is the interface of the dataset; the same generator state gives the same mesh. Importing
this needs numpy but no torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.training.families import (
    animals,
    beasts,
    buildings,
    creatures,
    furniture,
    household,
    plants,
    things,
    vehicles,
    wheeled,
)
from meshdeform.priors.builtin.training.families.parts import Part
from meshdeform.priors.builtin.training.families.traits import Traits, deformed

__all__ = ["FAMILIES", "Family", "Part", "Traits", "member"]

Family = Callable[[np.random.Generator, Traits], Part]

FAMILIES: dict[str, Family] = {
    "airplane": vehicles.airplane,
    "armchair": furniture.armchair,
    "bathtub": furniture.bathtub,
    "bed": furniture.bed,
    "bell": household.bell,
    "bench": furniture.bench,
    "boat": vehicles.boat,
    "bottle": household.bottle,
    "bowl": household.bowl,
    "bus": wheeled.bus,
    "cabinet": furniture.cabinet,
    "cactus": plants.cactus,
    "camel": beasts.camel,
    "car": vehicles.car,
    "carrot": plants.carrot,
    "castle": buildings.castle,
    "cat": creatures.cat,
    "chair": furniture.chair,
    "church": buildings.church,
    "cow": beasts.cow,
    "crocodile": beasts.crocodile,
    "deer": beasts.deer,
    "desk": furniture.desk,
    "dinosaur": animals.dinosaur,
    "dog": animals.dog,
    "duck": creatures.duck,
    "elephant": animals.elephant,
    "fish": creatures.fish,
    "giraffe": animals.giraffe,
    "goblet": household.goblet,
    "guitar": things.guitar,
    "hat": things.hat,
    "heart": things.heart,
    "hedgehog": beasts.hedgehog,
    "horse": animals.horse,
    "house": things.house,
    "igloo": buildings.igloo,
    "lamp": household.lamp,
    "lighthouse": buildings.lighthouse,
    "lion": beasts.lion,
    "motorcycle": wheeled.motorcycle,
    "mouse": beasts.mouse,
    "mushroom": plants.mushroom,
    "octopus": creatures.octopus,
    "pear": plants.pear,
    "penguin": creatures.penguin,
    "piano": furniture.piano,
    "pig": animals.pig,
    "pineapple": plants.pineapple,
    "rabbit": creatures.rabbit,
    "rhino": beasts.rhino,
    "rocket": vehicles.rocket,
    "sheep": beasts.sheep,
    "skyscraper": buildings.skyscraper,
    "snowman": things.snowman,
    "sofa": furniture.sofa,
    "star": things.star,
    "stool": furniture.stool,
    "table": furniture.table,
    "tank": wheeled.tank,
    "television": furniture.television,
    "tent": buildings.tent,
    "tractor": wheeled.tractor,
    "train": wheeled.train,
    "tree": plants.tree,
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
