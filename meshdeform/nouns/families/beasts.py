"""Draw wild and farm animals on four legs, and those that crouch on the ground."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import Quadruped, at
from meshdeform.nouns.families.parts import Part, ellipsoid, join, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits


def camel(rng: Rng, traits: Traits) -> Part:
    """Draw a camel: two humps on a long-legged body, a neck that dips and rises, a long face."""
    humps = traits.draw(rng, "humps", (0.04, 0.1), (0.34, 0.42), (0.72, 0.88))
    leg = traits.draw(rng, "legs", (0.16, 0.24), (0.6, 0.72), (1.15, 1.35))
    neck = traits.draw(rng, "neck", (0.1, 0.16), (0.42, 0.52), (0.95, 1.15))
    body = Quadruped(rng.uniform(0.78, 0.98), rng.uniform(0.26, 0.32), leg, rng.uniform(0.096, 0.12))
    parts = body.parts()
    for z in (-0.27, 0.27):
        base = np.array([0.0, body.height + 0.08, z])
        parts.append(limb([base, base + [0, 0.1 + humps, 0]], [[0.21, 0.24], [0.1, 0.11]]))
    chest = np.array([0.0, body.height, body.length / 2 + 0.05])
    dip = chest + [0, -0.02, 0.3 + 0.2 * neck]
    poll = dip + [0, 0.12 + neck, 0.1 + 0.1 * neck]
    parts += [limb([chest, dip, poll], [0.2, 0.15, 0.12]), limb([poll, poll + [0, -0.1, 0.34]], [0.15, 0.11])]
    parts += pair(limb([poll + [0.08, 0.08, -0.02], poll + [0.17, 0.2, -0.05]], [0.065, 0.05], segments=8))
    rump = np.array([0.0, body.height + 0.05, -body.length / 2 - body.radius * 0.85])
    return join([*parts, limb([rump, rump + [0, -0.34, -0.08]], [0.065, 0.08], segments=8)])


def cow(rng: Rng, traits: Traits) -> Part:
    """Draw a cow: a deep barrel with an udder, a broad muzzle, ears and horns at the sides, a tufted tail."""
    horns = traits.draw(rng, "horns", (0.02, 0.06), (0.26, 0.34), (0.7, 0.85))
    leg = traits.draw(rng, "legs", (0.1, 0.15), (0.36, 0.44), (0.85, 1.05))
    tail = traits.draw(rng, "tail", (0.06, 0.12), (0.46, 0.56), (1.0, 1.2))
    body = Quadruped(rng.uniform(0.81, 1.05), rng.uniform(0.35, 0.42), leg, rng.uniform(0.104, 0.136))
    half = body.length / 2
    parts = [*body.parts(), ellipsoid([0, body.height - body.radius * 0.9, -half * 0.6], [0.2, 0.17, 0.2], rings=8)]
    skull = np.array([0.0, body.height + 0.34, half + body.radius + 0.14])
    parts.append(limb([[0, body.height + 0.06, half], [*skull]], [0.28, 0.2]))
    parts.append(limb([skull, skull + [0, -0.22, 0.26]], [[0.2, 0.21], [0.19, 0.21]]))
    parts.append(ellipsoid(skull + [0, -0.27, 0.36], [0.23, 0.15, 0.14], rings=8))
    parts += pair(limb([skull + [0.15, 0.02, -0.05], skull + [0.38, -0.05, -0.08]], [0.08, 0.06], segments=8))
    horn = skull + [0.12, 0.14, 0]
    bend = horn + [0.08 + 0.55 * horns, 0.1 * horns + 0.04, 0]
    parts += pair(limb([horn, bend, bend + [0.05 * horns, 0.8 * horns, 0.1 * horns]], [0.085, 0.075, 0.05], segments=8))
    rump = np.array([0.0, body.height + 0.22, -half - body.radius * 0.85])
    tip = rump + [0, -tail, -0.16]
    parts += [limb([rump, rump + [0, -0.04, -0.12], tip], [0.06, 0.06, 0.055], segments=8)]
    return join([*parts, ellipsoid(tip, [0.1, 0.13, 0.1], rings=8)])


def deer(rng: Rng, traits: Traits) -> Part:
    """Draw a stag: a slim body on thin legs, an upright neck, branched antlers, a short raised tail."""
    horns = traits.draw(rng, "horns", (0.1, 0.16), (0.5, 0.6), (1.0, 1.2))
    leg = traits.draw(rng, "legs", (0.2, 0.28), (0.6, 0.72), (1.1, 1.3))
    neck = traits.draw(rng, "neck", (0.12, 0.18), (0.4, 0.5), (0.9, 1.1))
    body = Quadruped(rng.uniform(0.58, 0.78), rng.uniform(0.22, 0.27), leg, rng.uniform(0.081, 0.104))
    parts = body.parts()
    chest = np.array([0.0, body.height + 0.02, body.length / 2 + 0.06])
    poll = chest + at(rng.uniform(62, 72), neck + 0.16)
    parts += [limb([chest, poll], [0.18, 0.13]), limb([poll, poll + [0, -0.12, 0.32]], [0.145, 0.09])]
    parts += pair(limb([poll + [0.08, 0.06, -0.03], poll + [0.3, 0.12, -0.08]], [0.075, 0.05], segments=8))
    root, spread = poll + [0.07, 0.1, 0.0], rng.uniform(0.45, 0.69)
    middle = root + horns * np.array([spread, 0.5, -0.15])
    tip = root + horns * np.array([spread * 1.1, 1.15, 0.0])
    parts += pair(limb([root, middle, tip], [0.085, 0.08, 0.065], segments=8))
    parts += pair(limb([middle, middle + horns * np.array([0.45, 0.3, 0.0])], [0.075, 0.06], segments=8))
    low = root + 0.5 * (middle - root)
    parts += pair(limb([low, low + horns * np.array([-0.05, 0.35, 0.4])], [0.075, 0.06], segments=8))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.7])
    return join([*parts, limb([rump, rump + [0, 0.12, -0.14]], [0.09, 0.06], segments=8)])


def rhino(rng: Rng, traits: Traits) -> Part:
    """Draw a rhinoceros: a heavy body on pillars, a low long head with a tall horn on its nose and a second behind."""
    horns = traits.draw(rng, "horns", (0.0, 0.06), (0.5, 0.62), (1.1, 1.3))
    leg = traits.draw(rng, "legs", (0.06, 0.1), (0.26, 0.33), (0.75, 0.95))
    body = Quadruped(rng.uniform(0.7, 0.94), rng.uniform(0.39, 0.47), leg, rng.uniform(0.144, 0.176))
    parts = body.parts()
    front = np.array([0.0, body.height + 0.04, body.length / 2 + 0.16])
    brow = front + [0, 0.02, 0.42]
    nose = brow + [0, -0.2, 0.36]
    parts.append(limb([front, brow, nose], [[0.36, 0.34], [0.26, 0.25], [0.18, 0.19]], segments=18))
    parts.append(limb([nose + [0, 0.06, 0.02], nose + [0, 0.16 + horns, 0.1 + 0.12 * horns]], [0.17, 0.04]))
    middle = (brow + nose) / 2
    parts.append(limb([middle + [0, 0.1, 0], middle + [0, 0.22 + 0.4 * horns, 0.02]], [0.11, 0.045], segments=10))
    ear = brow + [0.15, 0.18, -0.12]
    parts += pair(limb([ear, ear + [0.09, 0.2, -0.02]], [0.08, 0.06], segments=8))
    rump = np.array([0.0, body.height + 0.12, -body.length / 2 - body.radius * 0.88])
    return join([*parts, limb([rump, rump + [0, -0.32, -0.1]], [0.06, 0.07], segments=8)])


def lion(rng: Rng, traits: Traits) -> Part:
    """Draw a lion: a round mane with tufts about a face with a muzzle, a slim body, a tail that ends in a brush."""
    leg = traits.draw(rng, "legs", (0.1, 0.15), (0.36, 0.45), (0.85, 1.05))
    mane = traits.draw(rng, "mane", (0.25, 0.28), (0.44, 0.52), (0.76, 0.9))
    tail = traits.draw(rng, "tail", (0.08, 0.14), (0.5, 0.62), (1.05, 1.25))
    body = Quadruped(rng.uniform(0.68, 0.9), rng.uniform(0.22, 0.28), leg, rng.uniform(0.094, 0.126))
    skull = np.array([0.0, body.height + 0.3, body.length / 2 + 0.3])
    parts = [*body.parts(), limb([[0, body.height, body.length / 2], [*skull]], [0.24, 0.24])]
    turn = np.linspace(0, 2 * np.pi, 44, endpoint=False)
    reach = mane * (1 + 0.1 * np.cos(11 * turn))
    ruff = plate(np.stack([reach * np.cos(turn), reach * np.sin(turn)], 1), 0.24 + 0.2 * mane, across="z", puff=0.25)
    parts.append(moved(ruff, skull + [0, -0.02, -0.06]))
    face = skull + [0, 0, 0.2 + 0.1 * mane]
    parts += [ellipsoid(face, [0.24, 0.24, 0.2]), ellipsoid(face + [0, -0.08, 0.18], [0.14, 0.11, 0.12], rings=8)]
    parts += pair(ellipsoid(face + [0.2, 0.2, -0.06], [0.09, 0.09, 0.07], rings=8))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.7])
    bend = rump + [0, -0.05 - 0.15 * tail, -0.12 - 0.4 * tail]
    tip = bend + [0, 0.5 * tail, -0.2 * tail]
    parts += [limb([rump, bend, tip], [0.07, 0.06, 0.055], segments=10)]
    return join([*parts, ellipsoid(tip, [0.12, 0.16, 0.12], rings=8)])


def sheep(rng: Rng, traits: Traits) -> Part:
    """Draw a sheep: a woolly body of many bulges on thin legs, a smooth head with drooping ears."""
    head = traits.draw(rng, "head", (0.12, 0.14), (0.22, 0.26), (0.42, 0.48))
    leg = traits.draw(rng, "legs", (0.1, 0.14), (0.34, 0.42), (0.85, 1.05))
    length, girth = rng.uniform(0.49, 0.65), rng.uniform(0.38, 0.48)
    centre = np.array([0.0, leg + 0.75 * girth, 0.0])
    parts = [ellipsoid(centre, [girth, girth * 0.95, length])]
    for layer, (lift, count) in enumerate([(-0.75, 5), (-0.15, 8), (0.5, 7), (0.95, 3)]):
        for k in range(count):
            angle, wide = 2 * np.pi * (k + 0.5 * layer + 0.2 * rng.uniform(-1, 1)) / count, np.sqrt(1 - lift**2)
            bulge = centre + [girth * wide * np.cos(angle), girth * 0.95 * lift, length * wide * np.sin(angle)]
            parts.append(ellipsoid(bulge, rng.uniform(0.141, 0.189), rings=8))
    for z in (-0.55, 0.55):
        foot = np.array([girth * 0.55, 0.06, length * z])
        parts += pair(limb([foot, foot + [0, leg + 0.2, 0]], [0.1, 0.105], segments=10))
    skull = centre + [0, girth * 0.55, length + 0.2 + 0.6 * head]
    parts.append(limb([skull, skull + [0, -0.7 * head, 1.1 * head]], [head, head * 0.7]))
    parts.append(ellipsoid(skull + [0, 0.85 * head, -0.25 * head], [head * 0.85, head * 0.6, head * 0.8], rings=8))
    ear = skull + [0.7 * head, 0.2 * head, 0]
    return join([*parts, *pair(limb([ear, ear + [0.9 * head, -0.35 * head, 0]], [0.4 * head, 0.3 * head], segments=8))])


def crocodile(rng: Rng, traits: Traits) -> Part:
    """Draw a crocodile: a low wide body on splayed legs, long flat jaws ajar, a row of plates down to the tail."""
    leg = traits.draw(rng, "legs", (0.0, 0.03), (0.14, 0.2), (0.55, 0.68))
    nose = traits.draw(rng, "nose", (0.02, 0.07), (0.42, 0.52), (0.95, 1.15))
    tail = traits.draw(rng, "tail", (0.05, 0.12), (0.58, 0.72), (1.2, 1.45))
    half, wide, gape = rng.uniform(0.4, 0.52), rng.uniform(0.36, 0.46), rng.uniform(0.22, 0.4)
    y = leg + 0.26
    rump, root = np.array([0.0, y, -half]), np.array([0.0, y + 0.06, half + 0.26])
    bend = rump + [rng.uniform(-0.15, 0.15), -0.02, -0.15 - 0.5 * tail]
    tip = rump + [0, 0.02, -0.3 - tail]
    parts = [
        limb([[*rump], [0, y, 0], [0, y, half]], [[0.24, wide * 0.85], [0.28, wide], [0.24, wide * 0.8]], segments=18)
    ]
    parts.append(limb([rump, bend, tip], [[0.22, wide * 0.8], [0.18, 0.2], [0.1, 0.08]]))
    parts.append(ellipsoid(root, [0.3, 0.22, 0.32]))
    for slope in (gape, -0.05):
        start = root + [0, 0.04 if slope > 0 else -0.07, 0.1]
        end = start + (0.16 + nose) * np.array([0.0, slope, 1.0])
        parts.append(limb([start, end], [[0.1, 0.25], [0.085, 0.17]]))
    parts += pair(ellipsoid(root + [0.16, 0.2, 0.0], 0.12, rings=8))
    for z in (-0.75, 0.75):
        hip = np.array([wide * 0.7, y - 0.02, half * z])
        knee = hip + [0.3, -0.02, 0.0]
        parts += pair(limb([[*hip], [*knee], [knee[0] + 0.04, 0.09, knee[2] + 0.1]], [0.15, 0.13, 0.12], segments=10))
    for t in np.linspace(0.0, 1.0, 7):
        top = np.array([0.0, y + 0.2, half * 0.7]) * (1 - t) + (tip + [0, 0.1, 0.1]) * t
        top[0] = bend[0] * np.exp(-(((top[2] - bend[2]) / 0.3) ** 2))
        parts.append(limb([top, top + [0, 0.2 - 0.08 * t, -0.08]], [[0.1, 0.15 - 0.05 * t], [0.04, 0.05]], segments=8))
    return join(parts)


def mouse(rng: Rng, traits: Traits) -> Part:
    """Draw a crouching mouse: a drop-shaped body with a pointed nose, large round ears, a long curving tail."""
    ears = traits.draw(rng, "ears", (0.12, 0.16), (0.32, 0.38), (0.56, 0.66))
    tail = traits.draw(rng, "tail", (0.1, 0.18), (0.7, 0.85), (1.6, 1.9))
    girth, length = rng.uniform(0.36, 0.46), rng.uniform(0.47, 0.63)
    parts = [ellipsoid([0, girth * 0.9, -0.1], [girth, girth * 0.95, length])]
    skull = np.array([0.0, girth * 0.95, length * 0.62])
    parts += [limb([skull, skull + [0, -0.14, 0.46]], [0.3, 0.09]), ellipsoid(skull + [0, -0.14, 0.52], 0.085, rings=8)]
    disc = turned(ellipsoid([0, 0, 0], [ears, ears, 0.12], rings=10), rng.uniform(15, 30), "y")
    parts += pair(moved(disc, skull + [0.16 + 0.6 * ears, 0.18 + 0.7 * ears, 0.0]))
    parts += pair(ellipsoid([girth * 0.6, 0.08, 0.3], [0.11, 0.09, 0.18], rings=8))
    parts += pair(ellipsoid([girth * 0.75, 0.12, -0.3], [0.16, 0.13, 0.26], rings=8))
    root, swing = np.array([0.0, 0.16, -length]), rng.uniform(0.2, 0.4) * rng.choice([-1.0, 1.0])
    along = [[0, 0, 0], [swing * 0.6, -0.05, -0.4], [-swing * 0.3, 0.02, -0.75], [-swing * 0.6, 0.22, -1.05]]
    return join([*parts, limb(root + tail * np.array(along), [0.11, 0.1, 0.09, 0.08], segments=10)])


def hedgehog(rng: Rng, traits: Traits) -> Part:
    """Draw a hedgehog: a dome covered with cones, a smooth pointed face with a ball of a nose, four small feet."""
    nose = traits.draw(rng, "nose", (0.02, 0.06), (0.3, 0.38), (0.8, 0.95))
    spikes = traits.draw(rng, "spikes", (0.0, 0.03), (0.14, 0.19), (0.5, 0.62))
    girth, length = rng.uniform(0.46, 0.56), rng.uniform(0.57, 0.73)
    centre = np.array([0.0, 0.12 + 0.5 * girth, 0.0])
    radii = np.array([girth, girth, length])
    parts = [ellipsoid(centre, radii)]
    for layer, (lift, count) in enumerate([(0.0, 9), (0.45, 8), (0.82, 5), (1.0, 1)]):
        for k in range(count):
            # Circles about the upright axis, open in front, where the face is.
            angle = np.radians(40 + 280 * (k + 0.5 * (layer % 2)) / max(count - 1 + layer % 2, 1))
            wide = np.sqrt(1 - lift**2)
            out = np.array([wide * np.sin(angle), lift, wide * np.cos(angle)])
            root = centre + 0.9 * radii * out
            parts.append(limb([root, root + (0.12 + spikes) * (out + [0, 0.1, -0.3])], [0.15, 0.05], segments=8))
    face = centre + [0, -0.06, length * 0.75]
    tip = face + [0, -0.08, 0.24 + nose]
    parts += [limb([face, tip], [0.27, 0.08]), ellipsoid(tip + [0, 0.02, 0.06], 0.1, rings=8)]
    parts += pair(ellipsoid(face + [0.22, 0.22, 0.02], [0.1, 0.1, 0.06], rings=8))
    for z in (-0.5, 0.55):
        parts += pair(ellipsoid([girth * 0.6, 0.09, length * z], [0.12, 0.1, 0.17], rings=8))
    return join(parts)
