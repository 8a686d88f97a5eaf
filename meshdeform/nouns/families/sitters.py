"""Draw animals that sit or stand upright, those that lie on the shore, and a bat."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import at
from meshdeform.nouns.families.bodies import Animal, FourLegged, Upright, of, strand, tube
from meshdeform.nouns.families.parts import Part, ellipsoid, limb, moved, named, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bat",  "gorilla", "kangaroo", "koala",  "panda", "seal",  "squirrel", "walrus"]  # fmt: skip


def _patches(animal: Animal, wide: float, high: float, slant: float) -> None:
    """Add a flat patch about each eye, in radii of the head."""
    flat = ellipsoid([0, 0, 0], animal.head * np.array([wide, high, 0.1]), rings=5)
    animal.two("cheek", moved(turned(turned(flat, slant, "z"), 24, "y"), animal.on_head(0.45, 0.16, 0.83)))


@of(Upright(thick=0.14, head=0.33, broad=1.12, muzzle=0.45, snout=(0.5, 0.4), ears="round", ear=0.28, hips=0.42,
            belly=0.42, chest=0.3, foot=0.2, reach=0.4, eyes=(0.42, 0.18, 0.86, 0.13)))  # fmt: skip
def panda(animal: Animal) -> None:
    """Draw a sitting panda: a round belly, thick limbs, a broad head with round ears, patches about the eyes."""
    _patches(animal, 0.3, 0.4, 28)


@of(Upright(thick=0.1, head=0.34, broad=1.2, muzzle=0.28, snout=(0.3, 0.22), drop=-20, ears="", trunk=0.55, hips=0.33,
            belly=0.32, lift=55, hold=0.9, eyes=(0.5, 0.2, 0.86, 0.13)))  # fmt: skip
def koala(animal: Animal) -> None:
    """Draw a sitting koala: a big head with great round fluffy ears at its sides, a long nose, a small body."""
    ears = animal.sized("ears", 0.19)
    for x, y, size in ((0.45, 0.45, 1.0), (1.2, 0.35, 0.5), (0.95, -0.2, 0.55), (0.55, -0.45, 0.5)):
        middle = animal.on_head(0.95, 0.3, 0.0) + ears * np.array([x, y, 0.0])
        animal.ball("ear", middle, ears * size * np.array([1.0, 1.0, 0.45]), two=True)


@of(Upright(thick=0.065, head=0.22, muzzle=0.7, snout=(0.6, 0.25), ear=0.16, trunk=0.55, hips=0.29, belly=0.25,
            chest=0.17, lean=12, reach=0.26, foot=0.12, lift=50, hold=1.4))  # fmt: skip
def squirrel(animal: Animal) -> None:
    """Draw a squirrel that sits up: paws before its chest, and behind it a bushy tail as tall as itself that curls."""
    length, turn = animal.sized("tail", 1.5) / 7, animal.rng.uniform(-8, 8)
    steps = [at(angle + turn, length) for angle in (195, 120, 80, 75, 105, 165, 235)]
    animal.add("tail", strand(animal.rump, steps, [0.08, 0.15, 0.19, 0.2, 0.2, 0.19, 0.15, 0.05], segments=12))


@of(Upright(trunk=0.85, hips=0.3, belly=0.24, chest=0.14, lean=20, thick=0.06, reach=0.3, hold=0.9, lift=25, head=0.15,
            muzzle=1.3, snout=(0.7, 0.45), drop=-28, ears="leaf", ear=0.3, neck=0.1, leg=0.25))  # fmt: skip
def kangaroo(animal: Animal) -> None:
    """Draw a kangaroo: a pear of a body on great folded legs with long feet, a thick tail, small arms, tall ears."""
    animal.parts["leg"], animal.parts["foot"], y = [], [], animal.height
    hip, knee, ankle = [0.24, y + 0.06, -0.02], [0.3, 0.84 * y, 0.3], [0.28, 0.1, -0.16]
    animal.two("leg", limb([hip, knee], [[0.2, 0.24], [0.12, 0.13]], segments=12))
    animal.two("leg", limb([knee, ankle], [0.11, 0.065], segments=8))
    animal.two("foot", limb([[0.28, 0.07, -0.16], [0.3, 0.05, 0.38]], [[0.06, 0.08], [0.05, 0.09]], segments=10))
    steps = np.array([[0, -0.75 * animal.rump[1], -0.3], [0, -0.1, -0.35], [0, 0.04, -0.4]])
    steps[:, 2] *= animal.sized("tail", 1.05)
    animal.add("tail", strand(animal.rump + [0, 0.05, 0.1], steps, [0.2, 0.12, 0.09, 0.05], segments=12))
    animal.ball("body", [0, y + 0.05, 0.2], [0.2, 0.2, 0.16])


@of(FourLegged(length=0.5, girth=0.3, hips=0.72, waist=0.9, deep=1.0, slope=0.26, leg=0.42, thick=0.12, neck=0, tilt=34,
               head=0.22, broad=0.95, muzzle=0.35, snout=(0.72, 0.66), drop=-38, ears="round", ear=0.06, tail=0,
               front="arm", paw=1.0, cartoon=0.0))  # fmt: skip
def gorilla(animal: Animal) -> None:
    """Draw a gorilla that leans on long thick arms, with huge shoulders, short legs and a crested head, no neck."""
    animal.parts["arm"], animal.parts["hand"] = [], []
    shoulder = animal.withers * [0, 1, 1] + [animal.girth, -0.22, 0.0]
    fist = shoulder * [1.35, 1, 1] + [0, 0.1 - animal.sized("arms", float(shoulder[1])), 0.2]
    elbow = (shoulder + fist) / 2 + [0.1, 0.02, -0.02]
    animal.two("arm", limb([shoulder, elbow, fist], [0.19, 0.145, 0.12], segments=12))
    animal.ball("hand", fist, [0.13, 0.11, 0.15], two=True)
    animal.ball("head", animal.on_head(0, 0.65, -0.15), animal.head * np.array([0.6, 0.75, 0.8]))
    brow = [animal.on_head(-0.55, 0.3, 0.7), animal.on_head(0, 0.36, 0.85), animal.on_head(0.55, 0.3, 0.7)]
    animal.add("head", limb(brow, 0.22 * animal.head * np.ones(3), segments=8, samples=2))


def _on_the_shore(animal: Animal, stout: float) -> None:
    """Add a body that tapers to hind flippers, front flippers, and a raised head with eyes."""
    girth, rise, head = 0.27 * stout, animal.rng.uniform(0.4, 0.75), animal.sized("head", 0.2 * stout)
    animal.head, animal.skull = head, np.array([0.0, 0.3 + rise, 0.58 + 0.3 * head])
    path = [[0, 0.1, -1.15], [0, 0.15, -0.8], [0, 0.95 * girth, -0.2], [0, girth + 0.1, 0.25], [0, 0.2 + rise, 0.5]]
    bulk = girth * np.array([0.25, 0.5, 1.0, 0.98, 0.62])
    animal.add("body", tube(path, bulk, bulk, segments=18))
    paddle = np.array([(-0.05, 0.28), (0.7, 0.16), (1.0, -0.25), (0.85, -0.5), (0.4, -0.32), (-0.05, -0.2)])
    flat = plate(animal.sized("fins", 0.42) * paddle, 0.09, across="y")
    animal.two("fin", moved(turned(turned(flat, -22, "z"), -15, "y"), [0.75 * girth, 0.22, 0.28]))
    animal.two("fin", moved(turned(flat._replace(verts=0.75 * flat.verts), 60, "y"), [0.04, 0.11, -1.15]))
    animal.add("head", ellipsoid(animal.skull, [head, 0.92 * head, head], rings=9))
    animal.ball("eye", animal.on_head(0.55, 0.35, 0.68), 0.16 * head, two=True)


def seal(rng: Rng, traits: Traits) -> Part:
    """Draw a seal: a smooth body that tapers to hind flippers, a raised round head with a short muzzle."""
    animal = Animal(rng, traits)
    _on_the_shore(animal, rng.uniform(0.9, 1.1))
    animal.ball("nose", animal.on_head(0.18, -0.2, 0.8), 0.34 * animal.head, two=True)
    animal.ball("nose", animal.on_head(0, 0.02, 1.12), 0.15 * animal.head)
    return named(**animal.parts)


def walrus(rng: Rng, traits: Traits) -> Part:
    """Draw a walrus: a huge body that tapers to hind flippers, bristly cheeks over two long tusks that hang down."""
    animal = Animal(rng, traits)
    _on_the_shore(animal, rng.uniform(1.25, 1.5))
    tusks, cheek = animal.sized("tusks", 0.5), animal.on_head(0.38, -0.25, 0.75)
    animal.ball("nose", cheek, animal.head * np.array([0.46, 0.4, 0.42]), two=True)
    animal.ball("nose", animal.on_head(0, 0.05, 1.0), 0.22 * animal.head)
    path = [cheek, cheek + [0.02, -0.5 * tusks, 0.06], cheek + [-0.02, -tusks - 0.05, 0.02]]
    animal.two("tusk", limb(path, [0.07, 0.055, 0.02], segments=10))
    return named(**animal.parts)


@of(Upright(trunk=0.34, hips=0.12, belly=0.16, chest=0.15, reach=0, leg=0.12, thick=0.03, foot=0.05, head=0.17,
            muzzle=0.3, snout=(0.5, 0.36), ear=0.26, eyes=(0.4, 0.25, 0.8, 0.16)))  # fmt: skip
def bat(animal: Animal) -> None:
    """Draw a flying bat: a small furry body, a head with great pointed ears, wings of skin with scalloped edges."""
    span, lift = animal.sized("wings", 0.95), animal.rng.uniform(-5, 28)
    rim = [(0, 0.12), (0.3, 0.3), (0.52, 0.36), (0.8, 0.2), (1.0, -0.12), (0.78, -0.06), (0.68, -0.3), (0.5, -0.14)]
    rim += [(0.38, -0.36), (0.22, -0.16), (0.0, -0.25)]
    wing = [plate(span * np.array(rim), 0.05, across="z")]
    wing.append(
        limb(span * np.array([[0, 0.1, 0], [0.5, 0.34, 0], [1, -0.1, 0]]), [0.04, 0.035, 0.015], segments=8, samples=2)
    )
    fingers = span * np.array([[[0.5, 0.34, 0], [x, -0.28, 0]] for x in (0.38, 0.68)])
    wing += [limb(finger, [0.028, 0.015], segments=6) for finger in fingers]
    root = [0.1, animal.height + 0.2, -0.03]
    animal.two("wing", *(moved(turned(turned(part, lift, "z"), -12, "y"), root) for part in wing))
