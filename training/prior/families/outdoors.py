"""Draw what lies or stands outdoors: stones, plants without a shape, clouds, signs; and coins."""

from __future__ import annotations

import numpy as np

from training.prior.families.parts import Part, box, disc, ellipsoid, extrude, join, lathe, limb, moved, turned
from training.prior.families.traits import Rng, Traits

__all__ = ["bush", "cloud", "coin", "crystal", "rock", "sign", "target"]


def _heap(rng: Rng, count: int, spread: float, radii: tuple[float, float], flat: float = 1.0) -> list[Part]:
    """Return balls on the ground about a large one in the middle."""
    parts = [ellipsoid([0, 0.6 * flat, 0], [0.62, 0.62 * flat, 0.62])]
    for k in range(count):
        angle, radius = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / count, rng.uniform(*radii)
        place = [spread * np.sin(angle), radius * flat * rng.uniform(0.8, 1.3), 0.75 * spread * np.cos(angle)]
        parts.append(ellipsoid(place, [radius, radius * flat, radius], rings=10))
    return parts


def rock(rng: Rng, _: Traits) -> Part:
    """Draw a rock: a ball cut by planes, wider than tall, sometimes with a smaller one beside it."""
    parts = []
    for size, x in ((1.0, 0.0), *(((rng.uniform(0.35, 0.55), rng.choice([-0.9, 0.9])),) if rng.random() < 0.35 else ())):
        verts = ellipsoid([0, 0, 0], 1.0, rings=24).verts
        for _cut in range(14):
            normal = rng.normal(size=3)
            normal /= np.linalg.norm(normal)
            over = np.maximum(verts @ normal - rng.uniform(0.62, 0.85), 0.0)
            verts = verts - over[:, None] * normal
        shape = Part(verts * rng.uniform([0.8, 0.5, 0.7], [1.0, 0.8, 0.95]) * size, ellipsoid([0, 0, 0], 1, rings=24).faces)
        parts.append(moved(shape, [x, -0.3 * (1 - size), 0.2 * x]))
    return join(parts)


def cloud(rng: Rng, _: Traits) -> Part:
    """Draw a cloud: a wide row of balls, high in the middle, flat below."""
    count = int(rng.integers(4, 7))
    spread = np.linspace(-1, 1, count)
    parts = []
    for x in spread:
        radius = (0.62 - 0.3 * x * x) * rng.uniform(0.85, 1.15)
        parts.append(ellipsoid([x, 0.55 * radius, rng.uniform(-0.12, 0.12)], [radius, radius, 0.85 * radius], rings=12))
    whole = join(parts)
    verts = whole.verts.copy()
    verts[:, 1] = np.where(verts[:, 1] < 0, 0.35 * verts[:, 1], verts[:, 1])
    return Part(verts, whole.faces)


def bush(rng: Rng, _: Traits) -> Part:
    """Draw a bush: a round heap of leafy balls on the ground, without a trunk; some are clipped to a box."""
    if rng.random() < 0.2:
        hedge = [box([0, 0.4, 0], [rng.uniform(1.4, 1.9), 0.8, 0.6], round_by=0.25)]
        tops = [ellipsoid([x, 0.74, 0], [0.3, 0.16, 0.3], rings=8) for x in np.linspace(-0.6, 0.6, 4)]
        return join(hedge + tops)
    parts = _heap(rng, int(rng.integers(6, 9)), rng.uniform(0.5, 0.65), (0.28, 0.4), rng.uniform(0.8, 1.1))
    for _leaf in range(6):
        way = rng.normal(size=3) * [1, 0.6, 1] + [0, 1, 0]
        parts.append(ellipsoid([0, 0.6, 0] + 0.6 * way / np.linalg.norm(way), rng.uniform(0.16, 0.26), rings=8))
    return join(parts)


