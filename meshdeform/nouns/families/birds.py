"""Draw birds from one archetype: an egg of a body, neck, head, beak, a fanned tail, wings, and legs or none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from meshdeform.nouns.families.animals import at
from meshdeform.nouns.families.drawing import Family, bead, bent_limb, kind, near, on, sized, varied
from meshdeform.nouns.families.parts import Array, Part, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits


@dataclass(frozen=True)
class Build:
    """Ranges of a bird; lengths in the family's unit, in which a body is about one long.

    Angles in degrees above straight ahead, the tail's above the body's line behind. `bow`: how far the neck swings in
    an S, as a share of its length; `hook`: how far the beak's tip drops; `bill`: height and width of the beak as
    shares of the head's radius; `fan_deg`: half the tail's angle; `chord`: depth of an open wing as a share of its
    length; `fingers`: whether its tip is of separate feathers.
    """

    girth: float = 0.3
    length: float = 0.53
    lean_deg: float = 22
    legs: float = 0.24
    shank: float = 0.045
    neck: float = 0.15
    neck_deg: float = 58
    bow: float = 0.0
    head: float = 0.195
    beak: float = 0.21
    hook: float = 0.1
    bill: tuple[float, float] = (0.4, 0.36)
    tail: float = 0.45
    fan_deg: float = 14
    tail_deg: float = 5
    wings: float = 0.6
    chord: float = 0.4
    fingers: bool = False


class Bird(NamedTuple):
    """The solids of a bird by their parts, and where more can be added."""

    solids: dict[str, list[Part]]
    skull: Array
    head: float
    throat: Array
    middle: Array


def bird_of(rng: Rng, traits: Traits, build: Build, *, flying: bool = False) -> Bird:
    """Draw a bird that stands with folded wings, or flies."""
    girth, length = near(rng, build.girth), near(rng, build.length)
    lean = build.lean_deg + rng.uniform(-10, 10)
    leg = 0.3 if flying else sized(rng, traits, "legs", build.legs)
    middle = np.array([0.0, leg + 0.85 * girth, 0.0])
    axis, up = at(lean, 1.0), at(lean + 90, 1.0)
    spine = [middle - 0.5 * length * axis, middle, middle + 0.4 * length * axis]
    solids = {"body": [limb(spine, girth * np.array([0.55, 1.0, 0.75]), segments=18, samples=4)]}
    throat = middle + 0.5 * length * axis + 0.25 * girth * up
    skull, head = _head(rng, traits, build, throat, girth, solids)
    tail = sized(rng, traits, "tail", build.tail)
    fan = turned(feathers(tail, build.fan_deg), build.tail_deg + rng.uniform(-10, 10) - lean, "x")
    solids["tail"] = [moved(fan, middle - 0.75 * length * axis + 0.15 * girth * up)]
    wings = sized(rng, traits, "wings", build.wings, by=1.9)
    if flying:
        wing = turned(open_wing(wings, build.chord, build.fingers), rng.uniform(-4, 42), "z")
        solids["wing"] = pair(moved(turned(wing, -0.8 * lean, "x"), middle + [0.4 * girth, 0.4 * girth, 0.1]))
        return Bird(solids, skull, head, throat, middle)
    solids["wing"] = pair(_folded_wing(rng, wings, girth, lean, middle))
    hip, ankle = np.array([0.42 * girth, middle[1] - 0.4 * girth, -0.04]), np.array([0.46 * girth, 0.05, 0.0])
    knee = (hip + ankle) / 2 + [0.02, 0, -0.1 * leg]
    solids["leg"] = pair(limb([hip, knee, ankle], build.shank * np.array([1.6, 1.0, 1.0]), segments=8, samples=3))
    solids["foot"] = pair(moved(_foot(1.6 * build.shank + 0.12), ankle * [1, 0, 1] + [0, 0.035, 0]))
    return Bird(solids, skull, head, throat, middle)


def _head(
    rng: Rng, traits: Traits, build: Build, throat: Array, girth: float, solids: dict[str, list[Part]]
) -> tuple[Array, float]:
    """Add neck, head, eyes and beak; return the middle of the head and its radius."""
    neck, head = sized(rng, traits, "neck", build.neck), sized(rng, traits, "head", build.head, by=1.8)
    deg, t = build.neck_deg + rng.uniform(-10, 10), np.array([0.0, 0.3, 0.65, 1.0])[:, None]
    path = throat + at(deg, neck) * t - at(deg + 90, build.bow * neck) * np.sin(2 * np.pi * t)
    thin = min(0.7 * head, 0.6 * girth)
    solids["neck"] = [bent_limb(path, [0.65 * girth, 1.15 * thin, thin, thin], segments=12, samples=4)]
    skull = path[-1] + [0, 0.2 * head, 0.25 * head]
    solids["head"] = [bead(skull, head * np.array([0.9, 0.95, 1.05]), segments=18, rings=9)]
    solids["eye"] = pair(bead(on(skull, head, 0.66, 0.25, 0.5), 0.22 * head))
    beak, root = sized(rng, traits, "beak", build.beak), on(skull, head, 0, -0.1, 0.7)
    way = 0.3 * head + beak * np.array([(0, 0.05 * build.hook, 0.55), (0, -0.9 * build.hook, 1 - 0.3 * build.hook)])
    size = head * np.array(build.bill)
    bill = [root, *(root + way * [0, 1, 1] - [0, 0.3 * head, 0])]
    solids["beak"] = [bent_limb(bill, [size, 0.75 * size, 0.22 * size], samples=4)]
    return skull, head


def feathers(length: float, half_deg: float, thick: float = 0.07) -> Part:
    """Return a level fan of seven feathers that points back from the origin."""
    angle = np.radians(half_deg) * np.linspace(-1, 1, 15)
    reach = (0.1 + length) * np.where(np.arange(15) % 2, 0.9, 1.0)
    arc = np.stack([reach * np.sin(angle) + 0.05 * np.sign(angle), -reach * np.cos(angle)], 1)
    return plate([(0.07, 0.06), *arc[::-1], (-0.07, 0.06)], thick, across="y")


def open_wing(length: float, chord: float, fingers: bool) -> Part:
    """Return a level wing that reaches out along X."""
    deep = chord * length
    front = [(0, 0.45 * deep), (0.4 * length, 0.6 * deep), (0.75 * length, 0.4 * deep)]
    tips = [(1, -0.25), (0.86, -0.2), (0.96, -0.55), (0.8, -0.4), (0.86, -0.8), (0.68, -0.55)]
    tip = tips if fingers else [(1, -0.45), (0.75, -0.3)]
    back = [(0.4 * length, -0.5 * deep), (0, -0.5 * deep)]
    return plate([*front, *(np.array(tip) * [length, deep]), *back], 0.07, across="y", puff=0.3)


def _folded_wing(rng: Rng, wings: float, girth: float, lean: float, middle: Array) -> Part:
    """Return a wing that lies on the flank, its tip behind."""
    rim = np.array([(0.5, 0.1), (0.35, 0.75), (-0.2, 0.9), (-0.9, 0.35), (-1.25, 0.0), (-0.5, -0.6), (0.1, -0.75)])
    wing = turned(plate(rim * [0.85 * wings, 0.85 * girth], 0.12, across="x", puff=0.3), -lean, "x")
    return moved(turned(wing, rng.uniform(-12, 2), "z"), middle + [0.92 * girth, 0.1 * girth, 0])


def _foot(reach: float) -> Part:
    """Return a flat foot with three toes ahead and one behind."""
    toes = [(-40, 1), (-20, 0.45), (0, 1.1), (20, 0.45), (40, 1), (100, 0.3), (180, 0.5), (260, 0.3)]
    angle, size = np.radians([deg for deg, _ in toes]), reach * np.array([size for _, size in toes])
    return plate(np.stack([size * np.sin(angle), size * np.cos(angle)], 1), 0.06, across="y")


def plumes(at_place: Array, length: float, degs: tuple[float, ...], thick: float = 0.03) -> list[Part]:
    """Return feathers that stand up from a place, at angles above straight ahead."""
    tips = [at_place + at(deg, length) for deg in degs]
    return [limb([at_place, tip], [[thick, thick], [0.6 * thick, 1.6 * thick]], segments=8, samples=2) for tip in tips]


def bird_kind(name: str, build: Build, *, flying: bool = False) -> Family:
    """Return the family of birds that are known by their build alone."""
    return kind(name, lambda rng, traits: varied(rng, **bird_of(rng, traits, build, flying=flying).solids))


_EAGLE = Build(girth=0.24, length=0.54, lean_deg=4, neck=0.14, neck_deg=15, head=0.16, beak=0.17, hook=0.7,
    bill=(0.55, 0.42), tail=0.47, fan_deg=24, wings=1.18, chord=0.48, fingers=True)  # fmt: skip
_PERCHED = replace(_EAGLE, girth=0.30, lean_deg=59, neck_deg=72, legs=0.19, shank=0.07, wings=0.8, fan_deg=12)


eagle = bird_kind("eagle", _EAGLE, flying=True)
"""An eagle in flight: broad wings that end in fingers, a hooked beak, a fanned tail."""


_PARROT = Build(girth=0.27, lean_deg=58, legs=0.1, neck=0.11, neck_deg=70, head=0.24, beak=0.19, hook=1.0,
    bill=(0.55, 0.4), tail=0.8, fan_deg=6, wings=0.67)  # fmt: skip


parrot = bird_kind("parrot", _PARROT)
"""An upright parrot: a big round head, a beak bent down, a long narrow tail."""


def cockatoo(rng: Rng, traits: Traits) -> Part:
    """Draw a parrot with a raised crest and a shorter tail."""
    bird = bird_of(rng, traits, replace(_PARROT, tail=0.45, fan_deg=10))
    crest = plumes(bird.skull + [0, 0.7 * bird.head, 0.1], rng.uniform(1.2, 1.6) * bird.head, (70, 95, 120, 145), 0.045)
    return varied(rng, **bird.solids, crest=crest)


flamingo = bird_kind("flamingo", Build(girth=0.24, length=0.43, lean_deg=10, legs=1.1, shank=0.035, neck=0.82,
    neck_deg=78, bow=0.26, head=0.108, beak=0.22, hook=1.0, bill=(0.55, 0.5), tail=0.17, wings=0.54))  # fmt: skip
"""A flamingo: a small body on stilts, a long neck in an S, a beak bent down."""

ostrich = bird_kind("ostrich", Build(girth=0.41, length=0.45, lean_deg=5, legs=0.88, shank=0.06, neck=0.82, neck_deg=78,
    bow=0.08, head=0.128, beak=0.135, bill=(0.3, 0.6), tail=0.31, fan_deg=38, tail_deg=40, wings=0.54))  # fmt: skip
"""An ostrich: a great round body on strong legs, a bare upright neck, a small flat head, a plume of a tail."""


def peacock(rng: Rng, traits: Traits) -> Part:
    """Draw a peacock: a wheel of feathers behind a slender bird with a small crown."""
    build = Build(girth=0.22, length=0.41, neck=0.42, neck_deg=76, bow=0.06, head=0.12, beak=0.135, tail=1.15,
        fan_deg=82, tail_deg=94, wings=0.43)  # fmt: skip
    bird = bird_of(rng, traits, build)
    return varied(rng, **bird.solids, crest=plumes(bird.skull + [0, 0.7 * bird.head, 0], 0.22, (70, 95, 120), 0.022))


def turkey(rng: Rng, traits: Traits) -> Part:
    """Draw a turkey: a plump body before an upright fan, a thin neck, a small head with a wattle."""
    build = Build(girth=0.41, length=0.46, lean_deg=20, neck=0.29, neck_deg=68, bow=0.12, head=0.13, beak=0.115,
        hook=0.4, tail=0.78, fan_deg=74, tail_deg=88)  # fmt: skip
    bird = bird_of(rng, traits, build)
    drop = on(bird.skull, bird.head, 0, -0.9, 0.75)
    wattle = limb([drop + [0, 0.05, 0], drop - [0, rng.uniform(0.1, 0.16), 0]], [0.05, 0.06], segments=10)
    return varied(rng, **bird.solids, wattle=wattle)


goose = bird_kind("goose", Build(girth=0.34, length=0.6, lean_deg=11, legs=0.21, shank=0.055, neck=0.61, neck_deg=80,
    bow=0.07, head=0.15, beak=0.19, bill=(0.35, 0.5), tail=0.23, tail_deg=30, wings=0.66))  # fmt: skip
"""A goose on its feet: a heavy level body, a long upright neck, a flat bill."""

seagull = bird_kind("seagull", Build(girth=0.24, length=0.56, lean_deg=4, neck=0.16, neck_deg=22, head=0.162, beak=0.2,
    hook=0.12, bill=(0.36, 0.3), tail=0.3, fan_deg=24, wings=1.15, chord=0.25), flying=True)  # fmt: skip
"""A gull that glides: long narrow pointed wings, a plump body, a short tail."""


crow = bird_kind("crow", Build(girth=0.26, lean_deg=26, beak=0.29, bill=(0.5, 0.4), hook=0.15, tail=0.53, fan_deg=9,
    wings=0.71))  # fmt: skip
"""A crow: a strong straight beak, a sleek body, a long tail."""

pigeon = bird_kind("pigeon", Build(girth=0.33, length=0.62, lean_deg=24, legs=0.13, neck=0.2, neck_deg=76, head=0.14,
    beak=0.085, bill=(0.32, 0.32), tail=0.48, fan_deg=14, wings=0.72))  # fmt: skip
"""A pigeon: a full breast, a small round head, a tiny beak."""


def pterodactyl(rng: Rng, traits: Traits) -> Part:
    """Draw a pterodactyl: wings of skin to a point, a long toothless beak, a crest that points back."""
    build = Build(girth=0.19, length=0.5, lean_deg=5, neck=0.23, neck_deg=30, head=0.15, beak=0.68, hook=0.04,
        bill=(0.5, 0.36), tail=0.12, wings=1.2)  # fmt: skip
    bird = bird_of(rng, traits, build, flying=True)
    span = float(np.ptp(bird.solids["wing"][0].verts[:, 0]))
    web = np.array([(0, 0.14), (0.3, 0.4), (0.42, 0.36), (1.05, -0.3), (0.62, -0.12), (0.3, -0.3), (0, -0.42)])
    wing = turned(plate(web * [span, 0.85], 0.06, across="y"), rng.uniform(6, 24), "z")
    crest = limb([bird.skull, bird.skull + [0, 0.22, -rng.uniform(0.4, 0.55)]], [[0.1, 0.05], [0.03, 0.025]])
    hip = bird.middle + [0.08, -0.06, -0.35]
    leg = limb([hip, hip + [0.06, -0.06, -0.4]], [0.06, 0.035], segments=8)
    return varied(rng, **{**bird.solids, "wing": pair(moved(wing, bird.middle + [0.06, 0.06, 0.05])), "leg": pair(leg)},
        crest=crest)  # fmt: skip


_GULL = Build(girth=0.27, length=0.62, lean_deg=14, neck=0.26, neck_deg=76, head=0.17, beak=0.22, hook=0.15,
    bill=(0.36, 0.3), tail=0.2, fan_deg=8, wings=0.85, legs=0.34, shank=0.035)  # fmt: skip
KINDS = {"eagle": (bird_kind("perched_eagle", _PERCHED),), "parrot": (cockatoo,),
    "seagull": (bird_kind("standing_gull", _GULL),)}  # fmt: skip
