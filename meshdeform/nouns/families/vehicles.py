"""Draw vehicles, all facing +Z."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Part, box, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def _plate(outline: ArrayLike, thickness: float) -> Part:
    """Return a flat plate whose outline (N, 2) of (x, z), clockwise from above, lies in the plane y = 0."""
    return turned(extrude(np.asarray(outline, float) * [1.0, -1.0], thickness, bevel=0.25), -90, "x")


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


def tyre(radius: float, half: float, centre: ArrayLike) -> Part:
    """Return a tyre with a hub that stands out, its axle along X; `half` is half the tyre's width."""
    tyre = [(0.9 * radius, -half), (radius, -0.6 * half), (radius, 0.6 * half), (0.9 * radius, half)]
    dish = [(0.6 * radius, half), (0.5 * radius, 0.6 * half), (0.3 * radius, 0.6 * half), (0.25 * radius, 1.15 * half)]
    profile = [*((r, -y) for r, y in dish[::-1]), *tyre, *dish]
    return moved(turned(lathe(profile), 90, "z"), centre)


def truck(rng: Rng, traits: Traits) -> Part:
    """Draw a truck: a cab with a sunk windscreen and a bumper, a gap, a taller ribbed box behind, six wheels."""
    width, length = rng.uniform(0.76, 0.86), rng.uniform(1.25, 1.5)
    wheel = traits.draw(rng, "wheels", (0.1, 0.13), (0.22, 0.26), (0.42, 0.48))
    floor, load, tall = wheel + 0.1, rng.uniform(0.82, 0.95), rng.uniform(0.54, 0.62)
    cab = rng.uniform(0.46, 0.54)
    front = length * 0.42 + 0.16
    middle = front + cab / 2
    parts = [box([0, floor, 0.16], [width * 0.7, 0.2, length + cab + 0.1], round_by=0.2)]
    parts += [box([0, floor + load / 2, front - 0.16 - length / 2], [width, load, length], round_by=0.06)]
    parts += [box([0, floor + tall * 0.28, middle + 0.06], [width * 0.94, tall * 0.66, cab + 0.12], round_by=0.25)]
    parts += [box([0, floor + tall / 2, middle - 0.03], [width * 0.78, tall, cab - 0.12], round_by=0.1)]
    parts += [box([0, floor + tall + 0.04, middle - 0.04], [width * 0.94, 0.13, cab - 0.02], round_by=0.45)]
    parts += [box([0, floor - 0.1, front + cab + 0.1], [width, 0.16, 0.16], round_by=0.4)]
    for z in (-cab / 2 + 0.04, cab / 2 - 0.1):
        parts += pair(box([width * 0.41, floor + tall * 0.7, middle + z], [0.1, tall * 0.7, 0.1], round_by=0.3))
    for z in np.linspace(front - 0.1 - length, front - 0.22, 5):
        parts.append(box([0, floor + load / 2, z], [width + 0.1, load + 0.06, 0.1], round_by=0.4))
    for z in (front - length * 0.98, front - length * 0.98 + 2.1 * min(wheel, 0.3), middle + 0.02):
        parts += pair(tyre(wheel, 0.11, [width / 2 - 0.02, wheel, z]))
    return join([*parts, *pair(ellipsoid([width * 0.32, floor + 0.1, front + cab + 0.12], 0.08, rings=8))])
