"""Draw other kinds of figures: people of other builds, machines, ghosts and snowmen, dragons on two legs."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.birds import Build as Bird
from meshdeform.nouns.families.birds import bird_of
from meshdeform.nouns.families.characters import FigureBuild, bat_wing, figure_kind, figure_of, hair_of
from meshdeform.nouns.families.drawing import bead, bent_limb, kind, near, on, pairs, sized, varied
from meshdeform.nouns.families.parts import Part, ellipsoid, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

_CARTOON = FigureBuild(head=0.47, trunk=0.43, wide=0.28, waist=0.95, hips=0.9, deep=0.75, arms=0.38, thick=0.115,
    legs=0.26, neck=-0.06)  # fmt: skip
_SLENDER = FigureBuild(head=0.175, trunk=0.65, wide=0.26, waist=0.72, arms=0.7, arm_deg=24, thick=0.08, legs=0.98)
_STRONG = FigureBuild(
    head=0.215, trunk=0.7, wide=0.46, waist=0.68, hips=0.55, arms=0.77, thick=0.155, legs=0.75, neck=0.04
)


def woman(rng: Rng, traits: Traits) -> Part:
    """Draw a woman with long hair in a flared dress to the knees."""
    build = FigureBuild(wide=0.24, waist=0.62, thick=0.08, robe=0.45, hem=rng.uniform(0.3, 0.55))
    figure = figure_of(rng, traits, build)
    return varied(rng, **figure.solids, hair=hair_of(figure, rng.uniform(0.6, 1.6)))


def arcade_ghost(rng: Rng, traits: Traits) -> Part:
    """Draw a short ghost: a dome with a scalloped hem, two large eyes, stubs of arms."""
    arms, girth, tall = sized(rng, traits, "arms", 0.21, by=3), rng.uniform(0.5, 0.58), rng.uniform(1.0, 1.3)
    angle = np.linspace(0, np.pi / 2, 7)
    dome = np.stack([girth * np.cos(angle), tall - girth + girth * np.sin(angle)], 1)
    sheet = lathe([(0.9 * girth, 0.0), (1.03 * girth, 0.02), (1.02 * girth, 0.15), (girth, 0.5 * (tall - girth)),
        *dome], segments=48)  # fmt: skip
    azimuth, low = np.arctan2(sheet.verts[:, 0], sheet.verts[:, 2]), np.clip(1 - sheet.verts[:, 1] / 0.3, 0, 1)
    sheet.verts[:, 1] += 0.09 * low * np.cos(int(rng.integers(6, 9)) * azimuth)
    face = tall - 0.85 * girth
    hand = np.array([girth + arms, 0.45 * tall, 0.2])
    return varied(rng, body=sheet, eye=pair(bead([0.36 * girth, face, 0.86 * girth], [0.14, 0.19, 0.12], segments=14)),
        mouth=bead([0, face - 0.3, 0.98 * girth], [0.12, 0.07, 0.08]),
        arm=pair(limb([[0.8 * girth, 0.42 * tall, 0.1], hand], [0.13, 0.09], segments=10)))  # fmt: skip


def floating_ghost(rng: Rng, traits: Traits) -> Part:
    """Draw a ghost that floats: a round head and body in one, which trail into a curled tail."""
    arms, girth, swing = sized(rng, traits, "arms", 0.35), rng.uniform(0.4, 0.5), rng.uniform(0.2, 0.5)
    path = [[0, 0.35, 0], [0, 0, 0], [0, -0.4, -0.05], [0.5 * swing, -0.8, -0.25], [swing, -1.0, -0.5]]
    shoulder = np.array([0.8 * girth, -0.05, 0.15])
    hand = shoulder + arms * np.array([0.6, rng.uniform(-0.4, 0.5), 0.7])
    return varied(rng, body=bent_limb(path, girth * np.array([0.95, 1.0, 0.75, 0.35, 0.06]), segments=20),
        eye=pair(bead([0.16, 0.4, 0.88 * girth], [0.09, 0.14, 0.09])),
        mouth=bead([0, 0.12, 0.98 * girth], [0.13, 0.1, 0.08]),
        arm=pair(limb([shoulder, hand], [0.14, 0.09], segments=10)))  # fmt: skip


def _snow(rng: Rng, traits: Traits, balls: tuple[float, ...], *, dressed: bool) -> Part:
    """Draw a snowman of balls from the ground up below a head, with a hat and a scarf if it is dressed."""
    head, nose = sized(rng, traits, "head", 0.28, by=1.6), sized(rng, traits, "nose", 0.28)
    body, buttons, level = [], [], 0.0
    for usual in balls:
        radius = near(rng, usual)
        body.append(ellipsoid([0, level + 0.9 * radius, 0], [radius, 0.95 * radius, radius], rings=10))
        buttons += [bead([0, level + 0.9 * radius + lift, 0.98 * np.sqrt(radius**2 - lift**2)], 0.05, segments=8)
            for lift in (-0.08, 0.12)]  # fmt: skip
        level += 1.55 * radius
    skull, wide = np.array([0, level + 0.7 * head, 0]), radius
    shoulder = np.array([0.85 * wide, level - 0.6 * wide, 0])
    hand = shoulder + rng.uniform(0.5, 0.7) * np.array([0.85, rng.uniform(0.1, 0.7), 0.15])
    twigs = [limb([shoulder, hand], [0.04, 0.03], segments=7),
        limb([0.35 * shoulder + 0.65 * hand, hand + [-0.1, 0.14, 0]], [0.03, 0.02], segments=6, samples=1)]  # fmt: skip
    tip = skull + [0, 0, 0.85 * head]
    more = {"button": buttons, "eye": pair(bead(on(skull, head, 0.36, 0.25, 0.85), 0.05))}
    if dressed:
        brim = 1.15 * head
        tall = rng.uniform(0.7, 1.2) * head
        more["hat"] = [moved(lathe([(0.2, 0), (brim, 0), (brim, 0.05), (0.75 * head, 0.06), (0.72 * head, tall),
            (0.2, tall + 0.02)], segments=18), skull + [0, 0.72 * head, 0])]  # fmt: skip
        more["collar"] = [bead([0, level + 0.02, 0], [0.85 * head, 0.1, 0.85 * head], segments=18),
            limb([[0.15, level, 0.8 * head], [0.2, level - 0.4, wide]], [[0.05, 0.09]] * 2, segments=8)]  # fmt: skip
    return varied(rng, body=body, head=bead(skull, head, segments=20, rings=10),
        nose=limb([tip, tip + [0, -0.02, nose]], [0.07, 0.015], segments=10), arm=pairs(twigs), **more)  # fmt: skip


def wyvern(rng: Rng, traits: Traits) -> Part:
    """Draw a dragon in flight: wings of skin spread wide, a long neck and tail, two legs drawn in."""
    build = Bird(girth=0.23, length=0.55, lean_deg=12, neck=0.57, neck_deg=40, bow=0.12, head=0.165, beak=0.23,
        hook=0.1, bill=(0.7, 0.62), tail=0.12, wings=1.0)  # fmt: skip
    bird = bird_of(rng, traits, build, flying=True)
    solids, middle, head = bird.solids, bird.middle, bird.head
    tail = sized(rng, traits, "tail", 1.07, by=2.0)
    rump = middle - [0, 0.05, 0.4]
    path = rump + tail * np.array([(0, 0, 0.1), (0, -0.15, -0.35), (0.05, 0, -0.7), (0.05, 0.15, -1)])
    hip, root = middle + [0.14, -0.12, -0.25], on(bird.skull, head, 0.45, 0.6, -0.2)
    size = float(np.ptp(solids["wing"][0].verts[:, 0]))
    wing = turned(turned(bat_wing(size, 0, 10), 90, "x"), rng.uniform(5, 35), "z")
    return varied(rng, body=solids["body"], neck=solids["neck"], head=[*solids["head"], *solids["beak"]],
        eye=solids["eye"], horn=pair(limb([root, on(root, head, 0.4, 0.8, -1.3)], [0.05, 0.015], segments=8)),
        wing=pair(moved(wing, middle + [0.1, 0.1, 0.1])), tail=[bent_limb(path, [0.16, 0.1, 0.06, 0.02]),
        bead(path[-1], [0.12, 0.03, 0.14])],
        leg=pair(limb([hip, hip + [0.08, -0.25, -0.12], hip + [0.1, -0.42, 0.05]], [0.1, 0.06, 0.05], segments=8,
        samples=3)), foot=pair(bead(hip + [0.1, -0.44, 0.12], [0.08, 0.04, 0.13])))  # fmt: skip


def upright_dragon(rng: Rng, traits: Traits) -> Part:
    """Draw a dragon on its hind legs: a pear of a belly, short arms, a large head, small wings, a thick tail."""
    head, neck = sized(rng, traits, "head", 0.29, by=1.7), sized(rng, traits, "neck", 0.16)
    tail, wings = sized(rng, traits, "tail", 0.85, by=2.0), sized(rng, traits, "wings", 0.53, by=1.9)
    girth, tall = rng.uniform(0.34, 0.44), rng.uniform(0.75, 0.95)
    chest = np.array([0, tall, 0.02])
    skull, hip = chest + [0, 0.2 + neck + 0.4 * head, 0.12], np.array([0.75 * girth, 0.3, 0.02])
    path = np.array([0, 0.3, -0.2]) + tail * np.array([(0, 0, 0.1), (0, -0.2, -0.4), (0.05, -0.2, -0.8),
        (0.05, 0.02, -1.1)])  # fmt: skip
    shoulder, root = chest + [0.6 * girth, -0.1, 0.08], on(skull, head, 0.45, 0.75, -0.2)
    spikes = [limb([place, place + [0, 0.14, -0.1]], [[0.06, 0.08], [0.015, 0.02]], segments=7, samples=1)
        for place in (path[1] + [0, 0.12, 0], path[0] + [0, 0.3, -0.2 * girth], chest + [0, -0.1, -0.55 * girth],
        skull - [0, -0.4 * head, 0.9 * head])]  # fmt: skip
    return varied(rng, body=bent_limb([[0, 0.3, 0], [0, 0.55 * tall, 0.02], chest], [0.9 * girth, girth, 0.6 * girth],
        segments=18), neck=limb([chest, skull], [0.5 * girth, 0.6 * head], segments=12), spike=spikes,
        wing=pair(moved(bat_wing(wings, 25, 10), chest + [0.1, 0, -0.5 * girth])),
        head=[bead(skull, head * np.array([0.95, 0.9, 1.0]), segments=16, rings=8),
        limb([skull - [0, 0.25 * head, 0], on(skull, head, 0, -0.3, 1.2)], head * np.array([0.6, 0.48]), segments=12)],
        eye=pair(bead(on(skull, head, 0.5, 0.5, 0.6), 0.24 * head)),
        horn=pair(limb([root, on(root, head, 0.3, 0.8, -0.5)], [0.07, 0.02], segments=8)),
        arm=pair(bent_limb([shoulder, shoulder + [0.14, -0.16, 0.1], shoulder + [0.1, -0.16, 0.3]], [0.1, 0.08, 0.07])),
        tail=bent_limb(path, [0.3, 0.2, 0.11, 0.03], segments=12),
        leg=pair(bead(hip, [0.22, 0.3, 0.26], segments=10, rings=6)),
        foot=pair(bead(hip * [1, 0, 1] + [0.04, 0.08, 0.2], [0.16, 0.09, 0.28], segments=12)))  # fmt: skip


KINDS = {"dragon": (upright_dragon, wyvern), "ghost": (arcade_ghost, floating_ghost),
    "person": (figure_kind("cartoon_person", _CARTOON), figure_kind("slender_person", _SLENDER),
    figure_kind("strong_person", _STRONG), woman),
    "snowman": (kind("dressed_snowman", lambda rng, traits: _snow(rng, traits, (0.53, 0.38), dressed=True)),
    kind("small_snowman", lambda rng, traits: _snow(rng, traits, (0.51,), dressed=bool(rng.integers(2)))))}  # fmt: skip
