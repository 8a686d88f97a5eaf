"""Draw vehicles, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.priors.builtin.training.families.parts import (
    Part,
    box,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    moved,
    pair,
    turned,
)
from meshdeform.priors.builtin.training.families.traits import Rng, Traits

__all__ = ["airplane", "boat", "car", "rocket"]


def airplane(rng: Rng, traits: Traits) -> Part:
    """Draw an airplane: a stout fuselage, thick swept wings, a tail plane and a tall fin."""
    length, girth = rng.uniform(0.8, 0.92), rng.uniform(0.22, 0.26)
    wings = traits.draw(rng, "wings", (0.22, 0.3), (0.66, 0.8), (1.4, 1.65))
    sweep, chord = rng.uniform(0.2, 0.36), rng.uniform(0.27, 0.32)
    hull = [[0, 0, length * 0.8], [0, 0, 0.2], [0, 0.02, -length * 0.5], [0, 0.1, -length]]
    parts = [limb(hull, [girth * 0.75, girth, girth * 0.9, 0.1], segments=16)]
    root, tip = np.array([0.08, -0.03, 0.1]), np.array([girth + wings, 0.05, 0.05 - sweep * wings / 0.9])
    parts += pair(limb([root, tip], [[0.095, chord * 1.1], [0.075, chord * 0.7]], segments=12))
    tail = np.array([0.05, 0.1, -length * 0.9])
    parts += pair(limb([tail, tail + [0.44, 0.03, -0.16]], [[0.07, 0.18], [0.06, 0.13]], segments=10))
    fin = np.array([0.0, 0.1, -length * 0.85])
    parts.append(limb([fin, fin + [0, 0.42, -0.2]], [[0.075, 0.2], [0.065, 0.13]], segments=10))
    return join(parts)


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


def car(rng: Rng, traits: Traits) -> Part:  # noqa: ARG001 (every family has one signature)
    """Draw a saloon car: a low body, a cabin with sloping ends, four wheels that stand out."""
    length, width = rng.uniform(1.7, 1.95), rng.uniform(0.78, 0.88)
    wheel, body = rng.uniform(0.22, 0.26), rng.uniform(0.34, 0.4)
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
    outline = [
        (0.06, 0.0),
        (0.06, sail),
        (-0.04, sail),
        *[(-0.04 - 0.56 * sail * t, sail * (1 - t)) for t in (0.33, 0.66, 1.0)],
    ]
    cloth = extrude(outline, 0.11, puff=0.15)
    # The outline lies in XY; the sail stands along the boat, its foot over the deck.
    parts += [mast, moved(turned(cloth, -90, "y"), [0, 0.16, 0.08])]
    return join(parts)
