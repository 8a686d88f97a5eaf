"""Draw wild and farm animals with hoofs, horns, humps or trunks."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.bodies import Animal, FourLegged, breed, of, strand, tube

__all__ = ["bison", "boar", "donkey", "goat", "hippo", "llama", "mammoth", "unicorn", "zebra"]

HORSE = FourLegged(
    length=0.85, girth=0.24, waist=0.92, leg=0.58, thick=0.07, paw=0, neck=0.42, tilt=52, head=0.16, broad=0.85,
    muzzle=1.9, snout=(0.72, 0.5), drop=-42, mask="head", ears="leaf", ear=0.17, tail=0.6,
    brush=(0.05, 0.09, 0.1, 0.04),
)  # fmt: skip
CATTLE = FourLegged(
    length=0.85, girth=0.31, deep=1.15, leg=0.36, thick=0.085, paw=0, neck=0.22, tilt=25, head=0.2, broad=0.95,
    muzzle=1.25, snout=(0.85, 0.72), drop=-48, ears="side", ear=0.22, tail=0.45, brush=(0.04, 0.035, 0.035, 0.07),
)  # fmt: skip
DEER = FourLegged(
    length=0.75, girth=0.2, leg=0.58, thick=0.054, paw=0, neck=0.42, tilt=60, head=0.14, broad=0.85, muzzle=1.55,
    snout=(0.7, 0.44), drop=-32, mask="head", ears="side", ear=0.22, tails="up", tail=0.16,
    brush=(0.05, 0.06, 0.05, 0.03),
)  # fmt: skip
_TUFT = (0.045, 0.04, 0.04, 0.095)
_BACKWARD = ((0.1, 0.45, 0.0), (0.15, 0.3, -0.3), (0.15, -0.05, -0.4), (0.1, -0.3, -0.2))
_INWARD = ((0.7, 0.1, 0.0), (0.25, 0.5, 0.0), (-0.15, 0.45, 0.0))

donkey = breed("donkey", HORSE, leg=0.4, neck=0.3, head=0.19, snout=(0.72, 0.6), ear=0.42, mane=0.1, brush=_TUFT)
goat = breed(
    "goat", DEER, girth=0.25, leg=0.4, neck=0.24, head=0.16, muzzle=1.3, beard=0.24, horns=(0.42, 0.065, _BACKWARD)
)
llama = breed(
    "llama", HORSE, girth=0.31, deep=1.1, hips=1.05, waist=1.05, leg=0.4, neck=0.66, tilt=82, nape=0.6, head=0.16,
    cap=0.8, muzzle=0.95, snout=(0.7, 0.55), drop=-15, ear=0.24, tails="over", tail=0.2, brush=(0.07, 0.09, 0.08, 0.04),
)  # fmt: skip
zebra = breed(
    "zebra", HORSE, leg=0.48, girth=0.27, head=0.17, ears="round", mane=0.24, brush=_TUFT, tail=0.5, snout=(0.72, 0.56)
)


@of(HORSE, tail=0.75, brush=(0.06, 0.12, 0.14, 0.04))
def unicorn(animal: Animal) -> None:
    """Draw a unicorn: a horse with a long horn on its brow, a flowing mane and a full tail."""
    steps = np.outer(np.full(7, animal.sized("horns", 0.5) / 7), [0, 0.8, 0.6])
    twist = [0.06, 0.046, 0.058, 0.038, 0.046, 0.026, 0.03, 0.01]
    animal.add("horn", strand(animal.on_head(0, 0.6, 0.35), steps, twist))
    fall = animal.withers - animal.on_head(0, 0.8, -0.1)
    for side, share in ((0.0, 0.95), (0.07, 0.6), (-0.07, 0.78)):
        steps = np.array([[side, 0.06, -0.12], [side, 0.4 * fall[1], 0.5 * fall[2]], [side, 0.45 * fall[1], -0.02]])
        animal.add("mane", strand(animal.on_head(0.3 * side, 0.8, 0.1), share * steps, [0.06, 0.1, 0.11, 0.03]))


@of(CATTLE, girth=0.33, hips=0.66, waist=0.85, slope=0.07, tilt=-12, neck=0.1, head=0.25, drop=-62, muzzle=0.9,
    ear=0.13, leg=0.3, cap=0.75, beard=0.34, horns=(0.3, 0.06, _INWARD))  # fmt: skip
def bison(animal: Animal) -> None:
    """Draw a bison: a shaggy hump over the shoulders, a low heavy head with short horns and a beard, slim hips."""
    hump = animal.sized("humps", 0.3)
    path = [[0, -0.1, -0.42], [0, 0.55 * hump, -0.12], [0, 0.7 * hump, 0.1], [0, 0.0, 0.36]]
    bulk = np.array([0.16, 0.27, 0.29, 0.24])
    animal.add("hump", tube(np.array(path) + animal.withers - [0, 0.26, 0.08], bulk, bulk + 0.1 * hump))


@of(CATTLE, hips=0.75, slope=0.05, leg=0.25, thick=0.07, neck=0.05, tilt=2, head=0.25, muzzle=1.5, girth=0.29,
    snout=(0.8, 0.36), drop=-16, ears="pointed", ear=0.2, tail=0.25, brush=_TUFT)  # fmt: skip
def boar(animal: Animal) -> None:
    """Draw a boar: a high-shouldered body with a ridge of bristles, a long wedge of a head, tusks that point up."""
    animal.crest(animal.rump + [0, 0.05, 0.3], animal.on_head(0, 0.7, -0.1), 0.14)
    root = animal.muzzle + animal.head * np.array([0.22, -0.12, -0.5])
    steps = animal.sized("tusks", 0.22) * np.array([(0.5, 0.1, 0.2), (0.1, 0.75, 0.0)])
    animal.two("tusk", strand(root, steps, [0.05, 0.045, 0.015]))


@of(CATTLE, girth=0.42, deep=0.95, leg=0.16, thick=0.13, thigh=1.3, neck=0.12, tilt=8, head=0.27, snout=(0.8, 1.05),
    muzzle=1.25, drop=-14, ears="round", ear=0.12, tail=0.2, eyes=(0.5, 0.8, 0.3, 0.26))  # fmt: skip
def hippo(animal: Animal) -> None:
    """Draw a hippopotamus: a huge barrel on short pillars, a broad muzzle with nostrils, eyes and ears on top."""
    animal.ball("nose", animal.muzzle + animal.head * np.array([0.55, 0.62, -0.3]), 0.34 * animal.head, two=True)


@of(CATTLE, girth=0.4, hips=0.85, slope=0.08, leg=0.34, thick=0.14, thigh=1.25, neck=0, tilt=38, head=0.33, muzzle=0,
    ear=0.26, tail=0.3, length=0.75, cap=0.7)  # fmt: skip
def mammoth(animal: Animal) -> None:
    """Draw a mammoth: a shaggy body that slopes from a high head, a trunk between long tusks that curl inward."""
    steps = animal.sized("trunk", 0.9) * np.array([(0, -0.35, 0.2), (0, -0.4, 0.02), (0, -0.15, 0.2)])
    animal.add("trunk", strand(animal.on_head(0, -0.2, 0.7), steps, [0.17, 0.13, 0.1, 0.07], segments=12))
    curl = np.array([(0.12, -0.3, 0.3), (0.14, -0.1, 0.45), (0.0, 0.25, 0.3), (-0.2, 0.3, 0.0)])
    curl *= animal.sized("tusks", 0.85)
    animal.two("tusk", strand(animal.on_head(0.45, -0.45, 0.55), curl, [0.085, 0.08, 0.07, 0.055, 0.02], segments=10))
    for z in (-1.0, -0.33, 0.33, 1.0):
        shag = [0, 0.72 * animal.height + 0.05 * z, 0.8 * z * animal.half]
        animal.ball("body", shag, [0.36, 0.3, 0.3])
