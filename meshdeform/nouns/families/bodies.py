"""Build animals of two plans: on four legs, and upright or sitting.

A plan holds the middles of proportions; each member draws its own about them, and nearly every second has something of
the big head, the short legs and the thick limbs of a cartoon. An animal is its named solids and the places where a noun
adds what it is known by.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.animals import at
from meshdeform.nouns.families.parts import Array, Part, curved, ellipsoid, lathe, limb, named, pair, plate
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["Animal", "FourLegged", "Upright", "breed", "of", "strand", "tube"]

_FACTORS = {"head": ((0.55, 0.64), (1.5, 1.7)), "eyes": ((0.3, 0.38), (1.6, 1.9))}
"""How much smaller and greater a part becomes that is called so; others as `_USUAL`."""
_USUAL = ((0.3, 0.42), (1.9, 2.3))
_POLAR = np.linspace(0.0, np.pi, 8)
_EARS: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = {
    # root in radii of the head, way to the tip, half widths at root, middle and tip in lengths of the ear
    "pointed": ((0.55, 0.6, -0.1), (0.25, 1.0, 0.0), (0.36, 0.26, 0.05)),
    "round": ((0.68, 0.6, -0.1), (0.3, 0.42, 0.0), (0.34, 0.52, 0.46)),
    "leaf": ((0.45, 0.7, -0.2), (0.22, 1.0, -0.1), (0.1, 0.2, 0.05)),
    "hanging": ((0.8, 0.5, -0.1), (0.4, -0.95, 0.0), (0.2, 0.28, 0.24)),
    "cup": ((0.85, 0.12, -0.1), (0.55, 0.3, 0.0), (0.3, 0.45, 0.36)),
    "side": ((0.6, 0.35, -0.2), (1.0, 0.1, -0.1), (0.16, 0.24, 0.1)),
}
_TAILS: dict[str, tuple[float, ...]] = {
    # degrees above straight ahead of three pieces: 180 is behind, 270 down
    "hanging": (215, 262, 272),
    "level": (185, 190, 180),
    "up": (140, 115, 100),
    "curled": (120, 60, 10),
    "over": (125, 85, 35),
    "down": (205, 205, 195),
    "swung": (225, 235, 160),
}


def tube(path: ArrayLike, wide: ArrayLike, deep: ArrayLike, *, segments: int = 14, samples: int = 3) -> Part:
    """Return a smooth tube along a path (N, 3) in the plane x = 0: `wide` (N,) along x, `deep` (N,) across both."""
    points = np.asarray(path, float)
    knots = curved(np.column_stack([points, wide, deep]), samples=samples)
    first = knots[1, :3] - knots[0, :3]
    level = abs(first[2]) >= 0.9 * np.linalg.norm(first)
    return limb(knots[:, :3], knots[:, [4, 3] if level else [3, 4]], segments=segments, samples=1)


def strand(root: ArrayLike, steps: ArrayLike, radii: ArrayLike, *, segments: int = 8) -> Part:
    """Return a smooth tube from a root on by steps (N, 3), with N + 1 radii, or pairs of them as in `limb`."""
    places = np.asarray(root, float) + np.concatenate([np.zeros((1, 3)), np.cumsum(np.asarray(steps, float), 0)])
    knots = curved(np.column_stack([places, np.asarray(radii, float)]), samples=2)
    return limb(knots[:, :3], knots[:, 3] if knots.shape[1] == 4 else knots[:, 3:], segments=segments, samples=1)


@dataclass
class Animal:
    """Solids by the names of their parts, and where to add more; lengths in the unit of its plan.

    `skull` (3,) is the middle of the head, `head` its radius, `muzzle` (3,) its tip; `withers` and `rump` (3,) are the
    top of the back above the shoulders and where the tail begins; the body is `girth` wide to each side, its axis at
    `height`, `half` of its length behind and before the middle.
    """

    rng: Rng
    traits: Traits
    parts: dict[str, list[Part]] = field(default_factory=dict)
    skull: Array = field(default_factory=lambda: np.zeros(3))
    muzzle: Array = field(default_factory=lambda: np.zeros(3))
    withers: Array = field(default_factory=lambda: np.zeros(3))
    rump: Array = field(default_factory=lambda: np.zeros(3))
    head: float = 0.0
    girth: float = 0.0
    height: float = 0.0
    half: float = 0.0

    def sized(self, part: str, size: float) -> float:
        """Draw the size of a part about `size`, or much smaller or greater if it is called so."""
        lesser, greater = _FACTORS.get(part, _USUAL)
        return size * self.traits.draw(self.rng, part, lesser, (0.8, 1.25), greater)

    def add(self, name: str, *solids: Part) -> None:
        """Add solids of a part."""
        self.parts.setdefault(name, []).extend(solids)

    def two(self, name: str, *solids: Part) -> None:
        """Add solids of the left and their mirror images."""
        self.add(name, *(each for solid in solids for each in pair(solid)))

    def ball(self, name: str, centre: ArrayLike, radii: ArrayLike, *, two: bool = False) -> None:
        """Add a small ellipsoid, or two."""
        unit = lathe(np.stack([np.sin(_POLAR), -np.cos(_POLAR)], 1), segments=14)
        solid = Part(unit.verts * np.asarray(radii, float) + np.asarray(centre, float), unit.faces)
        self.add(name, *(pair(solid) if two else [solid]))

    def on_head(self, *shares: float) -> Array:
        """Return a place (3,) by its distance from the head's middle in radii of the head."""
        return self.skull + self.head * np.array(shares)

    def crest(self, start: Array, end: Array, height: float, thick: float = 0.09) -> None:
        """Add an upright mane along a line in the plane x = 0."""
        along = (end - start) / np.linalg.norm(end - start)
        up = np.array([0.0, along[2], -along[1]]) * np.sign(along[2]) * height
        rim = [start - 0.3 * up, end - 0.3 * up, end + 0.4 * height * along, end + 0.7 * up]
        rim += [(start + end) / 2 + 1.1 * up, start + 0.6 * up]
        self.add("mane", plate(np.array(rim)[:, :0:-1], thick, across="x"))


