"""Draw figures of tales and games from one archetype: a person with a head of any size, on legs or in a robe."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from meshdeform.nouns.families.birds import open_wing
from meshdeform.nouns.families.drawing import (
    Family,
    bead,
    bent_limb,
    blade,
    kind,
    near,
    on,
    pairs,
    petal,
    sized,
    varied,
)
from meshdeform.nouns.families.parts import Array, Part, box, ellipsoid, lathe, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

Solids = dict[str, list[Part]]


@dataclass(frozen=True)
class FigureBuild:
    """Ranges of a figure; lengths in the family's unit, in which a grown person is about two and a half tall.

    `wide`: from the middle to a shoulder; `waist`, `hips`, `deep`: shares of it; `arm_deg`: the arms' angle from
    straight down to the sides, `ahead_deg`: and ahead; `stoop_deg`: how far the trunk leans ahead; `robe`: radius of a
    robe's hem as a share of the hips' height, without one if 0, `hem`: its height as a share of theirs.
    """

    head: float = 0.25
    trunk: float = 0.62
    wide: float = 0.31
    waist: float = 0.75
    hips: float = 0.8
    deep: float = 0.58
    arms: float = 0.66
    arm_deg: float = 34
    ahead_deg: float = 10
    thick: float = 0.105
    legs: float = 0.71
    stoop_deg: float = 2
    neck: float = 0.1
    robe: float = 0.0
    hem: float = 0.0


class Figure(NamedTuple):
    """The solids of a figure by their parts, and where more can be added: middle of the head, right hand, neck."""

    solids: Solids
    skull: Array
    head: float
    hand: Array
    top: Array
    wide: float
    hips: float


def figure_of(rng: Rng, traits: Traits, build: FigureBuild) -> Figure:
    """Draw a figure that stands."""
    head, arms = sized(rng, traits, "head", build.head, by=1.7), sized(rng, traits, "arms", build.arms)
    legs, wide, trunk = sized(rng, traits, "legs", build.legs), near(rng, build.wide), near(rng, build.trunk)
    thick, stoop, hips = near(rng, build.thick), np.radians(build.stoop_deg + rng.uniform(-10, 10)), legs + 0.12
    top = np.array([0, hips + trunk * np.cos(stoop), trunk * np.sin(stoop)])
    low, shares = np.array([0, hips, 0]), np.array([build.hips, build.waist, 1.0])
    spine = [low, 0.55 * low + 0.45 * top, top - [0, 0.1, 0]]
    skull = top + [0, build.neck + 0.85 * head, 0.4 * head * np.sin(stoop)]
    solids: Solids = {"body": [limb(spine, wide * shares[:, None] * [1, build.deep], segments=16, samples=3)],
        "neck": [limb([top - [0, 0.06, 0], skull], [0.1, 0.09], segments=8, samples=1)],
        "head": [bead(skull, head * np.array([0.92, 1.05, 0.97]), segments=18, rings=9)],
        "eye": pair(bead(on(skull, head, 0.36, 0.12, 0.84), 0.15 * head, segments=8, rings=5)),
        "nose": [bead(skull + [0, -0.12 * head, 0.96 * head], [0.14 * head, 0.18 * head, 0.2 * head],
        segments=8)]}  # fmt: skip
    out, ahead = np.radians(build.arm_deg + rng.uniform(-10, 10)), np.radians(build.ahead_deg + rng.uniform(-10, 10))
    way = np.array([np.sin(out) * np.cos(ahead), -np.cos(out) * np.cos(ahead), np.sin(ahead)])
    shoulder = top + [0.92 * wide, -0.1, 0]
    elbow = shoulder + 0.5 * arms * way
    hand = elbow + 0.5 * arms * (way + [0, 0, 0.25])
    path = [shoulder, elbow, hand]
    solids["arm"] = pair(limb(path, thick * np.array([1.15, 0.95, 0.85]), segments=10, samples=2))
    solids["hand"] = pair(bead(hand, 1.2 * thick, segments=8))
    if build.robe:
        hem, rim = build.hem * hips, build.robe * hips
        profile = [(0.7 * rim, hem + 0.05), (rim, hem), (0.55 * rim + 0.45 * wide, 0.55 * hips + 0.45 * hem)]
        over_legs = 0.48 * wide + 1.35 * thick if build.hem else 0.0
        waist = [(max(build.hips * wide, over_legs), hips), (0.6 * build.waist * wide, hips + 0.2 * trunk)]
        solids["skirt"] = [lathe([*profile, *waist], segments=20)]
    if not build.robe or build.hem:
        foot = np.array([rng.uniform(0.5, 0.75) * wide, 0.09, 0])
        leg = limb([[0.48 * wide, hips, 0], foot], thick * np.array([1.4, 1.05]), segments=10, samples=3)
        shoe = bead(foot + [0.01, -0.02, 0.08], [0.75 * thick + 0.03, 0.08, 0.1 + thick], segments=12)
        solids |= {"leg": pair(leg), "foot": pair(shoe)}
    return Figure(solids, skull, head, hand, top, wide, hips)


def figure_kind(name: str, build: FigureBuild) -> Family:
    """Return the family of figures that are known by their build alone."""
    return kind(name, lambda rng, traits: varied(rng, **figure_of(rng, traits, build).solids))


def _pointed_hat(rng: Rng, traits: Traits, figure: Figure, usual: float, brim: float, bend: float) -> Part:
    """Return a hat like a cone, bent back at its tip, with a brim of so many times the head's radius or none."""
    tall, head = sized(rng, traits, "hat", usual, by=2.2), figure.head
    crown = figure.skull + [0, 0.35 * head, -0.05 * head]
    ring = np.array([(0.1, 0), (1, 0.02), (1, 0.1), (0.1, 0.1)]) if brim else np.zeros((0, 2))
    cone = np.array([(0.98, 0.1), (0.8, 0.3), (0.55, 0.56), (0.28, 0.82), (0.05, 1.0)]) * [head, tall]
    profile = np.concatenate([ring * [brim * head, 1] if brim else [(0.5 * head, 0.0)], cone])
    hat = lathe(profile, segments=20)
    rise = np.clip(hat.verts[:, 1] / tall - 0.45, 0, 1)
    hat.verts[:, 2] -= bend * tall * rise**1.5
    return moved(turned(hat, -rng.uniform(2, 12), "x"), crown)