def coin(rng: Rng, _: Traits) -> Part:
    """Draw a coin that stands on its edge: a thick disc with a rim and a star, a square or a bar in relief."""
    thick, kind = rng.uniform(0.16, 0.26), int(rng.integers(3))
    profile = [(0.8, -thick / 2), (0.82, -thick), (0.97, -thick), (1.0, -0.7 * thick), (1.0, 0.7 * thick)]
    parts = [lathe([*profile, (0.97, thick), (0.82, thick), (0.8, thick / 2)], segments=36)]
    corners = (10, 4, 4)[kind]
    turn = np.pi / 2 + 2 * np.pi * np.arange(corners) / corners
    reach = np.where(np.arange(corners) % 2, 0.24, 0.56) if kind == 0 else np.full(corners, 0.5)
    relief = extrude(np.stack([reach * np.cos(turn), reach * np.sin(turn)], 1), 2 * thick, bevel=0.2)
    if kind == 2:
        relief = box([0, 0, 0], [0.2, 0.9, 2 * thick], round_by=0.3)
    return join([turned(parts[0], 90, "x"), relief])


def crystal(rng: Rng, _: Traits) -> Part:
    """Draw crystals: one cut stone with a point above and below, or a bunch of prisms with points that lean apart."""
    if rng.random() < 0.4:
        wide, sides = rng.uniform(0.45, 0.75), int(rng.integers(5, 9))
        return lathe([(0.02, -0.9), (wide, 0.1), (wide, 0.25), (0.55 * wide, 0.55)], segments=sides)
    parts = [ellipsoid([0, 0.05, 0], [0.55, 0.16, 0.5], rings=8)]
    for k in range(int(rng.integers(4, 7))):
        tall, wide = (1.5, 0.24) if k == 0 else (rng.uniform(0.6, 1.1), rng.uniform(0.13, 0.19))
        prism = lathe([(wide, -0.1), (1.1 * wide, 0.7 * tall), (0.02, tall)], segments=6)
        lean = turned(prism, 0 if k == 0 else rng.uniform(18, 38), "x")
        parts.append(turned(lean, 72 * k + rng.uniform(-15, 15), "y"))
    return join(parts)


def sign(rng: Rng, _: Traits) -> Part:
    """Draw a sign on a post: a board, an arrow that points aside, a disc or an octagon, one or two of them."""
    tall, kind = rng.uniform(1.3, 1.7), int(rng.integers(4))
    parts = [limb([[0, 0, 0], [0, tall, 0]], [0.08, 0.07]), box([0, 0.04, 0], [0.36, 0.12, 0.36])]
    if kind > 1:
        turn = 2 * np.pi * (np.arange(8 if kind == 3 else 28) + 0.5) / (8 if kind == 3 else 28)
        board = extrude(np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn)], 1), 0.16)
        return join([*parts, moved(board, [0, tall, 0.06])])
    half = rng.uniform(0.6, 0.75)
    outline = [(-half, -0.2), (half, -0.2), (half, 0.2), (-half, 0.2)]
    if kind == 1:
        outline = [(-half, -0.2), (0.7 * half, -0.2), (1.1 * half, 0.0), (0.7 * half, 0.2), (-half, 0.2)]
    board = extrude(outline, 0.16)
    parts += [moved(board, [0.1 * kind, tall - 0.12, 0.06])]
    if rng.random() < 0.5:
        parts += [moved(turned(board, 180 * kind, "y"), [0, tall - 0.62, 0.06 - 0.12 * kind])]
    return join(parts)


def target(rng: Rng, _: Traits) -> Part:
    """Draw a target: a thick disc with rings about its middle, faced to the front, on two or three legs."""
    thick, level = rng.uniform(0.14, 0.24), rng.uniform(0.9, 1.1)
    rings = [disc(r, 0, thick + step * 0.05, edge=0.02) for step, r in enumerate((0.75, 0.52, 0.28))]
    parts = [moved(turned(ring, 90, "x"), [0, level, 0]) for ring in rings]
    legs = [[0.35, level, -0.02], [0.5, 0, 0.12]]
    parts += [limb(legs, [0.08, 0.07]), limb(np.array(legs) * [-1, 1, 1], [0.08, 0.07])]
    return join([*parts, limb([[0, level, -0.05], [0, 0, -0.65]], [0.08, 0.07])])