@dataclass(frozen=True)
class _Head:
    """Proportions of a head and a tail.

    `broad`, `muzzle`, `snout` (half widths at the muzzle's root and tip), `eyes` (a place and a radius) and `cap` (of
    hair) are in radii of the head, `drop` is the muzzle's angle in degrees; `horns`: length, half width, and steps as
    shares of the length. `mask`: the part that a muzzle is, `head` where it is no nose of its own. `beard`, `mane`:
    lengths. `tails` says which way a tail of half widths `brush` goes.
    """

    head: float = 0.2
    broad: float = 1.0
    muzzle: float = 1.2
    snout: tuple[float, float] = (0.6, 0.42)
    drop: float = -18
    mask: str = "nose"
    eyes: tuple[float, float, float, float] | None = None
    cap: float = 0.0
    beard: float = 0.0
    horns: tuple[float, float, tuple[tuple[float, ...], ...]] | None = None
    ears: str = "pointed"
    ear: float = 0.2
    tails: str = "hanging"
    tail: float = 0.45
    brush: tuple[float, ...] = (0.06, 0.055, 0.05, 0.045)

    def add_head(self, animal: Animal, *, cartoon: float = 0.0) -> None:
        """Add all of a head whose place and radius are known."""
        radius = animal.head
        if self.muzzle or self.mask == "nose":
            self._add_face(animal, self.muzzle * (1 - 0.4 * cartoon))
        if self.ears:
            place, way, shares = _EARS[self.ears]
            length = animal.sized("ears", self.ear) * radius / self.head
            flat = np.outer(shares, [length, 0.45 * length]) + 0.012
            animal.two("ear", strand(animal.on_head(*place), np.array([way, way]) * length / 2, flat))
        if self.eyes:
            eye = animal.sized("eyes", self.eyes[3] * radius)
            animal.ball("eye", animal.on_head(*self.eyes[:3]), eye, two=True)
        if self.cap:
            animal.ball("head", animal.on_head(0, 0.72, -0.12), self.cap * radius * np.array([1.0, 0.8, 0.95]))
        if self.horns:
            size, thick, steps = self.horns
            radii = np.linspace(thick, 0.25 * thick, len(steps) + 1)
            horn = animal.sized("horns", size) * np.array(steps)
            animal.two("horn", strand(animal.on_head(0.4, 0.72, -0.1), horn, radii))
        if self.beard:
            chin = 0.3 * animal.skull + 0.7 * animal.muzzle - [0, 0.35 * radius, 0]
            hair = self.beard * np.array([[0, -0.5, -0.1], [0, -0.5, 0.1]])
            animal.add("mane", strand(chin, hair, self.beard * np.array([0.28, 0.22, 0.08])))

    def _add_face(self, animal: Animal, long: float) -> None:
        """Add a ball with a muzzle that is a nose, or one wedge from the crown to the lips."""
        radius, drop = animal.head, self.drop + animal.rng.uniform(-10, 10)
        start, end = radius * np.array(self.snout)
        root = animal.on_head(0, -0.12, 0) + at(drop, 0.35 * radius)
        reach = (
            animal.sized("nose", long) if self.mask == "nose" and long > 0.2 else long * animal.rng.uniform(0.85, 1.15)
        )
        animal.muzzle = root + at(drop, (0.3 + reach) * radius)
        widths, path = np.array([start, 0.35 * start + 0.65 * end, end]), [(root + animal.muzzle) / 2, animal.muzzle]
        if self.mask == "nose":
            animal.add("head", ellipsoid(animal.skull, radius * np.array([self.broad, 0.94, 1.0]), rings=8))
            if self.muzzle:
                animal.add("nose", tube([root, *path], widths * self.broad, 0.9 * widths, segments=12, samples=2))
                animal.ball("nose", animal.muzzle + at(drop + 50, 0.85 * end), 0.38 * end)
        else:
            path = [animal.skull - at(drop, 0.55 * radius), animal.skull, root + at(drop, 0.2 * radius), *path]
            widths = np.concatenate([[0.7 * radius, 0.92 * radius], widths])
            animal.add("head", tube(path, widths * self.broad, widths, samples=2))

    def add_tail(self, animal: Animal) -> None:
        """Add a tail at the rump."""
        if self.tail:
            angles, sway = np.array(_TAILS[self.tails]) + animal.rng.uniform(-18, 18), animal.rng.uniform(-0.4, 0.4)
            steps = np.array([at(angle, 1.0) for angle in angles])
            steps[:, 0] = sway * np.array([0.4, 1.0, -0.6])
            steps *= animal.sized("tail", self.tail) / 3
            animal.add("tail", strand(animal.rump, steps, self.brush, segments=9))


