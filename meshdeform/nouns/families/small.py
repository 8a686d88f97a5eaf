"""Draw small animals that crawl, hop or creep."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, ellipsoid, join, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def crab(rng: Rng, traits: Traits) -> Part:
    """Draw a crab: a wide low shell, eyes on stalks, three bent legs a side, two raised claws with open pincers."""
    claws = traits.draw(rng, "claws", (0.12, 0.15), (0.32, 0.38), (0.54, 0.62))
    legs = traits.draw(rng, "legs", (0.04, 0.1), (0.32, 0.4), (0.85, 1.0))
    wide, deep = rng.uniform(0.61, 0.77), rng.uniform(0.46, 0.58)
    y = 0.26 + 0.35 * legs
    parts = [ellipsoid([0, y, 0], [wide, 0.34, deep])]
    stalk = np.array([0.17, y + 0.18, deep * 0.75])
    parts += pair(limb([stalk, stalk + [0.02, 0.24, 0.04]], [0.07, 0.06], segments=8))
    parts += pair(ellipsoid(stalk + [0.02, 0.28, 0.05], 0.1, rings=8))
    for turn in (-42.0, -12.0, 18.0):
        path = [[wide * 0.6, y, 0], [wide + 0.5 * legs, y + 0.06 + 0.1 * legs, 0], [wide + 0.1 + 0.85 * legs, 0.06, 0]]
        parts += pair(turned(limb(path, [0.15, 0.14, 0.1], segments=10), -turn, "y"))
    shoulder = np.array([wide * 0.75, y, deep * 0.5])
    elbow = shoulder + [0.28, 0.06, 0.26]
    wrist = elbow + [-0.04, 0.28, 0.14]
    parts += pair(limb([shoulder, elbow, wrist], [0.15, 0.14, 0.14], segments=10))
    palm = wrist + [0, 0.8 * claws, 0.02]
    parts += pair(ellipsoid(palm, [0.85 * claws, claws, 0.6 * claws], rings=10))
    for out in (0.55, -0.55):
        root = palm + claws * np.array([out, 0.5, 0.0])
        pincer = [root, root + claws * np.array([0.75 * out, 0.8, 0.0])]
        pincer += [root + claws * np.array([-0.1 * out, 1.6, 0.0])]
        parts += pair(limb(pincer, np.array([0.45, 0.36, 0.16]) * claws + 0.01, segments=10))
    return join(parts)


def frog(rng: Rng, traits: Traits) -> Part:
    """Draw a sitting frog: a wide face with bulging eyes on top, front legs planted, hind legs folded at the sides."""
    eyes = traits.draw(rng, "eyes", (0.07, 0.085), (0.16, 0.185), (0.29, 0.34))
    legs = traits.draw(rng, "legs", (0.24, 0.28), (0.5, 0.6), (0.95, 1.1))
    wide = rng.uniform(0.42, 0.52)
    rump, chest = np.array([0.0, 0.26, -0.3]), np.array([0.0, 0.34 + 0.3 * legs, 0.26])
    parts = [limb([rump, chest], [[wide * 0.75, 0.26], [wide * 0.85, 0.28]], segments=20)]
    skull = chest + [0, 0.12, 0.16]
    parts.append(ellipsoid(skull, [wide, 0.25, 0.36]))
    parts += pair(ellipsoid(skull + [0.28, 0.16 + 0.4 * eyes, 0.02], eyes, rings=10))
    arm = np.array([wide * 0.7, chest[1] - 0.04, 0.3])
    parts += pair(limb([arm, arm + [0.16, 0.08 - arm[1], 0.08]], [0.12, 0.085], segments=10))
    hip = np.array([wide * 0.6, 0.24, -0.36])
    knee = hip + [0.12 + 0.22 * legs, 0.55 * legs - 0.05, 0.5 * legs + 0.05]
    ankle = np.array([hip[0] + 0.1 + 0.22 * legs, 0.09, -0.42])
    parts += [*pair(limb([hip, knee], [0.2, 0.15])), *pair(limb([knee, ankle], [0.14, 0.1]))]
    for toe, start, reach in ((ankle, 0.0, 0.2 + 0.5 * legs), (arm + [0.16, 0.08 - arm[1], 0.08], 0.0, 0.24)):
        for side in (-0.45, 0.1, 0.65):
            end = toe + reach * np.array([side, start, 0.9])
            parts += pair(limb([toe, [end[0], 0.065, end[2]]], [0.08, 0.07], segments=8))
    return join(parts)


def snail(rng: Rng, traits: Traits) -> Part:
    """Draw a snail: a coiled shell upright on a long flat foot, a raised head with two eyes on stalks."""
    head = traits.draw(rng, "head", (0.1, 0.12), (0.19, 0.22), (0.36, 0.42))
    shell = traits.draw(rng, "shell", (0.26, 0.31), (0.56, 0.64), (0.88, 1.0))
    length = rng.uniform(0.7, 0.94)
    spine = [[0, 0.1, -length - 0.1], [0, 0.14, -0.3], [0, 0.14, 0.3], [0, 0.22, length * 0.75]]
    parts = [limb(spine, [[0.1, 0.06], [0.24, 0.14], [0.26, 0.15], [0.2, 0.17]])]
    turn = np.linspace(0.0, rng.uniform(2.21, 2.69) * 2 * np.pi, 26)
    # The coil shrinks toward its middle and stands out there on both sides.
    shrink = np.exp(-0.13 * turn)
    centre = np.array([0.0, 0.16 + 0.98 * shell, -0.12])
    around = np.stack([np.zeros(26), np.cos(turn + np.pi), np.sin(turn + np.pi)], 1)
    path = centre + around * (0.62 * shell * shrink)[:, None]
    bulk = np.stack([0.4 * shell * shrink, 0.4 * shell * shrink**0.6 + 0.02], 1)
    parts += [limb(path, bulk, segments=14, samples=2), ellipsoid(centre, [0.3 * shell, 0.5 * shell, 0.5 * shell])]
    base = np.array([0.0, 0.2, length * 0.72])
    skull = base + [0, 0.26 + 0.6 * head, 0.14]
    parts += [limb([base, skull], [0.19, 0.8 * head + 0.02]), ellipsoid(skull, [head, head, head * 1.1], rings=10)]
    eye = skull + [0.5 * head, 0.6 * head, 0.1 * head]
    tip = eye + [0.12 + 0.2 * head, 0.22 + 0.5 * head, 0.08]
    return join([*parts, *pair(limb([eye, tip], [0.065, 0.055], segments=8)), *pair(ellipsoid(tip, 0.1, rings=8))])


def snake(rng: Rng, traits: Traits) -> Part:
    """Draw a snake: two coils on the ground, a neck that rises from their middle, a flat head that looks ahead."""
    head = traits.draw(rng, "head", (0.13, 0.15), (0.23, 0.27), (0.44, 0.52))
    thick, rise = rng.uniform(0.131, 0.179), rng.uniform(0.7, 0.95)
    turn = np.linspace(0.0, rng.uniform(1.78, 2.18) * 2 * np.pi, 34)
    radius = np.linspace(0.75, 0.36, 34) * rng.uniform(0.9, 1.15)
    level = thick + np.linspace(0.0, 2.1 * thick, 34) ** 1.1
    coil = np.stack([radius * np.sin(turn + 2.4), level, radius * np.cos(turn + 2.4)], 1)
    neck = np.array(
        [[0.0, level[-1] + 0.35 * rise, -0.26], [0, level[-1] + 0.8 * rise, -0.2], [0, level[-1] + rise, 0.05]]
    )
    widths = np.concatenate(
        [np.linspace(0.06, thick, 12), np.full(22, thick), [thick * 0.95, thick * 0.9, thick * 0.85]]
    )
    parts = [limb(np.concatenate([coil, neck]), widths, segments=14, samples=2)]
    # Fill the ring: nothing could deform a ball into its hole.
    parts.append(ellipsoid([0, thick, 0], [0.5, 1.3 * thick, 0.5], rings=8))
    skull = neck[-1] + [0, 0.02, 0.05]
    parts.append(ellipsoid(skull, [head, 0.68 * head, 1.15 * head], rings=10))
    parts.append(
        limb([skull, skull + [0, -0.12 * head, 1.1 * head]], [[0.5 * head, 0.8 * head], [0.35 * head, 0.5 * head]])
    )
    parts += pair(ellipsoid(skull + [0.55 * head, 0.5 * head, 0.35 * head], 0.28 * head, rings=8))
    return join(parts)


def spider(rng: Rng, traits: Traits) -> Part:
    """Draw a spider: a large round abdomen behind, a small head with fangs, eight legs with high knees."""
    head = traits.draw(rng, "head", (0.11, 0.13), (0.2, 0.24), (0.4, 0.46))
    legs = traits.draw(rng, "legs", (0.16, 0.22), (0.54, 0.66), (1.2, 1.4))
    belly = rng.uniform(0.4, 0.52)
    y = 0.18 + 0.32 * legs
    parts = [ellipsoid([0, y + 0.1, -belly * 1.05], [belly, belly * 0.9, belly * 1.15])]
    parts.append(limb([[0, y, -0.2], [0, y, 0.2]], [0.2, 0.2]))
    skull = np.array([0.0, y + 0.04, 0.28 + 0.7 * head])
    parts.append(ellipsoid(skull, head))
    parts += pair(ellipsoid(skull + [0.42 * head, 0.5 * head, 0.65 * head], 0.3 * head + 0.01, rings=8))
    fang = skull + [0.35 * head, -0.6 * head, 0.6 * head]
    parts += pair(limb([fang, fang + [0, -0.16, 0.05]], [0.07, 0.05], segments=8))
    for turn in (-58.0, -20.0, 18.0, 52.0):
        reach, lift = legs * rng.uniform(0.92, 1.08), rng.uniform(0.62, 0.8)
        knee = [0.2 + 0.62 * reach, y + lift * reach, 0.0]
        path = [[0.06, y, 0.0], knee, [0.3 + 1.05 * reach, 0.05, 0.0]]
        parts += pair(
            moved(turned(limb(path, [0.105, 0.1, 0.07], segments=10), turn, "y"), [0, 0, 0.04 - 0.003 * turn])
        )
    return join(parts)
