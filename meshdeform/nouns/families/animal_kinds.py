"""Draw other kinds of birds, fish, spiders and what has many arms, as toys, games and nature have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshdeform.nouns.families.birds import Build, bird_kind, bird_of, feathers
from meshdeform.nouns.families.drawing import bead, bent_limb, circle, kind, near, on, pairs, petal, sized, varied
from meshdeform.nouns.families.insects import claw_of, feelers_of, legs_of
from meshdeform.nouns.families.marine import FishBuild as FishBuild
from meshdeform.nouns.families.marine import fish_kind
from meshdeform.nouns.families.parts import Array, Part, ellipsoid, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

_DUCK = Build(lean_deg=14, legs=0.15, shank=0.05, neck=0.24, neck_deg=69, bow=0.08, head=0.185, beak=0.21,
    bill=(0.26, 0.5), tail=0.24, tail_deg=35)  # fmt: skip
_ALOFT = replace(_DUCK, neck=0.39, neck_deg=12, lean_deg=4, tail_deg=4, wings=0.82)
_SONGBIRD = Build(girth=0.33, length=0.41, lean_deg=34, legs=0.2, shank=0.03, neck=0.08, head=0.24, beak=0.11,
    bill=(0.26, 0.24), tail=0.41, fan_deg=9, wings=0.53)  # fmt: skip
_GLIDING = Build(girth=0.2, length=0.47, lean_deg=5, neck=0.1, neck_deg=20, head=0.155, beak=0.155, bill=(0.34, 0.3),
    tail=0.48, fan_deg=18, wings=1.05, chord=0.36)  # fmt: skip
_SLIM = FishBuild(tall=0.23, wide=0.16, fins=0.23, tail=0.38, back=(0.15, -0.2), fork=0.45)
_TALL = FishBuild(tall=0.78, wide=0.16, girths=(0.12, 0.7, 1.0, 0.85, 0.4, 0.16), fins=0.58, fork=0.2, back=(0.2, -0.6),
    belly=(0.2, -0.6), fin_lean=1.0)  # fmt: skip
_GOLDFISH = FishBuild(tall=0.55, wide=0.45, girths=(0.4, 0.85, 1.0, 0.8, 0.4, 0.2), fins=0.47, tail=0.9, tail_tall=0.8,
    fork=0.35, back=(0.3, -0.4))  # fmt: skip


def _ball(rng: Rng, traits: Traits, tall: float) -> tuple[dict[str, list[Part]], Array, Array]:
    """Return the solids of a toy bird whose body is its head as well, with its middle and radii."""
    radii = np.array([0.5, near(rng, tall), rng.uniform(0.46, 0.54)])
    middle, wings = np.array([0, 0.03 + radii[1], 0]), sized(rng, traits, "wings", 0.39, by=1.9)
    tail, beak = sized(rng, traits, "tail", 0.24), sized(rng, traits, "beak", 0.2)
    root = middle + radii * [0.92, 0.1, 0]
    flap = turned(turned(petal(wings, 0.5 * wings, thick=0.1), -rng.uniform(25, 60), "z"), rng.uniform(5, 35), "y")
    bill, fan = middle + radii * [0, 0.12, 0.92], turned(feathers(tail, 16), rng.uniform(10, 40), "x")
    solids = {"body": [ellipsoid(middle, radii, rings=12)], "eye": pair(bead(middle + radii * [0.38, 0.38, 0.8], 0.08)),
        "beak": [limb([bill, bill + [0, -0.03, beak]], [[0.09, 0.11], [0.02, 0.03]], segments=10)],
        "wing": pair(moved(flap, root)), "tail": [moved(fan, middle + radii * [0, -0.1, -0.85])],
        "foot": pair(bead([0.2, 0.06, 0.16], [0.1, 0.07, 0.19]))}  # fmt: skip
    return solids, middle, radii


def round_bird(rng: Rng, traits: Traits) -> Part:
    """Draw a bird as games have them: a ball with a beak, flaps of wings, a tuft on top."""
    solids, middle, radii = _ball(rng, traits, 0.52)
    top = middle + radii * [0, 0.95, 0.05]
    tuft = [limb([top, top + way], [0.05, 0.02], segments=7, samples=2) for way in ([0.0, 0.2, -0.12], [0, 0.14, -0.2])]
    head = bead(middle + [0, 0.3 * radii[1], 0.06], radii * [0.97, 0.75, 0.97], segments=20, rings=8)
    return varied(rng, **solids, head=[head, *tuft])


def plump_hen(rng: Rng, traits: Traits) -> Part:
    """Draw a hen: a heavy body, a fan of a tail, a comb and a wattle on a small head."""
    build = Build(girth=0.37, length=0.42, lean_deg=29, legs=0.2, neck=0.21, neck_deg=70, head=0.165, beak=0.12,
        bill=(0.42, 0.36), tail=0.41, fan_deg=24, tail_deg=85, wings=0.51)  # fmt: skip
    bird = bird_of(rng, traits, build)
    comb = [bead(on(bird.skull, bird.head, 0, 0.95 + lift, z), [0.04, 0.09, 0.07], segments=8)
        for z, lift in ((0.5, 0), (0, 0.2), (-0.5, 0.1))]  # fmt: skip
    wattle = bead(on(bird.skull, bird.head, 0, -0.95, 0.85), [0.045, 0.09, 0.05], segments=8)
    return varied(rng, **bird.solids, crest=comb, wattle=wattle)


def _eyes_of_owl(solids: dict[str, list[Part]], skull: Array, head: float, eyes: float) -> None:
    """Replace the eyes by round discs with a ball in each, which look ahead."""
    disc = turned(bead([0, 0, 0], [eyes, eyes, 0.4 * eyes], segments=12), 16, "y")
    ball = bead([0, 0, 0.36 * eyes], 0.42 * eyes)
    place = skull + [0.46 * head, 0.1 * head, 0.84 * head]
    solids["eye"] = [*pair(moved(disc, place)), *pair(moved(ball, place))]


def perched_owl(rng: Rng, traits: Traits) -> Part:
    """Draw an owl on its legs: a great round head with tufts on an upright body, long folded wings."""
    build = Build(girth=0.3, length=0.45, lean_deg=69, legs=0.1, shank=0.07, neck=0.065, neck_deg=78, head=0.32,
        beak=0.07, hook=1.0, bill=(0.3, 0.2), tail=0.28, wings=0.6)  # fmt: skip
    bird = bird_of(rng, traits, build)
    eyes, ears = sized(rng, traits, "eyes", 0.145, by=1.7), sized(rng, traits, "ears", 0.19)
    _eyes_of_owl(bird.solids, bird.skull, bird.head, eyes)
    root = on(bird.skull, bird.head, 0.5, 0.65, 0.1)
    return varied(rng, **bird.solids, ear=pair(limb([root, on(root, ears, 0.4, 1, -0.1)], [0.09, 0.02], segments=8)))


def flying_owl(rng: Rng, traits: Traits) -> Part:
    """Draw an owl in flight: broad blunt wings, a great round head."""
    build = Build(girth=0.28, length=0.46, lean_deg=12, neck=0.065, neck_deg=20, head=0.26, beak=0.06, hook=1.0,
        bill=(0.3, 0.2), tail=0.34, fan_deg=22, wings=0.95, chord=0.58, fingers=True)  # fmt: skip
    bird = bird_of(rng, traits, build, flying=True)
    _eyes_of_owl(bird.solids, bird.skull, bird.head, sized(rng, traits, "eyes", 0.12, by=1.7))
    return varied(rng, **bird.solids)


def flat_butterfly(rng: Rng, traits: Traits) -> Part:
    """Draw a butterfly with its wings level or half raised, its body along the ground."""
    wings, rise = sized(rng, traits, "wings", 0.8, by=1.9), rng.uniform(0, 60)
    long, girth = rng.uniform(0.4, 0.55), rng.uniform(0.06, 0.09)
    skull, root = np.array([0, 0, long + 0.02]), np.array([0.03, 0.03, 0.1])
    blades = [(petal(wings, 0.95 * wings), -28), (petal(0.72 * wings, 0.75 * wings), 38)]
    wing = [moved(turned(turned(blade, sweep, "y"), rise, "z"), root) for blade, sweep in blades]
    return varied(rng, body=limb([[0, 0, -long], [0, 0, 0], [0, 0, long]], [0.6 * girth, 1.3 * girth, girth],
        segments=12), head=bead(skull, 1.5 * girth, segments=12), feeler=feelers_of(skull + [0.03, 0.04, 0.04],
        np.array([0.2, 0.16, 0.32]), thick=0.02), wing=pairs(wing))  # fmt: skip


def fat_moth(rng: Rng, traits: Traits) -> Part:
    """Draw a moth: a thick body, wings laid back like a roof, feelers like feathers."""
    wings, rise = sized(rng, traits, "wings", 0.85, by=1.9), rng.uniform(-15, 15)
    skull, root = np.array([0, 0.02, 0.42]), np.array([0.06, 0.1, 0.2])
    wing = [moved(turned(turned(petal(size * wings, 0.62 * wings), sweep, "y"), rise, "z"), root - [0, drop, 0])
        for size, sweep, drop in ((1, 32, 0), (0.75, 55, 0.05))]  # fmt: skip
    comb = turned(turned(petal(0.34, 0.13, thick=0.04), -48, "y"), 25, "z")
    return varied(rng, body=[limb([[0, 0, -0.55], [0, 0, -0.1], [0, 0.02, 0.15]], [0.07, 0.16, 0.15], segments=14),
        bead([0, 0.03, 0.18], 0.2, segments=14)], head=bead(skull, 0.13, segments=12),
        feeler=pair(moved(comb, skull + [0.04, 0.06, 0.06])), wing=pairs(wing))  # fmt: skip


def _spider(rng: Rng, traits: Traits, reach: float, thick: float, lift: float, belly: float) -> Part:
    """Draw a spider on legs of a length and a thickness."""
    legs, head = sized(rng, traits, "legs", reach), sized(rng, traits, "head", 0.21, by=1.7)
    girth, y = near(rng, belly), 0.16 + 0.12 * lift + thick
    skull = np.array([0, y + 0.02, 0.2 + head])
    spots = ((0.16, 52), (0.05, 18), (-0.06, -18), (-0.17, -52))
    return varied(rng, body=[ellipsoid([0, y + 0.08, -0.25 - girth], [girth, 0.85 * girth, 1.2 * girth], rings=10),
        bead([0, y, 0], [0.2, 0.15, 0.28], segments=14)], head=bead(skull, head * np.array([1, 0.85, 1]), segments=14),
        eye=pair(bead(on(skull, head, 0.4, 0.5, 0.75), 0.3 * head)),
        fang=pair(limb([on(skull, head, 0.35, -0.4, 0.75), on(skull, head, 0.3, -1.0, 0.9)], [0.05, 0.015],
        segments=7)), leg=legs_of(legs, y, spots, lift=lift, thick=thick, inner=0.12))  # fmt: skip


def round_penguin(rng: Rng, traits: Traits) -> Part:
    """Draw a penguin of one round body that is its head as well."""
    solids, middle, radii = _ball(rng, traits, 0.68)
    crown = bead(middle + [0, 0.42 * radii[1], 0], radii * [0.9, 0.7, 0.9], segments=20, rings=8)
    return varied(rng, **solids, head=crown)


def slim_penguin(rng: Rng, traits: Traits) -> Part:
    """Draw a tall penguin with a small head, a thin bent beak, long flippers, perhaps tufts at its brows."""
    head, wings = sized(rng, traits, "head", 0.21, by=1.7), sized(rng, traits, "wings", 0.61, by=1.9)
    girth, tall = rng.uniform(0.28, 0.34), rng.uniform(0.6, 0.75)
    skull = np.array([0, 2 * tall + 0.5 * head, 0.08])
    bill, root = skull + [0, -0.05 * head, 0.75 * head], np.array([0.8 * girth, 1.55 * tall, 0.02])
    path = [root, on(root, wings, 0.25, -0.5, -0.05), on(root, wings, 0.35, -1, -0.1)]
    brow = on(skull, head, 0.7, 0.55, 0.2)
    return varied(rng, body=bent_limb([[0, 0.25, -0.05], [0, 0.8 * tall, 0.02], [0, 1.5 * tall, 0],
        [0, 1.9 * tall, 0.04]], girth * np.array([0.75, 1.05, 0.8, 0.5]), segments=18),
        head=[bead(skull, head, segments=16, rings=8),
        *pair(limb([brow, brow + [0.1, 0.1, -0.16]], [0.03, 0.012], segments=6, samples=1))],
        beak=bent_limb([bill, bill + [0, 0, 0.12], bill + [0, -0.06, 0.24]], [0.06, 0.045, 0.015], segments=8),
        wing=pair(bent_limb(path, [[0.05, 0.1], [0.05, 0.13], [0.03, 0.05]])),
        foot=pair(bead([0.16, 0.05, 0.14], [0.13, 0.06, 0.2], segments=10)),
        tail=limb([[0, 0.25, -0.2], [0, 0.06, -0.42]], [[0.06, 0.14], [0.03, 0.06]], segments=10))  # fmt: skip


def _crab(rng: Rng, traits: Traits, usual: Sequence[float], reach: float, thick: float, claw: float) -> Part:
    """Draw a crab with four pairs of legs, claws ahead and eyes on top."""
    radii = np.array([near(rng, each) for each in usual])
    legs, claws, y = sized(rng, traits, "legs", reach), sized(rng, traits, "claws", claw, by=1.9), 0.3
    out, top = radii * [0.8, 0, 0.55], np.array([0, y, 0]) + radii * [0.28, 0.85, 0.6]
    shoulder, wrist = out + [0, y, 0], out + [0.22, y + 0.05, 0.42]
    palm, eye = wrist + [-0.02, 0.1, 0.7 * claws], top + [0.02, 0.16, 0.04]
    return varied(rng, body=ellipsoid([0, y, 0], radii, rings=10),
        leg=legs_of(legs, y - 0.05, ((0.1, 22), (0, 2), (-0.1, -18), (-0.2, -38)), lift=0.3, thick=thick,
        inner=0.65 * radii[0]), eye=[*pair(limb([top, eye], [0.04, 0.04], segments=7, samples=1)),
        *pair(bead(eye, 0.075))],
        arm=pair(limb([shoulder, [wrist[0] + 0.1, y, 0.5 * (shoulder + wrist)[2]], wrist], [0.09, 0.09, 0.08],
        segments=8, samples=2)), claw=claw_of(palm, claws))  # fmt: skip


def round_octopus(rng: Rng, traits: Traits) -> Part:
    """Draw an octopus as toys have it: a ball of a head with large eyes on a ring of short curled arms."""
    head, arms = sized(rng, traits, "head", 0.55, by=1.7), sized(rng, traits, "arms", 0.39)
    skull = np.array([0, 0.12 + 0.85 * head, 0])
    solids = []
    for place in circle(1.0, 8):
        way = np.array([place * r + [0, h, 0] for r, h in ((0.3, 0.18), (0.4 + 0.5 * arms, 0.08), (0.42 + arms, 0.1),
            (0.4 + 1.05 * arms, 0.1 + 0.3 * arms))])  # fmt: skip
        solids.append(bent_limb(way, [0.15, 0.13, 0.1, 0.05], segments=9))
    return varied(rng, body=bead([0, 0.16, 0], [0.38, 0.16, 0.38], segments=16),
        head=bead(skull, head * np.array([1, rng.uniform(0.85, 1.1), 0.95]), segments=22, rings=12),
        eye=pair(bead(on(skull, head, 0.42, 0.02, 0.82), 0.13)), arm=solids)  # fmt: skip


def sea_octopus(rng: Rng, traits: Traits) -> Part:
    """Draw an octopus of the sea: a sack of a head that lies back, long arms that wind along the ground."""
    head, arms = sized(rng, traits, "head", 0.31, by=1.8), sized(rng, traits, "arms", 1.12, by=2.0)
    t, solids = np.linspace(0, 1, 7), []
    for place in circle(1.0, 8) + circle(1.0, 8)[[1, 2, 3, 4, 5, 6, 7, 0]]:
        out, side = 0.54 * place, 0.54 * np.array([place[2], 0, -place[0]])
        wave = (0.14 * arms * np.sin(rng.uniform(4, 6) * t) * rng.choice([-1.0, 1.0]))[:, None]
        path = out * (0.14 + arms * t[:, None]) + side * wave + [0, 0.06, 0] + np.outer(0.2 * (1 - t) ** 2, [0, 1, 0])
        solids.append(limb(path, np.linspace(0.11, 0.025, 7), segments=8, samples=1))
    brow = np.array([0, 0.34, 0.1])
    return varied(rng, body=bead([0, 0.24, 0], [0.26, 0.2, 0.26], segments=16),
        head=bent_limb([brow, on(brow, head, 0, 0.6, -0.7), on(brow, head, 0, 1.0, -2.2)],
        [0.22, 0.9 * head, 0.5 * head], segments=16), eye=pair(bead(brow + [0.17, 0.1, 0.06], 0.085)),
        arm=solids)  # fmt: skip


KINDS = {"bird": (bird_kind("songbird", _SONGBIRD), bird_kind("gliding_bird", _GLIDING, flying=True), round_bird),
    "butterfly": (flat_butterfly, fat_moth), "chicken": (plump_hen,),
    "crab": (kind("round_crab", lambda rng, traits: _crab(rng, traits, (0.5, 0.38, 0.42), 0.28, 0.06, 0.3)),
    kind("long_crab", lambda rng, traits: _crab(rng, traits, (0.36, 0.17, 0.32), 0.8, 0.045, 0.185))),
    "duck": (bird_kind("standing_mallard", _DUCK), bird_kind("flying_duck", _ALOFT, flying=True)),
    "fish": (fish_kind("slim_fish", _SLIM), fish_kind("tall_fish", _TALL), fish_kind("goldfish", _GOLDFISH)),
    "octopus": (round_octopus, sea_octopus), "owl": (perched_owl, flying_owl), "penguin": (round_penguin, slim_penguin),
    "spider": (kind("flat_spider", lambda rng, traits: _spider(rng, traits, 0.9, 0.03, 0.14, 0.26)),
    kind("hairy_spider", lambda rng, traits: _spider(rng, traits, 0.62, 0.09, 0.5, 0.38)),
    kind("toy_spider", lambda rng, traits: _spider(rng, traits, 0.39, 0.06, 0.45, 0.46)))}  # fmt: skip
