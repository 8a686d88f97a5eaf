"""Find what a body stands on, by the layers of its solid: legs, or a pedestal.

Legs are what touches the ground below the level at which the stems join; of a pedestal, what is below the widest slab.
A trunk or a tail that reaches the ground alone on the mirror plane beside pairs of feet is none of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from meshdeform.plain.body import UP, Body, Flags, Floats, Index
from meshdeform.plain.pieces import PartMissingError

AROUND = np.ones((3, 3, 3))


@dataclass(frozen=True)
class Stand:
    """Find the feet on the ground: the level where it ends, the leg (C,) of each cell, 0 for none, and a trunk (C,)."""

    hip: float
    base: float
    labels: Index
    trunk: Flags
    count: int


def find_stand(body: Body) -> Stand:
    """Return the stand below the body, by the layers of its solid; PartMissingError: there is none."""
    solid = body.solid
    filled, areas = solid.filled, solid.filled.sum((0, 2)).astype(float)
    ground, top = int(np.argmax(areas > 0)), int(np.flatnonzero(areas > 0).max())
    plane, breadth = (body.middle - solid.origin[body.lateral]) / solid.side, filled.shape[body.lateral]

    def feet(layer: int) -> tuple[Index, list[int]]:
        labels, _ = ndimage.label(filled[:, ground : layer + 1], AROUND)
        return labels, [int(k) for k in np.unique(labels[:, :3]) if k > 0]

    trunk = np.zeros(filled.shape, bool)
    tips = _trunk_tips(*feet(ground + max(3, int(0.06 * (top - ground)))), body, plane, breadth)
    counts, kept = [], list[list[int]]()
    for layer in range(ground, top + 1):
        labels, soles = feet(layer)
        bad = {int(labels[tip]) for tip in tips if tip[1] < labels.shape[1]}
        good = []
        for k in soles:
            if k in bad:
                cells = np.argwhere(labels[:, :3] == k)
                if np.abs(cells[:, body.lateral] + 0.5 - plane).max() < 0.12 * breadth:
                    trunk[:, ground : layer + 1][labels == k] = True
                    continue
            good.append(k)
        counts.append(len(good))
        kept.append(good)
        if layer - ground > 10 and len(good) < 2 and len(soles) < 2:
            break
    number = np.array(counts)
    lowest = number[1 : max(3, int(0.12 * (top - ground)))]
    usual = int(np.bincount(lowest).argmax()) if len(lowest) else 1
    hip = int(np.flatnonzero(number >= 2).max()) if usual >= 2 else _pedestal(areas[ground : top + 1])
    if hip < max(3, 0.08 * (top - ground)) or hip > 0.95 * (top - ground):
        raise PartMissingError("No legs were found: nothing stands between the ground and the body.")
    labels, soles = feet(ground + hip)
    good = kept[hip] if hip < len(kept) else soles
    within = np.isin(labels, good)
    full = min(int(np.flatnonzero(number >= usual).max()) if usual >= 2 else hip, hip)
    low_labels, low_found = feet(ground + full)
    low_good = kept[full] if full < len(kept) else low_found
    seeds, cells = np.argwhere(np.isin(low_labels, low_good)), np.argwhere(within)
    # Upright distances count less: a cell belongs to the leg below it.
    nearest = cKDTree(seeds * [1, 0.25, 1]).query(cells * [1, 0.25, 1])[1]
    order = {k: place + 1 for place, k in enumerate(low_good)}
    of_seed = np.array([order[int(k)] for k in low_labels[tuple(seeds.T)]])
    legs = np.zeros(filled.shape, int)
    legs[cells[:, 0], cells[:, 1] + ground, cells[:, 2]] = of_seed[nearest]
    of_leg, base = areas[ground : ground + hip + 1], 0
    while base < 0.5 * hip and of_leg[base] > 1.5 * np.median(of_leg[len(of_leg) // 3 :]):
        base += 1
    foot = solid.origin[UP] + (ground + base + 1) * solid.side if base > 2 else -np.inf
    return Stand(
        float(solid.origin[UP] + (ground + hip + 1) * solid.side),
        float(foot),
        legs[filled],
        trunk[filled],
        len(low_good),
    )


def _pedestal(areas: Floats) -> int:
    """Return the layer that a pedestal ends at: from the widest slab down to where the section is small."""
    wide = areas[int(0.3 * len(areas)) :].max() >= 0.8 * areas.max()
    hip = len(areas) - 1 - int(np.argmax(areas[::-1])) if wide else int(np.argmax(areas))
    while hip > 0 and areas[hip] > 0.45 * areas.max():
        hip -= 1
    return hip


def _trunk_tips(labels: Index, feet: list[int], body: Body, plane: float, breadth: int) -> list[tuple[int, int, int]]:
    """Return the lowest cell of each foot that stands alone on the mirror plane beside pairs: a trunk, or a tail."""
    if len(feet) < 5 or body.partners is None:
        return []
    tips = []
    for k in feet:
        cells = np.argwhere(labels == k)
        if abs(cells[:, body.lateral].mean() + 0.5 - plane) < 0.06 * breadth:
            tips.append(tuple(int(value) for value in cells[np.argmin(cells[:, 1])]))
    return [(a, b, c) for a, b, c in tips]
