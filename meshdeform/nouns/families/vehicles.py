"""Draw vehicles, all facing +Z."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Part, box, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["airplane", "balloon", "boat", "car", "helicopter", "rocket", "submarine"]


def _plate(outline: ArrayLike, thickness: float) -> Part:
    """Return a flat plate whose outline (N, 2) of (x, z), clockwise from above, lies in the plane y = 0."""
    return turned(extrude(np.asarray(outline, float) * [1.0, -1.0], thickness, bevel=0.25), -90, "x")


def airplane(rng: Rng, traits: Traits) -> Part:
    """Draw an airplane: a slim fuselage, flat broad swept wings, a flat tail plane and a tall flat fin."""
    length, girth = rng.uniform(0.92, 1.06), rng.uniform(0.16, 0.19)
    wings = traits.draw(rng, "wings", (0.22, 0.3), (0.74, 0.88), (1.4, 1.65))
    sweep, chord, thick = rng.uniform(0.24, 0.42), rng.uniform(0.6, 0.72), 0.12
    hull = [[0, 0, length * 0.86], [0, 0, 0.3], [0, 0, -length * 0.4], [0, 0.06, -length]]
    parts = [limb(hull, [girth * 0.8, girth, girth, 0.09], segments=16)]
    root, tip = 0.3 * chord, girth + wings
    back = sweep * wings / 0.8
    wing = [(0.0, root), (tip, root - back - 0.12), (tip, root - back - 0.12 - 0.5 * chord), (0.0, root - chord)]
    parts += pair(moved(_plate(wing, thick), [0, -0.03, 0.16]))
    span, rear = rng.uniform(0.46, 0.54), -length * 0.74
    tail = [(0.0, 0.02), (span, -0.16), (span, -0.4), (0.0, -0.34)]
    parts += pair(moved(_plate(tail, 0.11), [0, 0.06, rear]))
    tall = rng.uniform(0.46, 0.56)
    fin = [(0.0, 0.06), (tall, -0.22), (tall, -0.46), (0.0, -0.36)]
    return join([*parts, moved(turned(_plate(fin, 0.12), 90, "z"), [0, 0.04, rear])])


def balloon(rng: Rng, _: Traits) -> Part:
    """Draw a hot-air balloon: a round envelope of puffed gores, narrow below, that touches a square basket."""
    radius, gores = rng.uniform(0.72, 0.8), int(rng.integers(10, 13))
    low, mouth = rng.uniform(0.95, 1.1), rng.uniform(0.2, 0.24)
    turn = np.linspace(0.0, np.pi / 2, 9)
    drop = np.linspace(0.0, 1.0, 12)
    lower = [(mouth + (radius - mouth) * np.cos(np.pi / 2 * t**1.25), -low * t) for t in drop[:0:-1]]
    upper = [(radius * np.cos(t), 0.92 * radius * np.sin(t)) for t in turn[:-1]]
    skirt = [(mouth * 1.25, -low - 0.12), (mouth * 1.25, -low - 0.06)]
    bag = lathe([*skirt, *lower, *upper, (0.0, 0.92 * radius)], segments=60)
    x, y, z = bag.verts.T
    puff = np.abs(np.sin(np.arctan2(x, z) * gores / 2)) ** 0.7
    swell = 1 - 0.14 * (1 - puff) * np.clip((y + low) / 0.3, 0, 1)
    basket, tall = rng.uniform(0.46, 0.54), rng.uniform(0.32, 0.4)
    level = -low - 0.2 - tall
    rim = box([0, level + tall, 0], [basket + 0.1, 0.12, basket + 0.1], round_by=0.45)
    ropes = box([0, level + tall + 0.1, 0], [0.26, 0.36, 0.26], round_by=0.3)
    car = box([0, level + tall / 2, 0], [basket, tall, basket], round_by=0.15)
    return join([Part(np.stack([x * swell, y, z * swell], 1), bag.faces), ropes, rim, car])


def helicopter(rng: Rng, traits: Traits) -> Part:
    """Draw a helicopter: an egg-shaped cabin with a windscreen, four broad blades, a boom with a tail rotor, skids."""
    length, girth = rng.uniform(0.66, 0.76), rng.uniform(0.4, 0.46)
    tail = traits.draw(rng, "tail", (0.12, 0.22), (0.8, 0.95), (1.7, 2.0))
    reach, mast = rng.uniform(0.9, 1.05), girth + rng.uniform(0.18, 0.24)
    end = -0.4 * length - tail
    parts = [
        ellipsoid([0, 0, 0], [girth, girth, length]),
        ellipsoid([0, 0.1, 0.24 * length], [girth * 0.94, girth * 0.86, length * 0.72]),
        box([0, girth * 0.86, -0.08], [0.34, 0.24, 0.6], round_by=0.45),
        limb([[0, girth * 0.8, 0], [0, mast + 0.06, 0]], [0.1, 0.1], segments=10),
        limb([[0, 0.12, -0.3 * length], [0, 0.2, end]], [0.17, 0.085], segments=12),
        moved(
            turned(_plate([(-0.04, 0.1), (0.42, -0.12), (0.42, -0.32), (-0.04, -0.16)], 0.12), 90, "z"), [0, 0.18, end]
        ),
        moved(turned(lathe([(0.2, -0.05), (0.22, 0.0), (0.2, 0.05)]), 90, "z"), [0.1, 0.26, end - 0.04]),
        lathe([(0.14, mast), (0.16, mast + 0.08), (0.08, mast + 0.15)]),
    ]
    spin = rng.uniform(20, 70)
    blade = box([0, mast + 0.06, reach / 2], [0.22, 0.12, reach], round_by=0.35)
    parts += [turned(blade, spin + 90 * step, "y") for step in range(4)]
    ground, side = -girth - 0.22, girth * 0.86
    parts += pair(
        limb([[side, ground, -0.5], [side, ground, 0.42], [side, ground + 0.1, 0.62]], [0.075] * 3, segments=10)
    )
    # One broad strut a side: two would leave a hole between them.
    strut = limb([[0.1, -girth * 0.8, 0], [side, ground, 0]], [[0.075, 0.24], [0.07, 0.2]], segments=10)
    return join([*parts, *pair(strut)])


def rocket(rng: Rng, traits: Traits) -> Part:
    """Draw a rocket: an upright spindle with a pointed nose and four fins at its foot."""
    radius, body = rng.uniform(0.3, 0.36), rng.uniform(1.15, 1.4)
    fins = traits.draw(rng, "fins", (0.08, 0.12), (0.3, 0.38), (0.62, 0.75))
    turn = np.linspace(0.0, 1.0, 9)
    nose = [(radius * (1 - t**1.7), body + 0.65 * t) for t in turn[:-1]]
    wall = [(radius * (0.7 + 0.3 * np.sin(t * np.pi / 2)), body * t) for t in turn[1:]]
    hull = lathe([(radius * 0.55, -0.1), (radius * 0.68, 0.0), *wall, *nose[1:], (0.0, body + 0.66)])
    parts = [hull]
    for quarter in range(4):
        root, tip = [radius * 0.55, 0.36, 0], [radius * 0.75 + fins, -0.08 - 0.3 * fins, 0]
        fin = limb([root, tip], [[0.22, 0.08], [0.15, 0.07]], segments=10)
        parts.append(turned(fin, 90 * quarter, "y"))
    return join(parts)


def car(rng: Rng, traits: Traits) -> Part:
    """Draw a saloon car: a low body, a cabin with sloping ends, four wheels that stand out."""
    length, width = rng.uniform(1.7, 1.95), rng.uniform(0.78, 0.88)
    wheel, body = traits.draw(rng, "wheels", (0.12, 0.15), (0.22, 0.26), (0.38, 0.44)), rng.uniform(0.34, 0.4)
    floor = wheel * 0.75
    parts = [box([0, floor + body / 2, 0], [width, body, length], round_by=0.35)]
    roof = rng.uniform(0.34, 0.42)
    cabin = box([0, 0, 0], [width * 0.92, roof * 2, length * 0.56], round_by=0.25)
    slope = 1 - 0.28 * np.clip(cabin.verts[:, 1:2] / roof, 0, 1)
    cabin = Part(cabin.verts * np.concatenate([0.5 + slope / 2, np.ones_like(slope), slope], 1), cabin.faces)
    parts.append(moved(cabin, [0, floor + body * 0.9, -0.06 * length]))
    tyre = turned(lathe([(wheel * 0.92, -0.12), (wheel, -0.08), (wheel, 0.08), (wheel * 0.92, 0.12)]), 90, "z")
    for z in (-0.31, 0.31):
        parts += pair(moved(tyre, [width / 2, wheel, z * length]))
    return join(parts)


def boat(rng: Rng, traits: Traits) -> Part:
    """Draw a sailing boat: a hull pointed at the bow, a mast and a thick triangular sail."""
    length, beam, depth = rng.uniform(0.85, 1.0), rng.uniform(0.34, 0.4), rng.uniform(0.32, 0.38)
    sail = traits.draw(rng, "sail", (0.42, 0.52), (1.0, 1.2), (1.8, 2.1))
    hull = ellipsoid([0, 0, 0], 1.0, rings=18)
    verts = hull.verts[:, [0, 2, 1]]
    faces = hull.faces[:, ::-1].copy()
    fore = np.clip(verts[:, 2], 0, 1)
    # A flat deck at the top; the bow runs out to a stem that rises.
    height = np.minimum(verts[:, 1], 0.08) * depth + 0.1 * fore**2
    wide = np.sign(verts[:, 0]) * np.abs(verts[:, 0]) ** 0.8 * beam
    parts = [Part(np.stack([wide, height, verts[:, 2] * length], 1), faces)]
    mast = limb([[0, 0, 0.12], [0, 0.16 + sail, 0.12]], [0.07, 0.06], segments=10)
    outline = [(0.06, 0.0), (0.06, sail), (-0.04, sail)]
    outline += [*[(-0.04 - 0.56 * sail * t, sail * (1 - t)) for t in (0.33, 0.66, 1.0)]]
    cloth = extrude(outline, 0.11, puff=0.15)
    # The outline lies in XY; the sail stands along the boat, its foot over the deck.
    return join([*parts, mast, moved(turned(cloth, -90, "y"), [0, 0.16, 0.08])])


def submarine(rng: Rng, traits: Traits) -> Part:
    """Draw a submarine: a cigar with portholes, a tower with planes and a periscope, a tail cross and a propeller."""
    length, girth = rng.uniform(0.95, 1.1), rng.uniform(0.28, 0.33)
    tower = traits.draw(rng, "tower", (0.02, 0.07), (0.28, 0.36), (0.9, 1.1))
    line = np.linspace(-1.0, 1.0, 15)
    profile = [(girth * (1 - np.abs(t) ** (2.2 if t < 0 else 3.5)) ** 0.6, length * t) for t in line[1:-1]]
    parts = [turned(lathe([(0.0, -length), *profile, (0.0, length)]), 90, "x")]
    top, place = girth + tower, rng.uniform(0.08, 0.2)
    parts.append(limb([[0, 0.5 * girth, place], [0, top - 0.1, place]], [[0.16, 0.3], [0.14, 0.24]], segments=16))
    scope = [[0, top - 0.1, place], [0, top + 0.3, place], [0, top + 0.32, place + 0.14]]
    parts.append(limb(scope, [0.075] * 3, segments=10))
    vane = _plate([(0.0, 0.1), (0.42, -0.02), (0.42, -0.2), (0.0, -0.2)], 0.11)
    parts += [moved(turned(vane, 90 * step, "z"), [0, 0, -0.78 * length]) for step in range(4)]
    blade = box([0, 0.13, -length - 0.04], [0.17, 0.26, 0.11], round_by=0.45)
    parts += [turned(blade, 45 + 90 * step, "z") for step in range(4)]
    parts.append(limb([[0, 0, -0.9 * length], [0, 0, -length - 0.08]], [0.09, 0.08], segments=10))
    for z in np.linspace(-0.34, 0.66, 4):
        parts += pair(ellipsoid([girth * 0.93, 0.06, z * length], [0.08, 0.095, 0.095], rings=8))
    return join(parts)