def _beard(rng: Rng, traits: Traits, figure: Figure, usual: float) -> Part:
    """Return a beard from the cheeks down."""
    long, head = sized(rng, traits, "beard", usual), figure.head
    chin = on(figure.skull, head, 0, -0.35, 0.62)
    path = [chin, chin + [0, -0.45 * long, 0.12], chin + [0, -long, 0.08]]
    return bent_limb(path, head * np.array([[0.72, 0.4], [0.6, 0.4], [0.1, 0.1]]), segments=12)


def hair_of(figure: Figure, length: float) -> Part:
    """Return hair that covers the back of the head and hangs so many times its radius below its middle."""
    skull, head = figure.skull, figure.head
    path = [on(skull, head, 0, 0.35, -0.12), skull + [0, -0.4 * head, -0.5 * head]]
    path.append(skull + [0, -length * head, -0.62 * head])
    return bent_limb(path, head * np.array([[0.98, 0.98], [0.98, 0.66], [0.7, 0.25]]), segments=14)


def _staff(hand: Array, bottom: float, top: float, thick: float = 0.045) -> Part:
    """Return an upright staff in the hand between two heights."""
    return limb([[hand[0], bottom + thick, hand[2] + 0.05], [hand[0], top, hand[2] + 0.05]], [thick, thick], segments=8)


