"""Draw insects and what crawls: bodies of a few balls in a row, thin bent legs, feelers, thin wings."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from meshdeform.nouns.families.drawing import bead, bent_limb, near, on, pairs, petal, sized, varied
from meshdeform.nouns.families.parts import Array, Part, ellipsoid, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

_SIX = ((0.12, 35), (0.0, 0), (-0.12, -35))
"""Where (z) three legs a side begin, and their angles ahead of straight out."""


def legs_of(
    reach: float,
    y: float,
    spots: Iterable[tuple[float, float]],
    *,
    lift: float = 0.35,
    thick: float = 0.035,
    inner: float = 0.08,
) -> list[Part]:
    """Return pairs of legs that rise to a knee and stand on the ground, one at each of the spots (z, angle ahead)."""
    path = [[inner, y, 0], [inner + 0.5 * reach, y + lift * reach, 0], [inner + reach, thick, 0]]
    leg = limb(path, thick * np.array([1.25, 1.0, 0.65]), segments=6, samples=1)
    return [side for z, deg in spots for side in pair(moved(turned(leg, -deg, "y"), [0, 0, z]))]


def feelers_of(root: Array, tip: Array, *, bow: float = 0.15, thick: float = 0.025) -> list[Part]:
    """Return two feelers from a place on the right of the head, by the way to their tip."""
    middle = root + 0.55 * tip + [0, bow * float(np.linalg.norm(tip)), 0]
    return pair(bent_limb([root, middle, root + tip], [thick, 0.8 * thick, 0.8 * thick], segments=8, samples=2))


def claw_of(palm: Array, size: float, gape: float = 0.45) -> list[Part]:
    """Return both claws: a palm on the right and two bent tips ahead of it."""
    tips = [[on(palm, size, side * out, 0.1, z) for out, z in ((gape, 0.45), (1.8 * gape, 1.3), (0.08, 2.0))]
        for side in (1, -1)]  # fmt: skip
    tip = [bent_limb(path, [0.4 * size, 0.32 * size, 0.06 * size], segments=8, samples=2) for path in tips]
    return pairs([bead(palm, size * np.array([0.8, 0.6, 1.0]), segments=12), *tip])


def _wings(root: Array, size: Iterable[tuple[float, float, float]], rise_deg: float) -> list[Part]:
    """Return pairs of wings that rise from a place, each of a length, a width and an angle behind straight out."""
    blades = [turned(turned(petal(long, wide), rise_deg, "z"), sweep, "y") for long, wide, sweep in size]
    return [side for wing in blades for side in pair(moved(wing, root))]


def ant(rng: Rng, traits: Traits) -> Part:
    """Draw an ant: three balls in a row with thin waists, elbowed feelers, jaws, six long legs."""
    legs, head = sized(rng, traits, "legs", 0.55), sized(rng, traits, "head", 0.19, by=1.8)
    feelers, rear, y = sized(rng, traits, "feelers", 0.39), rng.uniform(0.22, 0.3), 0.2 + 0.25 * legs
    skull = np.array([0, y + rng.uniform(0.0, 0.12), 0.22 + head])
    chest = limb([[0, y, -0.2], [0, y + 0.03, 0], [0, y, 0.3]], [0.06, 0.13, 0.07], segments=12)
    tail = ellipsoid([0, y + 0.06, -0.2 - 1.1 * rear], [rear * 0.9, rear * 0.85, rear * 1.3], rings=8)
    jaw = on(skull, head, 0.35, -0.3, 0.8)
    elbow = skull + [0.4 * head, 0.5 * head, 0.6 * head]
    return varied(rng, body=[chest, tail], head=bead(skull, [head, 0.85 * head, 1.05 * head], segments=16, rings=8),
        eye=pair(bead(on(skull, head, 0.72, 0.35, 0.35), 0.28 * head)),
        jaw=pair(bent_limb([jaw, jaw + [0.05, 0, 0.1], jaw + [-0.04, 0, 0.17]], [0.05, 0.04, 0.02], segments=8)),
        feeler=feelers_of(elbow, feelers * np.array([0.45, 0.25, 0.85]), bow=0.45),
        leg=legs_of(legs, y, _SIX, lift=0.6))  # fmt: skip


def bee(rng: Rng, traits: Traits) -> Part:
    """Draw a bee: a plump body with stripes in relief and a sting, round eyes, two pairs of short wings."""
    wings, feelers = sized(rng, traits, "wings", 0.56), sized(rng, traits, "feelers", 0.23)
    girth, length, y = rng.uniform(0.25, 0.34), rng.uniform(0.42, 0.55), 0.4
    skull, head = np.array([0, y + 0.02, length * 0.85 + 0.1]), 0.72 * girth
    bands = []
    for t in (-0.62, -0.25, 0.12):
        ring = turned(bead([0, 0, 0], [1.12, 0.1, 1.12], segments=16), 90, "x")
        bands.append(moved(ring._replace(verts=ring.verts * [*[girth * np.sqrt(1 - t * t)] * 2, 1]),
            [0, y, t * length]))  # fmt: skip
    sting = limb([[0, y, -0.9 * length], [0, y, -length - 0.12]], [0.06, 0.01], segments=8, samples=2)
    rise, sweep = rng.uniform(20, 50), rng.uniform(10, 35)
    return varied(rng, body=ellipsoid([0, y, 0], [girth, girth, length]), band=bands, spike=sting,
        head=ellipsoid(skull, head, rings=8), eye=pair(bead(on(skull, head, 0.55, 0.25, 0.6), 0.36 * head)),
        feeler=feelers_of(on(skull, head, 0.3, 0.8, 0.3), feelers * np.array([0.4, 0.7, 0.6])),
        wing=_wings(np.array([0.06, y + 0.85 * girth, 0.12]),
        [(wings, 0.5 * wings, sweep), (0.7 * wings, 0.36 * wings, sweep + 28)], rise),
        leg=legs_of(0.2, y - 0.6 * girth, _SIX, lift=0.1, inner=0.12))  # fmt: skip


def _shelled(rng: Rng, traits: Traits, tall: float, long: float) -> tuple[dict[str, list[Part]], Array, float]:
    """Return the solids of a beetle under two arched wing covers, the middle of its head and the head's radius."""
    legs, head = sized(rng, traits, "legs", 0.31), sized(rng, traits, "head", 0.19, by=1.8)
    wide, height, length, y = rng.uniform(0.4, 0.5), near(rng, tall), near(rng, long), 0.12 + 0.2 * legs
    dome = ellipsoid([0, 0, 0], [0.78 * wide, height, length], rings=8)
    dome.verts[:, 1] *= np.where(dome.verts[:, 1] < 0, 0.3, 1.0)
    cover = turned(dome, rng.uniform(2, 8), "y")
    skull = np.array([0, y + 0.06, length + 0.4 * head])
    spots = ((0.5 * length, 30), (0.05, 0), (-0.5 * length, -35))
    solids = {"shell": pair(moved(cover, [0.27 * wide, y, -0.06])),
        "body": [ellipsoid([0, y + 0.02, 0.7 * length], [0.75 * wide, 0.5 * height, 0.34 * length], rings=8)],
        "head": [bead(skull, [head * 1.1, 0.8 * head, head], segments=16, rings=8)],
        "eye": pair(bead(on(skull, head, 0.8, 0.35, 0.45), 0.28 * head)),
        "leg": legs_of(legs, y, spots, inner=0.7 * wide, thick=0.045)}  # fmt: skip
    return solids, skull, head


