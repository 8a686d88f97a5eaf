"""Draw wild and farm animals: hoofed ones, beasts of prey, rodents, apes, those that lie on the shore, and a bat."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import at
from meshdeform.nouns.families.bodies import Animal, FourLegged, Upright, breed, of, strand, tube
from meshdeform.nouns.families.parts import Part, ellipsoid, limb, moved, named, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

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
    "zebra", HORSE, leg=0.44, girth=0.29, waist=1.06, nape=0.95, neck=0.38, tilt=58, head=0.17, muzzle=1.45, mane=0.26,
    snout=(0.74, 0.6), ears="leaf", ear=0.19, tail=0.45, brush=(0.035, 0.03, 0.03, 0.08),
)  # fmt: skip
_GREAT_CAT = FourLegged(
    length=1.1, girth=0.21, waist=0.84, hips=0.9, deep=1.2, leg=0.36, thick=0.085, thigh=1.8, paw=1.7, neck=0.2,
    tilt=16, nape=1.0, head=0.18, broad=1.08, muzzle=0.32, snout=(0.62, 0.52), drop=-20, ears="round", ear=0.085,
    tails="swung", tail=0.95, brush=(0.05, 0.045, 0.045, 0.05), eyes=(0.42, 0.3, 0.82, 0.14), cartoon=0.0,
)  # fmt: skip
SMALL = FourLegged(
    length=0.6, girth=0.21, hips=1.08, arch=0.07, leg=0.22, thick=0.06, neck=0.1, tilt=28, nape=0.8, head=0.19,
    muzzle=0.8, snout=(0.55, 0.25), ears="round", ear=0.14,
)  # fmt: skip
otter = breed(
    "otter", SMALL, length=1.0, girth=0.18, arch=0.1, leg=0.07, neck=0.2, tilt=24, nape=0.95, head=0.16, muzzle=0.4,
    broad=1.25, snout=(0.8, 0.7), ear=0.06, tails="down", tail=0.95, brush=(0.17, 0.13, 0.09, 0.03), paw=2.0,
    eyes=(0.55, 0.45, 0.72, 0.13),
)  # fmt: skip


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


@of(CATTLE, length=0.95, girth=0.31, hips=0.62, waist=0.8, slope=0.1, tilt=-22, neck=0.12, head=0.22, drop=-58,
    muzzle=0.5, snout=(0.92, 0.72), ear=0.13, leg=0.3, cap=0.0, cartoon=0.0, horns=(0.26, 0.06, _INWARD))  # fmt: skip
def bison(animal: Animal) -> None:
    """Draw a bison: a shaggy hump over the shoulders, a low heavy head with short horns and a beard, slim hips."""
    hump = animal.sized("humps", 0.36)
    path = [[0, -0.12, -0.6], [0, 0.5 * hump, -0.3], [0, 0.75 * hump, 0.02], [0, 0.0, 0.36]]
    bulk = np.array([0.12, 0.23, 0.29, 0.24])
    animal.add("hump", tube(np.array(path) + animal.withers - [0, 0.26, 0.08], bulk, bulk + 0.1 * hump))
    for place, size in (((0, 0.72, 0.1), (0.8, 0.6, 0.75)), ((0, -1.35, 0.75), (0.42, 0.75, 0.4))):
        animal.ball("mane", animal.on_head(*place), animal.head * np.array(size))


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


def _tufts(animal: Animal, long: float, *lows: float) -> None:
    """Add pointed tufts to the cheeks, by their heights and their length in radii of the head."""
    for low in lows:
        root = animal.on_head(0.68, low, 0.0)
        way = animal.head * long * np.array([0.7, -0.4, -0.2])
        animal.two("cheek", limb([root, root + way], [0.42 * animal.head, 0.015], segments=8, samples=2))


def _shoulders(animal: Animal, size: float) -> None:
    """Add a great cat's shoulders, which stand out above its back, and the two pads of its upper lip."""
    place = [0.6 * animal.girth, animal.withers[1] - 0.15, 0.75 * animal.half]
    animal.ball("body", place, size * np.array([0.11, 0.19, 0.2]), two=True)
    pads = animal.muzzle - animal.head * np.array([-0.28, 0.1, 0.12])
    animal.ball("nose", pads, animal.head * np.array([0.32, 0.26, 0.3]), two=True)


