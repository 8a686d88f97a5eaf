"""Draw four-legged animals with a body, legs, neck, head with a muzzle, tail and ears, and some of other builds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.nouns.families.parts import (
    Part,
    box,
    curved,
    disc,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    moved,
    pair,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits


@dataclass(frozen=True)
class Quadruped:
    """Barrel along Z on four legs; lengths in the family's unit."""

    length: float
    radius: float
    leg: float
    leg_radius: float

    @property
    def height(self) -> float:
        """Height of the barrel's axis."""
        return self.leg + 0.75 * self.radius

    def parts(self, slope: float = 0.0) -> list[Part]:
        """Return the barrel and the legs; `slope` raises the shoulders (front) above the hips."""
        half = self.length / 2
        spine = [[0, self.height - slope, -half], [0, self.height, 0], [0, self.height + slope, half]]
        parts = [limb(spine, [self.radius * 0.95, self.radius * 0.97, self.radius], segments=18)]
        for z, lift in ((-half, -slope), (half, slope)):
            x = self.radius - self.leg_radius * 0.8
            foot = [x, self.leg_radius * 0.5, z]
            parts += pair(limb([foot, [x * 0.95, self.height + lift, z]], [self.leg_radius, self.leg_radius * 1.2]))
        return parts


def at(angle_deg: float, length: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return a vector of this length in the YZ plane, at this angle above straight ahead."""
    angle = np.radians(angle_deg)
    return np.array([0.0, length * np.sin(angle), length * np.cos(angle)])


def giraffe(rng: Rng, traits: Traits) -> Part:
    """Draw a giraffe: a short sloping body on long legs, a very long neck, a small head with horns."""
    leg = traits.draw(rng, "legs", (0.24, 0.32), (0.72, 0.88), (1.3, 1.55))
    neck = traits.draw(rng, "neck", (0.32, 0.42), (0.95, 1.15), (1.6, 1.9))
    head = traits.draw(rng, "head", (0.09, 0.1), (0.155, 0.18), (0.28, 0.33))
    body = Quadruped(rng.uniform(0.42, 0.55), rng.uniform(0.25, 0.29), leg, rng.uniform(0.105, 0.12))
    chest = np.array([0.0, body.height + 0.1, body.length / 2])
    crown = chest + at(rng.uniform(64, 72), neck)
    muzzle = crown + np.array([0.0, -0.45 * head, 1.75 * head])
    parts = body.parts(slope=0.06)
    parts += [limb([chest, crown], [0.18, 0.115]), limb([crown, muzzle], [head, head * 0.72])]
    parts += pair(limb([crown, crown + [head * 0.5, head * 1.7, -0.02]], [0.055, 0.06], segments=8))
    rump = np.array([0.0, body.height, -body.length / 2 - body.radius * 0.8])
    return join([*parts, limb([rump, rump + [0, -0.34, -0.1]], [0.06, 0.075], segments=8)])


def horse(rng: Rng, traits: Traits) -> Part:
    """Draw a horse: a long barrel on long legs, a strong neck, a long face, a full tail."""
    leg = traits.draw(rng, "legs", (0.22, 0.28), (0.58, 0.7), (1.1, 1.3))
    neck = traits.draw(rng, "neck", (0.16, 0.22), (0.46, 0.56), (0.95, 1.15))
    head = traits.draw(rng, "head", (0.09, 0.1), (0.15, 0.17), (0.26, 0.3))
    tail = traits.draw(rng, "tail", (0.14, 0.2), (0.5, 0.62), (1.0, 1.2))
    body = Quadruped(rng.uniform(0.82, 0.98), rng.uniform(0.26, 0.3), leg, rng.uniform(0.1, 0.12))
    chest = np.array([0.0, body.height + 0.06, body.length / 2])
    poll = chest + at(rng.uniform(48, 58), neck + 0.12)
    face = poll + at(rng.uniform(-42, -32), 2.7 * head)
    parts = body.parts()
    parts += [limb([chest, poll], [[0.16, 0.25], [0.11, 0.16]]), limb([poll, face], [head, head * 0.68])]
    parts += pair(limb([poll, poll + [head * 0.55, head * 1.5, 0]], [0.06, 0.045], segments=8))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.8])
    parts.append(limb([rump, rump + [0, -0.1, -0.14], rump + [0, -0.1 - tail, -0.2]], [0.07, 0.1, 0.085], segments=10))
    return join(parts)


def dog(rng: Rng, traits: Traits) -> Part:
    """Draw a dog: a long body on short legs, a big head with a snout and hanging ears, a tail held up."""
    leg = traits.draw(rng, "legs", (0.08, 0.12), (0.34, 0.44), (0.8, 1.0))
    head = traits.draw(rng, "head", (0.14, 0.16), (0.26, 0.3), (0.44, 0.52))
    ears = traits.draw(rng, "ears", (0.06, 0.1), (0.22, 0.28), (0.5, 0.62))
    tail = traits.draw(rng, "tail", (0.06, 0.1), (0.34, 0.44), (0.8, 1.0))
    body = Quadruped(rng.uniform(0.7, 0.9), rng.uniform(0.22, 0.26), leg, rng.uniform(0.095, 0.115))
    front = np.array([0.0, body.height, body.length / 2 + 0.04])
    skull = front + at(rng.uniform(48, 62), 0.2 + head)
    parts = body.parts()
    parts += [limb([front, skull], [0.17, 0.16]), ellipsoid(skull, [head * 0.95, head, head])]
    snout = skull + np.array([0.0, -0.28 * head, 1.45 * head])
    parts.append(limb([skull + [0, -0.2 * head, 0], snout], [head * 0.55, head * 0.44]))
    top = skull + np.array([head * 0.75, head * 0.65, -0.1 * head])
    parts += pair(limb([top, top + [0.3 * ears + 0.06, -ears, 0]], [[0.06, 0.09], [0.07, 0.11]], segments=10))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.6])
    return join([*parts, limb([rump, rump + at(rng.uniform(115, 130), tail)], [0.08, 0.065], segments=10)])


def elephant(rng: Rng, traits: Traits) -> Part:
    """Draw an elephant: a huge round body on pillars, large flat ears, a trunk that hangs to the ground."""
    leg = traits.draw(rng, "legs", (0.08, 0.14), (0.36, 0.46), (0.9, 1.1))
    ears = traits.draw(rng, "ears", (0.12, 0.15), (0.3, 0.36), (0.56, 0.66))
    trunk = traits.draw(rng, "trunk", (0.16, 0.22), (0.62, 0.74), (1.2, 1.4))
    body = Quadruped(rng.uniform(0.5, 0.65), rng.uniform(0.42, 0.48), leg, rng.uniform(0.165, 0.19))
    skull = np.array([0.0, body.height + 0.22, body.length / 2 + body.radius * 0.85])
    parts = body.parts()
    parts.append(ellipsoid(skull, [0.3, 0.33, 0.32]))
    start = skull + [0, -0.06, 0.24]
    bend = start + [0, -0.4 * trunk, 0.2]
    tip = start + [0, -0.85 * trunk, 0.18 + 0.3 * trunk]
    parts.append(limb([start - [0, 0, 0.1], bend, tip], [0.16, 0.12, 0.085]))
    ear = ellipsoid(skull + [0.24 + ears * 0.8, 0.06, -0.12], [ears, ears * 1.2, 0.09])
    parts += pair(ear)
    tusk = skull + [0.17, -0.18, 0.22]
    parts += pair(limb([tusk, tusk + [0.03, -0.14, 0.22]], [0.065, 0.045], segments=8))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.9])
    return join([*parts, limb([rump, rump + [0, -0.34, -0.08]], [0.055, 0.06], segments=8)])


def dinosaur(rng: Rng, traits: Traits) -> Part:
    """Draw a sauropod: a heavy body, a long neck that rises in front, a long tail that tapers behind."""
    leg = traits.draw(rng, "legs", (0.06, 0.1), (0.28, 0.36), (0.75, 0.95))
    neck = traits.draw(rng, "neck", (0.12, 0.2), (0.72, 0.9), (1.35, 1.6))
    tail = traits.draw(rng, "tail", (0.1, 0.18), (0.8, 0.98), (1.5, 1.8))
    head = traits.draw(rng, "head", (0.08, 0.09), (0.135, 0.16), (0.27, 0.32))
    body = Quadruped(rng.uniform(0.5, 0.62), rng.uniform(0.32, 0.37), leg, rng.uniform(0.13, 0.15))
    half, girth = body.length / 2, body.radius
    chest = np.array([0.0, body.height + 0.03, half])
    middle = chest + [0, 0, 0.22] + at(42, 0.5 * neck)
    crown = middle + at(66, 0.5 * neck)
    rump = np.array([0.0, body.height, -half])
    tip = rump + [0, -0.1 - 0.18 * tail, -0.34 - tail]
    behind = (2 * rump + tip) / 3 + [0, -0.03, 0]
    # One smooth tube from the tail's tip to the head: parts of their own would leave seams along the back.
    path = np.array([tip, behind, rump, chest - [0, 0, half], chest, middle, crown])
    girths = [[0.07], [0.6 * girth], [0.95 * girth], [1.02 * girth], [0.9 * girth], [0.18], [0.13]]
    spine = curved(np.column_stack([path, girths]))
    legs = body.parts()[1:]
    parts = [*legs, limb(spine[:, :3], spine[:, 3], segments=20, samples=2)]
    return join([*parts, limb([crown, crown + [0, -0.1 * head, 1.5 * head]], [head, head * 0.75])])


def pig(rng: Rng, traits: Traits) -> Part:
    """Draw a pig: a round barrel on short legs, a snout that ends in a disc, pointed ears, a curly tail."""
    leg = traits.draw(rng, "legs", (0.03, 0.06), (0.22, 0.28), (0.75, 0.95))
    ears = traits.draw(rng, "ears", (0.03, 0.06), (0.17, 0.22), (0.46, 0.56))
    nose = traits.draw(rng, "nose", (0.02, 0.05), (0.16, 0.22), (0.6, 0.75))
    body = Quadruped(rng.uniform(0.42, 0.54), rng.uniform(0.4, 0.46), leg, rng.uniform(0.115, 0.135))
    skull = np.array([0.0, body.height + 0.12, body.length / 2 + body.radius * 0.8])
    parts = body.parts()
    parts.append(ellipsoid(skull, [0.31, 0.3, 0.29]))
    wide = rng.uniform(0.155, 0.18)
    disc = lathe([(wide * 0.85, 0.0), (wide * 0.88, 0.16 + nose), (wide, 0.18 + nose), (wide * 0.9, 0.26 + nose)])
    parts.append(moved(turned(disc, 90, "x"), skull + [0, -0.07, 0.02]))
    ear = skull + [0.17, 0.18, -0.04]
    parts += pair(
        limb([ear, ear + [0.05 + 0.25 * ears, 0.08 + ears, 0.06]], [[0.12, 0.07], [0.04, 0.035]], segments=10)
    )
    rump = np.array([0.0, body.height + 0.12, -body.length / 2 - body.radius * 0.85])
    turn = np.linspace(0.0, 2 * np.pi, 7)
    curl = [rump + [0.11 * np.sin(t), 0.11 * (1 - np.cos(t)), -0.05 - 0.028 * t] for t in turn]
    return join([*parts, limb(curl, np.linspace(0.06, 0.045, 7), segments=8, samples=3)])


def cat(rng: Rng, traits: Traits) -> Part:
    """Draw a sitting cat: a pear-shaped body, a round head with pointed ears, the tail curled up behind."""
    head = traits.draw(rng, "head", (0.17, 0.19), (0.3, 0.34), (0.5, 0.58))
    ears = traits.draw(rng, "ears", (0.05, 0.08), (0.19, 0.24), (0.42, 0.52))
    tail = traits.draw(rng, "tail", (0.06, 0.1), (0.5, 0.62), (1.1, 1.3))
    hips, height = rng.uniform(0.4, 0.46), rng.uniform(0.78, 0.9)
    parts = [ellipsoid([0, hips * 0.85, -0.1], [hips, hips * 0.9, hips * 1.05])]
    parts.append(limb([[0, hips * 0.8, 0], [0, height, 0.14]], [hips * 0.85, 0.22], segments=18))
    parts += pair(limb([[0.15, 0.09, 0.36], [0.15, height * 0.75, 0.2]], [0.105, 0.11], segments=10))
    parts += pair(ellipsoid([hips * 0.8, 0.11, 0.16], [0.14, 0.11, 0.26], rings=8))
    skull = np.array([0.0, height + head * 0.75, 0.22])
    parts.append(ellipsoid(skull, [head * 1.08, head * 0.92, head * 0.95]))
    parts.append(ellipsoid(skull + [0, -0.25 * head, 0.85 * head], head * 0.36, rings=8))
    ear = skull + [head * 0.62, head * 0.55, 0]
    parts += pair(limb([ear, ear + [0.07, ears + 0.1, 0]], [head * 0.34, 0.035], segments=10))
    rump = np.array([0.0, 0.12, -0.1 - hips])
    bend = rump + [0, 0.06, -0.12 - 0.28 * tail]
    parts.append(limb([rump + [0, 0, 0.15], bend, bend + [0, 0.85 * tail, -0.1]], [0.1, 0.095, 0.085], segments=10))
    eyes = head / 0.32 * traits.draw(rng, "eyes", (0.012, 0.02), (0.045, 0.06), (0.12, 0.15))
    return join([*parts, *pair(ellipsoid(skull + head * np.array([0.42, 0.18, 0.84]), eyes, rings=8))])


def turtle(rng: Rng, traits: Traits) -> Part:
    """Draw a turtle: a domed shell with a rim, four paddles, a head on a stretched neck, a short tail."""
    head = traits.draw(rng, "head", (0.12, 0.14), (0.22, 0.26), (0.4, 0.48))
    neck = traits.draw(rng, "neck", (0.0, 0.04), (0.2, 0.3), (0.75, 0.95))
    shell = traits.draw(rng, "shell", (0.4, 0.46), (0.66, 0.76), (1.0, 1.15))
    dome = shell / 0.71 * rng.uniform(0.44, 0.54)
    parts = [ellipsoid([0, 0.3, 0], [shell * 0.9, dome, shell])]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = np.stack([np.cos(angle) * shell * 1.02, np.sin(angle) * shell * 1.12], 1)
    parts.append(moved(turned(extrude(rim, 0.17), 90, "x"), [0, 0.27, 0]))
    for z in (-0.62, 0.62):
        hip = np.array([shell * 0.6, 0.22, shell * z])
        parts += pair(limb([hip, hip + [0.28, -0.16, 0.22 * np.sign(z)]], [[0.1, 0.15], [0.08, 0.16]], segments=10))
    front = np.array([0.0, 0.3, shell * 0.9])
    skull = front + [0, 0.12 + 0.4 * neck, 0.2 + 0.75 * neck]
    parts += [limb([front, skull], [0.16, 0.13]), ellipsoid(skull, [head * 0.9, head * 0.9, head * 1.1], rings=10)]
    return join([*parts, limb([[0, 0.25, -shell * 0.9], [0, 0.18, -shell * 1.3]], [0.1, 0.05], segments=8)])


def octopus(rng: Rng, traits: Traits) -> Part:
    """Draw an octopus: a bulbous head with two eyes in front, on eight arms that spread and curl up at their tips."""
    head = traits.draw(rng, "head", (0.2, 0.24), (0.42, 0.5), (0.85, 1.0))
    arms = traits.draw(rng, "arms", (0.05, 0.12), (0.62, 0.76), (1.4, 1.65))
    waist = rng.uniform(0.26, 0.3)
    parts = [ellipsoid([0, 0.26, 0], [waist * 1.15, 0.24, waist * 1.15], rings=10)]
    skull = np.array([0.0, 0.34 + head * 1.05, -0.08 * head])
    parts.append(limb([np.array([0.0, 0.26, 0.0]), skull], [waist * 0.9, 0.55 * head + 0.08]))
    parts.append(ellipsoid(skull, [head * 0.9, head * 1.15, head * 0.95]))
    parts += pair(ellipsoid([0.16 + 0.1 * head, 0.44, waist * 0.85], 0.11, rings=8))
    for eighth in range(8):
        reach = arms * rng.uniform(0.92, 1.08)
        out = [0.15, 0.3 + 0.45 * reach, 0.34 + 0.85 * reach, 0.36 + 1.05 * reach]
        path = np.stack([np.zeros(4), [0.2, 0.11, 0.09, 0.12 + 0.28 * reach], out], 1)
        parts.append(turned(limb(path, [0.15, 0.115, 0.085, 0.05], segments=10, samples=4), 22.5 + 45 * eighth, "y"))
    return join(parts)


def fox(rng: Rng, _: Traits) -> Part:
    """Draw a fox: a slim body on short legs, a wide face that runs to a point, big ears, a tail like a brush."""
    body = Quadruped(rng.uniform(0.56, 0.7), rng.uniform(0.22, 0.25), rng.uniform(0.24, 0.32), rng.uniform(0.075, 0.09))
    chest, head = np.array([0.0, body.height + 0.02, body.length / 2]), rng.uniform(0.25, 0.29)
    skull = chest + at(rng.uniform(50, 62), 0.42)
    nose = skull + [0, -0.5 * head, 1.75 * head]
    parts = [*body.parts(), limb([chest, skull], [0.22, 0.17])]
    parts += [ellipsoid(skull, [1.15 * head, 0.85 * head, 0.9 * head])]
    parts.append(limb([skull + [0, -0.2 * head, 0.2 * head], nose], [[0.75 * head, 0.6 * head], [0.06, 0.055]]))
    cheek = [skull + [0.5 * head, -0.25 * head, 0], skull + [1.4 * head, -0.5 * head, -0.04]]
    parts += pair(limb(cheek, [0.4 * head, 0.03]))
    ear = skull + [0.6 * head, 0.45 * head, -0.05]
    tall = rng.uniform(0.32, 0.4)
    parts += pair(limb([ear, ear + [0.1, tall, 0.0]], [[0.17, 0.09], [0.03, 0.03]], segments=12))
    rump = np.array([0.0, body.height + 0.06, -body.length / 2 - 0.5 * body.radius])
    way = at(rng.uniform(165, 185), 0.6), at(rng.uniform(150, 170), 0.95)
    path = [rump, rump + [0, -0.04, -0.25], rump + way[0], rump + way[1]]
    return join([*parts, limb(path, [0.09, 0.17, 0.21, 0.04])])


def wolf(rng: Rng, _: Traits) -> Part:
    """Draw a wolf on long legs, with a ruff about its neck and a hanging tail; it looks ahead or howls."""
    body = Quadruped(rng.uniform(0.74, 0.88), rng.uniform(0.24, 0.27), rng.uniform(0.5, 0.6), rng.uniform(0.085, 0.1))
    howls, head = rng.random() < 0.3, rng.uniform(0.22, 0.25)
    chest = np.array([0.0, body.height + 0.08, body.length / 2])
    neck, aim = (at(72, 0.55), at(68, 1.0)) if howls else (at(rng.uniform(28, 45), 0.5), at(-12, 1.0))
    skull = chest + neck
    up = np.array([0.0, aim[2], -aim[1]])
    parts = [*body.parts(slope=0.05), limb([chest - [0, 0.06, 0.1], chest + 0.45 * neck, skull], [0.33, 0.34, 0.2])]
    parts += [ellipsoid(skull, head * 1.1)]
    parts += [limb([skull + 0.1 * aim, skull + 2.3 * head * aim], [0.75 * head, 0.42 * head])]
    tufts = [chest + 0.55 * neck + [0.3 * np.sin(t), 0.3 * np.cos(t), 0.0] for t in (1.0, 1.9, 2.7)]
    for tuft in tufts:
        parts += pair(limb([tuft * [0.7, 1, 1], tuft + [0.05, -0.2, -0.16]], [0.15, 0.035], segments=10))
    ear = skull + 0.75 * head * up + [0.55 * head, 0, 0]
    parts += pair(limb([ear, ear + 0.24 * up + [0.02, 0, 0]], [[0.1, 0.08], [0.03, 0.03]], segments=10))
    rump = np.array([0.0, body.height + 0.08, -body.length / 2 - body.radius * 0.75])
    path = [rump, rump + [0, -0.12, -0.16], rump + [0, -0.45, -0.24], rump + [0, -0.75, -0.22]]
    return join([*parts, limb(path, [0.09, 0.12, 0.14, 0.04])])


def van(rng: Rng, traits: Traits) -> Part:
    """Draw a van: a tall box over its whole length with a short slanted nose, sunk side windows, two wheels a side."""
    wide, long = rng.uniform(0.38, 0.44), rng.uniform(0.85, 1.0)
    wheel = traits.draw(rng, "wheels", (0.1, 0.12), (0.18, 0.21), (0.31, 0.37))
    belt, nose = rng.uniform(0.55, 0.62), rng.uniform(0.1, 0.32)
    top, front, floor = belt + rng.uniform(0.36, 0.5), long + nose, 0.75 * wheel
    cab = rng.uniform(0.1, 0.3) if rng.random() < 0.6 else -long + 0.2  # where the windows end
    low = [(-long, floor), (front, floor), (front, belt - 0.16), (long, belt), (-long, belt)]
    glass = [(-long + 0.1, floor + 0.1), (long - 0.1, floor + 0.1), (long - 0.02, belt), (long - 0.26, top - 0.05)]
    glass += [(-long + 0.1, top - 0.05)]
    load = [(-long, floor + 0.1), (cab, floor + 0.1), (cab - 0.05, top), (-long, top)]
    layers = (low, wide), (glass, wide - 0.07), (load, wide - 0.005)
    parts = [turned(extrude(side, 2 * x, bevel=0.06), -90, "y") for side, x in layers]
    parts.append(box([0, top, -0.14], [2 * wide, 0.13, 2 * long - 0.32], round_by=0.45))
    for z in np.linspace(cab, long - 0.2, 3 if cab > 0 else 5)[1:-1]:
        parts += pair(box([wide - 0.06, (belt + top) / 2, z - 0.12], [0.12, top - belt, 0.11]))
    for z in (-0.62 * long, 0.68 * long):
        parts += pair(moved(turned(disc(wheel, -0.09, 0.09), 90, "z"), [wide - 0.02, wheel, z]))
    parts += [box([0, floor + 0.08, z], [2 * wide + 0.06, 0.14, 0.14], round_by=0.4) for z in (-long, front)]
    return join([*parts, *pair(ellipsoid([0.7 * wide, belt - 0.24, front], [0.09, 0.09, 0.07], rings=8))])
