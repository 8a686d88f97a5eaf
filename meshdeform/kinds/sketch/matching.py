"""Say how far the lines of a shape are from those of a drawing.

Every point of one goes to the nearest point of the other, once without regard to where its line runs and once to lines
that run the same way, both ways (chamfer matching, Barrow et al. 1977; by directions: Gavrila 1998).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from meshdeform.kinds.sketch.looking import Singles

__all__ = ["DrawnLines", "distance"]

_WAYS = 4
_FAR = 0.12
"""Greatest distance of a point that counts, as a share of the page."""
_INK, _BLUR = 0.4, 1.2


class DrawnLines:
    """The lines of a picture (S, S): their points, and how far each place is from them."""

    def __init__(self, picture: Singles) -> None:
        side = len(picture)
        smooth = gaussian_filter(picture.astype(np.float64), _BLUR)
        dy, dx = np.gradient(smooth)
        # the double angle of a line's own direction, from the structure tensor: both flanks of a stroke agree
        double = gaussian_filter(dx * dx - dy * dy, _BLUR) + 1j * gaussian_filter(2 * dx * dy, _BLUR)
        way = np.rint(np.mod(np.angle(double), 2 * np.pi) / (2 * np.pi) * _WAYS).astype(int) % _WAYS
        ink = picture > _INK
        self.points = np.argwhere(ink)
        self.ways = way[ink]
        far = np.full((side, side), _FAR)
        self._near = np.minimum(distance_transform_edt(~ink) / side, _FAR) if ink.any() else far
        alike = [ink & (way == number) for number in range(_WAYS)]
        self._near_of = [
            np.minimum(distance_transform_edt(~each) / side, _FAR) if each.any() else far for each in alike
        ]

    def from_points(self, other: DrawnLines) -> float:
        """Return the mean distance of another's points from these lines, as a share of the page."""
        rows, columns = other.points.T
        plain = self._near[rows, columns]
        alike = np.stack(self._near_of)[other.ways, rows, columns]
        return float((plain + alike).mean() / 2) if len(rows) else _FAR


def distance(one: DrawnLines, other: DrawnLines) -> float:
    """Return how far the lines of two pictures are from each other, as a share of the page; 0 where they agree."""
    return (one.from_points(other) + other.from_points(one)) / 2