@dataclass(frozen=True)
class FourLegged(_Head):
    """Proportions of an animal on four legs; lengths in a unit in which many bodies are 0.8 from hips to shoulders.

    `girth` is half of the chest's width, to which `hips`, `waist` and `nape` (the neck's root) are relative; `deep` the
    body's height over its width; `slope` and `arch` raise shoulders and back; `tilt` is the neck's angle in degrees.
    `leg`: the belly's height; `sprawl`: how far the legs stand out; `paw` in half widths of the leg, 0 for a hoof.
    """

    length: float = 0.8
    girth: float = 0.25
    hips: float = 0.95
    waist: float = 0.95
    deep: float = 1.1
    slope: float = 0.0
    arch: float = 0.0
    leg: float = 0.45
    sprawl: float = 0.0
    thick: float = 0.085
    thigh: float = 1.5
    paw: float = 1.25
    neck: float = 0.3
    tilt: float = 45
    nape: float = 0.7
    mane: float = 0.0
    front: str = "leg"
    cartoon: float | None = None

    def draw(self, animal: Animal) -> None:
        """Add body, legs, feet unless `paw` is 0, neck unless its length is 0, mane, head and tail."""
        rng = animal.rng
        odds = max(rng.uniform(-1.2, 1.0), 0.0)
        cartoon = odds if self.cartoon is None else self.cartoon
        wide = self.girth * rng.uniform(0.85, 1.15) * (1 + 0.1 * cartoon)
        half = 0.5 * self.length * rng.uniform(0.85, 1.15) * (1 - 0.2 * cartoon)
        tall = self.deep * wide
        size = (animal.sized("legs", 1.0) if self.leg > 0.03 else 1.0) * (1 - 0.3 * cartoon)
        animal.girth, animal.half, animal.height = wide, half, self.leg * size + 0.8 * tall
        along = np.array([-1.0, -0.6, 0.0, 0.6, 1.0])
        rise = animal.height + self.slope * along + self.arch * (1 - along**2)
        widths = wide * np.array([0.78 * self.hips, self.hips, self.waist, 1.0, 0.85])
        animal.add("body", tube(np.stack([0 * along, rise, half * along], 1), widths, self.deep * widths, samples=2))
        animal.withers = np.array([0.0, rise[3] + 0.95 * tall, 0.6 * half])
        animal.rump = np.array([0.0, rise[0] + 0.45 * tall, -half - 0.55 * widths[0]])
        thick = self.thick * rng.uniform(0.9, 1.1) * (1 + 0.2 * cartoon)
        for name, z, top in (("leg", -0.85 * half, rise[0]), (self.front, 0.85 * half, rise[4])):
            leg = self._splayed if self.sprawl else self._straight
            animal.two(name, limb(*leg(animal, z, float(top), thick, size), segments=8, samples=1))
            if self.paw:
                end = animal.parts[name][-2].verts[-1] * [1, 0, 1] + [0, 0.5 * thick, 0]
                toes = [end - [0, 0, 0.1 * thick], end + [0.3 * self.sprawl * thick, 0, self.paw * thick]]
                flat = thick * np.array([[0.75, 1.1], [0.6, 1.0]])
                animal.two("foot" if name == "leg" else "hand", limb(toes, flat, segments=6, samples=1))
        animal.head = animal.sized("head", self.head) * (1 + 0.45 * cartoon)
        self._add_neck(animal, float(rise[4]), cartoon)
        self.add_head(animal, cartoon=cartoon)
        self.add_tail(animal)
        if self.mane:
            height = animal.sized("mane", self.mane)
            animal.crest(animal.withers - [0, 0.08, 0], animal.on_head(0, 0.75, -0.2), height)

    def _add_neck(self, animal: Animal, rise: float, cartoon: float) -> None:
        """Place the head before or above the shoulders, and add the neck that carries it."""
        tilt, wide = self.tilt + animal.rng.uniform(-14, 12), animal.girth
        chest = np.array([0.0, rise + 0.25 * self.deep * wide, 0.75 * animal.half])
        reach = animal.sized("neck", self.neck) if self.neck >= 0.1 else self.neck
        reach *= 1 - 0.25 * cartoon
        animal.skull = chest + at(tilt, reach + 0.6 * wide + 0.35 * animal.head)
        if self.neck:
            bulk = np.array([self.nape * wide, max(0.55 * self.nape * wide, 0.55 * animal.head), 0.72 * animal.head])
            path = [chest, (chest + animal.skull) / 2 - at(tilt + 90, 0.02), animal.skull]
            animal.add("neck", tube(path, 0.85 * bulk, bulk, samples=2))

    def _straight(self, animal: Animal, z: float, top: float, thick: float, _: float) -> tuple[Array, Array]:
        """Return path and radii of a straight front leg, or of a hind leg with a hock."""
        x, bend = animal.girth - 0.7 * thick, animal.rng.uniform(0.05, 0.13)
        knees = [(0.5, bend, 1.0), (0.24, -0.8 * bend, 0.8)] if z < 0 else [(0.45, 0.0, 0.95)]
        rows = [[0.8 * x, top, z, self.thigh * thick * (1.2 if z < 0 else 1.0)]]
        rows += [[x, share * top, z + by * top, thick * size] for share, by, size in knees]
        knots = curved([*rows, [x, 0.7 * thick, z, 0.85 * thick]], samples=2)
        return knots[:, :3], knots[:, 3]

    def _splayed(self, animal: Animal, z: float, top: float, thick: float, size: float) -> tuple[Array, Array]:
        """Return path and radii of a leg that stands out, with an elbow."""
        out, step = self.sprawl * size, 0.4 * self.sprawl * size * animal.rng.uniform(0.5, 1.2) * np.sign(z)
        hip = np.array([0.6 * animal.girth, top, z])
        elbow = hip + [out, 0.12 * out, step]
        path = np.array([hip, (hip + elbow) / 2, elbow, [elbow[0] + 0.3 * out, 0.6 * thick, elbow[2] + 0.1]])
        return path, thick * np.array([1.4, 1.25, 1.1, 0.85])


