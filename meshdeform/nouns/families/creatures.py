"""Draw animals that sit, swim or stand upright."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, ellipsoid, extrude, join, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["cat", "duck", "octopus", "penguin", "rabbit", "turtle", "whale"]


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


def rabbit(rng: Rng, traits: Traits) -> Part:
    """Draw a crouching rabbit: an egg-shaped body, a round head, two upright ears, a round tail."""
    head = traits.draw(rng, "head", (0.16, 0.18), (0.28, 0.33), (0.48, 0.56))
    ears = traits.draw(rng, "ears", (0.14, 0.2), (0.52, 0.66), (1.1, 1.35))
    body = rng.uniform(0.42, 0.48)
    parts = [ellipsoid([0, body * 0.95, -0.05], [body, body * 0.95, body * 1.25])]
    skull = np.array([0.0, body * 1.55 + head * 0.35, body * 0.95])
    parts.append(ellipsoid(skull, [head * 0.95, head * 0.95, head * 1.1]))
    parts.append(ellipsoid(skull + [0, -0.2 * head, 0.85 * head], [head * 0.5, head * 0.42, head * 0.42], rings=8))
    ear, splay = skull + [head * 0.56, head * 0.55, -0.04], rng.uniform(0.32, 0.46)
    tip = ear + [splay * ears + 0.02, ears, -0.16 * ears]
    parts += pair(limb([ear, (ear + tip) / 2, tip], [[0.085, 0.075], [0.12, 0.085], [0.075, 0.065]], segments=10))
    parts += pair(ellipsoid([body * 0.72, 0.12, 0.08], [0.17, 0.13, 0.36], rings=9))
    parts += pair(limb([[0.15, 0.08, body * 1.05], [0.15, body * 0.8, body * 0.7]], [0.095, 0.11], segments=10))
    return join([*parts, ellipsoid([0, body * 0.75, -body * 1.32], 0.15, rings=8)])


def penguin(rng: Rng, traits: Traits) -> Part:
    """Draw an upright penguin: an egg-shaped body, a head with a beak, flippers held off the sides, feet in front."""
    head = traits.draw(rng, "head", (0.15, 0.175), (0.28, 0.32), (0.46, 0.54))
    wings = traits.draw(rng, "wings", (0.2, 0.28), (0.6, 0.72), (1.1, 1.3))
    girth, height = rng.uniform(0.42, 0.48), rng.uniform(1.15, 1.35)
    parts = [ellipsoid([0, height * 0.5, 0], [girth, height * 0.52, girth * 0.9], rings=14)]
    skull = np.array([0.0, height + head * 0.35, 0.05])
    parts.append(ellipsoid(skull, head))
    parts.append(limb([skull, skull + [0, -0.12 * head, head + 0.14]], [head * 0.45, 0.045], segments=10))
    shoulder = np.array([girth * 0.78, height * 0.82, 0.0])
    tip = shoulder + wings * np.array([0.5, -0.82, 0.0])
    parts += pair(limb([shoulder, (shoulder + tip) / 2, tip], [[0.07, 0.13], [0.08, 0.16], [0.06, 0.09]], segments=10))
    parts += pair(ellipsoid([girth * 0.48, 0.05, girth * 0.75], [0.15, 0.075, 0.26], rings=8))
    return join([*parts, limb([[0, 0.16, -girth * 0.6], [0, 0.05, -girth * 1.15]], [0.12, 0.07], segments=10)])


def duck(rng: Rng, traits: Traits) -> Part:
    """Draw a swimming duck: a boat-shaped body, a raised tail, a neck, a round head with a flat bill."""
    head = traits.draw(rng, "head", (0.14, 0.16), (0.25, 0.29), (0.42, 0.5))
    neck = traits.draw(rng, "neck", (0.0, 0.05), (0.28, 0.38), (0.85, 1.05))
    body = rng.uniform(0.4, 0.46)
    parts = [ellipsoid([0, body * 0.85, 0], [body, body * 0.82, body * 1.45])]
    parts.append(limb([[0, body, -body], [0, body * 1.45, -body * 1.75]], [0.24, 0.08], segments=12))
    base = np.array([0.0, body * 1.1, body * 0.9])
    skull = base + [0, 0.26 + neck, 0.1]
    parts += [limb([base, skull], [0.21, 0.14]), ellipsoid(skull, [head * 0.92, head * 0.95, head])]
    bill = skull + [0, -0.15 * head, head * 0.7]
    parts.append(limb([bill, bill + [0, -0.02, head * 0.5 + 0.14]], [[0.075, 0.13], [0.055, 0.14]], segments=10))
    wing = ellipsoid([body * 0.88, body * 1.05, -0.08], [0.12, body * 0.45, body * 0.9], rings=9)
    return join([*parts, *pair(wing)])


def whale(rng: Rng, traits: Traits) -> Part:
    """Draw a whale: a thick blunt body that tapers to two wide flukes, with flippers at its sides."""
    flukes = traits.draw(rng, "tail", (0.16, 0.22), (0.42, 0.52), (0.85, 1.0))
    girth, length = rng.uniform(0.48, 0.55), rng.uniform(0.72, 0.85)
    lift = rng.uniform(0.25, 0.38)
    spine = [[0.0, 0.0, length * 0.6], [0.0, 0.0, 0.0], [0.0, -0.02, -length * 0.7], [0.0, lift, -length * 1.35]]
    parts = [limb(spine, [girth * 0.85, girth, girth * 0.55, 0.13], segments=20)]
    end = np.array(spine[-1])
    parts += pair(limb([end, end + flukes * np.array([0.95, 0.12, -0.5])], [[0.08, 0.18], [0.065, 0.12]], segments=10))
    side = np.array([girth * 0.8, -girth * 0.45, length * 0.3])
    return join([*parts, *pair(limb([side, side + [0.34, -0.12, -0.24]], [[0.08, 0.14], [0.065, 0.11]], segments=10))])


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
