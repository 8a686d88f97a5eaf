"""Draw other kinds of crocodiles, turtles, frogs and snakes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshdeform.nouns.families.bodies import Animal, FourLegged, breed, strand, tube
from meshdeform.nouns.families.parts import (
    Array,
    Part,
    ellipsoid,
    lathe,
    limb,
    moved,
    named,
    plate,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits

__all__: list[str] = []

_CROCODILE = FourLegged(
    length=1.0, girth=0.24, deep=0.7, leg=0.1, sprawl=0.18, thick=0.085, paw=1.6, neck=0.1, tilt=8, nape=0.85,
    head=0.19, broad=1.1, muzzle=1.9, snout=(1.0, 0.75), drop=-3, ears="", eyes=(0.6, 0.75, 0.1, 0.38),
    tails="level", tail=1.0, brush=(0.17, 0.13, 0.08, 0.03),
)  # fmt: skip
_TORTOISE = FourLegged(
    length=0.6, girth=0.3, leg=0.18, thick=0.11, thigh=1.2, paw=0.8, neck=0.28, tilt=32, nape=0.45, head=0.13,
    muzzle=0.2, snout=(0.8, 0.6), mask="head", ears="", tails="down", tail=0.16, cartoon=0.0,
)  # fmt: skip


def _plates(animal: Animal) -> None:
    """Add a row of plates along back and tail."""
    places = np.concatenate([animal.parts["body"][0].verts, animal.parts["tail"][0].verts])
    for z in np.linspace(0.8 * animal.half, places[:, 2].min() + 0.2, 9):
        near = places[np.abs(places[:, 2] - z).argsort()[:24]]
        top = near[near[:, 1].argmax()] - [0, 0.02, 0]
        animal.add("spike", limb([top, top + [0, 0.12, -0.05]], [[0.05, 0.09], [0.015, 0.03]], segments=6, samples=1))


def _shell(animal: Animal) -> None:
    """Put a dome with a rim in place of the body."""
    wide, y = 1.45 * animal.girth, animal.height - 0.02
    dome, long = animal.girth * animal.rng.uniform(1.25, 1.75), animal.half * animal.rng.uniform(1.65, 1.95)
    turn, rim = np.radians(np.linspace(0, 90, 9)), np.linspace(0, 2 * np.pi, 24, endpoint=False)
    profile = [(0.75, -0.16), (0.97, -0.08), *np.stack([np.cos(turn), dome * np.sin(turn)], 1)[:-1], (0.0, dome)]
    edge = plate(1.05 * np.stack([wide * np.cos(rim), long * np.sin(rim)], 1), 0.1, across="y")
    animal.add("shell", moved(stretched(lathe(profile), wide, 1.0, long), [0, y, 0]), moved(edge, [0, y, 0]))
    animal.parts.pop("body")


def sea_turtle(rng: Rng, traits: Traits) -> Part:
    """Draw a swimming turtle: a flat drop-shaped shell, long front flippers like wings, short hind ones."""
    animal = Animal(rng, traits)
    head, neck = animal.sized("head", 0.17), animal.sized("neck", 0.2)
    wide, long, reach = rng.uniform(0.44, 0.54), rng.uniform(0.6, 0.7), rng.uniform(0.7, 1.0)
    spine, skull = (
        [[0, 0, -long], [0, 0.04, -0.2], [0, 0.04, 0.3], [0, 0, 0.5]],
        np.array([0, 0.08, 0.66 + neck + 0.5 * head]),
    )
    animal.add("shell", tube(spine, [0.12, wide, wide, 0.3], [0.1, 0.24, 0.26, 0.16]))
    blade = reach * np.array([(0, 0.14), (0.5, 0.2), (1.0, -0.45), (0.9, -0.55), (0.45, -0.16), (0, -0.14)])
    front = turned(plate(blade, 0.09, across="y"), rng.uniform(-25, 20), "z")
    rear = turned(plate(0.45 * blade, 0.08, across="y"), 35, "y")
    animal.two("leg", moved(front, [0.6 * wide, 0, 0.36]), moved(rear, [0.3 * wide, -0.02, -0.8 * long]))
    animal.add("neck", tube([np.array([0, 0, 0.4]), skull], [0.16, 0.11], [0.13, 0.1]))
    animal.add("head", ellipsoid(skull, head * np.array([0.85, 0.8, 1.15]), rings=9))
    animal.add("tail", limb([[0, 0, -long], [0, -0.02, -long - 0.16]], [0.07, 0.03], segments=8, samples=2))
    return named(**animal.parts)


def _add_frog(animal: Animal, wide: float, lift: float, eye: float, squat: float) -> None:
    """Add the solids of a frog."""
    eyes, legs, chest = animal.sized("eyes", eye), animal.sized("legs", 0.5), np.array([0.0, 0.3 + lift, 0.3])
    bulk, skull = wide * np.array([0.7, 1.0, 0.9]), chest + [0, 0.1, 0.2]
    animal.add(
        "body", tube(np.array([[0, 0.24, -0.42], [0, 0.3, -0.1], [*chest]]), bulk, [0.2, 0.28, 0.26], segments=18)
    )
    animal.add("head", ellipsoid(skull, [0.98 * wide, 0.22, 0.34], rings=10))
    animal.ball("eye", skull + [0.58 * wide, 0.14 + 0.4 * eyes, 0.05], eyes, two=True)
    hip, arm = np.array([0.65 * wide, 0.24, -0.4]), np.array([0.75 * wide, chest[1] - 0.02, 0.3])
    knee, ankle = hip + legs * np.array([0.35 + squat, 0.35, 0.62]), [hip[0] + 0.12 + squat * legs, 0.07, -0.3]
    hand = np.array([arm[0] + 0.14, 0.05, arm[2] + 0.16])
    animal.two("leg", limb([hip, knee], [0.17, 0.12], segments=12), limb([knee, ankle], [0.11, 0.08], segments=10))
    elbow = (arm + hand) / 2 + [0.1, 0.04, -0.06]
    animal.two("leg", limb([arm, elbow, hand], [0.1, 0.08, 0.07], segments=10, samples=3))
    for toe, reach in ((np.array(ankle), 0.34), (hand, 0.2)):
        for side in (-0.5, 0.05, 0.6):
            tip = toe * [1, 0, 1] + reach * np.array([side, 0, 0.9]) + [0, 0.045, 0]
            animal.two("foot", limb([toe, tip], [0.05, 0.055], segments=6, samples=1))


def _frog(name: str, wide: float, lift: float, eye: float, squat: float) -> Callable[[Rng, Traits], Part]:
    """Return a family of frogs: `lift` of the chest above the rump, radius of the eyes, hind legs folded wide."""

    def family(rng: Rng, traits: Traits) -> Part:
        animal = Animal(rng, traits)
        _add_frog(animal, wide * rng.uniform(0.88, 1.12), lift + rng.uniform(-0.05, 0.08), eye, squat)
        return named(**animal.parts)

    family.__name__ = name
    return family


def _snake(animal: Animal, knots: Array, thick: float) -> Part:
    """Draw a snake along knots (N, 3) from its tail to its head."""
    head = animal.head = animal.sized("head", 1.45 * thick)
    radii = thick * np.concatenate([[0.2, 0.6, 0.85], np.ones(len(knots) - 4), [0.75]])
    animal.skull = knots[-1] + [0, 0, 0.5 * head]
    animal.add("body", strand(knots[0], np.diff(knots, axis=0), radii, segments=12))
    jaw = [animal.on_head(0, 0.05, -0.5), animal.on_head(0, 0, 0.2), animal.on_head(0, -0.15, 1.2)]
    animal.add("head", limb(jaw, head * np.array([[0.55, 0.75], [0.62, 1.0], [0.35, 0.5]]), segments=14))
    animal.ball("eye", animal.on_head(0.6, 0.45, 0.3), 0.24 * head, two=True)
    return named(**animal.parts)


def slithering_snake(rng: Rng, traits: Traits) -> Part:
    """Draw a snake that winds over the ground, its head a little raised."""
    thick, t = rng.uniform(0.07, 0.12), np.arange(2 * int(rng.integers(4, 7)) + 1)
    side = rng.uniform(0.22, 0.36) * np.sin(np.pi * t / 2) * np.minimum(1, (t[-1] - t) / 2)
    knots = np.stack([side, np.full(len(t), thick), 2.0 * t / t[-1] - 1.0], 1)
    return _snake(Animal(rng, traits), np.concatenate([knots, knots[-1] + [[0, 0.08, 0.14], [0, 0.16, 0.26]]]), thick)


def _coil(thick: float, turns: float, inner: float) -> Array:
    """Return knots of a coil on the ground from outside to its middle, which climbs."""
    turn = np.linspace(0, turns * 2 * np.pi, int(9 * turns))
    radius = np.linspace(inner + 2.0 * thick * turns, inner, len(turn))
    level, phase = thick + np.linspace(0, 1.2 * thick * turns, len(turn)), turn - turn[-1] + np.pi
    return np.stack([radius * np.sin(phase), level, radius * np.cos(phase)], 1)


def cobra(rng: Rng, traits: Traits) -> Part:
    """Draw a cobra: a coil from which a neck rises with a spread hood, the head looking ahead."""
    animal, thick, rise = Animal(rng, traits), rng.uniform(0.1, 0.13), rng.uniform(0.7, 1.0)
    coil = _coil(thick, rng.uniform(1.6, 2.2), 0.25)
    neck = coil[-1] * [0, 1, 1] + rise * np.array([[0, 0.3, 0.12], [0, 0.65, 0.1], [0, 0.95, 0.18], [0, 1.02, 0.34]])
    spread = thick * np.array([[0.9, 3.0, 1.3], [0.6, 0.5, 0.6]])
    animal.add("neck", tube(neck[:3] - [0, 0.02, 0.03], spread[0], spread[1]))
    return _snake(animal, np.concatenate([coil, neck]), thick)


def coiled_snake(rng: Rng, traits: Traits) -> Part:
    """Draw a snake at rest: a flat coil with the head lying on top."""
    thick = rng.uniform(0.12, 0.17)
    coil = _coil(thick, rng.uniform(1.8, 2.6), 0.2)
    top = coil[-1] + np.array([[0.05, 1.3 * thick, 0.16], [0.05, 1.6 * thick, 0.36], [0.0, 1.7 * thick, 0.55]])
    return _snake(Animal(rng, traits), np.concatenate([coil, top]), thick)


KINDS = {
    "crocodile": (
        breed("alligator", _CROCODILE, _plates),
        breed("gharial", _CROCODILE, _plates, snout=(0.7, 0.26), muzzle=3.0, girth=0.2),
        breed("cartoon_crocodile", _CROCODILE, _plates, length=0.6, girth=0.26, deep=0.95, head=0.25, muzzle=1.4,
              snout=(0.95, 0.72), tail=0.6, sprawl=0.13),
    ),
    "frog": (
        _frog("toad", 0.53, 0.05, 0.12, 0.12), _frog("tree_frog", 0.32, 0.17, 0.17, 0.45),
        _frog("cartoon_frog", 0.47, 0.42, 0.23, 0.1),
    ),
    "snake": (slithering_snake, cobra, coiled_snake),
    "turtle": (
        sea_turtle,
        breed("tortoise", _TORTOISE, _shell),
        breed("cartoon_turtle", _TORTOISE, _shell, length=0.5, girth=0.25, leg=0.12, neck=0.12, tilt=45, head=0.24,
              muzzle=0.12, tails="level"),
    ),
}  # fmt: skip