def beetle(rng: Rng, traits: Traits) -> Part:
    """Draw a horned beetle: two arched wing covers, a horn that curves up from the nose, six strong legs."""
    solids, skull, head = _shelled(rng, traits, 0.36, 0.62)
    horns, root = sized(rng, traits, "horns", 0.43), skull + [0, 0.2 * head, 0.7 * head]
    way = horns * np.array([(0, 0, 0), (0, 0.25, 0.7), (0, 0.95, 0.9)])
    return varied(rng, **solids, horn=bent_limb(root + way, [0.08, 0.06, 0.02]))


def stag_beetle(rng: Rng, traits: Traits) -> Part:
    """Draw a long beetle with two great jaws like antlers."""
    solids, skull, head = _shelled(rng, traits, 0.27, 0.73)
    horns, root = sized(rng, traits, "horns", 0.48), skull + [0.6 * head, 0, 0.6 * head]
    way = horns * np.array([(0, 0, 0), (0.45, 0.05, 0.55), (0.05, 0.1, 1.0)])
    tooth = root + way[1]
    return varied(rng, **solids, horn=[*pair(bent_limb(root + way, [0.07, 0.07, 0.02], segments=8)),
        *pair(limb([tooth, on(tooth, horns, -0.25, 0.03, 0.1)], [0.05, 0.015], segments=8, samples=2))])  # fmt: skip


