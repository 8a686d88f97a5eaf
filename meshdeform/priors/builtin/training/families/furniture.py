"""Draw furniture: boxes with rounded edges and thick legs."""

from __future__ import annotations

from meshdeform.priors.builtin.training.families.parts import Part, box, join, limb, pair
from meshdeform.priors.builtin.training.families.traits import Rng, Traits

__all__ = ["chair", "sofa", "table"]


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
