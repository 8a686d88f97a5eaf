"""Masks of one object seen from given directions: how long their pixels are, and where in a picture what lies.

A picture says nothing about the size of what it shows, but two pictures of one object agree: with an ellipsoid of
squared half axes A, view k sees the squared width ``4 r_k A r_k`` and height ``4 u_k A u_k``, r and u the view's right
and up. A and the squared scales of the pictures follow by non-negative least squares, so that a front and a side get
the same height, and a front and a top the same width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import SilhouetteError

__all__ = ["SilhouetteView", "mask_centre", "mask_radius", "mask_spread", "picture_scales"]

_CONTRADICTION = 0.2
"""Relative error of a width or height above which pictures contradict their directions."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SilhouetteView:
    """A mask and the direction from which it was seen."""

    mask: NDArray[np.bool_]  # (H, W) bool: row 0 at the top
    # As in `cameras.fixed_cameras`
    azimuth_deg: float
    elevation_deg: float = 0.0
    fov_deg: float = 20.0

    @property
    def right(self) -> _Floats:
        """The direction (3,) that points to the right in the picture."""
        azimuth = math.radians(self.azimuth_deg)
        return np.array([math.cos(azimuth), 0.0, -math.sin(azimuth)])

    @property
    def up(self) -> _Floats:
        """The direction (3,) that points up in the picture."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        sine = math.sin(elevation)
        return np.array([-sine * math.sin(azimuth), math.cos(elevation), -sine * math.cos(azimuth)])


def picture_scales(views: Sequence[SilhouetteView]) -> _Floats:
    """Return lengths (K,) of a pixel of each picture, relative to one another.

    Raises SilhouetteError: the widths and heights of the masks contradict their directions.
    """
    # Unknown: the three squared half axes, then the squared scales. The first scale is 1.
    count = len(views)
    rows = []
    for number, view in enumerate(views):
        high, wide = _extents(view.mask)
        for axis, extent in ((view.right, wide), (view.up, high)):
            row = np.zeros(3 + count)
            row[:3] = 4 * axis**2 / extent**2
            row[3 + number] = -1.0
            rows.append(row)
    system = np.array(rows)
    from scipy.optimize import nnls  # which no other run needs

    scales, _ = nnls(np.delete(system, 3, 1), -system[:, 3])
    squared = np.concatenate([[1.0], scales[3:]])
    if (squared <= 0).any():
        raise _contradiction(views)
    seen = np.sqrt(np.maximum(system[:, :3] @ scales[:3], 0) / np.repeat(squared, 2))
    if np.abs(seen - 1).max() > _CONTRADICTION:
        raise _contradiction(views)
    return np.asarray(np.sqrt(squared))


def mask_centre(mask: NDArray[np.bool_]) -> _Floats:
    """Return the centre of area (row, column) of a mask (H, W), in pixels from its upper left corner."""
    return np.asarray(np.argwhere(mask).mean(0) + 0.5)


def mask_spread(mask: NDArray[np.bool_]) -> float:
    """Return the root mean square distance of the covered pixels of a mask (H, W) from their centre."""
    return float(np.sqrt(np.argwhere(mask).var(0).sum()))


def mask_radius(mask: NDArray[np.bool_]) -> float:
    """Return the greatest distance of a covered pixel of a mask (H, W) from the centre of area."""
    return float(np.linalg.norm(np.argwhere(mask) + 0.5 - mask_centre(mask), axis=1).max())


def _contradiction(views: Sequence[SilhouetteView]) -> SilhouetteError:
    sizes = "; ".join(
        f"azimuth {view.azimuth_deg:g}, elevation {view.elevation_deg:g}: {high} high and {wide} wide"
        for view in views
        for high, wide in [_extents(view.mask)]
    )
    return SilhouetteError(
        f"The pictures cannot show one object from these directions, whatever their scales. In pixels: {sizes}.",
        advice="Correct the azimuths and elevations, or leave out the picture that does not fit.",
    )


def _extents(mask: NDArray[np.bool_]) -> tuple[int, int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
