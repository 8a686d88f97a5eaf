"""Draw what families of many archetypes share: a size that a prompt can set, small balls, thin limbs, thin blades."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Array, Part, curved, lathe, limb, moved, named, pair, plate, stretched
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bead", "bent_limb", "blade", "circle", "kind", "near", "on", "pairs", "petal", "sized", "varied"]

Family = Callable[[Rng, Traits], Part]

_PETAL = [(0, 0.15), (0.35, 0.45), (0.75, 0.5), (0.95, 0.25), (1, 0), (0.9, -0.3), (0.6, -0.5), (0.3, -0.4), (0, -0.15)]


def near(rng: Rng, usual: float) -> float:
    """Draw a size near its usual one."""
    return float(rng.uniform(0.82, 1.2) * usual)


def sized(rng: Rng, traits: Traits, part: str, usual: float, by: float = 2.4) -> float:
    """Draw the size of a part near its usual one, or `by` times less or greater."""
    low, high = 0.82 * usual, 1.2 * usual
    return traits.draw(rng, part, (low / by, high / by), (low, high), (low * by, high * by))


def on(middle: Array, radius: float, *place: float) -> Array:
    """Return a place (3,) given in radii from the middle of a ball, such as a head."""
    return middle + radius * np.array(place)


def kind(name: str, draw: Family) -> Family:
    """Return a family under a name."""
    draw.__name__ = name
    return draw


def pairs(parts: Iterable[Part]) -> list[Part]:
    """Return parts with their mirror images."""
    return [side for part in parts for side in pair(part)]


def bead(centre: ArrayLike, radii: ArrayLike, *, segments: int = 10, rings: int = 6) -> Part:
    """Return an ellipsoid of few faces, such as an eye; `radii` is one number or three."""
    polar = np.linspace(0.0, np.pi, rings + 1)
    ball = lathe(np.stack([np.sin(polar), -np.cos(polar)], 1), segments=segments)
    return moved(stretched(ball, *np.broadcast_to(np.asarray(radii, float), 3)), centre)


def bent_limb(path: ArrayLike | Sequence[object], radii: ArrayLike, *, segments: int = 10, samples: int = 3) -> Part:
    """Return a limb along the curve through `path` (N, 3), with radii (N,) or (N, 2)."""
    points, widths = np.asarray(path, float), np.asarray(radii, float)
    knots = curved(np.column_stack([points, widths]), samples=samples)
    return limb(knots[:, :3], knots[:, 3] if widths.ndim == 1 else knots[:, 3:], segments=segments, samples=1)


def blade(outline: ArrayLike, size: float, *, across: str = "x", thick: float = 0.07) -> Part:
    """Return a thin plate, such as a fin, with `size` times an outline (N, 2)."""
    return plate(size * np.asarray(outline, float), thick, across=across)


def petal(length: float, width: float, *, thick: float = 0.06) -> Part:
    """Return a level wing or leaf with a round end, which reaches out along X."""
    return plate(np.array(_PETAL) * [length, width], thick, across="y")


def circle(radius: float, count: int) -> Array:
    """Return places (count, 3) on a level circle, the first ahead."""
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.stack([np.sin(angle), np.zeros(count), np.cos(angle)], 1)


def varied(rng: Rng, **solids: Part | Sequence[Part]) -> Part:
    """Join named solids, stretched a little along each axis: no two members are of one build."""
    return stretched(named(**solids), *rng.uniform(0.85, 1.18, 3))
