"""Draw furniture: boxes with rounded edges and thick legs."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, box, ellipsoid, join, lathe, limb, moved, pair
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = [
    "armchair",
    "bathtub",
    "bed",
    "bench",
    "cabinet",
    "chair",
    "desk",
    "piano",
    "sofa",
    "stool",
    "table",
    "television",
]


def _legs(half_width: float, half_depth: float, height: float, radius: float) -> list[Part]:
    legs: list[Part] = []
    for z in (-half_depth, half_depth):
        foot, top = (half_width, radius * 0.5, z), (half_width, height, z)
        legs += pair(limb([foot, top], [radius * 0.85, radius], segments=10))
    return legs


def table(rng: Rng, traits: Traits) -> Part:
    """Draw a table: a thick top on four legs at its corners."""
    width, depth = rng.uniform(1.5, 1.8), rng.uniform(0.95, 1.25)
    height = traits.draw(rng, "legs", (0.3, 0.4), (0.72, 0.9), (1.35, 1.65))
    radius, slab = rng.uniform(0.11, 0.135), rng.uniform(0.16, 0.2)
    top = box([0, height, 0], [width, slab, depth])
    return join([top, *_legs(width / 2 - radius * 1.15, depth / 2 - radius * 1.15, height, radius)])


def chair(rng: Rng, traits: Traits) -> Part:
    """Draw a chair: a square seat on four legs, with a tall back behind (-Z)."""
    width, depth = rng.uniform(0.8, 0.92), rng.uniform(0.8, 0.92)
    height = traits.draw(rng, "legs", (0.22, 0.3), (0.55, 0.7), (1.1, 1.35))
    rise = traits.draw(rng, "back", (0.28, 0.38), (0.78, 0.95), (1.5, 1.8))
    radius, slab = rng.uniform(0.1, 0.12), rng.uniform(0.17, 0.21)
    seat = box([0, height, 0], [width, slab, depth])
    back = box([0, height + rise / 2, -depth / 2 + slab / 2], [width, rise + slab, slab])
    return join([seat, back, *_legs(width / 2 - radius, depth / 2 - radius, height, radius)])


def sofa(rng: Rng, traits: Traits) -> Part:
    """Draw a sofa: a long low seat between two arm rests, with a back."""
    width, depth = rng.uniform(1.7, 2.0), rng.uniform(0.8, 0.92)
    seat, arm = rng.uniform(0.38, 0.46), rng.uniform(0.24, 0.3)
    rise = traits.draw(rng, "back", (0.0, 0.06), (0.42, 0.54), (1.0, 1.2))
    cushion = box([0, seat / 2, 0.05], [width, seat, depth], round_by=0.3)
    back = box([0, (seat + rise) / 2, -depth / 2 + 0.14], [width, seat + rise, 0.28], round_by=0.4)
    rest = box([width / 2 - arm / 2, seat * 0.78, 0.03], [arm, seat * 1.56, depth + 0.06], round_by=0.45)
    return join([cushion, back, *pair(rest)])


def armchair(rng: Rng, traits: Traits) -> Part:
    """Draw an armchair: one deep cushion between rolled arms, a high padded back with wings, on short feet."""
    width, depth = rng.uniform(1.0, 1.12), rng.uniform(0.9, 1.02)
    seat, roll = rng.uniform(0.42, 0.5), rng.uniform(0.15, 0.18)
    rise = traits.draw(rng, "back", (0.1, 0.16), (0.7, 0.85), (1.45, 1.7))
    side, rear = width / 2 - roll, -depth / 2 + 0.16
    parts = [box([0, seat / 2 + 0.06, 0], [width - 0.1, seat - 0.12, depth], round_by=0.1)]
    parts += [box([0, seat, 0.08], [width - 2.6 * roll, 0.24, depth * 0.86], round_by=0.5)]
    parts += [box([0, (seat + rise) / 2 + 0.1, rear], [width * 0.84, seat + rise - 0.2, 0.3], round_by=0.5)]
    arm = box([side, seat * 0.6 + 0.1, 0], [1.5 * roll, seat + 0.2, depth], round_by=0.2)
    top = limb([[side, seat + 0.22, -depth / 2 + 0.1], [side, seat + 0.22, depth / 2 - 0.02]], [roll, roll * 1.1])
    wing = box([side, seat + 0.32 * rise, rear + 0.14], [roll, 0.8 * rise, 0.4], round_by=0.5)
    return join([*parts, *pair(arm), *pair(top), *pair(wing), *_legs(width / 2 - 0.14, depth / 2 - 0.12, 0.14, 0.1)])


def bathtub(rng: Rng, _: Traits) -> Part:
    """Draw a bathtub: a long hollow basin with a rolled rim on four feet, its head end high, a tap at its foot (+Z)."""
    width, length, deep = rng.uniform(0.46, 0.54), rng.uniform(0.9, 1.05), rng.uniform(0.55, 0.65)
    slope, lift = rng.uniform(0.66, 0.78), rng.uniform(0.1, 0.24)
    outer = [(slope, 0.0), (slope + 0.12, 0.14), (0.95, 0.75 * deep), (0.96, deep - 0.1)]
    rim = [(1.06, deep - 0.07), (1.08, deep), (1.0, deep + 0.03), (0.88, deep)]
    shell = lathe([*outer, *rim, (0.84, 0.7 * deep), (0.7, 0.2), (0.0, 0.16)], segments=40)
    x, y, z = shell.verts.T
    # A rounded rectangle from above; the head end rises.
    round_ = np.maximum(np.abs(x), np.abs(z))
    square = np.hypot(x, z) / np.where(round_ > 0, round_, 1.0)
    x, z = x * square**0.6, z * square**0.6
    head = np.clip(-z, 0, 1) ** 2 * np.clip(y / deep, 0, 1)
    basin = Part(np.stack([x * width, 0.2 + y + lift * head, z * length], 1), shell.faces)
    feet: list[Part] = []
    for end in (-0.6, 0.6):
        feet += pair(limb([[width * 0.62, 0.3, end * length], [width * 0.8, 0.08, end * length]], [0.13, 0.1]))
    top = deep + 0.2
    spout = [[0, top - 0.1, length * 0.98], [0, top + 0.32, length * 0.98], [0, top + 0.3, length * 0.72]]
    return join([basin, *feet, limb(spout, [0.09, 0.085, 0.085], segments=10)])


def bed(rng: Rng, traits: Traits) -> Part:
    """Draw a bed: a mattress on a low frame, a blanket over its foot, pillows at a headboard behind (-Z)."""
    width, length, height = rng.uniform(1.0, 1.35), rng.uniform(1.75, 2.0), rng.uniform(0.26, 0.34)
    rise = traits.draw(rng, "back", (0.02, 0.08), (0.46, 0.58), (1.15, 1.4))
    frame = box([0, height, 0], [width, 0.18, length], round_by=0.2)
    mattress = box([0, height + 0.16, 0], [width * 0.94, 0.26, length * 0.96], round_by=0.4)
    blanket = box([0, height + 0.16, length * 0.17], [width * 1.05, 0.34, length * 0.6], round_by=0.35)
    top = height + 0.2 + rise
    head = box([0, top / 2 + 0.06, -length / 2], [width * 1.06, top - 0.12, 0.16], round_by=0.4)
    foot = box([0, height + 0.1, length / 2], [width * 1.06, 0.56, 0.15], round_by=0.4)
    pillow = ellipsoid([width * 0.24, height + 0.34, -length * 0.33], [width * 0.22, 0.13, 0.2], rings=10)
    return join(
        [frame, mattress, blanket, head, foot, *pair(pillow), *_legs(width / 2 - 0.08, length / 2, height, 0.1)]
    )


def bench(rng: Rng, traits: Traits) -> Part:
    """Draw a park bench: a wide seat and a leaning back of round planks, on thick legs at its ends."""
    width, plank = rng.uniform(1.8, 2.15), rng.uniform(0.12, 0.14)
    height = traits.draw(rng, "legs", (0.1, 0.16), (0.44, 0.54), (1.1, 1.3))
    places = [(height, z) for z in np.linspace(0.3, -0.18, 3)]
    places += [(height + 0.2 + step, -0.3 - 0.35 * step) for step in (0.02, 0.25, 0.48)]
    across = width / 2 - 0.05
    planks = [
        limb([[-across, y, z], [across, y, z]], [[0.075, plank], [0.075, plank]], segments=12) for y, z in places[:3]
    ]
    planks += [
        limb([[-across, y, z], [across, y, z]], [[plank, 0.075], [plank, 0.075]], segments=12) for y, z in places[3:]
    ]
    end = width / 2 - 0.22
    parts = [limb([[end, 0.06, 0.38], [end, height, 0.3]], [0.11, 0.1], segments=10)]
    parts.append(
        limb([[end, 0.06, -0.38], [end, height, -0.26], [end, height + 0.72, -0.54]], [0.11, 0.1, 0.08], segments=10)
    )
    parts.append(limb([[end, height - 0.02, 0.3], [end, height - 0.02, -0.3]], [0.1, 0.1], segments=10))
    return join([*planks, *(side for part in parts for side in pair(part))])


def cabinet(rng: Rng, traits: Traits) -> Part:
    """Draw a cabinet: a tall case with a cornice, two raised doors with knobs side by side, on four legs."""
    width, height, depth = rng.uniform(0.95, 1.15), rng.uniform(1.3, 1.55), rng.uniform(0.5, 0.6)
    legs = traits.draw(rng, "legs", (0.04, 0.08), (0.22, 0.3), (0.8, 1.0))
    case = box([0, legs + height / 2, 0], [width, height, depth], round_by=0.06)
    cornice = box([0, legs + height, 0.02], [width + 0.18, 0.15, depth + 0.18], round_by=0.35)
    plinth = box([0, legs + 0.05, 0.02], [width + 0.08, 0.13, depth + 0.1], round_by=0.3)
    door = box([width * 0.25, legs + height / 2, depth / 2], [width * 0.43, height * 0.78, 0.16], round_by=0.48)
    knob = ellipsoid([width * 0.1, legs + height / 2, depth / 2 + 0.12], 0.085, rings=8)
    feet = _legs(width / 2 - 0.08, depth / 2 - 0.08, legs + 0.05, 0.105)
    return join([case, cornice, plinth, *pair(door), *pair(knob), *feet])


def desk(rng: Rng, traits: Traits) -> Part:
    """Draw a writing desk: a wide top, a block of drawers with knobs under its right, a panel behind, four legs."""
    width, depth, slab = rng.uniform(1.6, 1.85), rng.uniform(0.72, 0.85), rng.uniform(0.13, 0.16)
    legs = traits.draw(rng, "legs", (0.04, 0.09), (0.3, 0.4), (1.0, 1.2))
    block, tall = rng.uniform(0.5, 0.6), rng.uniform(0.5, 0.58)
    top = legs + tall
    x, front = width / 2 - block / 2 - 0.05, depth / 2 - 0.04
    parts = [box([0, top, 0], [width + 0.08, slab, depth + 0.08], round_by=0.3)]
    parts += [box([x, top - tall / 2, 0], [block, tall, depth - 0.08], round_by=0.06)]
    parts += [box([0, top - tall * 0.42, -depth / 2 + 0.1], [width - 0.1, tall * 0.84, 0.12], round_by=0.3)]
    for place in (0.3, 0.76):
        parts.append(box([x, top - tall * place, front], [block * 0.88, tall * 0.38, 0.12], round_by=0.48))
        parts.append(ellipsoid([x, top - tall * place, front + 0.1], 0.07, rings=8))
    return join([*parts, *_legs(width / 2 - 0.13, depth / 2 - 0.12, top, 0.105)])


def piano(rng: Rng, traits: Traits) -> Part:
    """Draw an upright piano: a tall case with a lid, a shelf of keys in front (+Z) on two legs, a music rest."""
    width, depth, above = rng.uniform(1.4, 1.6), rng.uniform(0.36, 0.42), rng.uniform(0.55, 0.68)
    legs = traits.draw(rng, "legs", (0.16, 0.22), (0.5, 0.6), (1.15, 1.35))
    shelf = rng.uniform(0.44, 0.52)
    front = depth / 2
    case = box([0, (legs + above) / 2, 0], [width, legs + above, depth], round_by=0.08)
    lid = box([0, legs + above, 0.03], [width + 0.14, 0.13, depth + 0.16], round_by=0.35)
    board = box([0, legs, front + shelf / 2 - 0.05], [width, 0.17, shelf + 0.1], round_by=0.2)
    cheek = box([width / 2 - 0.06, legs + 0.12, front + shelf / 2 - 0.04], [0.15, 0.22, shelf + 0.08], round_by=0.35)
    spots = np.linspace(-width / 2 + 0.22, width / 2 - 0.22, 7)
    keys = [box([x, legs + 0.09, front + shelf * 0.55], [0.165, 0.12, shelf * 0.82], round_by=0.4) for x in spots]
    rest = box([0, legs + above * 0.58, front + 0.03], [width * 0.6, above * 0.55, 0.12], round_by=0.45)
    leg = limb(
        [[width / 2 - 0.1, 0.06, front + shelf - 0.1], [width / 2 - 0.1, legs, front + shelf - 0.1]], [0.085, 0.11]
    )
    pedal = box([0.12, 0.07, front + 0.08], [0.13, 0.1, 0.26], round_by=0.4)
    return join([case, lid, board, rest, *keys, *pair(cheek), *pair(leg), *pair(pedal)])


def stool(rng: Rng, traits: Traits) -> Part:
    """Draw a stool: a thick round cushion on a ring, on four legs that spread, without a back."""
    radius, slab = rng.uniform(0.42, 0.5), rng.uniform(0.2, 0.26)
    height = traits.draw(rng, "legs", (0.2, 0.28), (0.72, 0.88), (1.5, 1.8))
    spread = rng.uniform(0.85, 1.05) * radius
    seat = [(radius * 0.82, -0.06), (radius * 0.86, 0.04), (radius, 0.07), (radius * 1.03, slab * 0.6)]
    cushion = lathe([*seat, (radius * 0.9, slab), (radius * 0.5, slab + 0.05)])
    foot, top = [spread, 0.05, spread], [radius * 0.5, height, radius * 0.5]
    legs = [part for z in (1, -1) for part in pair(limb(np.array([foot, top]) * [1, 1, z], [0.085, 0.1], segments=10))]
    return join([moved(cushion, [0, height, 0]), *legs])


def television(rng: Rng, traits: Traits) -> Part:
    """Draw a television: a wide screen sunk in a thick frame, a bulge behind, on a stem with a broad foot."""
    width, ratio, frame = rng.uniform(1.7, 1.95), rng.uniform(0.56, 0.64), rng.uniform(0.12, 0.15)
    stem = traits.draw(rng, "stem", (0.02, 0.06), (0.24, 0.32), (0.9, 1.1))
    height = width * ratio
    middle = 0.1 + stem + height / 2
    parts = [box([0, middle, 0], [width - 0.05, height - 0.05, 0.13], round_by=0.2)]
    parts += [box([0, middle - 0.05, -0.12], [width * 0.5, height * 0.55, 0.2], round_by=0.45)]
    for end in (-1, 1):
        parts.append(box([0, middle + end * (height - frame) / 2, 0.03], [width, frame, 0.24], round_by=0.35))
        parts.append(box([end * (width - frame) / 2, middle, 0.03], [frame, height, 0.24], round_by=0.35))
    foot = lathe([(0.46, 0.0), (0.46, 0.07), (0.38, 0.12), (0.1, 0.14)])
    pole = box([0, 0.06 + stem / 2, 0], [0.26, stem + 0.2, 0.16], round_by=0.3)
    return join([*parts, Part(foot.verts * [1.0, 1.0, 0.62], foot.faces), pole])
