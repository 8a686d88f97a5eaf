"""Draw vessels and food: what stands on a stove, in a cupboard or on a plate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import (
    SEGMENTS,
    Part,
    ellipsoid,
    extrude,
    join,
    lathe,
    limb,
    mirrored,
    moved,
    turned,
)  # fmt: skip
from meshdeform.nouns.families.traits import Rng, Traits


def vessel(outer: ArrayLike, wall: float, floor: float, segments: int = SEGMENTS) -> Part:
    """Return a vessel of an outer profile (radius, height) from foot to rim, hollow down to `floor`."""
    outside = np.asarray(outer, float)
    inside = outside[outside[:, 1] > floor][::-1] - [wall, 0.0]
    return lathe([*outside, *inside, (0.9 * inside[-1, 0], floor)], segments=segments)


def _ear(root: float, low: float, high: float, reach: float, thick: float) -> list[Part]:
    """Return a handle whose middle is closed by a skin, as a deformed ball has no hole."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 9)
    bow = np.stack([root + reach * np.cos(turn) ** 0.7, (low + high) / 2 + (high - low) / 2 * np.sin(turn)], 1)
    return [limb(np.c_[bow, np.zeros(9)], np.full(9, thick), segments=10, samples=3), extrude(bow, 0.08)]


def mug(rng: Rng, _: Traits) -> Part:
    """Draw a straight mug, a tea cup that narrows to its foot, or a tankard that widens; its handle toward -X."""
    wide, kind = rng.uniform(0.44, 0.54), rng.integers(3)
    high, foot = rng.uniform(0.9, 1.1) * (1.0, 0.75, 1.2)[kind], wide * (0.97, 0.5, 1.15)[kind]
    share = np.array([0.0, 0.06, 0.16, 0.2, 0.4, 0.6, 0.8, 0.84, 0.94, 1.0])
    band = 0.05 * ((share < 0.18) | (share > 0.82)) * (kind == 2)
    wall = np.stack([foot + (wide - foot) * np.sqrt(share) + band, high * share], 1)
    handle = _ear(0.92 * wide, 0.22 * high, 0.82 * high, rng.uniform(0.32, 0.42), rng.uniform(0.08, 0.1))
    return join([vessel(wall, 0.09, 0.12), *map(mirrored, handle)])


def pan(rng: Rng, _: Traits) -> Part:
    """Draw a frying pan with a long handle toward +X."""
    wide, deep = rng.uniform(0.62, 0.75), rng.uniform(0.2, 0.32)
    body = vessel([(0.78 * wide, 0.0), (0.84 * wide, 0.03), (wide, deep - 0.03), (1.03 * wide, deep)], 0.09, 0.08)
    root, reach, rise = 0.95 * wide, rng.uniform(0.85, 1.1), rng.uniform(0.0, 0.2)
    path = [[root, deep - 0.09, 0], [root + 0.3 * reach, deep + 0.4 * rise, 0], [root + reach, deep + rise, 0]]
    return join([body, limb(path, [[0.09, 0.07], [0.08, 0.09], [0.09, 0.13]], segments=12)])


def jar(rng: Rng, _: Traits) -> Part:
    """Draw a jar with shoulders, a short neck and a broad lid: straight, round, or of earth with a cloth tied on."""
    wide, high, kind = rng.uniform(0.44, 0.52), rng.uniform(0.85, 1.1), rng.integers(3)
    share = np.linspace(0.0, 1.0, 12)
    belly = (0.1 + 0.9 * np.sin(np.pi * np.clip(share, 0.0, 1.0)) ** 0.5) if kind else np.ones(12)
    radius = (0.74 if kind else 0.96) * wide + (0.3 if kind else 0.04) * wide * belly
    neck = [(0.74 * wide, high + 0.05), (0.72 * wide, high + 0.14)]
    lid = wide * rng.uniform(0.84, 0.92)
    top = [(lid, high + 0.14), (lid, high + 0.32), (lid - 0.06, high + 0.36)]
    parts = [lathe([(0.8 * wide, 0.0), *np.stack([radius, 0.04 + (high - 0.08) * share], 1), *neck, *top])]
    if kind == 1:
        parts += [ellipsoid([0, high + 0.42, 0], [0.13, 0.1, 0.13])]
    if kind == 2:
        cloth = [(lid, 0.1), (lid + 0.16, 0.02), (lid + 0.02, 0.2), (0.6 * lid, 0.42)]
        parts += [lathe(np.array(cloth) + [0, high])]
    return join(parts)