def ladybug(rng: Rng, traits: Traits) -> Part:
    """Draw a ladybug: a dome of two wing covers with round spots, a small head with feelers."""
    solids, skull, head = _shelled(rng, traits, 0.47, 0.5)
    cover, spots = solids["shell"][0].verts, []
    radii = np.ptp(cover, axis=0) / [2, 1.3, 2]
    middle = cover.max(0) - radii
    for lift, deg in ((0.86, 40), (0.5, 75), (0.5, 140), (0.86, 150)):
        wide, turn = np.sqrt(1 - lift**2), np.radians(deg)
        out = np.array([wide * np.sin(turn), lift, wide * np.cos(turn)])
        spots += pair(bead(middle + 0.86 * radii * out, 0.11, segments=8))
    feeler = feelers_of(on(skull, head, 0.4, 0.6, 0.4), 0.24 * np.array([0.5, 0.7, 0.6]))
    return varied(rng, **solids, boss=spots, feeler=feeler)


def dragonfly(rng: Rng, traits: Traits) -> Part:
    """Draw a dragonfly: a long thin tail, two pairs of long level wings, a head that is all eyes."""
    tail, wings = sized(rng, traits, "tail", 1.0), sized(rng, traits, "wings", 0.89)
    girth, y, droop = rng.uniform(0.12, 0.16), 0.35, rng.uniform(-0.1, 0.12)
    skull, wide = np.array([0, y, 0.42]), rng.uniform(0.2, 0.3) * wings
    path = [[0, y, -0.1], [0, y + droop * tail, -0.1 - 0.5 * tail], [0, y, -0.1 - tail]]
    return varied(rng, body=limb([[0, y, -0.12], [0, y + 0.05, 0.1], [0, y, 0.3]],
        [0.8 * girth, 1.3 * girth, 0.8 * girth]), tail=bent_limb(path, [0.065, 0.05, 0.06]),
        head=bead(skull, 1.1 * girth, segments=14), eye=pair(bead(on(skull, girth, 0.7, 0.25, 0.35), 0.85 * girth)),
        wing=_wings(np.array([0.04, y + girth, 0.1]), [(wings, wide, -12), (0.95 * wings, 1.1 * wide, 14)],
        rng.uniform(-4, 16)), leg=legs_of(0.18, y - 0.8 * girth, _SIX, lift=0.1, inner=0.05, thick=0.025))  # fmt: skip


def fly(rng: Rng, traits: Traits) -> Part:
    """Draw a fly: huge eyes, a round chest, wings laid back in a V, bristly legs."""
    wings, eyes = sized(rng, traits, "wings", 0.69), sized(rng, traits, "eyes", 0.162, by=1.7)
    legs, girth = sized(rng, traits, "legs", 0.37), rng.uniform(0.24, 0.3)
    y, head = 0.14 + 0.35 * legs + 0.5 * girth, 0.17
    skull = np.array([0, y - 0.02, 0.24 + girth])
    rear = ellipsoid([0, y - 0.06, -0.32], [girth * 0.95, girth * 0.85, girth * 1.4], rings=8)
    return varied(rng, body=[ellipsoid([0, y, 0.06], [girth, girth, 1.05 * girth], rings=8), rear],
        head=bead(skull, [1.15 * head, head, 0.9 * head], segments=14),
        nose=limb([skull, skull + [0, -0.24, 0.1]], [0.06, 0.05], segments=8),
        eye=pair(bead(skull + [0.6 * head + 0.3 * eyes, 0.05, 0.06], [eyes, 1.1 * eyes, eyes], segments=14)),
        wing=_wings(np.array([0.1, y + 0.75 * girth, -0.02]), [(wings, 0.45 * wings, rng.uniform(42, 62))],
        rng.uniform(5, 25)), leg=legs_of(legs, y - 0.4 * girth, _SIX, lift=0.45, inner=0.15, thick=0.035))  # fmt: skip


def grasshopper(rng: Rng, traits: Traits) -> Part:
    """Draw a grasshopper: a long keel of a body, hind legs folded high above it, long feelers."""
    legs, feelers = sized(rng, traits, "legs", 0.69), sized(rng, traits, "feelers", 0.57)
    girth, length, y = rng.uniform(0.14, 0.18), rng.uniform(0.62, 0.78), 0.32
    skull = np.array([0, y + 0.05, 0.5 * length + 0.12])
    hip = np.array([girth * 0.9, y, 0.0])
    knee = on(hip, legs, 0.16, 0.75, -0.6)
    ankle = np.array([knee[0] + 0.06, 0.03, knee[2] - 0.18 * legs])
    hind = [limb([hip, knee], [0.1, 0.035], segments=10), limb([knee, ankle], [0.035, 0.03], segments=8)]
    spine = [[0, y + 0.02, 0.5 * length], [0, y, 0], [0, y + 0.04, -length]]
    front = legs_of(0.24, y - 0.05, ((0.4 * length, 30), (0.18 * length, 5)), lift=0.3)
    return varied(rng, body=limb(spine, girth * np.array([[1.1, 0.9], [1.0, 0.85], [0.4, 0.3]])),
        leg=[*front, *pairs(hind), *pair(limb([ankle, ankle + [0.02, 0, 0.14]], [0.03, 0.02], segments=8, samples=2))],
        head=bead(skull, girth * np.array([0.9, 1.25, 0.8]), segments=14, rings=8),
        eye=pair(bead(on(skull, girth, 0.75, 0.6, 0.2), 0.4 * girth)), feeler=feelers_of(skull + [0.05, 0.15, 0.08],
        feelers * np.array([0.25, 0.5, 0.6]), thick=0.02),
        wing=pair(moved(turned(turned(petal(length, 0.26), 90, "x"), 90, "y"),
        [0.7 * girth, y + 0.08, 0.1])))  # fmt: skip


