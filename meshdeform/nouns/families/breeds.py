"""Draw other kinds of pets, farm animals and beasts of prey: breeds, young ones, and those of cartoons."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.bodies import Animal, FourLegged, Upright, breed, of, strand
from meshdeform.nouns.families.parts import disc, ellipsoid, limb, moved, turned
from meshdeform.nouns.families.wildlife import CATTLE, DEER, HORSE, SMALL, patched, upright_hamster

_DOG = FourLegged(
    length=0.75, girth=0.21, waist=0.85, leg=0.42, thick=0.065, neck=0.26, tilt=52, head=0.19, muzzle=1.1, tails="up",
    tail=0.4, brush=(0.05, 0.05, 0.045, 0.03),
)  # fmt: skip
_WOLF = FourLegged(
    length=0.85, girth=0.22, waist=0.85, leg=0.5, thick=0.065, neck=0.26, tilt=36, nape=1.0, head=0.18, muzzle=1.3,
    snout=(0.58, 0.36), tails="down", tail=0.6, brush=(0.06, 0.11, 0.11, 0.03),
)  # fmt: skip
_CAT = FourLegged(
    length=0.72, girth=0.17, waist=0.86, leg=0.34, thick=0.055, neck=0.14, tilt=48, nape=0.9, head=0.2, broad=1.05,
    muzzle=0.15, snout=(0.5, 0.4), tails="up", tail=0.6, brush=(0.045, 0.045, 0.045, 0.04),
)  # fmt: skip
_LION = FourLegged(
    length=0.95, girth=0.23, waist=0.86, leg=0.4, thick=0.08, neck=0.22, tilt=38, nape=0.9, head=0.21, muzzle=0.5,
    snout=(0.6, 0.5), ears="round", ear=0.12, tails="swung", tail=0.75, brush=(0.05, 0.04, 0.04, 0.11),
)  # fmt: skip
_BEAR = FourLegged(
    girth=0.34, deep=1.05, leg=0.3, thick=0.13, thigh=1.3, neck=0.16, tilt=18, nape=0.85, head=0.25, muzzle=0.85,
    snout=(0.55, 0.42), ears="round", ear=0.15, tails="down", tail=0.1, brush=(0.07, 0.07, 0.06, 0.05),
)  # fmt: skip
_PIG = FourLegged(
    length=0.75, girth=0.33, deep=1.0, leg=0.2, thick=0.085, paw=0, neck=0, tilt=14, head=0.26, muzzle=0.5,
    snout=(0.52, 0.5), drop=-8, ear=0.22, tails="curled", tail=0.16, brush=(0.035, 0.035, 0.03, 0.025),
)  # fmt: skip
_SHEEP = FourLegged(
    length=0.6, girth=0.25, leg=0.3, thick=0.055, thigh=1.1, paw=0, neck=0.06, tilt=38, head=0.16, muzzle=0.9,
    snout=(0.7, 0.5), drop=-42, mask="head", ears="side", tails="down", tail=0.14, brush=(0.08, 0.09, 0.08, 0.05),
)  # fmt: skip
_ASIDE = ((0.8, 0.0, 0.1), (0.35, 0.25, 0.1), (0.05, 0.4, 0.0))
_SNOUT = (0.7, 0.58)


@of(CATTLE, leg=0.28, girth=0.35, horns=(0.6, 0.06, _ASIDE))
def highland_cow(animal: Animal) -> None:
    """Draw a shaggy cow with very long level horns and a fringe over its brow."""
    animal.ball("head", animal.on_head(0.3, 0.4, 0.6), animal.head * np.array([0.45, 0.75, 0.4]), two=True)
    animal.ball("body", [0, 0.75 * animal.height, 0], [animal.girth, 0.24, animal.half + 0.1])


@of(DEER, girth=0.25, tilt=42, leg=0.48, nape=0.9)
def reindeer(animal: Animal) -> None:
    """Draw a sturdy deer with long antlers that sweep back and up, with many points."""
    size, root = animal.sized("horns", 0.75), animal.on_head(0.35, 0.65, -0.1)
    steps = size * np.array([(0.3, 0.3, -0.3), (0.15, 0.45, 0.0), (-0.05, 0.3, 0.3)])
    animal.two("horn", strand(root, steps, [0.05, 0.045, 0.04, 0.02]))
    for k in range(3):
        fork, way = root + steps[:k].sum(0) + 0.6 * steps[k], size * np.array([0.05 * k, 0.22, 0.25 - 0.4 * (k == 1)])
        animal.two("horn", limb([fork, fork + way], [0.036, 0.014], segments=8, samples=2))


@of(_SHEEP, length=0.5, cap=0.85)
def fleece_sheep(animal: Animal) -> None:
    """Draw a sheep with one smooth round fleece and a woollen cap."""
    bulk = animal.girth * np.array([1.4, 1.35, 1.0]) + [0, 0, animal.half]
    animal.parts["body"] = [ellipsoid([0, animal.height + 0.04, 0], bulk, rings=12)]


@of(_SHEEP, girth=0.3, neck=0.16, length=0.75, ear=0.15)
def ram(animal: Animal) -> None:
    """Draw a ram: a strong body, great horns that curl round beside the face."""
    turn, size = np.linspace(0, 1.7 * np.pi, 10), animal.rng.uniform(0.9, 1.2) * np.linspace(1.0, 0.55, 10)
    path = animal.head * np.stack([np.linspace(0.45, 1.5, 10), size * np.cos(turn), -size * np.sin(turn)], 1)
    widths = np.linspace(0.42, 0.1, 10) * animal.head
    animal.two("horn", strand(animal.on_head(0, -0.1, -0.15) + path[0], np.diff(path, axis=0), widths))


def _mane(animal: Animal) -> None:
    """Add a smooth ruff that falls over the chest."""
    mane = animal.sized("mane", 0.18) + 0.8 * animal.head
    animal.add("mane", ellipsoid(animal.on_head(0, 0.05, -0.75), [mane, 1.08 * mane, 0.6 * mane], rings=8))
    chest = animal.on_head(0, -0.6, -0.9) - [0, 0.45 * mane, 0]
    animal.add("mane", limb([chest + [0, 0.3 * mane, 0.1], chest - [0, 0.5 * mane, 0]], [0.75 * mane, 0.3 * mane]))


@of(_WOLF, tilt=8, girth=0.24, waist=0.8, slope=0.04)
def ruffed_wolf(animal: Animal) -> None:
    """Draw a wolf that stalks: a low head, a ruff about its neck, a bushy tail."""
    animal.ball("mane", (animal.withers + animal.skull) / 2 - [0, 0.1, 0], 1.15 * animal.girth)
    for low in (0.0, -0.4):
        tuft = [animal.on_head(0.6, low, -0.2), animal.on_head(1.35, low - 0.5, -0.55)]
        animal.two("mane", limb(tuft, [0.1, 0.015], segments=8, samples=2))


def _disc(animal: Animal) -> None:
    """End the muzzle of a pig in a disc."""
    way = (animal.muzzle - animal.skull) / np.linalg.norm(animal.muzzle - animal.skull)
    flat = disc(0.54 * animal.head, 0.0, 0.35 * animal.head, edge=0.02)
    animal.add("nose", moved(turned(flat, float(np.degrees(np.arctan2(way[2], way[1]))), "x"), animal.muzzle))


KINDS = {
    "bear": (
        breed("polar_bear", _BEAR, neck=0.36, tilt=14, head=0.2, muzzle=1.1, girth=0.32, ear=0.09),
        breed("grizzly", _BEAR, slope=0.06, hips=0.85, tilt=2, girth=0.36),
        breed("bear_cub", _BEAR, length=0.6, leg=0.24, head=0.28, cartoon=0.8, neck=0.05, tilt=40),
        breed("upright_cub", Upright(leg=0.2, thick=0.13, muzzle=0.6, ears="round", ear=0.22, head=0.33)),
    ),
    "cat": (
        breed("kitten", _CAT, length=0.5, leg=0.22, head=0.25, cartoon=0.8, tail=0.45),
        breed("bushy_cat", _CAT, girth=0.22, tail=0.65, brush=(0.06, 0.12, 0.13, 0.05), tails="up", head=0.21),
        breed("loaf_cat", _CAT, leg=0.01, girth=0.26, thick=0.07, neck=0.05, tails="level", tail=0.5),
        breed("slim_cat", _CAT, girth=0.13, leg=0.44, neck=0.22, head=0.16, ear=0.24, muzzle=0.35, tail=0.75),
    ),
    "cow": (
        breed("bull", CATTLE, girth=0.37, hips=0.74, waist=0.82, slope=0.06, tilt=5, neck=0.14, nape=1.0, ear=0.16,
              horns=(0.36, 0.075, ((0.75, 0.05, 0.1), (0.25, 0.4, 0.3), (-0.05, 0.4, 0.1)))),
        highland_cow,
        breed("calf", CATTLE, cartoon=1.0, girth=0.27, length=0.7, horns=(0.13, 0.05, ((0.3, 0.5, 0), (0.1, 0.5, 0)))),
    ),
    "deer": (
        reindeer,
        breed("doe", DEER, ear=0.28),
        breed("fawn", DEER, length=0.5, leg=0.5, neck=0.24, head=0.17, muzzle=1.0, ear=0.28, cartoon=0.7),
    ),
    "dog": (
        breed("husky", _DOG, tails="curled", tail=0.5, brush=(0.07, 0.09, 0.09, 0.04), girth=0.23),
        breed("dachshund", _DOG, length=1.15, leg=0.12, girth=0.18, ears="hanging", ear=0.28, muzzle=1.5),
        breed("bulldog", _DOG, girth=0.29, hips=0.75, leg=0.24, thick=0.09, neck=0.08, tilt=30, head=0.25, muzzle=0.3,
              snout=(0.8, 0.75), ear=0.14, tail=0.1),
        breed("greyhound", _DOG, length=0.85, girth=0.19, waist=0.66, deep=1.35, leg=0.62, thick=0.05, neck=0.36,
              head=0.15, muzzle=1.6, ears="hanging", ear=0.14, tails="hanging", tail=0.6),
        breed("puppy", _DOG, length=0.55, leg=0.24, head=0.25, muzzle=0.8, ears="hanging", ear=0.26, cartoon=0.9),
    ),
    "hamster": (upright_hamster,),
    "horse": (
        breed("maned_horse", HORSE, neck=0.46, mane=0.18, brush=(0.05, 0.11, 0.13, 0.04)),
        breed("draught_horse", HORSE, girth=0.31, leg=0.5, thick=0.11, nape=0.9, head=0.18),
        breed("pony", HORSE, length=0.7, girth=0.28, leg=0.34, neck=0.32, head=0.17, cartoon=0.4),
        breed("cartoon_horse", HORSE, length=0.6, leg=0.4, head=0.2, cartoon=1.0, thick=0.085),
    ),
    "lion": (
        breed("maned_lion", _LION, _mane),
        breed("cartoon_lion", _LION, _mane, length=0.6, leg=0.26, head=0.26, thick=0.09, cartoon=0.6),
    ),
    "monkey": (
        breed("walking_monkey", FourLegged(length=0.6, girth=0.17, leg=0.46, thick=0.055, neck=0.05, head=0.19, paw=1.8,
              muzzle=0.35, snout=_SNOUT, ears="cup", tails="over", tail=1.0, front="arm", brush=(0.045,) * 4)),
        breed("chimpanzee", Upright(trunk=0.55, hips=0.22, belly=0.23, chest=0.2, leg=0.26, reach=0.75, thick=0.08,
              lift=22, head=0.22, muzzle=0.4, hold=0.3, snout=_SNOUT, ears="cup", lean=16)),
        breed("sitting_monkey", Upright(hips=0.27, belly=0.25, chest=0.18, head=0.29, muzzle=0.35, snout=_SNOUT,
              ears="cup", ear=0.26, thick=0.07, tails="over", tail=0.9, brush=(0.045,) * 4)),
    ),
    "mouse": (
        breed("field_mouse", SMALL, girth=0.19, leg=0.1, thick=0.04, muzzle=1.2, head=0.17, tails="level", ear=0.22,
              tail=0.9, brush=(0.04, 0.03, 0.025, 0.015)),
        breed("rat", SMALL, length=0.85, girth=0.2, leg=0.13, thick=0.05, muzzle=1.5, head=0.17, snout=(0.6, 0.22),
              tails="down", tail=1.1, brush=(0.05, 0.04, 0.03, 0.015)),
        breed("cartoon_mouse", Upright(leg=0.2, hips=0.24, belly=0.22, chest=0.15, thick=0.07, muzzle=0.7, ears="round",
              snout=(0.5, 0.22), ear=0.42, tails="over", tail=0.8, brush=(0.035, 0.03, 0.03, 0.02))),
    ),
    "panda": (
        breed("walking_panda", _BEAR, patched, girth=0.4, hips=1.05, head=0.31, broad=1.18, muzzle=0.35, neck=0.06,
              tilt=26, ear=0.17, eyes=(0.48, 0.13, 1.0, 0.11)),
    ),
    "pig": (
        breed("hog", _PIG, _disc, length=0.9, girth=0.3, leg=0.26, ears="hanging", ear=0.24, muzzle=0.7),
        breed("piglet", _PIG, _disc, length=0.5, girth=0.28, head=0.28, leg=0.16, cartoon=0.8),
        breed("potbelly", _PIG, _disc, girth=0.4, leg=0.1, arch=-0.05, muzzle=0.3),
    ),
    "sheep": (
        fleece_sheep, ram,
        breed("lamb", _SHEEP, leg=0.38, girth=0.22, head=0.19, muzzle=0.7, ear=0.26, tail=0.3, cartoon=0.5),
    ),
    "squirrel": (
        breed("running_squirrel", SMALL, girth=0.17, leg=0.12, thick=0.045, head=0.16, ears="pointed", ear=0.13,
              tails="up", tail=0.9, brush=(0.07, 0.16, 0.18, 0.07)),
    ),
    "wolf": (
        ruffed_wolf,
        breed("lean_wolf", _WOLF),
        breed("cartoon_wolf", _WOLF, length=0.6, leg=0.34, head=0.26, muzzle=1.1, cartoon=0.7, tails="level"),
    ),
}  # fmt: skip
