"""Draw shapes that families do not have: a bear on four legs, a bird that stands, an office chair."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import Quadruped, at
from meshdeform.nouns.families.parts import Part, box, ellipsoid, join, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = [
    "desk_chair",
    "great_cat",
    "office_chair",
    "quadruped",
    "standing_bear",
    "standing_bird",
    "standing_cat",
    "standing_rabbit",
]


def quadruped(rng: Rng, _: Traits) -> Part:
    """Draw any animal on four legs, with wide ranges of everything."""
    radius = rng.uniform(0.18, 0.42)
    body = Quadruped(rng.uniform(0.5, 1.1), radius, rng.uniform(0.12, 0.85), radius * rng.uniform(0.3, 0.48))
    head, neck = rng.uniform(0.12, 0.3) * (0.6 + radius), rng.uniform(0.05, 0.6)
    front = np.array([0.0, body.height + rng.uniform(0, 0.1), body.length / 2 + 0.3 * radius])
    skull = front + at(rng.uniform(-10, 70), neck + 0.8 * head)
    thick = max(0.45 * radius, 0.5 * head)
    parts = body.parts(slope=rng.uniform(-0.04, 0.08))
    parts.append(limb([front, skull], [thick * rng.uniform(1.0, 1.4), min(thick, 0.8 * head)]))
    parts.append(ellipsoid(skull, [head * rng.uniform(0.85, 1.05), head * 0.95, head]))
    muzzle = skull + at(rng.uniform(-50, 0), rng.uniform(1.0, 2.2) * head)
    girth = head * np.array([rng.uniform(0.55, 0.75), rng.uniform(0.3, 0.5)])
    parts.append(limb([skull + [0, -0.2 * head, 0], muzzle], girth))
    ear, kind = rng.uniform(0.08, 0.3), int(rng.integers(3))
    root = skull + [0.65 * head, (0.75, 0.5, 0.45)[kind] * head, -0.15 * head]
    way = np.array([(0.25, 1.0, -0.1), (0.9, 0.2, -0.1), (0.35, -1.0, 0.0)][kind])  # upright, level or hanging
    parts += pair(limb([root, root + ear * way], [[0.4 * head, 0.25 * head], [0.12 * head, 0.1 * head]], segments=10))
    return join([*parts, _tail(rng, body)])


def _tail(rng: Rng, body: Quadruped) -> Part:
    """Return a tail that hangs, stands out or is held up."""
    length, rump = rng.uniform(0.15, 0.9), np.array([0.0, body.height + 0.25 * body.radius, 0.0])
    rump[2] = -body.length / 2 - 0.75 * body.radius
    angle_deg = rng.uniform(*((230, 265), (170, 200), (110, 150))[int(rng.integers(3))])
    way = length * at(angle_deg, 1.0)
    path = [rump, rump + 0.5 * way + [0, 0, -0.06], rump + way + [0, rng.uniform(-0.1, 0.1), -0.1]]
    return limb(path, [rng.uniform(0.04, 0.09), rng.uniform(0.05, 0.12), rng.uniform(0.03, 0.08)], segments=8)


def standing_bear(rng: Rng, traits: Traits) -> Part:
    """Draw a bear on four legs: a deep body on thick legs, a broad head with a blunt muzzle and round ears."""
    ears = traits.draw(rng, "ears", (0.05, 0.06), (0.09, 0.12), (0.2, 0.26))
    head = traits.draw(rng, "head", (0.15, 0.17), (0.25, 0.29), (0.42, 0.48))
    leg = traits.draw(rng, "legs", (0.05, 0.1), (0.22, 0.32), (0.7, 0.9))
    body = Quadruped(rng.uniform(0.66, 0.8), rng.uniform(0.34, 0.4), leg, rng.uniform(0.15, 0.17))
    front = np.array([0.0, body.height + 0.02, body.length / 2 + 0.04])
    skull = front + at(rng.uniform(-5, 32), 0.26 + head)
    parts = [*body.parts(slope=0.03), limb([front, skull], [0.3, 0.24])]
    parts.append(ellipsoid(skull, [head, head * 0.92, head * 0.95]))
    parts.append(limb([skull + [0, -0.2 * head, 0], skull + [0, -0.25 * head, 1.3 * head]], [head * 0.55, head * 0.42]))
    top = skull + [head * 0.66, head * 0.72, -0.1 * head]
    return join([*parts, *pair(ellipsoid(top, [ears, ears, 0.6 * ears], rings=8))])


def great_cat(rng: Rng, _: Traits) -> Part:
    """Draw a great cat without a mane: a long slim body, a round head, a long tail that hangs."""
    leg, tail = rng.uniform(0.3, 0.5), rng.uniform(0.5, 0.9)
    body = Quadruped(rng.uniform(0.75, 1.0), rng.uniform(0.2, 0.26), leg, rng.uniform(0.085, 0.11))
    head, front = rng.uniform(0.2, 0.26), np.array([0.0, body.height + 0.04, body.length / 2])
    skull = front + at(rng.uniform(5, 45), rng.uniform(0.4, 0.5))
    parts = [*body.parts(), limb([front, skull], [0.2, 0.14]), ellipsoid(skull, head)]
    parts.append(ellipsoid(skull + [0, -0.3 * head, 0.8 * head], [head * 0.6, head * 0.5, head * 0.6], rings=8))
    parts += pair(ellipsoid(skull + [0.75 * head, 0.85 * head, -0.1], [0.08, 0.08, 0.05], rings=8))
    rump = np.array([0.0, body.height + 0.1, -body.length / 2 - body.radius * 0.7])
    path = [rump, rump + [0, -0.25 * tail, -0.3 * tail], rump + [0, -0.6 * tail, -0.6 * tail]]
    return join([*parts, limb(path, [0.06, 0.055, 0.05], segments=8)])


def standing_cat(rng: Rng, traits: Traits) -> Part:
    """Draw a cat on four legs: a slim body, a round head with pointed ears and hardly a muzzle, a long raised tail."""
    ears = traits.draw(rng, "ears", (0.04, 0.08), (0.17, 0.23), (0.42, 0.52))
    head = traits.draw(rng, "head", (0.12, 0.14), (0.2, 0.24), (0.36, 0.42))
    tail = traits.draw(rng, "tail", (0.08, 0.16), (0.6, 0.8), (1.2, 1.4))
    body = Quadruped(rng.uniform(0.62, 0.8), rng.uniform(0.17, 0.22), rng.uniform(0.28, 0.42), rng.uniform(0.07, 0.09))
    front = np.array([0.0, body.height + 0.04, body.length / 2])
    skull = front + at(rng.uniform(25, 60), 0.16 + head)
    parts = [*body.parts(), limb([front, skull], [0.15, 0.12]), ellipsoid(skull, [head * 1.05, head * 0.92, head])]
    nose = ellipsoid(skull + [0, -0.25 * head, 0.85 * head], [head * 0.42, head * 0.32, head * 0.3], rings=8)
    top = skull + [0.6 * head, 0.6 * head, -0.05 * head]
    ear = limb([top, top + ears * np.array([0.3, 1.0, 0.0])], [[0.5 * head, 0.3 * head], [0.08, 0.06]], segments=10)
    rump, angle_deg = np.array([0.0, body.height + 0.06, -body.length / 2 - 0.7 * body.radius]), rng.uniform(95, 215)
    middle = rump + [0, 0.1 * tail, -0.45 * tail]
    path = [rump, middle, middle + at(angle_deg, 0.55 * tail)]
    return join([*parts, nose, *pair(ear), limb(path, [0.06, 0.055, 0.05], segments=8)])


def office_chair(rng: Rng, traits: Traits) -> Part:
    """Draw an office chair: a padded seat and back on one column, over a star of five feet."""
    width, depth = rng.uniform(0.78, 0.95), rng.uniform(0.75, 0.9)
    height = traits.draw(rng, "legs", (0.22, 0.3), (0.6, 0.8), (1.1, 1.35))
    rise = traits.draw(rng, "back", (0.28, 0.38), (0.75, 1.05), (1.5, 1.8))
    reach, slab, lean = rng.uniform(0.45, 0.6), rng.uniform(0.12, 0.18), rng.uniform(-12, 0)
    seat = box([0, height, 0], [width, slab, depth], round_by=0.4)
    rest = box([0, rise / 2, 0], [width * rng.uniform(0.8, 1.0), rise, 0.8 * slab], round_by=0.4)
    back = moved(turned(rest, lean, "x"), [0, height + 0.1, -depth / 2])
    column = limb([[0, 0.12, 0], [0, height, 0]], [0.07, 0.06], segments=12)
    angles = np.arange(5) * 2 * np.pi / 5
    ends = reach * np.stack([np.sin(angles), np.zeros(5), np.cos(angles)], 1)
    star = [limb([[0, 0.14, 0], end + [0, 0.06, 0]], [0.07, 0.06], segments=8) for end in ends]
    return join([seat, back, column, *star])


def desk_chair(rng: Rng, traits: Traits) -> Part:
    """Draw an office chair with two arm rests."""
    chair = office_chair(rng, traits)
    seat = chair.verts[: len(box([0, 0, 0], [1, 1, 1], round_by=0.4).verts)]
    side, top, depth = 1.08 * float(seat[:, 0].max()), float(seat[:, 1].max()), float(np.ptp(seat[:, 2]))
    lift, thick = rng.uniform(0.22, 0.34), rng.uniform(0.05, 0.07)
    rest = [[side, top + lift, -0.35 * depth], [side, top + lift, 0.35 * depth]]
    post = [[0.9 * side, top - 0.1, 0], [side, top + lift, 0]]
    return join([chair, *pair(limb(rest, [thick, thick], segments=10)), *pair(limb(post, [thick, thick], segments=8))])


def standing_bird(rng: Rng, traits: Traits) -> Part:
    """Draw a bird that stands: an egg of a body, a neck of any length, folded wings, two thin legs with feet."""
    girth, length, lean = rng.uniform(0.26, 0.42), rng.uniform(0.45, 0.65), rng.uniform(5, 50)
    leg, neck, head = rng.uniform(0.1, 0.4), rng.uniform(0.05, 0.5), rng.uniform(0.16, 0.26)
    y, axis, up = leg + girth, at(lean, 1.0), at(lean + 90, 1.0)
    middle = np.array([0.0, y, 0.0])
    parts = [
        limb([middle - 0.45 * length * axis, middle, middle + 0.4 * length * axis], [0.6 * girth, girth, 0.75 * girth])
    ]
    base = middle + 0.55 * length * axis + 0.2 * girth * up
    skull = base + at(rng.uniform(55, 88), neck + 0.7 * head)
    parts += [limb([base, skull], [0.6 * girth, 0.7 * head]), ellipsoid(skull, [0.9 * head, 0.95 * head, head])]
    bill = skull + [0, -0.1 * head, 0.7 * head]
    broad = rng.uniform(0.1, 0.5) * head
    beak = traits.draw(rng, "beak", (0.02, 0.07), (0.15, 0.4), (0.55, 0.8))
    parts.append(limb([bill, bill + [0, -0.04, beak]], [[0.3 * head, broad], [0.1 * head, 0.7 * broad]]))
    rump = middle - 0.8 * length * axis
    tail = traits.draw(rng, "tail", (0.02, 0.08), (0.2, 0.5), (0.8, 1.1))
    parts.append(limb([rump, rump - tail * at(lean + rng.uniform(-40, 15), 1.0)], [[0.1, 0.2], [0.05, 0.12]]))
    reach = traits.draw(rng, "wings", (0.3, 0.45), (0.8, 1.2), (1.5, 1.9)) * length
    deep = rng.uniform(0.45, 0.65) * girth
    rim = np.array(
        [(0.4, 0.1), (0.3, 0.7), (-0.2, 1.0), (-0.9, 0.4), (-1.1, 0.0), (-0.5, -0.7), (0.1, -0.8), (0.35, -0.4)]
    )
    wing = turned(plate(rim * [reach, deep], 0.1, across="x", puff=0.3), -0.8 * lean, "x")
    parts += pair(moved(turned(wing, rng.uniform(-14, 4), "z"), middle + [0.9 * girth, 0.2 * girth, -0.05]))
    hip = [0.4 * girth, y - 0.6 * girth, -0.05]
    parts += pair(limb([hip, [0.4 * girth, 0.05, 0.02]], [0.07, 0.045], segments=8))
    return join([*parts, *pair(ellipsoid([0.42 * girth, 0.035, 0.12], [0.1, 0.035, 0.16], rings=8))])


def standing_rabbit(rng: Rng, traits: Traits) -> Part:
    """Draw a rabbit that stands like a person: an egg of a body, arms at its sides, long feet, upright ears."""
    head = traits.draw(rng, "head", (0.16, 0.18), (0.28, 0.36), (0.5, 0.58))
    ears = traits.draw(rng, "ears", (0.14, 0.2), (0.52, 0.7), (1.1, 1.35))
    girth, height, leg = rng.uniform(0.3, 0.4), rng.uniform(0.4, 0.52), rng.uniform(0.12, 0.3)
    middle = leg + 0.85 * height
    skull = np.array([0.0, middle + 0.95 * height + 0.75 * head, 0.04])
    parts = [ellipsoid([0, middle, 0], [girth, height, 0.9 * girth]), ellipsoid(skull, [head, 0.95 * head, head])]
    parts.append(ellipsoid(skull + [0, -0.22 * head, 0.85 * head], [head * 0.5, head * 0.4, head * 0.4], rings=8))
    ear, splay = skull + [head * 0.45, head * 0.7, -0.04], rng.uniform(0.05, 0.35)
    tip = ear + [splay * ears, ears, -0.1 * ears]
    parts += pair(limb([ear, (ear + tip) / 2, tip], [[0.085, 0.06], [0.12, 0.07], [0.06, 0.05]], segments=10))
    shoulder, lift = np.array([0.8 * girth, middle + 0.6 * height, 0.02]), np.radians(rng.uniform(15, 50))
    hand = shoulder + rng.uniform(0.35, 0.5) * np.array([np.sin(lift), -np.cos(lift), 0.1])
    parts += pair(limb([shoulder, hand], [0.09, 0.085], segments=10))
    parts += pair(limb([[0.55 * girth, middle - 0.5 * height, 0], [0.55 * girth, 0.08, 0]], [0.13, 0.11], segments=10))
    parts += pair(ellipsoid([0.58 * girth, 0.07, 0.14], [0.12, 0.075, 0.26], rings=8))
    return join([*parts, ellipsoid([0, middle - 0.45 * height, -0.95 * girth], 0.13, rings=8)])
