"""Draw vessels, a lamp, a bell and an umbrella, all solids of revolution, and what has no other place."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, box, ellipsoid, extrude, join, lathe, limb, pair
from meshdeform.nouns.families.traits import Rng, Traits


def vase(rng: Rng, traits: Traits) -> Part:
    """Draw a vase: a round belly, a narrow neck and a flared lip, open at the top."""
    belly, foot = rng.uniform(0.46, 0.58), rng.uniform(0.26, 0.34)
    neck = traits.draw(rng, "neck", (0.12, 0.18), (0.3, 0.42), (0.65, 0.85))
    throat, lip = rng.uniform(0.17, 0.22), rng.uniform(0.32, 0.42)
    body = rng.uniform(0.85, 1.0)
    turn = np.linspace(0.12, 0.88, 9)
    wall = [(foot + (belly - foot) * np.sin(np.pi * t) ** 0.8, body * t) for t in turn[:5]]
    wall += [(throat + (belly - throat) * np.sin(np.pi * t) ** 1.2, body * t) for t in turn[5:]]
    top = body + neck
    lips = [(throat, body), (throat, body + 0.6 * neck), (lip * 0.8, top - 0.04), (lip, top)]
    inside = [(lip * 0.85, top), (throat * 0.75, top - 0.12)]
    return lathe([(foot, 0.0), *wall, *lips, *inside])


def bottle(rng: Rng, traits: Traits) -> Part:
    """Draw a bottle: a straight cylinder with round shoulders and a closed, slim neck."""
    radius, body = rng.uniform(0.36, 0.44), rng.uniform(0.95, 1.15)
    neck = traits.draw(rng, "neck", (0.14, 0.2), (0.4, 0.55), (0.85, 1.1))
    throat, shoulder = rng.uniform(0.12, 0.15), rng.uniform(0.22, 0.32)
    turn = np.linspace(0.0, np.pi / 2, 6)
    shoulders = [(throat + (radius - throat) * np.cos(t), body + shoulder * np.sin(t)) for t in turn]
    top = body + shoulder + neck
    crown = [(throat, top - 0.14), (throat * 1.45, top - 0.12), (throat * 1.45, top)]
    return lathe(
        [(radius * 0.92, 0.0), (radius, 0.05), *[(radius, body * s) for s in (0.3, 0.6, 0.9)], *shoulders, *crown]
    )


def goblet(rng: Rng, traits: Traits) -> Part:
    """Draw a goblet: a cup on a stem on a wide foot."""
    foot, stalk = rng.uniform(0.4, 0.48), rng.uniform(0.13, 0.16)
    stem = traits.draw(rng, "stem", (0.14, 0.22), (0.48, 0.62), (0.95, 1.2))
    cup, depth = rng.uniform(0.42, 0.52), rng.uniform(0.65, 0.8)
    turn = np.linspace(0.15, 1.0, 7)
    bowl_wall = [(cup * np.sin(t * np.pi / 2) ** 0.8, 0.12 + stem + depth * t**1.6) for t in turn]
    inside = [(cup * 0.86, 0.12 + stem + depth), (cup * 0.7, stem + depth * 0.5), (0.1, stem + depth * 0.3)]
    # Soft bends above the foot and below the cup: a sharp one folds the skin of what is deformed into it.
    stalks = [(stalk * (1 + 0.5 * (2 * t - 0.9) ** 2), 0.14 + stem * t) for t in np.linspace(0.1, 0.85, 6)]
    return lathe([(foot, 0.0), (foot, 0.08), (0.7 * foot, 0.12), *stalks, *bowl_wall, *inside])


def bowl(rng: Rng, _: Traits) -> Part:
    """Draw a bowl: a wide hollow half sphere on a small foot."""
    radius, depth, foot = rng.uniform(0.85, 1.0), rng.uniform(0.6, 0.75), rng.uniform(0.32, 0.42)
    turn = np.linspace(0.3, np.pi / 2, 9)
    outer = [(radius * np.sin(t), depth * (1 - np.cos(t)) + 0.1) for t in turn]
    inner = [(0.87 * radius * np.sin(t), depth * (1 - 0.85 * np.cos(t)) + 0.1) for t in turn[::-1]]
    return lathe([(foot, 0.0), (foot * 0.9, 0.1), *outer, *inner, (0.0, 0.15 * depth + 0.1)], segments=28)


def bell(rng: Rng, traits: Traits) -> Part:
    """Draw a hand bell: a flared hollow skirt with its clapper, round shoulders, a handle with a knob."""
    mouth, waist, height = rng.uniform(0.56, 0.66), rng.uniform(0.32, 0.38), rng.uniform(0.78, 0.92)
    handle = traits.draw(rng, "handle", (0.04, 0.08), (0.36, 0.48), (1.05, 1.3))
    rise = np.linspace(0.0, 1.0, 7)
    skirt = [(waist + (mouth - waist) * (1 - t) ** 2.4, 0.8 * height * t) for t in rise]
    turn = np.linspace(0.3, np.pi / 2, 5)[:-1]
    shoulder = [(waist * np.cos(t) ** 0.7, (0.8 + 0.2 * np.sin(t)) * height) for t in turn]
    inside = [(0.86 * radius, level * 0.92) for radius, level in reversed(skirt)]
    shell = lathe([(0.0, 0.75 * height), *inside, *skirt, *shoulder, (0.0, height)])
    clapper = [limb([[0, 0.7 * height, 0], [0, 0.1, 0]], [0.06, 0.06], segments=8), ellipsoid([0, 0, 0], 0.16, rings=8)]
    knob = height + handle
    grip = lathe([(0.1, height * 0.94), (0.085, height + 0.06), (0.1, height + 0.5 * handle), (0.085, knob + 0.02)])
    return join([shell, *clapper, grip, ellipsoid([0, knob + 0.08, 0], 0.135, rings=8)])


def umbrella(rng: Rng, traits: Traits) -> Part:
    """Draw an open umbrella: a scalloped canopy with a tip on a shaft that ends in a hook, toward its right."""
    radius, dome = rng.uniform(0.88, 1.0), rng.uniform(0.46, 0.58)
    handle = traits.draw(rng, "handle", (0.22, 0.3), (0.78, 0.94), (1.7, 2.0))
    turn = np.linspace(0.1, np.pi / 2, 9)
    outer = [(radius * np.sin(t), dome * np.cos(t)) for t in turn[::-1]]
    inner = [(0.94 * radius * np.sin(t), dome * np.cos(t) - 0.09) for t in turn]
    canopy = lathe([(0.0, dome - 0.09), *inner, *outer, (0.0, dome)], segments=32)
    verts = canopy.verts.copy()
    across = np.hypot(verts[:, 0], verts[:, 2]) / radius
    # Eight ribs hold the rim down; between them the cloth is drawn up and in.
    slack = 0.5 - 0.5 * np.cos(8 * np.arctan2(verts[:, 0], verts[:, 2]))
    verts[:, 1] += 0.16 * slack * across**3
    verts[:, [0, 2]] *= (1 - 0.1 * slack * across**3)[:, None]
    bow, thick = rng.uniform(0.15, 0.19), 0.08
    bottom = -handle
    arc = np.linspace(0.0, np.pi * 1.1, 7)
    hook = [[bow * (np.cos(t) - 1), bottom - bow * np.sin(t), 0.0] for t in arc]
    shaft = limb([[0, dome * 0.9, 0], [0, bottom + 0.1, 0], *hook], [thick] * 9, segments=10, samples=3)
    tip = limb([[0, dome - 0.05, 0], [0, dome + 0.16, 0]], [0.06, 0.045], segments=8)
    return join([Part(verts, canopy.faces), shaft, tip])


def guitar(rng: Rng, traits: Traits) -> Part:
    """Draw a guitar standing upright, its strings toward +Z: a waisted body, a neck, a head with six pegs."""
    low, high, waist = rng.uniform(0.48, 0.54), rng.uniform(0.34, 0.38), rng.uniform(0.24, 0.28)
    height, deep = rng.uniform(1.1, 1.22), rng.uniform(0.24, 0.3)
    neck = traits.draw(rng, "neck", (0.1, 0.16), (0.75, 0.9), (1.6, 1.85))
    turn = np.linspace(0.0, np.pi, 25)[1:-1]
    share = (1 - np.cos(turn)) / 2
    bout = low + (high - low) / (1 + np.exp(-(share - 0.5) * 16))
    side = (bout - (bout - waist) * np.exp(-(((share - 0.6) / 0.16) ** 2))) * np.sin(turn) ** 0.55
    right = list(zip(side, height * share, strict=True))
    outline = [(0.0, 0.0), *right, (0.0, height), *[(-x, y) for x, y in reversed(right)]]
    parts = [extrude(outline, deep, bevel=0.15)]
    face, top = deep / 2, height + neck
    parts.append(box([0, height * 0.25, face], [0.34, 0.09, 0.1], cells=4))
    parts.append(ellipsoid([0, height * 0.56, face], [0.13, 0.13, 0.05], rings=8))
    parts.append(box([0, (height * 0.6 + top) / 2, face], [0.15, top - height * 0.6, 0.13], cells=12))
    parts.append(box([0, top + 0.14, face - 0.02], [0.26, 0.36, 0.12]))
    for level in (0.04, 0.14, 0.24):
        parts += pair(limb([[0.1, top + level, face], [0.2, top + level, face]], [0.045, 0.05], segments=8, samples=3))
    return join(parts)


def hat(rng: Rng, traits: Traits) -> Part:
    """Draw a round hat: a domed crown on a wide brim."""
    crown, height = rng.uniform(0.42, 0.48), rng.uniform(0.55, 0.7)
    brim = traits.draw(rng, "brim", (0.56, 0.6), (0.86, 0.98), (1.4, 1.6))
    droop = rng.uniform(0.0, 0.08)
    turn = np.linspace(0.2, 1.0, 6)
    dome = [
        (crown * np.cos(t * np.pi / 2) ** 0.5, 0.1 + height * (0.35 + 0.65 * np.sin(t * np.pi / 2))) for t in turn[:-1]
    ]
    disc = [(brim * 0.96, -droop), (brim, 0.05 - droop), (brim * 0.96, 0.11 - droop), (crown * 1.04, 0.14)]
    return lathe([(crown * 0.9, 0.0), *disc, (crown, 0.2), *dome, (0.0, 0.1 + height)], segments=28)


def star(rng: Rng, _: Traits) -> Part:
    """Draw a five-pointed star standing on two points, thickest in the middle, facing +Z."""
    inner = rng.uniform(0.42, 0.5)
    corners = []
    for point in range(10):
        angle = np.pi / 2 + point * np.pi / 5
        reach = 1.0 if point % 2 == 0 else inner
        corners.append((reach * np.cos(angle), reach * np.sin(angle)))
    return extrude(_refined(corners, 3), rng.uniform(0.22, 0.28), puff=rng.uniform(0.3, 0.45))


def heart(rng: Rng, _: Traits) -> Part:
    """Draw a heart standing on its point, thick and round as a cushion, facing +Z."""
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    x = 16 * np.sin(turn) ** 3
    y = 13 * np.cos(turn) - 5 * np.cos(2 * turn) - 2 * np.cos(3 * turn) - np.cos(4 * turn)
    outline = np.stack([x, y], 1)[::-1] / 16
    return extrude(
        outline * [1.0, rng.uniform(0.95, 1.1)], rng.uniform(0.36, 0.46), bevel=0.4, puff=rng.uniform(0.25, 0.4)
    )


def _refined(corners: list[tuple[float, float]], pieces: int) -> list[tuple[float, float]]:
    """Divide each edge of a polygon into equal pieces."""
    refined = []
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        refined += [(x0 + (x1 - x0) * k / pieces, y0 + (y1 - y0) * k / pieces) for k in range(pieces)]
    return refined
