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
    creatures,
    food,
    furniture,
    household,
    plants,
    things,
    tools,
    vehicles,
)
from meshdeform.priors.builtin.training.families.parts import Part
from meshdeform.priors.builtin.training.families.traits import Traits, deformed

__all__ = ["FAMILIES", "Family", "Part", "Traits", "member"]

Family = Callable[[np.random.Generator, Traits], Part]

FAMILIES: dict[str, Family] = {
    "airplane": vehicles.airplane,
    "anvil": tools.anvil,
    "apple": food.apple,
    "axe": tools.axe,
    "banana": food.banana,
    "barrel": tools.barrel,
    "bell": household.bell,
    "boat": vehicles.boat,
    "bottle": household.bottle,
    "bowl": household.bowl,
    "bucket": tools.bucket,
    "burger": food.burger,
    "cactus": plants.cactus,
    "cake": food.cake,
    "camera": tools.camera,
    "candle": tools.candle,
    "car": vehicles.car,
    "carrot": plants.carrot,
    "cat": creatures.cat,
    "chair": furniture.chair,
    "chest": tools.chest,
    "corn": food.corn,
    "cupcake": food.cupcake,
    "dinosaur": animals.dinosaur,
    "dog": animals.dog,
    "duck": creatures.duck,
    "dumbbell": tools.dumbbell,
    "elephant": animals.elephant,
    "fish": creatures.fish,
    "giraffe": animals.giraffe,
    "goblet": household.goblet,
    "guitar": things.guitar,
    "hammer": tools.hammer,
    "hat": things.hat,
    "heart": things.heart,
    "horse": animals.horse,
    "house": things.house,
    "lamp": household.lamp,
    "mushroom": plants.mushroom,
    "octopus": creatures.octopus,
    "pear": plants.pear,
    "penguin": creatures.penguin,
    "pig": animals.pig,
    "pineapple": plants.pineapple,
    "pumpkin": food.pumpkin,
    "rabbit": creatures.rabbit,
    "rocket": vehicles.rocket,
    "shield": tools.shield,
    "snowman": things.snowman,
    "sofa": furniture.sofa,
    "star": things.star,
    "strawberry": food.strawberry,
    "sword": tools.sword,
    "table": furniture.table,
    "teapot": tools.teapot,
    "tree": plants.tree,
    "turtle": creatures.turtle,
    "umbrella": household.umbrella,
    "vase": household.vase,
    "whale": creatures.whale,
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
