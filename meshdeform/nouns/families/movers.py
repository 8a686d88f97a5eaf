"""Draw a fox, a wolf, a van and an astronaut, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.animals import Body, at
from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, extrude, join, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["fox", "van", "wolf"]


def fox(rng: Rng, _: Traits) -> Part:
    """Draw a fox: a slim body on short legs, a wide face that runs to a point, big ears, a tail like a brush."""
    body = Body(rng.uniform(0.56, 0.7), rng.uniform(0.22, 0.25), rng.uniform(0.24, 0.32), rng.uniform(0.075, 0.09))
    chest, head = np.array([0.0, body.height + 0.02, body.length / 2]), rng.uniform(0.25, 0.29)
    skull = chest + at(rng.uniform(50, 62), 0.42)
    nose = skull + [0, -0.5 * head, 1.75 * head]
    parts = [*body.parts(), limb([chest, skull], [0.22, 0.17])]
    parts += [ellipsoid(skull, [1.15 * head, 0.85 * head, 0.9 * head])]
    parts.append(limb([skull + [0, -0.2 * head, 0.2 * head], nose], [[0.75 * head, 0.6 * head], [0.06, 0.055]]))
    cheek = [skull + [0.5 * head, -0.25 * head, 0], skull + [1.4 * head, -0.5 * head, -0.04]]
    parts += pair(limb(cheek, [0.4 * head, 0.03]))
    ear = skull + [0.6 * head, 0.45 * head, -0.05]
    tall = rng.uniform(0.32, 0.4)
    parts += pair(limb([ear, ear + [0.1, tall, 0.0]], [[0.17, 0.09], [0.03, 0.03]], segments=12))
    rump = np.array([0.0, body.height + 0.06, -body.length / 2 - 0.5 * body.radius])
    way = at(rng.uniform(165, 185), 0.6), at(rng.uniform(150, 170), 0.95)
    path = [rump, rump + [0, -0.04, -0.25], rump + way[0], rump + way[1]]
    return join([*parts, limb(path, [0.09, 0.17, 0.21, 0.04])])


def wolf(rng: Rng, _: Traits) -> Part:
    """Draw a wolf on long legs, with a ruff about its neck and a hanging tail; it looks ahead or howls."""
    body = Body(rng.uniform(0.74, 0.88), rng.uniform(0.24, 0.27), rng.uniform(0.5, 0.6), rng.uniform(0.085, 0.1))
    howls, head = rng.random() < 0.3, rng.uniform(0.22, 0.25)
    chest = np.array([0.0, body.height + 0.08, body.length / 2])
    neck, aim = (at(72, 0.55), at(68, 1.0)) if howls else (at(rng.uniform(28, 45), 0.5), at(-12, 1.0))
    skull = chest + neck
    up = np.array([0.0, aim[2], -aim[1]])
    parts = [*body.parts(slope=0.05), limb([chest - [0, 0.06, 0.1], chest + 0.45 * neck, skull], [0.33, 0.34, 0.2])]
    parts += [ellipsoid(skull, head * 1.1)]
    parts += [limb([skull + 0.1 * aim, skull + 2.3 * head * aim], [0.75 * head, 0.42 * head])]
    tufts = [chest + 0.55 * neck + [0.3 * np.sin(t), 0.3 * np.cos(t), 0.0] for t in (1.0, 1.9, 2.7)]
    for tuft in tufts:
        parts += pair(limb([tuft * [0.7, 1, 1], tuft + [0.05, -0.2, -0.16]], [0.15, 0.035], segments=10))
    ear = skull + 0.75 * head * up + [0.55 * head, 0, 0]
    parts += pair(limb([ear, ear + 0.24 * up + [0.02, 0, 0]], [[0.1, 0.08], [0.03, 0.03]], segments=10))
    rump = np.array([0.0, body.height + 0.08, -body.length / 2 - body.radius * 0.75])
    path = [rump, rump + [0, -0.12, -0.16], rump + [0, -0.45, -0.24], rump + [0, -0.75, -0.22]]
    return join([*parts, limb(path, [0.09, 0.12, 0.14, 0.04])])


def van(rng: Rng, traits: Traits) -> Part:
    """Draw a van: a tall box over its whole length with a short slanted nose, sunk side windows, two wheels a side."""
    wide, long = rng.uniform(0.38, 0.44), rng.uniform(0.85, 1.0)
    wheel = traits.draw(rng, "wheels", (0.1, 0.12), (0.18, 0.21), (0.31, 0.37))
    belt, nose = rng.uniform(0.55, 0.62), rng.uniform(0.1, 0.32)
    top, front, floor = belt + rng.uniform(0.36, 0.5), long + nose, 0.75 * wheel
    cab = rng.uniform(0.1, 0.3) if rng.random() < 0.6 else -long + 0.2  # where the windows end
    low = [(-long, floor), (front, floor), (front, belt - 0.16), (long, belt), (-long, belt)]
    glass = [(-long + 0.1, floor + 0.1), (long - 0.1, floor + 0.1), (long - 0.02, belt), (long - 0.26, top - 0.05)]
    glass += [(-long + 0.1, top - 0.05)]
    load = [(-long, floor + 0.1), (cab, floor + 0.1), (cab - 0.05, top), (-long, top)]
    layers = (low, wide), (glass, wide - 0.07), (load, wide - 0.005)
    parts = [turned(extrude(side, 2 * x, bevel=0.06), -90, "y") for side, x in layers]
    parts.append(box([0, top, -0.14], [2 * wide, 0.13, 2 * long - 0.32], round_by=0.45))
    for z in np.linspace(cab, long - 0.2, 3 if cab > 0 else 5)[1:-1]:
        parts += pair(box([wide - 0.06, (belt + top) / 2, z - 0.12], [0.12, top - belt, 0.11]))
    for z in (-0.62 * long, 0.68 * long):
        parts += pair(moved(turned(disc(wheel, -0.09, 0.09), 90, "z"), [wide - 0.02, wheel, z]))
    parts += [box([0, floor + 0.08, z], [2 * wide + 0.06, 0.14, 0.14], round_by=0.4) for z in (-long, front)]
    return join([*parts, *pair(ellipsoid([0.7 * wide, belt - 0.24, front], [0.09, 0.09, 0.07], rings=8))])
