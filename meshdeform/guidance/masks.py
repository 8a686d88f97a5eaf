"""Place the masks of pictures for a mesh that is compared with them, and draw what the mesh covers.

**Scale.** The pictures get scales that agree (`geometry.pictures`); the size of all together is that with which the
masks spread on average as the mesh at rest does from the same directions.

**Place.** A mask is compared with what a shape covers once both have the same centre of area, since a solve keeps the
asset's centre of mass in place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView, mask_centre, mask_radius, mask_spread, picture_scales
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.visibility import nearest_faces

__all__ = ["SIDE", "PlacedMask", "covered", "placed_masks"]

SIDE = 128
"""Side of a view in pixels."""

_MARGIN = 1.25
"""Radius that just fits the view, relative to the farthest point of asset or mask."""

_FINE = 4
"""Samples along a pixel from which it is averaged."""

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class PlacedMask:
    """A view with its mask in the pixels of its camera."""

    cameras: Cameras
    mask: _Floats  # (S, S) float64: the share of each pixel that it covers
    distance: _Floats  # (S, S) float64: signed distance to its outline in shares of the side, positive outside

    def overlap(self, verts: _Floats, faces: NDArray[np.int64]) -> float:
        """Return the intersection over union of the mask and what vertices (V, 3) cover, at one centre of area."""
        from scipy import ndimage  # a part of scipy that no other run needs

        ours = covered(verts, faces, self.cameras, len(self.mask))[0]
        shift = centre_of(ours) - centre_of(self.mask) if ours.any() else np.zeros(2)
        theirs = ndimage.shift(self.mask, shift, order=1) > 0.5
        return float((ours & theirs).sum() / max((ours | theirs).sum(), 1))


def placed_masks(views: Sequence[SilhouetteView], mesh: TriangleMesh, side: int = SIDE) -> list[PlacedMask]:
    """Return the masks of pictures, placed for a mesh at rest in the cameras' frame.

    Raises
    ------
    SilhouetteError
        The pictures contradict their directions.
    """
    scales = picture_scales(views)
    spreads = [mask_spread(view.mask) * scale for view, scale in zip(views, scales, strict=True)]
    reach = float(np.linalg.norm(mesh.verts, axis=1).max())
    own = []
    for view in views:
        seen = covered(mesh.verts, mesh.faces, _cameras(view, _MARGIN * reach), side)[0]
        own.append(mask_spread(seen) * _view_width(view, _MARGIN * reach) / side)
    size = math.exp(float(np.mean(np.log(np.array(own) / np.array(spreads)))))
    return [
        _placed(view, scale, _MARGIN * max(reach, mask_radius(view.mask) * scale), side)
        for view, scale in zip(views, scales * size, strict=True)
    ]


def _placed(view: SilhouetteView, scale: float, radius: float, side: int) -> PlacedMask:
    """Return a mask whose centre of area is in the middle of the view, sampled finer than that and averaged down."""
    from scipy import ndimage

    width = _view_width(view, radius) / scale  # in pixels of the picture
    height, wide = view.mask.shape
    centre = mask_centre(view.mask)
    steps = (np.arange(side * _FINE) + 0.5) / (side * _FINE) - 0.5
    rows, columns = centre[0] + steps * width, centre[1] + steps * width
    inside = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < wide))[None]
    at_rows, at_columns = (
        np.clip(np.floor(at).astype(int), 0, most - 1) for at, most in ((rows, height), (columns, wide))
    )
    sampled = view.mask[at_rows[:, None], at_columns[None]] & inside
    outside = ndimage.distance_transform_edt(~sampled) - ndimage.distance_transform_edt(sampled)
    mask, away = (each.reshape(side, _FINE, side, _FINE).mean((1, 3)) for each in (sampled, outside))
    return PlacedMask(_cameras(view, radius), mask, away / (side * _FINE))


def covered(verts: _Floats, faces: NDArray[np.int64], cameras: Cameras, side: int) -> _Flags:
    """Return what a mesh covers of the pixels (B, side, side) of each camera."""
    return np.asarray(nearest_faces(cameras.project(verts.astype(np.float32)), faces, side, side)[0] >= 0)


def centre_of(image: NDArray[np.floating] | _Flags) -> _Floats:
    """Return the centre of area (row, column) of an image (S, S), in pixels from its middle."""
    steps = np.arange(len(image)) + 0.5 - len(image) / 2
    total = max(float(image.sum()), 1e-6)
    return np.array([(image.sum(1) * steps).sum() / total, (image.sum(0) * steps).sum() / total])


def _cameras(view: SilhouetteView, radius: float) -> Cameras:
    return fixed_cameras(view.azimuth_deg, view.elevation_deg, view.fov_deg, views=1, fitting_radius=radius)


def _view_width(view: SilhouetteView, radius: float) -> float:
    """Return the width of a view in the plane through the origin."""
    return 2 * radius / math.cos(math.radians(view.fov_deg) / 2)
