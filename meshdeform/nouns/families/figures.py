"""Draw figures that sit or stand upright: toys, apes, people, machines, a ghost, a bust and a slime."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.drawing import bead, bent_limb, circle, on, sized, varied
from meshdeform.nouns.families.parts import Part, curved, ellipsoid, join, lathe, limb, pair
from meshdeform.nouns.families.traits import Rng, Traits


def monkey(rng: Rng, traits: Traits) -> Part:
    """Draw a sitting monkey: large ears at the sides of a broad face, long arms, bent knees, a tail in a curl."""
    arms = traits.draw(rng, "arms", (0.18, 0.24), (0.68, 0.8), (1.25, 1.45))
    ears = traits.draw(rng, "ears", (0.06, 0.09), (0.23, 0.27), (0.4, 0.46))
    tail = traits.draw(rng, "tail", (0.12, 0.18), (0.72, 0.85), (1.35, 1.55))
    head, girth, height = rng.uniform(0.36, 0.42), rng.uniform(0.3, 0.36), rng.uniform(0.44, 0.54)
    parts = [ellipsoid([0, height * 0.85, 0], [girth, height * 0.95, girth * 0.9])]
    skull = np.array([0.0, height * 1.65 + 0.7 * head, 0.05])
    parts.append(ellipsoid(skull, head))
    parts.append(ellipsoid(skull + [0, -0.38 * head, 0.55 * head], [0.78 * head, 0.52 * head, 0.62 * head], rings=10))
    parts += pair(
        ellipsoid(skull + [0.3 * head, 0.28 * head, 0.75 * head], [0.26 * head, 0.3 * head, 0.25 * head], rings=8)
    )
    parts += pair(ellipsoid(skull + [head * 0.8 + 0.75 * ears, 0.02, -0.02], [ears, ears * 1.1, 0.12], rings=10))
    shoulder = np.array([girth * 0.75, height * 1.4, 0.02])
    elbow = shoulder + arms * np.array([0.5, -0.3, 0.05])
    hand = elbow + arms * np.array([0.05, rng.uniform(0.35, 0.55), 0.3])
    parts += pair(limb([shoulder, elbow, hand], [0.13, 0.12, 0.115], segments=10))
    parts += pair(ellipsoid(hand, [0.15, 0.16, 0.14], rings=8))
    knee = np.array([girth * 1.5, 0.42, 0.42])
    parts += pair(
        limb([[girth * 0.6, 0.14, 0.0], [*knee], [girth * 1.15, 0.09, 0.55]], [0.16, 0.14, 0.12], segments=10)
    )
    parts += pair(ellipsoid([girth * 1.15, 0.08, 0.66], [0.12, 0.085, 0.2], rings=8))
    rump = np.array([0.0, 0.12, -girth * 0.6])
    curl = [(0.0, 0.0), (-0.45, -0.02), (-0.75, 0.2), (-0.75, 0.6), (-0.5, 0.85), (-0.25, 0.75), (-0.28, 0.52)]
    path = curved([rump + tail * np.array([0.0, y, z]) for z, y in curl])
    return join([*parts, limb(path, np.linspace(0.12, 0.09, len(path)), segments=10, samples=1)])


def person(rng: Rng, traits: Traits) -> Part:
    """Draw a standing person: a round head, shoulders, arms held off the sides, two legs with feet."""
    arms = traits.draw(rng, "arms", (0.14, 0.22), (0.62, 0.74), (1.2, 1.4))
    head = traits.draw(rng, "head", (0.11, 0.125), (0.21, 0.24), (0.38, 0.44))
    legs = traits.draw(rng, "legs", (0.12, 0.2), (0.72, 0.86), (1.4, 1.6))
    wide, trunk, thick = rng.uniform(0.26, 0.36), rng.uniform(0.57, 0.73), rng.uniform(0.094, 0.126)
    hips = legs + 0.1
    spine = [[0, hips + 0.05, 0], [0, hips + 0.4 * trunk, 0], [0, hips + trunk - 0.1, 0]]
    parts = [limb(spine, [[wide * 0.8, 0.18], [wide * 0.75, 0.17], [wide, 0.19]], segments=18)]
    top = hips + trunk
    skull = np.array([0.0, top + 0.18 + 0.85 * head, 0.02])
    parts.append(limb([[0, top - 0.05, 0], [*skull]], [0.115, 0.1]))
    parts.append(ellipsoid(skull, [head * 0.92, head * 1.08, head * 0.98]))
    parts.append(ellipsoid(skull + [0, -0.1 * head, 0.95 * head], 0.2 * head + 0.01, rings=8))
    shoulder, lift = np.array([wide * 0.95, top - 0.08, 0.0]), np.radians(rng.uniform(25, 50))
    elbow = shoulder + 0.5 * arms * np.array([np.sin(lift), -np.cos(lift), -0.05])
    hand = elbow + 0.55 * arms * np.array([np.sin(lift) * 0.9, -np.cos(lift), 0.2])
    parts += pair(limb([shoulder, elbow, hand], [thick * 1.1, thick * 0.95, thick * 0.85], segments=12))
    parts += pair(ellipsoid(hand, thick * 1.15, rings=8))
    foot = np.array([wide * rng.uniform(0.59, 0.91), 0.09, 0.0])
    parts += pair(limb([[wide * 0.45, hips + 0.02, 0], [*foot]], [thick * 1.45, thick * 1.05], segments=12))
    return join([*parts, *pair(ellipsoid(foot + [0.01, -0.01, 0.1], [0.115, 0.09, 0.22], rings=8))])


def ghost(rng: Rng, traits: Traits) -> Part:
    """Draw a ghost: a hanging sheet with deep folds that flare at the hem, hollow eyes and mouth, two arms held out."""
    arms = traits.draw(rng, "arms", (0.0, 0.06), (0.3, 0.4), (0.9, 1.1))
    girth, height, flare = rng.uniform(0.38, 0.48), rng.uniform(1.19, 1.51), rng.uniform(0.2, 0.32)
    rise = np.linspace(0.0, 1.0, 16)
    dome = [(girth * np.sqrt(max(0.0, 1 - ((t - 0.68) / 0.32) ** 2)) if t > 0.68 else girth, t) for t in rise]
    wall = [(radius + flare * (1 - t) ** 2, height * t) for radius, t in dome]
    sheet = lathe([(0.0, 0.04), *wall], segments=56)
    verts = sheet.verts.copy()
    low = np.clip(1 - verts[:, 1] / (0.7 * height), 0, 1)
    folds = int(rng.integers(6, 9))
    wave = np.cos(folds * np.arctan2(verts[:, 0], verts[:, 2]) + rng.uniform(0, 2 * np.pi))
    away = np.hypot(verts[:, 0], verts[:, 2])
    verts[:, [0, 2]] *= (1 + 0.2 * low * wave)[:, None]
    # Down at the crests of the folds, up between them.
    verts[:, 1] += -0.12 * wave * low**3 * (away > 0)
    verts[:, 2] -= rng.uniform(0.1, 0.3) * low**2
    parts = [Part(verts, sheet.faces)]
    face = height * 0.76
    parts += pair(ellipsoid([0.15, face, girth * 0.82], [0.1, 0.16, 0.11], rings=8))
    parts.append(ellipsoid([0, face - 0.32, girth * 0.98], [0.11, 0.14, 0.1], rings=8))
    shoulder = np.array([girth * 0.7, height * 0.55, 0.06])
    hand = shoulder + [0.26 + 0.75 * arms, 0.06 + rng.uniform(0.0, 0.3) * arms, 0.1 + 0.45 * arms]
    return join([*parts, *pair(limb([shoulder, hand], [0.17, 0.115], segments=12))])


def slime(rng: Rng, traits: Traits) -> Part:
    """Draw a slime: a drop that spreads on the ground, lobes at its rim, large eyes and a mouth."""
    eyes = sized(rng, traits, "eyes", 0.18, by=1.7)
    wide, tall, peak = rng.uniform(0.65, 0.85), rng.uniform(0.9, 1.3), rng.uniform(0.0, 0.45)
    t = np.linspace(0, 1, 14)
    radius = wide * (np.sqrt(np.clip(1 - t**2.2, 0, 1)) * (1 - peak * t) + 0.12 * (1 - t) ** 6)
    lobes = [bead(place + [0, 0.06, 0], [0.26, rng.uniform(0.1, 0.2), 0.26], segments=12)
        for place in circle(0.92 * wide, 7)]  # fmt: skip
    face = np.array([0.27 * wide, 0.48 * tall, 0.82 * wide * np.sqrt(1 - 0.2 - 0.3 * peak)])
    mouth = bead(face * [0, 1, 1] - [0, 0.26 * tall, -0.1 * wide], [0.2, 0.05 + rng.uniform(0, 0.07), 0.08],
        segments=12)  # fmt: skip
    return varied(rng, body=[lathe(np.stack([radius, tall * t], 1), segments=24), *lobes], mouth=mouth,
        eye=pair(bead(face, eyes * np.array([0.9, 1.2, 0.8]), segments=14)))  # fmt: skip


def _stuffed(rng: Rng, traits: Traits, *, sits: bool) -> Part:
    """Draw a stuffed bear with stubs of limbs, a bow at its neck."""
    head, ears = sized(rng, traits, "head", 0.44, by=1.6), sized(rng, traits, "ears", 0.175, by=1.9)
    legs, girth = sized(rng, traits, "legs", 0.41), rng.uniform(0.38, 0.48)
    low = 0.16 if sits else legs
    tall = rng.uniform(0.42, 0.52)
    middle = np.array([0, low + 0.8 * tall, 0])
    skull = middle + [0, 0.75 * tall + 0.8 * head, 0.03]
    hip, splay = middle + [0.55 * girth, -0.55 * tall, 0.3 * girth * sits], rng.uniform(0.25, 0.5)
    way = np.array([splay, 0, 1]) if sits else np.array([0.12, -1, 0])
    foot = hip + (0.12 + legs) * way
    sole = [0.2, 0.24, 0.12] if sits else [0.2, 0.12, 0.26]
    shoulder = middle + [0.75 * girth, 0.55 * tall, 0.05]
    hand = shoulder + rng.uniform(0.3, 0.42) * np.array([0.8, rng.uniform(-0.6, 0.3), 0.5])
    tie = middle + [0, 0.75 * tall, 0.75 * girth]
    return varied(rng, body=ellipsoid(middle, [girth, tall, 0.9 * girth], rings=10),
        head=ellipsoid(skull, head * np.array([1.05, 0.95, 0.95]), rings=10),
        nose=[bead(on(skull, head, 0, -0.25, 0.8), head * np.array([0.48, 0.38, 0.42]), segments=14),
        bead(on(skull, head, 0, -0.12, 1.2), head * np.array([0.17, 0.12, 0.1]))],
        eye=pair(bead(on(skull, head, 0.36, 0.16, 0.84), 0.12 * head)),
        ear=pair(bead(skull + [0.72 * head + 0.35 * ears, 0.66 * head + 0.4 * ears, -0.02],
        ears * np.array([1, 1, 0.5]), segments=14)), leg=pair(limb([hip, foot], [0.19, 0.18], segments=12, samples=3)),
        foot=pair(bead(foot + [0, 0.02, 0.04], sole, segments=12)),
        arm=pair(limb([shoulder, hand], [0.15, 0.14], segments=12, samples=3)),
        bow=[*pair(limb([tie, tie + [0.17, 0.02, 0]], [[0.05, 0.04], [0.11, 0.05]], segments=8, samples=2)),
        bead(tie, 0.06)])  # fmt: skip


def teddy(rng: Rng, traits: Traits) -> Part:
    """Draw a sitting teddy: a stuffed bear whose legs point ahead."""
    return _stuffed(rng, traits, sits=True)


def standing_teddy(rng: Rng, traits: Traits) -> Part:
    """Draw a teddy on its feet."""
    return _stuffed(rng, traits, sits=False)


def bust(rng: Rng, traits: Traits) -> Part:
    """Draw a bust: a head with hair, nose, ears and brows on a neck and cut shoulders, on a turned foot."""
    head, neck = sized(rng, traits, "head", 0.33, by=1.6), sized(rng, traits, "neck", 0.19)
    wide, base, foot = rng.uniform(0.46, 0.6), rng.uniform(0.2, 0.34), rng.uniform(0.24, 0.32)
    ring = np.array([(1, 0), (1, 0.2), (0.85, 0.25), (0.5, 0.45), (0.45, 0.7), (0.7, 1.0)]) * [foot, base]
    chest = np.array([0, base + 0.3, 0])
    top = chest + [0, 0.26, 0]
    body = bent_limb([chest - [0, 0.2, 0], chest, top - [0, 0.06, 0]],
        wide * np.array([[0.5, 0.4], [0.95, 0.55], [0.8, 0.36]]), segments=18)  # fmt: skip
    skull = top + [0, neck + 0.75 * head, 0.06]
    hair = bent_limb([on(skull, head, 0, 0.3, 0.1), on(skull, head, 0, 0.2, -0.4), on(skull, head, 0, -0.5, -0.5)],
        head * np.array([[0.85, 0.85], [0.98, 0.9], [0.75, 0.4]]), segments=14)  # fmt: skip
    return varied(rng, base=lathe(ring, segments=20), body=body,
        neck=limb([top - [0, 0.08, 0], skull], [0.19, 0.42 * head], segments=12),
        head=bent_limb([skull + [0, -0.55 * head, 0.12 * head], skull, skull + [0, 0.45 * head, -0.04]],
        head * np.array([0.5, 0.8, 0.72]), segments=16),
        nose=limb([on(skull, head, 0, 0.15, 0.75), on(skull, head, 0, -0.25, 0.95)], head * np.array([0.08, 0.15]),
        segments=8), eye=pair(bead(on(skull, head, 0.3, 0.1, 0.72), head * np.array([0.17, 0.1, 0.1]))), hair=hair,
        ear=pair(bead(on(skull, head, 0.82, -0.05, 0), head * np.array([0.1, 0.22, 0.14]))))  # fmt: skip


KINDS = {"teddy": (standing_teddy,)}
