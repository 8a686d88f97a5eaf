"""How much is spent on a fit: all that its result needs, or a tenth of that, for a draft that is seen at once."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["DRAFT", "FULL", "Effort"]


class Effort(NamedTuple):
    """What the stages of a fit take.

    `pieces`: samples, and rounds of the maps of pieces (`affine_maps`); `levels`: intervals and rounds of each level of
    a smooth map between like pieces, `whole`: all to all; `smooth`: samples of both, and Jacobians (`smooth_fit`);
    `limbs`: samples by which limbs grow, `grown`: samples and rounds of their surface (`growth`).
    """

    pieces: tuple[int, int]
    levels: tuple[tuple[int, int], ...]
    whole: tuple[tuple[int, int], ...]
    smooth: tuple[int, int]
    limbs: int
    grown: tuple[int, int]


FULL = Effort((2200, 14), ((3, 3), (6, 5), (12, 5)), ((3, 6), (6, 6), (12, 5)), (1200, 400), 6000, (3000, 8))
DRAFT = Effort((700, 7), ((3, 2), (6, 3)), ((3, 3), (6, 3)), (500, 200), 2000, (1000, 4))