def _row(rng: Rng, count: int, length: float, girth: float, arch: float, sway: float) -> Array:
    """Return places (count, 3) along a body on the ground, the head's first, with arches and sideways bends."""
    t, phase = np.linspace(0, 1, count), rng.uniform(0, 2 * np.pi)
    lift = arch * np.sin(np.pi * np.clip(1.6 * t - 0.3, 0, 1)) ** 2
    return np.stack([sway * np.sin(3.0 * t * np.pi + phase), girth + lift, length * (0.5 - t)], 1)


def caterpillar(rng: Rng, traits: Traits) -> Part:
    """Draw a caterpillar: a row of balls, the middle ones arched up, stub legs, a large head with feelers."""
    head, feelers = sized(rng, traits, "head", 0.30, by=1.7), sized(rng, traits, "feelers", 0.3)
    count, girth = int(rng.integers(6, 9)), rng.uniform(0.19, 0.23)
    row = _row(rng, count, 0.26 * count, girth, rng.choice([0.0, 0.25, 0.45]), rng.uniform(0, 0.1))
    skull = row[0] + [0, 0.5 * head, 0.5 * head]
    feet = [foot for place in row[1:] for foot in pair(bead(place + [0.6 * girth, -0.85 * girth, 0], [0.08, 0.09, 0.08],
        segments=8))]  # fmt: skip
    return varied(rng, body=[bead(place, [1.05 * girth, girth, 0.19], segments=14, rings=8) for place in row[1:]],
        head=bead(skull, head, segments=18, rings=10), eye=pair(bead(on(skull, head, 0.42, 0.2, 0.82), 0.2 * head)),
        feeler=feelers_of(on(skull, head, 0.4, 0.8, 0.1), feelers * np.array([0.45, 0.85, 0.2]), thick=0.035),
        foot=feet)  # fmt: skip


def scorpion(rng: Rng, traits: Traits) -> Part:
    """Draw a scorpion: a flat body, two open claws ahead, eight legs, a tail of beads curled over to a sting."""
    claws, tail = sized(rng, traits, "claws", 0.17, by=2.0), sized(rng, traits, "tail", 0.83, by=2.0)
    legs, y = sized(rng, traits, "legs", 0.41), 0.26
    body = limb([[0, y, 0.42], [0, y + 0.03, 0.1], [0, y, -0.45]], [[0.1, 0.18], [0.14, 0.27], [0.09, 0.13]], samples=3)
    arc = np.array([[0, y + tail * up, -0.45 + tail * out] for out, up in ((-0.1, 0.02), (-0.32, 0.2), (-0.42, 0.45),
        (-0.36, 0.72), (-0.18, 0.92), (0.04, 0.98), (0.24, 0.9))])  # fmt: skip
    sting = bent_limb([arc[-1], arc[-1] + [0, -0.02, 0.14], arc[-1] + [0, -0.18, 0.2]], [0.09, 0.06, 0.012])
    shoulder, elbow, wrist = np.array([0.12, y, 0.42]), np.array([0.42, y + 0.05, 0.5]), np.array([0.42, y + 0.1, 0.78])
    palm = wrist + [0, 0, 0.8 * claws]
    return varied(rng, body=body, tail=[limb([a, b], [0.1, 0.1], segments=8, samples=1) for a, b in pairwise(arc)],
        spike=sting, arm=pair(limb([shoulder, elbow, wrist], [0.06, 0.07, 0.06], segments=7, samples=2)),
        claw=claw_of(palm, claws), leg=legs_of(legs, y, ((0.28, 40), (0.12, 12), (-0.05, -14), (-0.22, -40)), lift=0.4,
        inner=0.15), eye=pair(bead([0.07, y + 0.13, 0.36], 0.05)))  # fmt: skip


KINDS = {"beetle": (stag_beetle,)}
