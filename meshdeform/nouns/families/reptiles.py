"""Draw lizards and dinosaurs, and other kinds of crocodiles, turtles, frogs and snakes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshdeform.nouns.families.animals import at
from meshdeform.nouns.families.bodies import Animal, FourLegged, breed, of, strand, tube
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
)  # fmt: skip
from meshdeform.nouns.families.traits import Rng, Traits

_HEAVY = FourLegged(
    length=0.8, girth=0.33, hips=1.0, arch=0.06, leg=0.28, thick=0.12, thigh=1.3, paw=0.9, neck=0.1, tilt=5, head=0.2,
    muzzle=1.1, snout=(0.75, 0.5), drop=-22, mask="head", ears="", tails="down", tail=0.8,
    brush=(0.22, 0.13, 0.07, 0.02),
)  # fmt: skip

lizard = breed(
    "lizard", _HEAVY, length=0.95, girth=0.18, deep=0.75, arch=0, leg=0.07, sprawl=0.15, thick=0.045, paw=2.4,
    neck=0.12, tilt=14, nape=0.8, head=0.14, muzzle=0.9, snout=(0.85, 0.45), drop=-6, eyes=(0.68, 0.5, 0.2, 0.3),
    tails="level", tail=1.2, brush=(0.12, 0.075, 0.04, 0.015),
)  # fmt: skip
_CROCODILE = FourLegged(
    length=1.0, girth=0.24, deep=0.7, leg=0.1, sprawl=0.18, thick=0.085, paw=1.6, neck=0.1, tilt=8, nape=0.85,
    head=0.19, broad=1.1, muzzle=1.9, snout=(1.0, 0.75), drop=-3, ears="", eyes=(0.6, 0.75, 0.1, 0.38),
    tails="level", tail=1.0, brush=(0.17, 0.13, 0.08, 0.03),
)  # fmt: skip
_TORTOISE = FourLegged(
    length=0.6, girth=0.3, leg=0.18, thick=0.11, thigh=1.2, paw=0.8, neck=0.28, tilt=32, nape=0.45, head=0.13,
    muzzle=0.2, snout=(0.8, 0.6), mask="head", ears="", tails="down", tail=0.16, cartoon=0.0,
)  # fmt: skip


@of(_HEAVY, length=0.66, girth=0.15, deep=1.7, waist=1.15, arch=0.1, leg=0.22, thick=0.05, neck=0, tilt=14, head=0.19,
    broad=0.75, muzzle=0.8, snout=(0.8, 0.42), drop=-24, tail=0, paw=1.2, cartoon=0.0)  # fmt: skip
def chameleon(animal: Animal) -> None:
    """Draw a chameleon: a tall narrow body with an arched back, turret eyes, a casque, a tail rolled to a spiral."""
    eyes, tail = animal.sized("eyes", 0.085), animal.sized("tail", 1.0)
    animal.ball("eye", animal.on_head(0.7, 0.3, 0.3) + [0.4 * eyes, 0, 0], eyes, two=True)
    casque = [animal.on_head(0, 0.2, -0.2), animal.on_head(0, 1.35, -0.9)]
    animal.add("crest", limb(casque, animal.head * np.array([[0.6, 0.8], [0.12, 0.3]]), segments=10))
    turn = np.linspace(0, animal.rng.uniform(2.4, 3.2) * np.pi, 22)
    coil = 0.3 * tail * np.exp(-0.17 * turn) * np.stack([0 * turn, np.cos(turn), -np.sin(turn)])
    path = np.concatenate([[[0, -0.1, 0.1]], coil.T + [0, -0.25, -0.32 * tail - 0.12]]) + animal.rump
    animal.add("tail", tube(path, np.linspace(0.11, 0.025, 23), np.linspace(0.11, 0.025, 23), segments=10, samples=1))


@of(_HEAVY, head=0.25, muzzle=1.0, snout=(0.8, 0.36), tail=0.65, tilt=8)
def triceratops(animal: Animal) -> None:
    """Draw a triceratops: a heavy body, a great head with a beak, a broad frill behind it and three horns."""
    horns, size = animal.sized("horns", 0.4), 0.44 * animal.rng.uniform(0.85, 1.15) * (0.6 + 1.6 * animal.head)
    turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    reach = size * (1 + 0.07 * np.cos(12 * turn)) * np.where(np.sin(turn) < -0.4, 0.75, 1.0)
    frill = plate(np.stack([1.1 * reach * np.cos(turn), reach * np.sin(turn)], 1), 0.1, across="z", puff=0.2)
    animal.add("crest", moved(turned(frill, animal.rng.uniform(-38, -20), "x"), animal.on_head(0, 0.45, -0.45)))
    brow, nose = animal.on_head(0.5, 0.5, 0.3), 0.25 * animal.skull + 0.75 * animal.muzzle + [0, 0.3 * animal.head, 0]
    animal.two("horn", limb([brow, brow + horns * np.array([0.15, 0.65, 0.8])], [0.075, 0.018]))
    animal.add("horn", limb([nose, nose + horns * np.array([0, 0.42, 0.14])], [0.065, 0.02], segments=10))


@of(_HEAVY, length=0.95, girth=0.26, deep=1.2, arch=0.14, slope=-0.06, head=0.11, neck=0.24, tilt=-8, nape=0.75,
    tail=0.9, brush=(0.2, 0.12, 0.07, 0.035), tails="level", cartoon=0.0)  # fmt: skip
def stegosaurus(animal: Animal) -> None:
    """Draw a stegosaurus: a high arched back with a row of upright plates, a small low head, a tail with spikes."""
    spikes, count = animal.sized("spikes", 0.34), int(animal.rng.integers(6, 9))
    shape = spikes * np.array([(0, -0.2), (-0.25, 0.05), (-0.32, 0.45), (0, 1.0), (0.27, 0.45), (0.21, 0.0)])
    backs = np.concatenate([part.verts for name in ("body", "tail", "neck") for part in animal.parts[name]])
    for k, z in enumerate(np.linspace(-1.9, 1.05, count) * animal.half):
        size, high = 1.25 - 0.55 * abs(2 * (k + 0.5) / count - 1.1), backs[np.abs(backs[:, 2] - z) < 0.14, 1].max()
        animal.add("spike", moved(plate(size * shape, 0.075, across="x"), [0.05 * (-1) ** k, high - 0.03, z]))
    for z in (0.12, 0.28):
        root = animal.parts["tail"][0].verts[-1] + [0, 0.02, z]
        animal.two(
            "spike", limb([root, root + spikes * np.array([0.7, 0.55, -0.45])], [0.045, 0.012], segments=8, samples=2)
        )


def _on_two_legs(animal: Animal, lean: float, leg: float, head: float, arms: float, stout: float) -> None:
    """Add all but the head of a dinosaur that runs on two legs: body and tail in one line `lean` degrees from level."""
    legs, tail, arms = animal.sized("legs", leg), animal.sized("tail", 1.05), animal.sized("arms", arms)
    girth, lean = stout * animal.rng.uniform(0.9, 1.12), lean + animal.rng.uniform(-8, 8)
    hip = np.array([0.0, legs + 0.1, 0.0])
    chest = hip + at(lean, 0.5)
    bulk = girth * np.array([0.72, 1.0, 0.98, 0.6])
    animal.add("body", tube([hip - at(lean, 0.22), hip, chest, chest + at(lean + 15, 0.2)], 0.85 * bulk, bulk))
    steps = [-at(angle, tail / 3) for angle in (lean, lean * 0.5, -6)]
    animal.add("tail", strand(hip - at(lean, 0.15), steps, girth * np.array([0.75, 0.48, 0.24, 0.06]), segments=12))
    throat, animal.head = chest + at(lean + 25, 0.36), animal.sized("head", head)
    animal.skull = throat + at(50, 0.5 * animal.head)
    nape = [0.62 * girth, max(0.42 * girth, 0.45 * animal.head), 0.6 * animal.head]
    animal.add("neck", tube([chest, throat, animal.skull], nape, nape))
    thick, sole = 0.42 * girth, np.array([0.62 * girth + 0.09, 0.07, 0.02])
    leg_at = sole * [1, 0, 0] + [
        [-0.09, hip[1], 0],
        [0, 0.58 * legs + 0.1, 0.18 * legs],
        [0, 0.28 * legs + 0.1, -0.22 * legs],
    ]
    animal.two("leg", limb([*leg_at, sole], thick * np.array([1.5, 1.0, 0.6, 0.5]), segments=10, samples=3))
    for side in (-0.09, 0.0, 0.09):
        toe = limb([sole, sole + [side, -0.02, 0.2]], thick * np.array([0.42, 0.28]), segments=8, samples=1)
        animal.two("foot", toe)
    shoulder = chest + [0.65 * girth, -0.3 * girth, 0.12]
    arm = shoulder + arms * np.array([[0, 0, 0], [0.1, -0.65, 0.0], [0.12, -0.55, 0.75]])
    animal.two("arm", limb(arm, [0.075, 0.055, 0.045], segments=8, samples=2))


def _hunter(rng: Rng, traits: Traits, long: float, deep: float, **sizes: float) -> Part:
    """Draw a dinosaur on two legs with an upper and a lower jaw, which may be open."""
    animal, gape = Animal(rng, traits), rng.uniform(4, 28)
    _on_two_legs(animal, **sizes)
    radius = animal.head
    animal.add("head", ellipsoid(animal.skull, radius * np.array([0.8, 0.92, 1.0]), rings=9))
    for name, tilt, y, size in (("head", -6.0, 0.05, 1.0), ("jaw", -6.0 - gape, -0.38, 0.6)):
        path = animal.on_head(0, y, 0.2) + np.array([at(tilt, radius * long * share) for share in (0.0, 0.5, 1.0)])
        bulk = radius * np.array([[0.68, 0.58, 0.42], [0.85, 0.75, 0.55]])
        animal.add(name, tube(path, bulk[0], deep * size * bulk[1], samples=2))
    animal.ball("eye", animal.on_head(0.6, 0.5, 0.3), 0.2 * radius, two=True)
    return named(**animal.parts)


def tyrannosaurus(rng: Rng, traits: Traits) -> Part:
    """Draw a tyrannosaurus: a huge head with open jaws, a heavy body on two strong legs, tiny arms, a thick tail."""
    return _hunter(rng, traits, 1.7, 0.62, lean=28, leg=0.55, head=0.27, arms=0.2, stout=0.28)


def raptor(rng: Rng, traits: Traits) -> Part:
    """Draw a raptor: a slim runner, its body level, with a long low head, longer arms and a stiff tail."""
    return _hunter(rng, traits, 2.0, 0.5, lean=12, leg=0.6, head=0.14, arms=0.36, stout=0.17)


@of(_HEAVY, girth=0.38, deep=0.72, leg=0.18, head=0.19, muzzle=0.6, tail=0.9, tails="level",
    brush=(0.2, 0.1, 0.06, 0.05), cartoon=0.0)  # fmt: skip
def ankylosaur(animal: Animal) -> None:
    """Draw an armoured dinosaur: a low broad body with rows of spikes, a club at the end of its tail."""
    animal.ball("tail", animal.parts["tail"][0].verts[-1], [0.17, 0.1, 0.14])
    for x, y in ((0.5, 0.45), (0.95, 0.07)):
        for z in np.linspace(-0.9, 0.9, 4) * animal.half:
            root = np.array([x * animal.girth, animal.height + y * animal.girth, z])
            animal.two(
                "spike", limb([root, root + [0.16 * x, 0.2 - 0.14 * x, -0.05]], [0.075, 0.02], segments=6, samples=1)
            )


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


def cobra(rng: Rng, traits: Traits) -> Part:
    """Draw a cobra: a coil from which a neck rises with a spread hood, the head looking ahead."""
    animal, thick, turns = Animal(rng, traits), rng.uniform(0.1, 0.13), rng.uniform(1.6, 2.2)
    turn = 2 * np.pi * np.linspace(-turns, 0, int(9 * turns)) + np.pi
    radius = np.linspace(0.25 + 2.0 * thick * turns, 0.25, len(turn))
    level = thick * np.linspace(1, 1 + 1.2 * turns, len(turn))
    coil = np.stack([radius * np.sin(turn), level, radius * np.cos(turn)], 1)
    rise = rng.uniform(0.7, 1.0) * np.array([[0, 0.3, 0.12], [0, 0.65, 0.1], [0, 0.95, 0.18], [0, 1.02, 0.34]])
    neck, spread = coil[-1] * [0, 1, 1] + rise, thick * np.array([[0.9, 3.0, 1.3], [0.6, 0.5, 0.6]])
    animal.add("neck", tube(neck[:3] - [0, 0.02, 0.03], spread[0], spread[1]))
    return _snake(animal, np.concatenate([coil, neck]), thick)


KINDS = {
    "dinosaur": (
        raptor, ankylosaur,
        breed("baby_dinosaur", _HEAVY, length=0.6, leg=0.24, neck=0.42, tilt=68, nape=0.6, head=0.24, muzzle=0.35),
        breed("long_dinosaur", _HEAVY, girth=0.27, leg=0.42, neck=1.1, tilt=38, nape=0.6, head=0.1, tail=1.3),
    ),
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
    "snake": (slithering_snake, cobra),
    "turtle": (
        sea_turtle,
        breed("tortoise", _TORTOISE, _shell),
        breed("cartoon_turtle", _TORTOISE, _shell, length=0.5, girth=0.25, leg=0.12, neck=0.12, tilt=45, head=0.24,
              muzzle=0.12, tails="level"),
    ),
}  # fmt: skip