def can(rng: Rng, _: Traits) -> Part:
    """Draw a tin with ribs and rims, or a can of a drink with a narrow neck and foot, its lid sunk."""
    wide, high, ribs = rng.uniform(0.4, 0.55), rng.uniform(1.0, 1.4), rng.random() < 0.5
    if ribs:
        share = np.linspace(0.0, 1.0, 33)
        wave = 0.035 * np.cos(share * 8 * np.pi) * (abs(share - 0.5) < 0.32)
        side = [(wide + wave[k], 0.06 + (high - 0.12) * share[k]) for k in range(33)]
        rims = [(wide + 0.05, 0.0), (wide + 0.05, 0.06)], [(wide + 0.05, high - 0.06), (wide + 0.05, high)]
        wall = [*rims[0], *side, *rims[1]]
    else:
        neck, high = 0.76 * wide, high + 0.2
        wall = [(neck, 0.0), (wide, 0.14), (wide, 0.5 * high), (wide, high - 0.2), (neck, high - 0.05)]
        wall += [(neck + 0.03, high)]
    return vessel(wall, 0.07, high - 0.09)


def potion(rng: Rng, _: Traits) -> Part:
    """Draw a flask with a collar, a long neck and a cork: round, conical or heart-like with broad shoulders."""
    wide, neck, kind = rng.uniform(0.5, 0.62), rng.uniform(0.15, 0.19), rng.integers(3)
    share = np.linspace(0.0, 1.0, 14)
    round_, heart = np.sqrt(np.clip(1 - (2 * share - 1) ** 2, 0, 1)), (0.35 + 0.65 * share) * (1 - share**6)
    radius = np.maximum(wide * (round_, 1.0 - 0.85 * share**0.9, heart)[kind], np.where(share > 0.5, neck, 0.5 * wide))
    body = rng.uniform(0.9, 1.05)
    rise = body + rng.uniform(0.22, 0.36)
    collar = [(neck, rise), (neck + 0.09, rise + 0.02), (neck + 0.09, rise + 0.12), (neck - 0.02, rise + 0.13)]
    cork = [(neck - 0.01, rise + 0.2), (neck + 0.02, rise + 0.34)]
    return lathe([*np.stack([radius, body * share], 1), (neck, body + 0.05), *collar, *cork])


def bread(rng: Rng, _: Traits) -> Part:
    """Draw a long loaf with cuts across, a round one with a grid of cuts, or a tin loaf with a swollen top, along X."""
    long, kind = rng.uniform(0.75, 0.95), rng.integers(3)
    if kind == 2:
        turn = np.linspace(-0.25, np.pi + 0.25, 15)
        crown = [(0.5 * np.cos(t), 0.62 + 0.28 * np.sin(t)) for t in turn]
        slice_ = [(-0.4, 0.0), (0.0, 0.0), (0.4, 0.0), *crown]
        return turned(extrude(slice_, 1.7 * long, bevel=0.08, puff=0.02), 90, "y")
    if kind:
        crust = lathe([(0.7, 0.0), (0.84, 0.1), (0.88, 0.24), (0.8, 0.4), (0.6, 0.52), (0.3, 0.58)])
        cut = limb([[-0.62, 0.46, 0], [-0.3, 0.57, 0], [0.3, 0.57, 0], [0.62, 0.46, 0]], np.full(4, 0.09), segments=10)
        return join([crust, *(moved(cut, [0, -0.03 * abs(z), z]) for z in (-0.36, 0.0, 0.36)), turned(cut, 90, "y")])
    loaf = limb([[-long, 0.3, 0], [0, 0.32, 0], [long, 0.3, 0]], [[0.22, 0.26], [0.3, 0.4], [0.22, 0.26]], segments=20)
    cut = limb([[-0.1, 0.52, -0.24], [0, 0.6, 0], [0.1, 0.52, 0.24]], [0.07, 0.1, 0.07], segments=10)
    return join([loaf, *(moved(cut, [x * long, -0.1 * abs(x), 0]) for x in (-0.75, -0.25, 0.25, 0.75))])


def hotdog(rng: Rng, _: Traits) -> Part:
    """Draw a hot dog along X: a sausage longer than its bun, with a wave of mustard on top."""
    long, thick = rng.uniform(0.8, 0.95), rng.uniform(0.17, 0.21)
    half = limb([[-long, 0.24, 0.2], [0, 0.26, 0.25], [long, 0.24, 0.2]], [[0.2, 0.22], [0.23, 0.26], [0.2, 0.22]])
    ends = rng.uniform(1.15, 1.3) * long
    sausage = limb([[-ends, 0.5, 0], [-0.5 * long, 0.38, 0], [0.5 * long, 0.38, 0], [ends, 0.5, 0]], np.full(4, thick))
    x = np.linspace(-0.9 * long, 0.9 * long, 25)
    wave = np.stack([x, 0.36 + thick + 0 * x, 0.09 * np.sin(np.linspace(0, 8 * np.pi, 25))], 1)
    bun = [half, Part(half.verts * [1, 1, -1], half.faces[:, ::-1].copy())]
    return join([*bun, sausage, limb(wave, np.full(25, 0.06), samples=1)])