def bat_wing(size: float, fold_deg: float, lift_deg: float) -> Part:
    """Return an upright wing of skin with three points below, as a bat has, spread to the right."""
    rim = [(0, 0.1), (0.3, 0.6), (0.6, 0.75), (1.1, 0.45), (1.15, -0.2), (0.85, 0.05), (0.7, -0.4), (0.42, -0.05),
        (0.1, -0.4)]  # fmt: skip
    wing = turned(plate(size * np.array(rim), 0.07, across="z"), lift_deg, "z")
    return turned(wing, fold_deg, "y")


_ROBED = FigureBuild(robe=0.5, wide=0.29, arm_deg=38)
_REACHING = FigureBuild(arm_deg=6, ahead_deg=82, stoop_deg=10, head=0.27)


def astronaut(rng: Rng, traits: Traits) -> Part:
    """Draw an astronaut: a round helmet with a visor, a puffed suit, a box on the back, thick boots."""
    build = FigureBuild(head=0.33, thick=0.145, wide=0.36, waist=0.9, hips=0.9, deep=0.75, legs=0.57, neck=0.0)
    figure = figure_of(rng, traits, build)
    solids, skull, head, wide = figure.solids, figure.skull, figure.head, figure.wide
    visor = ellipsoid(skull + [0, 0.02, 0.3 * head], head * np.array([0.76, 0.66, 0.8]), rings=8)
    collar = lathe([(0.2, -0.05), (0.75 * head, -0.06), (0.75 * head, 0.05), (0.2, 0.06)], segments=18)
    pack = box(figure.top + [0, -0.24, -0.62 * wide - 0.12], [1.3 * wide, 0.6, 0.26], round_by=0.25, cells=4)
    boots = pair(bead(np.abs(solids["foot"][0].verts).mean(0) + [0, 0.04, 0], [0.17, 0.14, 0.24], segments=12))
    panel = box(figure.top + [0, -0.3, 0.7 * wide], [0.7 * wide, 0.16, 0.1], cells=3)
    face = {"eye": [], "nose": [], "visor": [visor], "collar": [moved(collar, figure.top + [0, 0.02, 0])]}
    return varied(rng, **{**solids, **face, "foot": boots, "tank": [pack], "panel": [panel]})


def knight(rng: Rng, traits: Traits) -> Part:
    """Draw a knight: a closed helmet with a slit and a plume, round shoulders, a shield and an upright sword."""
    figure = figure_of(rng, traits, FigureBuild(thick=0.125, wide=0.36, waist=0.7, ahead_deg=38, neck=0.04))
    skull, head, hand = figure.skull, figure.head, figure.hand
    can = [(0.6, -1.0), (0.95, -0.9), (0.98, 0.1), (0.85, 0.6), (0.5, 0.95), (0.05, 1.1)]
    visor = bead(skull + [0, -0.05 * head, 0.35 * head], head * np.array([0.9, 0.62, 0.85]), segments=14)
    crest = skull + [0, 1.0 * head, 0.1]
    plume = bent_limb([crest, crest + [0, 0.2, -0.12], crest + [0, 0.12, -0.42]],
        [[0.05, 0.05], [0.06, 0.12], [0.02, 0.05]])  # fmt: skip
    rim = np.array([(-0.9, 1.0), (0.9, 1.0), (0.85, 0.0), (0.45, -0.9), (0, -1.3), (-0.45, -0.9), (-0.85, 0.0)])
    shield = moved(turned(blade(rim, rng.uniform(0.24, 0.32), across="z"), 22, "y"),
        hand * [-1, 1, 1] + [0, 0.05, 0.12])  # fmt: skip
    grip = hand + [0, 0, 0.04]
    edge = plate([(-0.05, 0.1), (0.05, 0.1), (0.045, 0.85), (0, 0.98), (-0.045, 0.85)], 0.04, across="z")
    sword = [moved(edge, grip), limb([grip - [0, 0.12, 0], grip + [0, 0.1, 0]], [0.035, 0.035], segments=8, samples=2)]
    sword.append(box(grip + [0, 0.11, 0], [0.26, 0.05, 0.07], cells=2))
    pads = pair(bead(figure.top + [figure.wide, -0.06, 0], [0.17, 0.15, 0.17], segments=12))
    solids = {**figure.solids, "head": [moved(lathe(np.array(can) * head, segments=18), skull)], "eye": [], "nose": []}
    solids["body"] += pads
    return varied(rng, **solids, visor=visor, plume=plume, shield=shield, weapon=sword)


