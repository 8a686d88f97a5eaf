"""Pose a goal as the source stands: its legs, and a person's arms, turn about where they hang.

A limb of the goal turns by the least rotation from its long axis to that of the source's limb, if the two differ by
15 to 75 degrees (120 of arms) and the source's is longer than 2.2 times its width; of shorter ones the axis says
little.
"""

from __future__ import annotations

import numpy as np

from meshdeform.exemplar.affine_maps import Cloud, long_axis, rotation_between
from meshdeform.exemplar.pieces import Matching
from meshdeform.exemplar.shapes import Shape
from meshdeform.nouns.labels import Floats

__all__ = ["posed_like"]

_LEAST_DEG, _MOST_LEG_DEG, _MOST_ARM_DEG = 15.0, 75.0, 120.0
_LONG, _GOAL_LONG = 2.2, 1.3
_TOP = 0.15
_FEWEST = 20


def posed_like(source: Cloud, goal: Shape, matching: Matching) -> Shape:
    """Return the goal with its limbs turned as those of the source, standing on the ground that it stood on."""
    verts = goal.verts.copy()
    arms = _has_arms(matching)
    for piece, partner in enumerate(matching.partner):
        name = matching.source.names[piece]
        if partner < 0 or not (name == "leg" or (name == "arm" and arms)):
            continue
        rows = np.unique(goal.faces[matching.goal.of_face == partner])
        turn = _turn(source.places[source.own == piece], verts[rows], arm=name == "arm")
        if turn is not None:
            verts[rows] = turn
    verts[:, 1] += goal.verts[:, 1].min() - verts[:, 1].min()
    return goal.moved(verts)


def _has_arms(matching: Matching) -> bool:
    """Return whether the source has arms that hang or spread: two, and no more than two legs."""
    return len(matching.source.named("leg")) <= 2 and len(matching.source.named("arm")) == 2


def _turn(mine: Floats, others: Floats, *, arm: bool) -> Floats | None:
    """Return the vertices of a limb turned as the source's, or None if it stays."""
    if min(len(mine), len(others)) < _FEWEST:
        return None
    up = np.array([-np.sign(others[:, 0].mean()), 0.5, 0.0]) if arm else np.array([0.0, 1.0, 0.0])
    axis, longer = long_axis(mine, mine.mean(0) + up)
    goal_axis, goal_longer = long_axis(others, others.mean(0) + up)
    degrees = np.degrees(np.arccos(np.clip(axis @ goal_axis, -1, 1)))
    if longer < _LONG or goal_longer < _GOAL_LONG:
        return None
    if not _LEAST_DEG < degrees < (_MOST_ARM_DEG if arm else _MOST_LEG_DEG):
        return None
    hanging = others @ up
    root = others[hanging > hanging.max() - _TOP * np.ptp(hanging)].mean(0)
    return np.asarray((others - root) @ rotation_between(goal_axis, axis).T + root)
