"""Place cameras: four views around the object, a quarter turn apart, at random azimuth and elevations.

Conventions: +Y is up and +Z is the asset's front (glTF). At azimuth 0 the camera is on +Z and sees the front; at
azimuth 90 it is on +X and sees the asset's left side. Clip space is OpenGL's: x right, y up, -w <= z <= w. The distance
of the camera is such that a given sphere at the origin just fits the view.

The published code places the camera at three half extents of the shape, measured anew at every step, so a growing shape
keeps its size in the picture and never leaves it. `Framing` does the same within bounds.

`CameraFrame` maps the source into the cameras' frame: centred at the origin, small enough to be able to grow.

Source of the ranges: Xu et al. 2024, FusionDeformer, section 4.2 (orthogonal views).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh

_Floats = NDArray[np.float64]

NUM_VIEWS = 4
UNIT_SPHERE = 1.05
"""Default radius of the sphere that just fits the view: the unit sphere and a margin."""
RADIUS = 0.6
"""Radius of the source in the cameras' frame, where they see the unit sphere: it leaves space for growth."""


@dataclass(frozen=True)
class CameraRange:
    """Bounds of the uniform draws, in degrees."""

    elevation_min_deg: float = 0.0
    elevation_max_deg: float = 30.0
    fov_min_deg: float = 30.0
    fov_max_deg: float = 45.0


@dataclass(frozen=True)
class Framing:
    """Size of a shape in the picture, and when the camera adapts to it."""

    share: float
    """Share of the view that the shape spans at rest: its half extent over the radius of the sphere that just fits."""
    largest: float
    """Share up to which the shape may grow in the picture before the camera moves back. If it equals `share`, the
    camera follows at once, whether the shape grows or shrinks."""

    def fitting_radius(self, rest: float, now: float) -> float:
        """Return the radius of the sphere that just fits the view.

        Parameters
        ----------
        rest, now : float
            Half extent of the shape (its largest absolute coordinate) at rest and now.
        """
        growth = self.largest / self.share
        return min(max(rest, now / growth), now * growth) / self.share


@dataclass(frozen=True)
class Cameras:
    """B cameras that look at the origin."""

    view_proj: NDArray[np.float32]  # (B, 4, 4) float32: world to clip space: ``clip = view_proj @ [x, y, z, 1]``
    view: NDArray[np.float32]  # (B, 4, 4) float32: world to camera space; the camera looks along its -Z
    eye: NDArray[np.float32]  # (B, 3) float32: camera positions in world space
    azimuths_deg: tuple[float, ...]
    """Azimuths from the front of the shape, without the `turn_deg` with which they were placed."""
    elevation_deg: tuple[float, ...]
    fov_deg: float  # vertical field of view, the same for all views

    @property
    def azimuth_deg(self) -> float:
        """Azimuth of view 0; orthogonal view k is at ``azimuth_deg + 90 k``."""
        return self.azimuths_deg[0]

    def project(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the positions (B, V, 4) of points (V, 3) in the views' clip space, each coordinate contiguous."""
        matrices = self.view_proj.reshape(-1, 4)
        clip: NDArray[np.float32] = matrices[:, :3] @ points.T + matrices[:, 3:]
        return clip.reshape(-1, 4, len(points)).mT


def fixed_cameras(
    azimuth_deg: float | tuple[float, ...],
    elevation_deg: float | tuple[float, ...],
    fov_deg: float = 37.5,
    *,
    views: int = NUM_VIEWS,
    fitting_radius: float = UNIT_SPHERE,
    turn_deg: float = 0.0,
) -> Cameras:
    """Place cameras that look at the origin, at azimuths ``azimuth_deg + 90 k`` or at the given ones.

    Parameters
    ----------
    azimuth_deg, elevation_deg, fov_deg : degrees
        One azimuth for view 0, or one per view; one elevation for all views, or one per view.
    views : int
        Number of views, if `azimuth_deg` is a single number.
    fitting_radius : float
        Radius of the sphere around the origin that just fits the view.
    turn_deg : float
        Azimuth of the shape's front. The cameras are placed this much further around; their `azimuths_deg` are those
        from the front.
    """
    if isinstance(azimuth_deg, int | float):
        azimuths = tuple(float(azimuth_deg + 90 * k) for k in range(views))
    else:
        azimuths, views = azimuth_deg, len(azimuth_deg)
    elevations = (elevation_deg,) * views if isinstance(elevation_deg, int | float) else tuple(elevation_deg)
    distance = fitting_radius / math.sin(math.radians(fov_deg) / 2)
    focal = 1 / math.tan(math.radians(fov_deg) / 2)
    # In proportion to the sphere, so that a depth bias is about the same length at every field of view.
    near, far = max(distance - 2 * fitting_radius, 0.05 * fitting_radius), distance + 2 * fitting_radius
    projection = np.array(
        [
            [focal, 0, 0, 0],
            [0, focal, 0, 0],
            [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)],
            [0, 0, -1, 0],
        ]
    )
    view = np.stack([_look_at(a + turn_deg, e, distance) for a, e in zip(azimuths, elevations, strict=True)])
    eye = -(view[:, :3, :3].mT @ view[:, :3, 3:])[..., 0]
    view_proj = (projection @ view).astype(np.float32)
    return Cameras(view_proj, view.astype(np.float32), eye.astype(np.float32), azimuths, elevations, float(fov_deg))