def zombie(rng: Rng, traits: Traits) -> Part:
    """Draw a zombie: both arms held out ahead at odd heights, a hanging head with an open jaw, torn trousers."""
    figure = figure_of(rng, traits, _REACHING)
    solids, skull, head = figure.solids, figure.skull, figure.head
    shoulder = figure.top * [0, 1, 1] - [0, 0.1, 0]
    drop = rng.uniform(10, 35)
    for part in ("arm", "hand"):
        right, left = solids[part]
        solids[part] = [right, moved(turned(moved(left, -shoulder), drop, "x"), shoulder)]
    jaw = bead(on(skull, head, 0, -0.85, 0.35), head * np.array([0.62, 0.4, 0.6]), segments=14)
    knee = figure.hips * 0.35
    rags = [lathe([(0.12, knee + 0.03 * k), (0.17, knee), (0.15, 0.8 * figure.hips)], segments=10) for k in (1, 2)]
    side = abs(float(solids["leg"][0].verts[:, 0].mean()))
    trousers = [moved(rags[0], [side, 0, 0]), moved(rags[1], [-side, 0.08, 0])]
    return varied(rng, **solids, jaw=jaw, cuff=trousers)


def skeleton(rng: Rng, traits: Traits) -> Part:
    """Draw a skeleton: ribs about a bare spine, a skull with a jaw, a pelvis, thin bones with knobs at the joints."""
    figure = figure_of(rng, traits, FigureBuild(thick=0.046, wide=0.31, neck=0.12, arm_deg=28))
    solids, skull, head, top, wide = figure.solids, figure.skull, figure.head, figure.top, figure.wide
    hips, trunk = figure.hips, float(top[1] - figure.hips)
    spine = limb([[0, hips - 0.05, -0.05], top - [0, 0.02, 0.05]], [0.05, 0.05], segments=8)
    ribs = []
    for k, share in enumerate((0.8, 1.0, 1.0, 0.85)):
        turn = np.linspace(-0.1, 2 * np.pi - 0.1, 15)
        girth = share * wide * np.array([0.9, 0.6])
        loop = np.stack([girth[0] * np.sin(turn), top[1] - 0.1 - 0.15 * trunk * k - 0.04 * np.cos(turn),
            girth[1] * np.cos(turn)], 1)  # fmt: skip
        ribs.append(limb(loop, [0.032] * 15, segments=5, samples=1))
    pelvis = pair(bead([0.4 * wide, hips + 0.02, 0], [0.45 * wide, 0.13, 0.14], segments=12))
    knobs = []
    for part in ("arm", "leg"):
        places = solids[part][0].verts
        middle = (places.min(0) + places.max(0)) / 2
        knobs += pair(bead(places[np.linalg.norm(places - middle, axis=1).argmin()], 0.06, segments=8))
    solids["arm"] += knobs[:2]
    solids["leg"] += knobs[2:]
    jaw = bead(on(skull, head, 0, -0.8, 0.4), head * np.array([0.55, 0.32, 0.5]), segments=12)
    eye = pair(bead(on(skull, head, 0.36, 0.0, 0.78), 0.26 * head))
    return varied(rng, **{**solids, "body": [spine, *ribs, *pelvis], "eye": eye, "nose": []}, jaw=jaw)


