"""Draw wild animals on four paws: great cats, and those known by a tail, a shell, a nose or a neck."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.bodies import Animal, FourLegged, breed, of, strand
from meshdeform.nouns.families.parts import ellipsoid, limb, moved, plate, turned

__all__ = [
    "anteater", "armadillo", "hamster", "hyena", "leopard", "mole", "otter", "platypus", "raccoon", "skunk", "tiger",
]  # fmt: skip

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
skunk = breed(
    "skunk", SMALL, leg=0.15, head=0.16, girth=0.2, muzzle=1.0, ear=0.09, tilt=10, tails="over", tail=0.95,
    brush=(0.09, 0.15, 0.19, 0.07),
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


@of(SMALL, length=0.72, girth=0.24, hips=0.75, arch=0, slope=0.13, leg=0.5, thick=0.07, neck=0.34, tilt=30, nape=0.9,
    muzzle=1.0, snout=(0.68, 0.56), ear=0.26, tail=0.35, brush=(0.04, 0.07, 0.08, 0.03), mane=0.16)  # fmt: skip
def hyena(animal: Animal) -> None:
    """Draw a hyena: high shoulders and low hips, a mane along the back, big round ears, a blunt muzzle."""
    animal.crest(animal.rump + [0, 0.1, 0.35], animal.withers - [0, 0.03, 0], 0.14)


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


@of(SMALL, girth=0.24, leg=0.13, head=0.14, muzzle=1.5, snout=(0.62, 0.25), drop=-28, ears="leaf", ear=0.24,
    tails="down", tail=0.6, brush=(0.1, 0.07, 0.05, 0.02), tilt=8)  # fmt: skip
def armadillo(animal: Animal) -> None:
    """Draw an armadillo: an arched shell of bands, a long pointed head, upright ears, a tail that tapers."""
    shell, t = animal.sized("shell", 1.0), np.linspace(-1, 1, 2 * int(animal.rng.integers(4, 7)) + 7)
    wide = (1.35 * np.sqrt(1 - 0.7 * t**2) + 0.09 * (np.arange(len(t)) % 2)) * (0.5 + 0.5 * shell) * animal.girth
    path = np.stack([0 * t, animal.height + 0.07 * (1 - t**2), t * (animal.half + 0.18) * (0.7 + 0.3 * shell)], 1)
    animal.add("shell", limb(path, wide, segments=18, samples=1))


@of(SMALL, length=0.8, girth=0.2, hips=0.95, arch=0, leg=0.32, thick=0.08, neck=0.16, tilt=0, nape=0.7, head=0.12,
    muzzle=4.4, deep=1.2, snout=(0.72, 0.3), drop=-24, ear=0.09, tail=0)  # fmt: skip
def anteater(animal: Animal) -> None:
    """Draw an anteater: a head that is a long thin tube, high shoulders, a tail like a great drooping flag."""
    flag = np.array(
        [(0.1, 0.08), (-0.3, 0.22), (-0.75, 0.2), (-1.1, -0.12), (-1.15, -0.4), (-0.9, -0.45), (-0.6, -0.38)]
    )
    flag = np.concatenate([flag, [(-0.3, -0.3), (0.05, -0.1)]]) * animal.sized("tail", 0.85)
    animal.add("tail", moved(plate(flag, 0.15, across="x", puff=0.2), animal.rump))


@of(SMALL, length=0.55, girth=0.27, deep=0.9, arch=0, leg=0.04, neck=0, tilt=-2, head=0.24, muzzle=1.0, drop=-6,
    snout=(0.65, 0.2), ears="", tails="level", tail=0.2, brush=(0.04, 0.03, 0.03, 0.02))  # fmt: skip
def mole(animal: Animal) -> None:
    """Draw a mole: a barrel without a neck, a pointed nose with a ball at its tip, great hands with claws spread."""
    animal.parts["foot"], animal.parts["leg"] = animal.parts["foot"][:2], animal.parts["leg"][:2]
    animal.ball("nose", animal.muzzle, 0.06)
    size, shoulder = animal.sized("claws", 0.09), np.array([0.5, 0.8, 0.7]) * [animal.girth, animal.height, animal.half]
    hand = shoulder + [0.5 * animal.girth + 0.09, -0.06, 0.3 * animal.half + 0.05]
    animal.two("arm", limb([shoulder, hand], [0.12, 0.11], segments=10))
    palm = hand + [0.07, -0.02, 0.04]
    animal.two("hand", moved(turned(ellipsoid([0, 0, 0], [0.16, 0.07, 0.17], rings=8), -20, "z"), palm))
    for turn in np.radians([-30, 5, 40, 75]):
        way = np.array([np.sin(turn), -0.2, np.cos(turn)])
        claw = [palm + 0.12 * way, palm + (0.15 + size) * way]
        animal.two("claw", limb(claw, [0.05, 0.02], segments=6, samples=1))


@of(SMALL, girth=0.25, hips=1.0, length=0.7, deep=0.8, arch=0.02, leg=0.04, sprawl=0.06, thick=0.065, neck=0.05,
    tilt=12, head=0.2, muzzle=0, ears="", tail=0, eyes=(0.55, 0.6, 0.4, 0.2), cartoon=0.0)  # fmt: skip
def platypus(animal: Animal) -> None:
    """Draw a platypus: a low body with a broad flat bill, a flat paddle of a tail and webbed feet."""
    half = np.array([(0.1, -0.12), (0.17, 0.3), (0.19, 0.75), (0.12, 0.98)])
    rim = np.concatenate([half, half[::-1] * [-1, 1]])
    bill = plate(rim * [1.0, animal.sized("beak", 0.34)], 0.07, across="y", puff=0.2)
    animal.add("beak", moved(bill, animal.on_head(0, -0.2, 0.6)))
    paddle = plate(rim * [1.1, -animal.sized("tail", 0.55)], 0.1, across="y", puff=0.3)
    animal.add("tail", moved(turned(paddle, 4, "x"), animal.rump + [0, -0.1, 0.05]))
    for foot in list(animal.parts["foot"]):
        animal.ball("foot", foot.verts.mean(0) * [1.15, 0, 1] + [0, 0.03, 0.06], [0.11, 0.025, 0.13])
