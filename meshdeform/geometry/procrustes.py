"""Find the rigid motion or similarity that takes points closest to others.

Source: Umeyama 1991, Least-Squares Estimation of Transformation Parameters Between Two Point Patterns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """The map ``scale * rotation @ x + shift``."""

    rotation: _Floats  # (3, 3) float64: orthogonal; a reflection only if those were allowed
    scale: float
    shift: _Floats  # (3,) float64
    max_distance: float  # greatest distance between a point that it maps and that point's goal


def closest_motion(before: _Floats, after: _Floats, *, scaled: bool = False, mirrored: bool = False) -> Motion:
    """Return the motion that takes `before` (N, 3) closest to `after` (N, 3) in the sense of least squares.

    Parameters
    ----------
    before, after : (N, 3) float64
    scaled : bool
        Whether it may scale.
    mirrored : bool
        Whether it may reflect.
    """
    start, goal = before.mean(0), after.mean(0)
    arms, reached = before - start, after - goal
    u, sizes, vh = np.linalg.svd(reached.T @ arms)
    signs = np.ones(3)
    if not mirrored:
        signs[2] = np.sign(np.linalg.det(u @ vh))
    rotation = (u * signs) @ vh
    spread = float((arms**2).sum())
    scale = float((sizes * signs).sum()) / spread if scaled and spread > 0 else 1.0
    distances = np.linalg.norm(scale * arms @ rotation.T - reached, axis=1)
    return Motion(rotation, scale, goal - scale * rotation @ start, float(distances.max(initial=0.0)))