def wizard(rng: Rng, traits: Traits) -> Part:
    """Draw a wizard: a tall pointed hat with a brim, a long beard, a robe to the ground, a staff with an orb."""
    figure = figure_of(rng, traits, replace(_ROBED, ahead_deg=35))
    high = figure.top[1] + rng.uniform(0.3, 0.6)
    orb = bead(figure.hand * [1, 0, 1] + [0, high + 0.05, 0.05], rng.uniform(0.09, 0.13), segments=12)
    hat = _pointed_hat(rng, traits, figure, 0.71, near(rng, 1.75), near(rng, 0.2))
    beard = _beard(rng, traits, figure, 0.48)
    return varied(rng, **figure.solids, hat=hat, beard=beard, staff=[_staff(figure.hand, 0, high), orb])


def witch(rng: Rng, traits: Traits) -> Part:
    """Draw a witch: a pointed hat with a wide brim, long hair, a hooked nose, a dress over boots, a broom."""
    build = replace(_ROBED, robe=0.46, hem=rng.uniform(0.2, 0.4), waist=0.6, ahead_deg=35, wide=0.24)
    figure = figure_of(rng, traits, build)
    skull, head, hand = figure.skull, figure.head, figure.hand + [0, 0, 0.05]
    high, brush = hand[1] + 0.55, np.array([(0.05, 0.42), (0.13, 0.3), (0.17, 0.02), (0.05, 0.0)])
    broom = [_staff(hand, 0.3, high, 0.035), moved(lathe(brush[::-1], segments=12), hand * [1, 0, 1] + [0, 0.03, 0.05])]
    beak = skull + [0, -0.1 * head, 0.9 * head]
    nose = bent_limb([beak, beak + [0, 0.02, 0.1], beak + [0, -0.06, 0.2]], [0.06, 0.045, 0.02], segments=8)
    hat = _pointed_hat(rng, traits, figure, 0.69, near(rng, 2.15), near(rng, 0.3))
    return varied(rng, **{**figure.solids, "nose": [nose]}, hat=hat, hair=hair_of(figure, 1.5), staff=broom)


def mermaid(rng: Rng, traits: Traits) -> Part:
    """Draw a mermaid: a slender trunk with long hair on a scaly tail that bends forward to a wide fin."""
    build = FigureBuild(wide=0.24, waist=0.62, hips=0.85, thick=0.0775, legs=0.8, arm_deg=42)
    figure = figure_of(rng, traits, build)
    tail, hips = sized(rng, traits, "tail", 0.95, by=1.9), figure.hips
    bend = rng.uniform(-0.35, 0.35)
    path = [[0, hips + 0.05, 0], [0, hips - 0.3 * tail, 0.06], [0, hips - 0.65 * tail, bend * 0.4],
        [0, hips - tail, bend]]  # fmt: skip
    girth = figure.wide * np.array([[0.84, 0.55], [0.84, 0.62], [0.45, 0.4], [0.16, 0.14]])
    fluke = plate([(0, 0.1), (0.3, -0.08), (0.48, -0.36), (0.2, -0.28), (0, -0.16)], 0.06, across="z")
    fin = pair(moved(turned(fluke, -60 * bend, "x"), [-0.03, hips - tail, bend]))
    solids = {part: own for part, own in figure.solids.items() if part not in ("leg", "foot")}
    return varied(rng, **solids, hair=hair_of(figure, rng.uniform(2.0, 2.8)), tail=bent_limb(path, girth, segments=14),
        fin=fin)  # fmt: skip


def angel(rng: Rng, traits: Traits) -> Part:
    """Draw an angel: two great feathered wings, a ring above the head, a robe to the ground."""
    figure = figure_of(rng, traits, replace(_ROBED, arm_deg=25, ahead_deg=35))
    wings, lift = sized(rng, traits, "wings", 0.95, by=1.9), rng.uniform(5, 45)
    wing = turned(turned(turned(open_wing(wings, 0.6, True), -90, "x"), lift, "z"), rng.uniform(5, 25), "y")
    loop = np.array([[0.8 * np.sin(t), 0, 0.8 * np.cos(t)] for t in np.linspace(0, 6.2, 15)]) * figure.head
    halo = limb(loop + figure.skull + [0, 1.5 * figure.head, 0], [0.04] * 15, segments=7, samples=1)
    back = figure.top + [0.06, -0.12, -0.55 * figure.wide]
    return varied(rng, **figure.solids, wing=pair(moved(wing, back)), halo=halo,
        hair=hair_of(figure, rng.uniform(0.6, 1.6)))  # fmt: skip


