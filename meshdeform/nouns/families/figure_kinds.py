"""Draw other kinds of figures: people of other builds, machines, ghosts and snowmen, dragons on two legs."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.birds import Build as Bird
from meshdeform.nouns.families.birds import bird_of
from meshdeform.nouns.families.characters import Build, bat_wing, figure_kind, figure_of, hair_of
from meshdeform.nouns.families.drawing import bead, bent_limb, kind, near, on, pairs, sized, varied
from meshdeform.nouns.families.parts import Part, box, ellipsoid, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def woman(rng: Rng, traits: Traits) -> Part:
    """Draw a woman with long hair in a flared dress to the knees."""
    build = Build(wide=0.24, waist=0.62, thick=0.08, robe=0.45, hem=rng.uniform(0.3, 0.55))
    figure = figure_of(rng, traits, build)
    return varied(rng, **figure.solids, hair=hair_of(figure, rng.uniform(0.6, 1.6)))


def block_person(rng: Rng, traits: Traits) -> Part:
    """Draw a person of boxes: a cube of a head, boards for arms and legs."""
    head, arms = sized(rng, traits, "head", 0.29, by=1.7), sized(rng, traits, "arms", 0.61)
    legs, wide, trunk = sized(rng, traits, "legs", 0.56), rng.uniform(0.25, 0.3), rng.uniform(0.56, 0.66)
    top, thick, bevel = legs + trunk, rng.uniform(0.2, 0.25), rng.uniform(0.04, 0.2)
    skull = np.array([0, top + 0.9 * head, 0])
    arm = box([0, -0.5 * arms, 0], [thick, arms, 0.24], round_by=bevel, cells=4)
    shoulder = [wide + 0.5 * thick + 0.01, top - 0.01, 0]
    return varied(rng, body=box([0, legs + 0.5 * trunk, 0], [2 * wide, trunk, 0.28], round_by=bevel, cells=5),
        head=box(skull, 2 * head * np.array([0.9, 0.92, 0.9]), round_by=bevel, cells=5),
        eye=pair(box(on(skull, head, 0.4, 0.1, 0.9), head * np.array([0.24, 0.24, 0.1]), cells=2)),
        neck=box([0, top, 0], [0.16, 0.12, 0.16], cells=3),
        arm=pair(moved(turned(arm, rng.uniform(3, 30), "z"), shoulder)),
        leg=pair(box([0.51 * wide, 0.5 * legs + 0.04, 0], [0.94 * wide, legs, 0.25], round_by=bevel, cells=4)),
        foot=pair(box([0.51 * wide, 0.06, 0.04], [wide, 0.12, 0.33], round_by=bevel, cells=3)))  # fmt: skip


def mech(rng: Rng, traits: Traits) -> Part:
    """Draw a walking machine: a broad chest over narrow hips, armour on shoulders and shins, a small visored head."""
    head, arms = sized(rng, traits, "head", 0.17, by=1.8), sized(rng, traits, "arms", 0.73)
    legs, wide, bevel = sized(rng, traits, "legs", 0.8), rng.uniform(0.38, 0.5), rng.uniform(0.1, 0.25)
    chest, skull = np.array([0, legs + 0.55, 0]), np.array([0, legs + 0.86 + 0.6 * head, 0.06])
    shoulder, hip = chest + [wide + 0.1, 0.16, 0], np.array([0.2, legs + 0.12, 0])
    elbow = on(shoulder, arms, 0.1, -0.5, 0.0)
    hand, knee = on(elbow, arms, 0, -0.42, 0.22), np.array([0.24, 0.5 * legs + 0.05, 0.06])
    plates = (  # part, middle, size
        ("body", chest, [2 * wide, 0.5, 0.46]), ("body", [0, legs + 0.2, 0], [0.42, 0.3, 0.32]),
        ("head", skull, head * np.array([1.6, 1.5, 1.7])),
        ("eye", skull + [0, 0.1 * head, 0.8 * head], head * np.array([1.2, 0.3, 0.3])),
    )  # fmt: skip
    sides = (("arm", shoulder + [0.03, 0.04, 0], [0.3, 0.3, 0.36]),
        ("arm", 0.5 * (elbow + hand), [0.2, 0.45 * arms, 0.22]), ("hand", hand, [0.18, 0.18, 0.2]),
        ("leg", 0.5 * (hip + knee), [0.22, 0.5 * legs, 0.24]), ("leg", knee * [1, 0.5, 1] + [0, 0.03, -0.03],
        [0.26, 0.52 * legs, 0.3]), ("foot", [0.24, 0.07, 0.08], [0.3, 0.14, 0.5]))  # fmt: skip
    solids: dict[str, list[Part]] = {"neck": [limb([chest + [0, 0.2, 0.03], skull], [0.08, 0.08], segments=8,
        samples=2)]}  # fmt: skip
    for part, middle, size in plates:
        solids.setdefault(part, []).append(box(middle, size, round_by=bevel, cells=4))
    for part, middle, size in sides:
        solids.setdefault(part, []).extend(pair(box(middle, size, round_by=bevel, cells=3)))
    solids["arm"] += pair(limb([shoulder, elbow], [0.08, 0.08], segments=8, samples=2))
    return varied(rng, **solids)


def ball_robot(rng: Rng, traits: Traits) -> Part:
    """Draw a friendly robot: a ball or barrel of a body, a domed head with one wide eye and a feeler, thin limbs."""
    head, arms = sized(rng, traits, "head", 0.34, by=1.7), sized(rng, traits, "arms", 0.48)
    legs, girth, tall = sized(rng, traits, "legs", 0.3), rng.uniform(0.34, 0.42), rng.uniform(0.34, 0.5)
    middle = np.array([0, legs + 0.1 + tall, 0])
    skull, shoulder = middle + [0, tall + 0.55 * head, 0], middle + [0.9 * girth, 0.4 * tall, 0]
    hand = shoulder + arms * np.array([rng.uniform(0.3, 0.8), -0.7, 0.25])
    foot, tip = np.array([0.5 * girth, 0.08, 0.05]), skull + [0, 0.8 * head + 0.22, 0]
    return varied(rng, body=ellipsoid(middle, [girth, tall, girth], rings=10),
        neck=limb([middle, skull], [0.13, 0.13], segments=10, samples=2),
        head=[bead(skull, head * np.array([1.1, 0.85, 0.95]), segments=18, rings=10),
        limb([skull, tip], [0.03, 0.025], segments=7, samples=1), bead(tip, 0.07)],
        eye=bead(on(skull, head, 0, 0.05, 0.62), head * np.array([0.75, 0.4, 0.4]), segments=16),
        arm=pair(bent_limb([shoulder, (shoulder + hand) / 2 + [0.08, 0, 0], hand], [0.06] * 3, segments=8)),
        hand=pair(bead(hand, 0.13)),
        leg=pair(limb([[0.5 * girth, legs + 0.25, 0], foot], [0.08, 0.08], segments=8, samples=2)),
        foot=pair(bead(foot, [0.14, 0.1, 0.22], segments=12)))  # fmt: skip


def tin_robot(rng: Rng, traits: Traits) -> Part:
    """Draw a tin robot: drums for trunk and head, a funnel or a lamp on top, jointed pipes, wide feet."""
    head, arms = sized(rng, traits, "head", 0.27, by=1.7), sized(rng, traits, "arms", 0.56)
    legs, girth, trunk = sized(rng, traits, "legs", 0.43), rng.uniform(0.32, 0.4), rng.uniform(0.6, 0.75)
    top, edge = legs + 0.08 + trunk, np.array([(0.85, 0), (1, 0.06), (1, 0.94), (0.85, 1)])
    skull, shoulder = np.array([0, top + 0.08, 0]), np.array([girth + 0.06, top - 0.12, 0])
    elbow = on(shoulder, arms, 0.2, -0.5, 0)
    hand = on(elbow, arms, 0.05, -0.3, 0.35)
    eye = moved(turned(lathe([(0.24 * head, -0.08), (0.24 * head, 0.08)], segments=12), 90, "x"),
        on(skull, head, 0.42, 1.0, 0.9))  # fmt: skip
    funnel = [(0.75 * head, 1.55 * head), (0.15 * head, 2.0 * head), (0.1 * head, 2.6 * head)]
    return varied(rng, body=moved(lathe(edge * [girth, trunk], segments=20), [0, legs + 0.08, 0]),
        neck=limb([[0, top - 0.05, 0], skull + [0, 0.1, 0]], [0.12, 0.12], segments=8),
        head=[moved(lathe(edge * [head, 1.6 * head], segments=20), skull), moved(lathe(funnel, segments=14), skull)],
        eye=pair(eye), arm=[*pair(limb([shoulder, elbow, hand], [0.07] * 3, segments=8)), *pair(bead(shoulder, 0.13))],
        hand=pair(bead(hand, 0.13)),
        leg=pair(limb([[0.5 * girth, legs + 0.2, 0], [0.5 * girth, 0.1, 0]], [0.1, 0.09], segments=8)),
        foot=pair(box([0.5 * girth, 0.08, 0.07], [0.26, 0.16, 0.44], cells=3)))  # fmt: skip


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


_CARTOON = Build(head=0.47, trunk=0.43, wide=0.28, waist=0.95, hips=0.9, deep=0.75, arms=0.38, thick=0.115, legs=0.26,
    neck=-0.06)  # fmt: skip
_SLENDER = Build(head=0.175, trunk=0.65, wide=0.26, waist=0.72, arms=0.7, arm_deg=24, thick=0.08, legs=0.98)
_STRONG = Build(head=0.215, trunk=0.7, wide=0.46, waist=0.68, hips=0.55, arms=0.77, thick=0.155, legs=0.75, neck=0.04)

KINDS = {"dragon": (upright_dragon, wyvern), "ghost": (arcade_ghost, floating_ghost),
    "person": (block_person, figure_kind("cartoon_person", _CARTOON), figure_kind("slender_person", _SLENDER),
    figure_kind("strong_person", _STRONG), woman), "robot": (ball_robot, mech, tin_robot),
    "snowman": (kind("dressed_snowman", lambda rng, traits: _snow(rng, traits, (0.53, 0.38), dressed=True)),
    kind("small_snowman", lambda rng, traits: _snow(rng, traits, (0.51,), dressed=bool(rng.integers(2)))))}  # fmt: skip