def orthogonal_cameras(
    bounds: CameraRange, shares: Sequence[float], fitting_radius: float = UNIT_SPHERE, turn_deg: float = 0.0
) -> Cameras:
    """Place four cameras a quarter turn apart by six shares of the ways from the least to the greatest values.

    They are those of the azimuth of view 0, which is anything, the field of view, and the four elevations.
    `fitting_radius`: radius of the sphere around the origin that just fits the view; `turn_deg`: as in `fixed_cameras`.
    """
    azimuth = -180 + 360 * shares[0]
    fov = bounds.fov_min_deg + (bounds.fov_max_deg - bounds.fov_min_deg) * shares[1]
    span = bounds.elevation_max_deg - bounds.elevation_min_deg
    elevations = tuple(bounds.elevation_min_deg + span * e for e in shares[2:])
    return fixed_cameras(azimuth, elevations, fov, fitting_radius=fitting_radius, turn_deg=turn_deg)


def _look_at(azimuth_deg: float, elevation_deg: float, distance: float) -> NDArray[np.float64]:
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    back = np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
    right = np.array([math.cos(a), 0.0, -math.sin(a)])
    view = np.eye(4)
    view[:3, :3] = [right, np.cross(back, right), back]
    view[2, 3] = -distance
    return view


@dataclass(frozen=True)
class CameraFrame:
    """Similarity between the world and the cameras' frame."""

    centre: _Floats  # (3,) float64: centre of the bounding box, in the world
    scale: float  # camera units per world unit

    @classmethod
    def around(cls, verts: _Floats) -> CameraFrame:
        """Return the frame in which `verts` (V, 3) are centred and the farthest is at `RADIUS`."""
        centre = (verts.min(0) + verts.max(0)) / 2
        return cls(centre, RADIUS / float(np.linalg.norm(verts - centre, axis=1).max()))

    def enter(self, verts: _Floats) -> _Floats:
        """Transform positions (V, 3) from the world into the frame."""
        return np.asarray((verts - self.centre) * self.scale)

    def leave(self, verts: _Floats) -> _Floats:
        """Transform positions (V, 3) from the frame into the world."""
        return np.asarray(verts / self.scale + self.centre)

    def place(self, mesh: TriangleMesh) -> TriangleMesh:
        """Transform a mesh from the world into the frame."""
        return TriangleMesh(self.enter(mesh.verts), mesh.faces)