def alien(rng: Rng, traits: Traits) -> Part:
    """Draw an alien: a great head that narrows to the chin, slanted eyes, a thin body, long arms with three fingers."""
    build = FigureBuild(head=0.4, wide=0.19, trunk=0.48, thick=0.0525, arms=0.73, legs=0.5, arm_deg=31)
    figure = figure_of(rng, traits, build)
    skull, head, hand = figure.skull, figure.head, figure.hand
    size = sized(rng, traits, "eyes", 0.12, by=1.7)
    egg = bent_limb([skull - [0, 0.55 * head, -0.1], skull, skull + [0, 0.35 * head, -0.08]],
        head * np.array([0.38, 0.8, 1.0]), segments=18)  # fmt: skip
    eye = turned(turned(bead([0, 0, 0], size * np.array([0.8, 1.3, 0.45]), segments=14), -28, "z"), 24, "y")
    reach = [[side, -0.16, 0.05] for side in (-0.07, 0.0, 0.07)]
    fingers = [side for way in reach for side in pair(limb([hand, hand + way], [0.03, 0.025], segments=7, samples=1))]
    eyes = pair(moved(eye, on(skull, head, 0.4, -0.1, 0.74)))
    solids = {**figure.solids, "nose": [], "head": [egg], "eye": eyes, "hand": figure.solids["hand"] + fingers}
    return varied(rng, **solids)


def gnome(rng: Rng, traits: Traits) -> Part:
    """Draw a garden gnome: a pointed cap as tall as its body, a full beard, a round nose, a belly, short legs."""
    build = FigureBuild(
        head=0.29, wide=0.35, trunk=0.46, waist=1.05, hips=1.0, deep=0.85, arms=0.4, legs=0.17, neck=0.0
    )
    figure = figure_of(rng, traits, build)
    nose = bead(on(figure.skull, figure.head, 0, -0.05, 0.98), 0.26 * figure.head)
    belt = lathe(np.array([(0.4, -0.05), (1.1, -0.06), (1.1, 0.06), (0.4, 0.05)]) * [figure.wide, 1], segments=18)
    belt = moved(belt._replace(verts=belt.verts * [1, 1, 0.88]), [0, figure.hips + 0.14, 0])
    hat = _pointed_hat(rng, traits, figure, 0.8, 0.0, near(rng, 0.175))
    beard = _beard(rng, traits, figure, 0.41)
    return varied(rng, **{**figure.solids, "nose": [nose]}, hat=hat, beard=beard, belt=belt)


def orc(rng: Rng, traits: Traits) -> Part:
    """Draw an orc: a hulk with a low head between its shoulders, tusks, pointed ears, long thick arms, a club."""
    build = FigureBuild(head=0.27, wide=0.45, waist=0.74, hips=0.66, deep=0.62, trunk=0.68, arms=0.74, thick=0.16,
        legs=0.62, stoop_deg=5, neck=0.0, arm_deg=26)  # fmt: skip
    figure = figure_of(rng, traits, build)
    skull, head, hand = figure.skull, figure.head, figure.hand
    jaw = on(skull, head, 0, -0.62, 0.55)
    tusk, ear = on(jaw, head, 0.5, 0.15, 0.5), skull + [0.8 * head, 0.1 * head, 0]
    club = bent_limb([hand - [0, 0.1, 0.1], hand + [0, 0.15, 0.25], hand + [0, 0.4, 0.6]], [0.05, 0.07, 0.15])
    return varied(rng, **figure.solids, jaw=bead(jaw, head * np.array([0.98, 0.5, 0.75]), segments=14),
        tusk=pair(limb([tusk, tusk + [0.03, 0.62 * head, 0.06]], [0.06, 0.012], segments=7, samples=2)), weapon=club,
        ear=pair(limb([ear, ear + [0.95 * head, 0.35 * head, -0.3 * head]], [[0.11, 0.05], [0.015, 0.015]],
        segments=8)))  # fmt: skip