@of(_GREAT_CAT, girth=0.25, hips=0.86, thick=0.1, head=0.235, snout=(0.66, 0.56), tail=0.85, leg=0.34)
def tiger(animal: Animal) -> None:
    """Draw a tiger: a great cat with heavy forequarters, a low broad head with a ruff of tufts, a long tail."""
    _shoulders(animal, 0.95)
    _tufts(animal, 0.75, -0.25, -0.6)


@of(_GREAT_CAT, girth=0.19, waist=0.78, head=0.15, tail=1.25, leg=0.38, thick=0.07)
def leopard(animal: Animal) -> None:
    """Draw a leopard: a low slim cat with a small head, shoulders that stand out and a very long tail."""
    _shoulders(animal, 0.9)


@of(SMALL, ears="pointed", ear=0.17, broad=1.15, head=0.22, muzzle=0.9, tail=0)
def raccoon(animal: Animal) -> None:
    """Draw a raccoon: a round back, a broad face that runs to a point with tufts at its sides, a ringed bushy tail."""
    _tufts(animal, 0.7, -0.2)
    _patches(animal, 0.42, 0.2, -24)
    angle = np.radians(np.linspace(200, 130, 10) + animal.rng.uniform(-15, 15))
    steps = animal.sized("tail", 0.75) / 10 * np.stack([0 * angle, np.sin(angle), np.cos(angle)], 1)
    rings = np.where(np.arange(11) % 2, 0.15, 0.105) * np.array([0.7, *np.ones(9), 0.5])
    animal.add("tail", strand(animal.rump, steps, rings, segments=10))


def _cheeks(animal: Animal) -> None:
    """Add full cheeks and a stump of a tail."""
    animal.ball("cheek", animal.on_head(0.7, -0.4, 0.4), 0.48 * animal.head, two=True)
    animal.ball("tail", animal.rump + [0, -0.15, -0.1], 0.07)


@of(SMALL, length=0.34, girth=0.3, deep=1.0, leg=0.05, neck=0, tilt=16, head=0.3, muzzle=0.12, snout=(0.5, 0.36),
    broad=1.12, ear=0.17, tail=0, paw=1.6, cartoon=0.0, eyes=(0.55, 0.3, 0.78, 0.17))  # fmt: skip
def hamster(animal: Animal) -> None:
    """Draw a hamster: a ball of a body that is hardly apart from its head, full cheeks, tiny feet, round ears."""
    bulk = animal.girth * np.array([1.15, 1.08, 1.0]) + [0, 0, 0.8 * animal.half]
    animal.parts["body"] = [ellipsoid([0, animal.height, 0], bulk, rings=10)]
    _cheeks(animal)


upright_hamster = breed("upright_hamster", Upright(
    trunk=0.36, hips=0.39, belly=0.43, chest=0.36, leg=0.03, thick=0.05, foot=0.16, reach=0.17, lift=12, hold=2.8,
    head=0.33, muzzle=0.12, snout=(0.5, 0.36), broad=1.15, ears="round", ear=0.17, eyes=(0.55, 0.3, 0.78, 0.17)),
    _cheeks)  # fmt: skip


def _patches(animal: Animal, wide: float, high: float, slant: float) -> None:
    """Add a patch about each eye, in radii of the head."""
    flat = ellipsoid([0, 0, 0], animal.head * np.array([wide, high, 0.2]), rings=7)
    animal.two("cheek", moved(turned(turned(flat, slant, "z"), 24, "y"), animal.on_head(0.46, 0.1, 0.86)))


def patched(animal: Animal) -> None:
    """Draw a panda: a round belly, thick limbs, a broad head with round ears, patches that droop about the eyes."""
    _patches(animal, 0.24, 0.4, 36)


panda = breed("panda", Upright(
    thick=0.16, head=0.38, broad=1.18, muzzle=0.3, snout=(0.46, 0.38), ears="round", ear=0.2, hips=0.46, belly=0.48,
    chest=0.36, foot=0.2, reach=0.42, eyes=(0.48, 0.13, 1.0, 0.11)), patched)  # fmt: skip


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
