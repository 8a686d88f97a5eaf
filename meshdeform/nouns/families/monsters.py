"""Draw a centaur, a slime, and what figures are copied to: a teddy and a bust."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.drawing import bead, bent_limb, circle, on, sized, varied
from meshdeform.nouns.families.parts import Part, ellipsoid, lathe, limb, pair
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bust", "slime", "teddy"]


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
