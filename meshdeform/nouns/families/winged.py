"""Draw birds and other winged animals."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import Quadruped, at
from meshdeform.nouns.families.parts import Part, curved, ellipsoid, join, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits


def bird(rng: Rng, traits: Traits) -> Part:
    """Draw a bird in flight: a plump body, a round head with a pointed beak, raised wings, a fanned tail."""
    beak = traits.draw(rng, "beak", (0.02, 0.05), (0.18, 0.24), (0.5, 0.62))
    tail = traits.draw(rng, "tail", (0.02, 0.07), (0.52, 0.62), (1.15, 1.35))
    wings = traits.draw(rng, "wings", (0.28, 0.36), (0.8, 0.95), (1.5, 1.75))
    girth, length = rng.uniform(0.31, 0.4), rng.uniform(0.46, 0.56)
    parts = [ellipsoid([0, 0, 0], [girth, girth * 0.95, length])]
    skull = np.array([0.0, girth * 0.75, length * 0.85])
    parts += [limb([[0, 0.05, length * 0.5], [*skull]], [girth * 0.8, girth * 0.75]), ellipsoid(skull, girth * 0.8)]
    bill = skull + [0, -0.02, girth * 0.6]
    parts.append(limb([bill, bill + [0, -0.05, 0.1 + beak]], [0.12, 0.035], segments=10))
    rump, spread = -length * 0.7, 0.16 + 0.55 * tail
    fan = [(0.1, rump), (-0.1, rump), (-spread, rump - 0.9 * tail - 0.1), (0, rump - tail - 0.15)]
    fan += [(spread, rump - 0.9 * tail - 0.1)]
    parts.append(moved(turned(plate(fan, 0.11, across="y"), 8, "x"), [0, 0.06, 0]))
    root, tip = length * 0.4, rng.uniform(-0.25, -0.05)
    edge = [(0, root), (0.45 * wings, root + 0.12), (wings, tip), (0.95 * wings, tip - 0.2), (0.5 * wings, -0.34)]
    wing = turned(plate([*edge, (0, -length * 0.5)], 0.11, across="y"), rng.uniform(30, 48), "z")
    return join([*parts, *pair(moved(wing, [girth * 0.3, girth * 0.5, 0.02]))])


def butterfly(rng: Rng, traits: Traits) -> Part:
    """Draw a butterfly upright: two large upper and two small lower wings, a slim body with two feelers."""
    wings = traits.draw(rng, "wings", (0.3, 0.38), (0.82, 1.0), (1.6, 1.85))
    body, fold = rng.uniform(0.38, 0.5), rng.uniform(15, 30)
    parts = [limb([[0.0, -body, 0.0], [0.0, 0.0, 0.0], [0.0, body * 0.8, 0.0]], [0.085, 0.13, 0.12])]
    parts += [ellipsoid([0, body, 0], 0.15)]
    parts += pair(
        limb([[0.05, body, 0.02], [0.2, body + 0.32, 0.06], [0.34, body + 0.42, 0.06]], [0.05] * 3, segments=8)
    )
    upper = np.array(
        [(0, -0.05), (0.5, -0.1), (0.85, 0.15), (1.0, 0.6), (0.95, 0.85), (0.6, 0.8), (0.2, 0.45), (0, 0.2)]
    )
    lower = np.array([(0, 0.1), (0, -0.2), (0.2, -0.75), (0.45, -0.85), (0.7, -0.65), (0.75, -0.3), (0.5, 0.05)])
    size = wings * np.array([rng.uniform(0.86, 1.1), rng.uniform(0.86, 1.1)])
    for outline in (upper * size, lower * size * rng.uniform(0.81, 1.05)):
        parts += pair(moved(turned(plate(outline, 0.11, across="z"), fold, "y"), [0.05, 0.04, 0]))
    return join(parts)


def chicken(rng: Rng, traits: Traits) -> Part:
    """Draw a chicken: a boat-shaped body, a raised fan of a tail, a head with comb, beak and wattle, two legs."""
    head = traits.draw(rng, "head", (0.11, 0.13), (0.2, 0.23), (0.36, 0.42))
    leg = traits.draw(rng, "legs", (0.06, 0.1), (0.3, 0.38), (0.8, 1.0))
    tail = traits.draw(rng, "tail", (0.04, 0.1), (0.36, 0.46), (0.85, 1.0))
    girth, length = rng.uniform(0.34, 0.44), rng.uniform(0.46, 0.58)
    y = leg + 0.12 + girth * 0.8
    parts = [ellipsoid([0, y, 0], [girth, girth * 0.95, length])]
    skull = np.array([0.0, y + girth * 0.9 + 0.22, length * 0.8])
    parts += [limb([[0, y + 0.05, length * 0.45], [*skull]], [girth * 0.75, 0.15]), ellipsoid(skull, head)]
    crest = 0.7 * head + 0.03
    for z, tall in ((0.6, 0.7), (0.0, 1.0), (-0.6, 0.75)):
        low = skull + [0, 0.75 * head, z * head]
        parts.append(ellipsoid(low + [0, 0.5 * crest * tall, 0], [0.07, crest * tall, crest * 0.55], rings=8))
    parts.append(limb([skull + [0, 0, 0.7 * head], skull + [0, -0.06, 1.2 * head + 0.14]], [0.1, 0.035], segments=10))
    parts.append(ellipsoid(skull + [0, -0.95 * head, 0.75 * head], [0.075, 0.13, 0.08], rings=8))
    for lean, reach in ((78, 0.85), (55, 1.0), (30, 0.9)):
        rump = np.array([0.0, y + girth * 0.35, -length * 0.75])
        feather = rump + at(180 - lean, 0.12 + reach * tail)
        parts.append(limb([rump + [0, -0.05, 0.2], feather], [[0.1, 0.16], [0.09, 0.13]], segments=10))
    parts += pair(ellipsoid([girth * 0.9, y + 0.04, -0.06], [0.11, girth * 0.55, length * 0.6], rings=9))
    foot = np.array([0.17, 0.07, 0.06])
    parts += pair(limb([foot, foot + [0, leg + 0.2, -0.04]], [0.08, 0.095], segments=8))
    for side in (-0.12, 0.0, 0.12):
        parts += pair(limb([foot, foot + [side, -0.01, 0.22]], [0.07, 0.055], segments=8))
    return join(parts)


def owl(rng: Rng, traits: Traits) -> Part:
    """Draw an owl: an upright egg, a broad face with two large discs for eyes, tufts of ears, folded wings, feet."""
    ears = traits.draw(rng, "ears", (0.02, 0.05), (0.22, 0.28), (0.58, 0.7))
    eyes = traits.draw(rng, "eyes", (0.09, 0.11), (0.2, 0.23), (0.31, 0.35))
    wings = traits.draw(rng, "wings", (0.2, 0.26), (0.5, 0.6), (0.95, 1.1))
    girth, height = rng.uniform(0.42, 0.52), rng.uniform(0.52, 0.69)
    parts = [ellipsoid([0, height, 0], [girth, height, girth * 0.85])]
    face = np.array([0.0, height * 1.62, 0.06])
    parts.append(ellipsoid(face, [girth * 1.02, girth * 0.8, girth * 0.85]))
    front = girth * 0.75
    eye = turned(ellipsoid([0, 0, 0], [eyes, eyes, 0.08], rings=9), 14, "y")
    parts += pair(moved(eye, face + [0.1 + 0.5 * eyes, 0.06, front - 0.25 * eyes + 0.02]))
    parts += pair(ellipsoid(face + [0.12 + 0.5 * eyes, 0.06, front - 0.01], [0.42 * eyes] * 2 + [0.1], rings=8))
    parts.append(limb([face + [0, -0.04, front], face + [0, -0.22, front + 0.16]], [0.11, 0.04], segments=10))
    ear = face + [girth * 0.62, girth * 0.42, 0.05]
    parts += pair(limb([ear, ear + [0.08 + 0.35 * ears, 0.1 + ears, 0]], [0.17, 0.04], segments=10))
    shoulder = np.array([girth * 0.8, height * 1.3, -0.02])
    flap = rng.uniform(0.35, 0.55)
    tip = shoulder + wings * np.array([flap, -0.95, -0.15])
    path = [shoulder, (shoulder + tip) / 2 + [0.05, 0, 0], tip]
    parts += pair(limb(path, [[0.1, 0.2], [0.09, 0.24], [0.07, 0.1]], segments=10))
    for side in (-0.08, 0.08):
        parts += pair(ellipsoid([girth * 0.42 + side, 0.05, girth * 0.6], [0.085, 0.085, 0.2], rings=8))
    return join([*parts, limb([[0, 0.3, -girth * 0.6], [0, 0.06, -girth]], [[0.2, 0.1], [0.16, 0.07]], segments=10)])


def swan(rng: Rng, traits: Traits) -> Part:
    """Draw a swan: a boat-shaped body, a long neck in an S, a small head with a bill, wings raised like sails."""
    head = traits.draw(rng, "head", (0.1, 0.115), (0.165, 0.19), (0.31, 0.36))
    neck = traits.draw(rng, "neck", (0.16, 0.24), (0.72, 0.86), (1.4, 1.65))
    wings = traits.draw(rng, "wings", (0.18, 0.24), (0.6, 0.7), (1.05, 1.2))
    girth, length = rng.uniform(0.34, 0.44), rng.uniform(0.59, 0.75)
    parts = [ellipsoid([0, 0.26, 0], [girth, 0.32, length])]
    parts.append(limb([[0, 0.3, -length * 0.6], [0, 0.55, -length * 1.2]], [[0.18, 0.2], [0.07, 0.06]], segments=12))
    base = np.array([0.0, 0.32, length * 0.75])
    curve = [(0.2, 0.12), (0.26, 0.35), (0.06, 0.6), (-0.08, 0.85), (0.04, 1.05), (0.2, 1.08)]
    knots = [base, *(base + [0, 0.06 + neck * up, 0.08 + 0.75 * neck * out] for out, up in curve)]
    path = curved(np.column_stack([knots, [0.2, 0.15, 0.12, 0.11, 0.11, 0.11, 0.11]]))
    parts.append(limb(path[:, :3], path[:, 3], samples=1))
    skull = knots[-1] + [0, -0.02, 0.06]
    parts.append(ellipsoid(skull, [head * 0.9, head * 0.9, head * 1.1], rings=10))
    bill = skull + [0, -0.1 * head, 0.6 * head]
    parts.append(
        limb([bill, bill + [0, -0.12 - 0.2 * head, 0.16 + 0.5 * head]], [[0.09, 0.09], [0.05, 0.07]], segments=10)
    )
    sail = np.array([(0.45, 0.0), (0.4, 0.35), (0.0, 0.7), (-0.6, 1.05), (-1.0, 0.95), (-0.9, 0.5), (-0.7, 0.1)])
    wing = turned(plate(sail * wings, 0.15, across="x", puff=0.3), rng.uniform(-22, -10), "z")
    return join([*parts, *pair(moved(wing, [girth * 0.72, 0.3, 0.05]))])


def dragon(rng: Rng, traits: Traits) -> Part:
    """Draw a dragon: horned head on a raised neck, large scalloped wings, a crest, a tail that ends in an arrow."""
    head = traits.draw(rng, "head", (0.09, 0.11), (0.18, 0.21), (0.34, 0.4))
    neck = traits.draw(rng, "neck", (0.08, 0.14), (0.48, 0.6), (1.05, 1.25))
    tail = traits.draw(rng, "tail", (0.1, 0.16), (0.7, 0.85), (1.4, 1.65))
    wings = traits.draw(rng, "wings", (0.26, 0.34), (0.85, 1.0), (1.45, 1.65))
    body = Quadruped(
        rng.uniform(0.42, 0.58), rng.uniform(0.27, 0.36), rng.uniform(0.2, 0.28), rng.uniform(0.114, 0.146)
    )
    half, y = body.length / 2, body.height
    parts = body.parts(slope=0.06)
    chest = np.array([0.0, y + 0.08, half])
    middle = chest + [0, 0.15 + 0.45 * neck, 0.32]
    crown = middle + [0, 0.1 + 0.55 * neck, 0.1]
    parts.append(limb([chest, middle, crown], [0.26, 0.17, 0.13]))
    muzzle = crown + [0, -0.35 * head, 2.0 * head]
    parts.append(limb([crown, muzzle], [[head, head * 0.95], [head * 0.6, head * 0.7]]))
    parts += pair(
        limb(
            [crown + [0.5 * head, 0.5 * head, 0], crown + [0.9 * head, 1.5 * head + 0.06, -1.2 * head]],
            [0.08, 0.04],
            segments=8,
        )
    )
    parts += pair(ellipsoid(muzzle + [0.4 * head, 0.45 * head, 0.1 * head], 0.3 * head, rings=8))
    rump = np.array([0.0, y - 0.04, -half])
    bend = rump + [0, -0.12, -0.2 - 0.6 * tail]
    tip = bend + [0, 0.05 + 0.45 * tail, -0.35 * tail]
    parts.append(limb([rump, bend, tip], [0.27, 0.15, 0.075]))
    arrow = plate([(0.0, 0.32), (-0.21, -0.06), (0.21, -0.06)], 0.13, across="z")
    parts.append(moved(turned(arrow, -40, "x"), tip))
    for t in np.linspace(0.0, 1.0, 4):
        top = (1 - t) * (chest + [0, 0.2, -0.1]) + t * (rump + [0, 0.24, 0])
        parts.append(limb([top, top + [0, 0.2, -0.1]], [[0.06, 0.13], [0.045, 0.045]], segments=8))
    web = np.array([(0, 0.12), (0.2, 0.65), (0.5, 1.0), (1.2, 0.8), (0.88, 0.5), (0.98, 0.02), (0.62, 0.2)])
    web = np.concatenate([web, [(0.55, -0.25), (0.28, 0.02), (0, -0.2)]])
    wing = turned(turned(plate(web * wings, 0.13, across="z"), 6, "x"), rng.uniform(14, 28), "y")
    return join([*parts, *pair(moved(wing, [0.1, y + 0.14, half * 0.35]))])
