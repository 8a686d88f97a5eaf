"""Make a part of a shape longer, shorter, bigger or smaller about where it hangs, so that it stays where it is joined.

A point x of a piece of the part goes to x + w(x) (S - 1) (x - r), with the root r where the piece touches the rest, and
S a scale: along the axis away from the root for lengths, along all axes for sizes. The weight w rises smoothly from 0
at points that touch the rest to 1 a quarter of the piece's size away from them.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.nouns.poses import limbs

__all__ = ["sized"]

_FACTORS = {"long": 1.6, "short": 0.55, "big": 1.45, "small": 0.65}
_LENGTHS = ("long", "short")
_TOUCHING, _BAND = 0.004, 0.25
_NEAREST = 0.1
"""Share of the vertices of a piece that touches nothing which are its root: those nearest to the rest."""


def sized(member: LabelledMember, part: str, degree: str) -> LabelledMember:
    """Return a member with another size of a part; without that part, as it is."""
    if part not in member.parts:
        return member
    verts = member.verts.copy()
    for rows in limbs(member, part):
        others = np.setdiff1d(np.arange(len(verts)), rows)
        if len(others):
            verts[rows] = _sized(member.verts[rows], member.verts[others], degree)
    return member.moved(verts)


def _sized(own: Floats, others: Floats, degree: str) -> Floats:
    """Return the positions (N, 3) of a piece beside those of the rest."""
    distance = cKDTree(others).query(own)[0]
    diagonal = float(np.linalg.norm(np.ptp(np.concatenate([own, others]), axis=0)))
    rooted: Index = np.flatnonzero(distance <= max(_TOUCHING * diagonal, float(np.quantile(distance, _NEAREST))))
    root = own[rooted].mean(0)
    moved = (_FACTORS[degree] - 1) * (own - root)
    if degree in _LENGTHS:
        axis = own.mean(0) - root
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        moved = (moved @ axis)[:, None] * axis
    size = float(np.sqrt(np.square(own - own.mean(0)).sum(1).mean()))
    away = np.clip(cKDTree(own[rooted]).query(own)[0] / max(_BAND * size, 1e-12), 0, 1)
    return np.asarray(own + (away * away * (3 - 2 * away))[:, None] * moved)