@dataclass(frozen=True)
class Upright(_Head):
    """Proportions of an animal that sits or stands upright: half widths of its body at hips, belly and chest.

    `leg` 0: it sits with its feet before it. `reach`: the arms' length; `lift`: their angle from straight down; `hold`:
    how far they are before it, as a share of their length.
    """

    trunk: float = 0.7
    hips: float = 0.36
    belly: float = 0.34
    chest: float = 0.24
    lean: float = 6
    leg: float = 0.0
    thick: float = 0.1
    foot: float = 0.22
    neck: float = 0.0
    reach: float = 0.42
    lift: float = 35
    hold: float = 0.45
    head: float = 0.3
    tail: float = 0.0

    def draw(self, animal: Animal) -> None:
        """Add body, arms and hands, legs and feet, head and tail."""
        rng, cartoon = animal.rng, max(animal.rng.uniform(-1.0, 1.0), 0.0)
        widths = rng.uniform(0.85, 1.18) * np.array([self.hips, self.belly, self.chest])
        hips, _, chest = widths
        leg = animal.sized("legs", self.leg) if self.leg else 0.0
        low = np.array([0.0, leg + 0.75 * hips, 0.0])
        up = at(90 - self.lean + rng.uniform(-5, 7), self.trunk * rng.uniform(0.88, 1.14) * (1 - 0.25 * cartoon))
        animal.girth, animal.height, animal.half = hips, float(low[1]), chest
        animal.add("body", tube([low, low + 0.45 * up, low + 0.85 * up], widths, 0.92 * widths))
        animal.head = animal.sized("head", self.head) * (1 + 0.3 * cartoon)
        neck = animal.sized("neck", self.neck) if self.neck else 0.0
        animal.skull = low + up + (0.72 * animal.head + neck) * np.array([0.0, 1.0, 0.12])
        if neck:
            animal.add("neck", tube([low + 0.8 * up, animal.skull], [0.7 * chest, 0.55 * self.head], [0.7 * chest] * 2))
        animal.withers, animal.rump = low + 0.95 * up, low + [0, -0.25 * hips, -0.85 * hips]
        if self.reach:
            self._add_arms(animal, low + 0.82 * up + [0.8 * chest, 0, 0])
        self._add_legs(animal)
        self.add_head(animal, cartoon=0.5 * cartoon)
        self.add_tail(animal)

    def _add_arms(self, animal: Animal, shoulder: Array) -> None:
        """Add an arm with a hand on each side."""
        length, lift = animal.sized("arms", self.reach), np.radians(self.lift + animal.rng.uniform(-12, 16))
        way = np.array([np.sin(lift), -np.cos(lift), self.hold * animal.rng.uniform(0.6, 1.4)])
        hand = shoulder + length * way / np.linalg.norm(way)
        elbow = (shoulder + hand) / 2 + [0.12 * length, 0, -0.08 * length]
        animal.two("arm", limb([shoulder, elbow, hand], self.thick * np.array([1.1, 1.0, 0.9]), segments=10, samples=2))
        animal.two("hand", limb([hand, hand + 0.1 * way * length], [1.1 * self.thick] * 2, segments=6, samples=1))

    def _add_legs(self, animal: Animal) -> None:
        """Add legs that stand, or lie before a sitting animal, with feet."""
        x, thick = 0.62 * animal.girth, 1.15 * self.thick
        if self.leg:
            pole = [[x, animal.height, 0], [1.05 * x, 0.6 * thick, 0]]
            animal.two("leg", limb(pole, [1.3 * thick, thick], segments=10))
            toes = [[1.05 * x, 0.55 * thick, -0.05], [1.15 * x, 0.5 * thick, self.foot]]
        else:
            out = animal.girth * animal.rng.uniform(0.75, 0.95)
            hip, heel = [x, 0.5 * animal.girth, 0.15], [out, thick, 1.05 * animal.girth]
            animal.two("leg", limb([hip, heel], [1.45 * thick, 1.05 * thick], segments=10, samples=2))
            toes = [[out, 0.8 * thick, heel[2] + 0.03], [1.08 * out, 0.8 * thick + 0.6 * self.foot, heel[2] + 0.08]]
        animal.two("foot", limb(toes, thick * np.array([[1.0, 0.9], [1.15, 0.75]]), segments=8, samples=1))


def breed(
    name: str, plan: FourLegged | Upright, add: Callable[[Animal], None] | None = None, **changes: Any
) -> Callable[[Rng, Traits], Part]:
    """Return a family of this name that draws a plan with changes, then what `add` adds."""
    own = replace(plan, **changes)

    def family(rng: Rng, traits: Traits) -> Part:
        animal = Animal(rng, traits)
        own.draw(animal)
        if add is not None:
            add(animal)
        return named(**animal.parts)

    family.__name__, family.__doc__ = name, add and add.__doc__
    return family


def of(
    plan: FourLegged | Upright, **changes: Any
) -> Callable[[Callable[[Animal], None]], Callable[[Rng, Traits], Part]]:
    """Return a decorator that makes a family of what a function adds to a plan with changes."""
    return lambda add: breed(add.__name__, plan, add, **changes)