def scarecrow(rng: Rng, traits: Traits) -> Part:
    """Draw a scarecrow: arms straight out along a pole, tufts of straw for hands and feet, a sack of a head, a hat."""
    figure = figure_of(rng, traits, FigureBuild(arm_deg=90, ahead_deg=0, waist=0.8, legs=0.65))
    solids, head, top, hand = figure.solids, figure.head, figure.top, figure.hand
    pole = limb([[0, -rng.uniform(0.25, 0.5), -0.14], [0, top[1], -0.14]], [0.06, 0.06], segments=8)
    bar = limb([top - [hand[0] + 0.1, 0.1, 0.1], top + [hand[0] + 0.1, -0.1, -0.1]], [0.05, 0.05], segments=8)
    tuft = [limb([hand, hand + [0.2, dy, dz]], [0.05, 0.02], segments=6, samples=1)
        for dy, dz in ((0.1, 0), (-0.1, 0.05), (0, -0.1), (-0.02, 0.12))]  # fmt: skip
    foot = np.abs(solids["foot"][0].verts).mean(0)
    straw = [limb([foot + [0, 0.06, 0], foot + [dx, -0.14, dz]], [0.06, 0.025], segments=6, samples=1)
        for dx, dz in ((0.08, 0), (-0.08, 0.03), (0, 0.1))]  # fmt: skip
    brim = rng.uniform(1.6, 2.1) * head
    hat = lathe([(0.3, 0.0), (brim, -0.05), (brim, 0.03), (0.98 * head, 0.06), (0.75 * head, 0.75 * head),
        (0.05, 0.85 * head)], segments=18)  # fmt: skip
    solids |= {part: pairs(ends) for part, ends in (("hand", tuft), ("foot", straw))}
    return varied(rng, **solids, pole=[pole, bar], hat=moved(turned(hat, rng.uniform(-10, 4), "x"),
        figure.skull + [0, 0.45 * head, 0]))  # fmt: skip


def mummy(rng: Rng, traits: Traits) -> Part:
    """Draw a mummy: a figure wound in bands from head to foot, arms ahead, loose ends that hang from them."""
    figure = figure_of(rng, traits, replace(_REACHING, stoop_deg=4))
    solids, skull, head, hand = figure.solids, figure.skull, figure.head, figure.hand
    wide = [(share, np.sqrt(1.02 - share**2)) for share in (0.62, 0.36, 0.1, -0.42, -0.66)]
    bands = [moved(_band(0.93 * r * head, 1.06 * r * head, rng), skull + [0, y * head, 0]) for y, r in wide]
    for share in (0.06, 0.2, 0.34, 0.48, 0.62, 0.76, 0.9):
        place = (1 - share) * np.array([0, figure.hips, 0]) + share * figure.top
        girth = figure.wide * (0.8 + 0.2 * share)
        bands.append(moved(_band(girth, 0.66 * girth, rng), place))
    leg = np.abs(solids["leg"][0].verts)
    for share in (0.2, 0.36, 0.52, 0.68, 0.84):
        bands += pair(moved(_band(0.135, 0.135, rng), [leg[:, 0].mean(), share * figure.hips, 0]))
    ends = [bent_limb([hand, hand - [0, 0.2, 0.02], hand - [0, rng.uniform(0.35, 0.5), 0.08]], [[0.02, 0.06]] * 3,
        segments=6, samples=2)]  # fmt: skip
    return varied(rng, **{**solids, "nose": []}, band=bands, strap=[*ends, *pair(moved(ends[0], [0, 0, -0.22]))])


def _band(wide: float, deep: float, rng: Rng) -> Part:
    """Return a tilted level band about the origin, a little wider than what it is wound about."""
    ring = lathe([(0.5, -0.04), (1.02, -0.045), (1.02, 0.045), (0.5, 0.04)], segments=16)
    return turned(ring._replace(verts=ring.verts * [wide, 1, deep]), rng.uniform(-10, 10), "z")


