"""Draw wild animals on four paws: great cats, and those known by a tail, a shell, a nose or a neck."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.bodies import Animal, FourLegged, breed, of, strand
from meshdeform.nouns.families.parts import ellipsoid, limb

__all__ = ["hamster",  "leopard",  "otter",  "raccoon",  "tiger"]  # fmt: skip

_GREAT_CAT = FourLegged(
    length=1.0, girth=0.2, waist=0.86, leg=0.4, thick=0.075, neck=0.22, tilt=35, nape=0.9, head=0.18, broad=1.05,
    muzzle=0.35, snout=(0.6, 0.48), drop=-25, ears="round", ear=0.12, tails="swung", tail=0.9,
    brush=(0.05, 0.045, 0.045, 0.05),
)  # fmt: skip
SMALL = FourLegged(
    length=0.6, girth=0.21, hips=1.08, arch=0.07, leg=0.22, thick=0.06, neck=0.1, tilt=28, nape=0.8, head=0.19,
    muzzle=0.8, snout=(0.55, 0.25), ears="round", ear=0.14,
)  # fmt: skip

otter = breed(
    "otter", SMALL, length=1.15, girth=0.17, arch=0.05, leg=0.1, neck=0.22, tilt=50, head=0.155, muzzle=0.55, broad=1.2,
    snout=(0.75, 0.6), ear=0.07, tails="down", tail=0.75, brush=(0.15, 0.11, 0.07, 0.03),
)  # fmt: skip


def _tufts(animal: Animal, long: float, *lows: float) -> None:
    """Add pointed tufts to the cheeks, by their heights and their length in radii of the head."""
    for low in lows:
        root = animal.on_head(0.68, low, 0.0)
        way = animal.head * long * np.array([0.7, -0.4, -0.2])
        animal.two("cheek", limb([root, root + way], [0.42 * animal.head, 0.015], segments=8, samples=2))


@of(_GREAT_CAT, girth=0.23, thick=0.09, head=0.22, snout=(0.66, 0.56), ear=0.13)
def tiger(animal: Animal) -> None:
    """Draw a tiger: a great cat with a heavy head, a ruff of tufts on its cheeks and a long tail."""
    _tufts(animal, 0.9, 0.0, -0.35, -0.7)


@of(_GREAT_CAT, girth=0.18, waist=0.78, deep=1.2, head=0.155, tilt=20, tail=1.15, leg=0.44, thick=0.06)
def leopard(animal: Animal) -> None:
    """Draw a leopard: a low slim cat with a small head, shoulders that stand out and a very long tail."""
    animal.ball("body", [0.1, animal.withers[1] - 0.08, 0.8 * animal.half], [0.08, 0.16, 0.14], two=True)


@of(SMALL, ears="pointed", ear=0.17, broad=1.15, head=0.22, muzzle=0.9, tail=0)
def raccoon(animal: Animal) -> None:
    """Draw a raccoon: a round back, a broad face that runs to a point with tufts at its sides, a ringed bushy tail."""
    _tufts(animal, 0.7, -0.2)
    angle = np.radians(np.linspace(200, 130, 10) + animal.rng.uniform(-15, 15))
    steps = animal.sized("tail", 0.75) / 10 * np.stack([0 * angle, np.sin(angle), np.cos(angle)], 1)
    rings = np.where(np.arange(11) % 2, 0.15, 0.105) * np.array([0.7, *np.ones(9), 0.5])
    animal.add("tail", strand(animal.rump, steps, rings, segments=10))


@of(SMALL, length=0.34, girth=0.3, deep=1.0, leg=0.05, neck=0, tilt=22, head=0.3, muzzle=0.3, snout=(0.5, 0.35),
    broad=1.08, ear=0.17, tail=0, paw=1.6, cartoon=0.0, eyes=(0.5, 0.3, 0.8, 0.17))  # fmt: skip
def hamster(animal: Animal) -> None:
    """Draw a hamster: a ball of a body that is hardly apart from its head, full cheeks, tiny feet, round ears."""
    bulk = animal.girth * np.array([1.15, 1.08, 1.0]) + [0, 0, 0.8 * animal.half]
    animal.parts["body"] = [ellipsoid([0, animal.height, 0], bulk, rings=10)]
    animal.ball("cheek", animal.on_head(0.5, -0.35, 0.6), 0.45 * animal.head, two=True)
    animal.ball("tail", animal.rump + [0, -0.15, -0.1], 0.07)
