"""Draw bridges along X, and stairs that wind: what is bent too much for a sketch."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block
from meshdeform.nouns.families.parts import Array, Part, disc, extrude, lathe, limb, moved, named, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bridge"]


def bridge(rng: Rng, _: Traits) -> Part:
    """Draw a bridge along X: a deck over one to three round arches, level or humped, between two parapets or rails."""
    half, deep, arches = rng.uniform(1.0, 1.3), rng.uniform(0.26, 0.36), int(rng.integers(1, 4))
    hump, stone = rng.uniform(0.0, 0.3) if arches == 1 else rng.uniform(0, 0.12), rng.random() < 0.6
    tall = rng.uniform(0.42, 0.6)
    line = np.linspace(-1, 1, 14 * arches + 1)
    phase = np.abs((line + 1) * arches / 2 % 1 - 0.5) * 2
    top = tall + hump * (1 - line**2)
    under = np.where(phase < 0.8, np.sqrt(np.clip(1 - (phase / 0.8) ** 2, 0, 1)) * (top - 0.16), 0.0)
    body = [_span(half * line, under, top, deep)]
    body += [
        moved(_span(half * line[::2], top[::2] - 0.07, top[::2] + 0.01, 0.05), [0, 0, side * deep]) for side in (1, -1)
    ]
    ends = [(x, z) for x in (-half, half) for z in (-deep, deep)]
    pillars = [block([x, 0, z], [0.15, tall + 0.26, 0.15], 0.1) for x, z in ends]
    if stone:
        rails = [moved(_span(half * line, top, top + 0.17, 0.04), [0, 0, z]) for z in (-deep, deep)]
        return named(body=body, rail=rails, pole=pillars)
    across = np.linspace(-1, 1, 9)
    path = np.stack([half * across, tall + hump * (1 - across**2) + 0.2, 0 * across + deep], 1)
    rails = [limb(path * [1, 1, side], [0.028] * len(path), segments=6, samples=1) for side in (1, -1)]
    pillars += [bar([x, y - 0.22, side * z], [x, y, side * z], 0.022, 6) for x, y, z in path[1:-1] for side in (1, -1)]
    return named(body=body, rail=rails, pole=pillars)


def suspension_bridge(rng: Rng, _: Traits) -> Part:
    """Draw a suspension bridge along X: a level deck that hangs on two ropes over two tall gates."""
    half, deep, deck, tall = (
        rng.uniform(1.4, 1.8),
        rng.uniform(0.18, 0.24),
        rng.uniform(0.3, 0.4),
        rng.uniform(0.9, 1.15),
    )
    gates = [block([x, 0, z], [0.12, tall, 0.1], 0.1) for x in (-0.55 * half, 0.55 * half) for z in (-deep, deep)]
    gates += [
        block([x, y, 0], [0.09, 0.09, 2 * deep], 0.1)
        for x in (-0.55 * half, 0.55 * half)
        for y in (0.5 * tall, tall - 0.09)
    ]
    gates += [block([x, 0, 0], [0.16, deck, 2 * deep - 0.04], 0.05) for x in (-half, half)]
    inner, outer = np.linspace(-0.55, 0.55, 9), np.linspace(0.55, 1, 4)
    sag = deck + 0.08 + (tall - deck - 0.08) * (inner / 0.55) ** 2
    slope = deck + (tall - deck) * (1 - (outer - 0.55) / 0.45)
    x = half * np.concatenate([-outer[:0:-1], inner, outer[1:]])
    y = np.concatenate([slope[:0:-1], sag, slope[1:]])
    ropes = [limb(np.c_[x, y, 0 * x + z], [0.025] * len(x), segments=6, samples=1) for z in (deep, -deep)]
    ropes += [
        bar([a, deck, z], [a, b, z], 0.016, 4) for a, b in zip(x[1:-1], y[1:-1], strict=True) for z in (deep, -deep)
    ]
    return named(body=block([0, deck - 0.05, 0], [2 * half, 0.09, 2 * deep - 0.03], 0.1, 4), pole=gates, rope=ropes)


def spiral_stairs(rng: Rng, _: Traits) -> Part:
    """Draw spiral stairs: wedge-shaped steps that wind up about a post, with a rail on thin bars."""
    count, radius, rise = int(rng.integers(10, 15)), rng.uniform(0.5, 0.65), rng.uniform(0.11, 0.14)
    turn = rng.uniform(24, 32)
    wedge = turned(extrude([(0.02, -0.06), (radius, -0.16), (radius, 0.16), (0.02, 0.06)], 0.06), -90, "x")
    steps = [moved(turned(wedge, turn * k, "y"), [0, (k + 1) * rise, 0]) for k in range(count)]
    angle = np.radians(turn * np.arange(count))
    path = np.stack(
        [0.93 * radius * np.cos(angle), (np.arange(count) + 1) * rise + 0.45, -0.93 * radius * np.sin(angle)], 1
    )
    bars = [bar(end - [0, 0.45, 0], end, 0.018, 4) for end in path]
    return named(
        step=steps,
        pole=[disc(0.08, 0, (count + 1) * rise + 0.5), *bars],
        rail=limb(path, [0.03] * count, segments=6, samples=2),
    )


def _span(x: Array, low: Array, high: Array, half: float) -> Part:
    """Return a bar along X of square section whose lower and upper sides run at the levels given at places x."""
    part = turned(lathe([(1.0, t) for t in range(len(x))], segments=8), -90, "z")
    at = np.round(part.verts[:, 0]).astype(int)
    section = part.verts[:, 1:]
    section = section / np.maximum(np.abs(section).max(1, keepdims=True), 1e-9)
    level = low[at] + (high - low)[at] * (section[:, 0] + 1) / 2
    return Part(np.stack([x[at], level, half * section[:, 1]], 1), part.faces)


KINDS = {"bridge": (suspension_bridge,), "stairs": (spiral_stairs,)}