def demon(rng: Rng, traits: Traits) -> Part:
    """Draw a demon: curved horns, wings like a bat's, a tail with an arrow's head, a trident in the hand."""
    build = FigureBuild(wide=0.38, waist=0.65, hips=0.6, thick=0.115, ahead_deg=32)
    figure = figure_of(rng, traits, build)
    skull, head, hand = figure.skull, figure.head, figure.hand
    horns, wings = sized(rng, traits, "horns", 0.35), sized(rng, traits, "wings", 0.71, by=1.9)
    root = on(skull, head, 0.5, 0.7, 0.1)
    horn = bent_limb([root, on(root, horns, 0.45, 0.4, 0.1), on(root, horns, 0.4, 1.0, 0.15)], [0.08, 0.06, 0.015],
        segments=8)  # fmt: skip
    rump, high = np.array([0, figure.hips, -0.15]), hand[1] + rng.uniform(0.6, 0.9)
    path = rump + np.array([(0, 0, 0), (0, -0.25, -0.3), (0.1, -0.2, -0.6), (0.1, 0.1, -0.75)])
    arrow = moved(blade([(0, 0.18), (-0.13, -0.05), (0.13, -0.05)], 1.0, across="x", thick=0.05), path[-1])
    fork = [moved(limb([[x, high - 0.08, 0], [1.3 * x, high + 0.2, 0]], [0.03, 0.01], segments=5, samples=1),
        hand * [1, 0, 1] + [0, 0, 0.05]) for x in (-0.12, 0, 0.12)]  # fmt: skip
    fork.append(limb(hand * [1, 0, 1] + [[-0.14, high - 0.08, 0.05], [0.14, high - 0.08, 0.05]], [0.03, 0.03],
        segments=7))  # fmt: skip
    back = figure.top + [0.08, -0.15, -0.5 * figure.wide]
    return varied(rng, **figure.solids, horn=pair(horn),
        wing=pair(moved(bat_wing(wings, rng.uniform(5, 30), rng.uniform(0, 15)), back)),
        tail=[bent_limb(path, [0.06, 0.045, 0.04, 0.03], segments=8), arrow],
        weapon=[_staff(hand, 0.1, high, 0.032), *fork])  # fmt: skip


def fairy(rng: Rng, traits: Traits) -> Part:
    """Draw a fairy: wings like a butterfly's, a short flared dress, slender limbs, a wand with a star."""
    build = FigureBuild(wide=0.21, waist=0.62, thick=0.0675, head=0.26, robe=0.4, hem=0.52, legs=0.62, ahead_deg=32)
    figure = figure_of(rng, traits, build)
    wings, hand = sized(rng, traits, "wings", 0.81, by=1.9), figure.hand
    fold, back = rng.uniform(10, 35), figure.top + [0.03, -0.15, -0.6 * figure.wide]
    blades = [turned(turned(turned(petal(long, 0.62 * long), -90, "x"), deg, "z"), fold, "y")
        for long, deg in ((wings, 38), (0.72 * wings, -32))]  # fmt: skip
    tip = hand + [0, 0.26, 0.14]
    angle = 2 * np.pi * np.arange(10) / 10
    star = 0.11 * np.where(np.arange(10) % 2, 0.45, 1.0)
    wand = [limb([hand, tip], [0.025, 0.02], segments=7, samples=2),
        moved(plate(np.stack([star * np.sin(angle), star * np.cos(angle)], 1), 0.05, across="z"), tip)]  # fmt: skip
    bun = bead(on(figure.skull, figure.head, 0, 1.1, -0.3), 0.4 * figure.head, segments=12)
    return varied(rng, **figure.solids, wing=[side for wing in blades for side in pair(moved(wing, back))],
        hair=[hair_of(figure, 0.5), bun], staff=wand)  # fmt: skip
