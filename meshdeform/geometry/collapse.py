"""When a triangle counts as collapsed. Numpy-only at most: the check at the door needs it without torch."""

from __future__ import annotations

__all__ = ["COLLAPSED_SHAPE"]

COLLAPSED_SHAPE = 1e-5
"""A face is collapsed when its area is at most this times its longest edge squared (an equilateral one has 0.433).

Along a needle of shape s the energy weighs about s, across it 1 / (4 s): rounding errors of the one reach the other
divided by 4 s^2, which leaves six digits here and none a hundredfold thinner. Relative to the face itself, so neither
the object's unit nor the face's size in it matters.
"""
