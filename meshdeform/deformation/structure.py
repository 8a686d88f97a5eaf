"""Find what of an asset few degrees of freedom keep: its mirror planes, and what is level and upright of built things.

`Structure` has the mirror planes of an asset, and whether it stands level and upright. A plane counts if most of the
surface has a mirror image close by, so that a few parts may lack one, or if nearly all of it has one not far off, as an
animal in the middle of a step; a second plane only if it is as good. Of two, the one in which the front lies is kept,
since nearly all things have a front; both are if the result has none: a vase leans without the second. Things that are
built have most of their area along few directions, and of those every wall should stay upright and every shelf level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.surface_samples import even_samples

_Floats = NDArray[np.float64]

_SAMPLES = 5000

NEAR = 0.006
"""Distance of a mirror image from the surface that counts as none, as a share of the diagonal."""

_MATCHED = 0.8
"""Share of the surface that must have a mirror image."""

_NOT_FAR, _NEARLY_ALL = 0.03, 0.93

_AS_GOOD = 0.02
"""How much smaller the matched share of the second plane may be, for both to count."""

_ALONG = 0.98
"""Cosine from which a normal is along an axis."""

_BUILT, _EACH = 0.5, 0.05
"""Share of the area along the axes from which a thing counts as built, and of its upright and its level faces."""

_CONVEX = 0.01
"""By which share the areas of a surface and its convex hull may differ if it counts as convex."""


@dataclass(frozen=True)
class Structure:
    """Properties of an asset that few degrees of freedom keep."""

    planes: tuple[int, ...] = ()  # axes to which the mirror planes, through the middle of the box, are perpendicular
    level: bool = False  # whether what is level stays level, and what is upright upright

    def to_array(self) -> NDArray[np.int64]:
        """Return the members as int64, for checkpoints."""
        return np.array([*(self.planes or (-1,)), int(self.level)], np.int64)

    @classmethod
    def from_array(cls, values: NDArray[np.int64]) -> Self:
        """Return the structure that `to_array` stored."""
        *planes, level = values.tolist()
        return cls(tuple(plane for plane in planes if plane >= 0), bool(level))


def mirror_planes(mesh: RestMesh) -> tuple[int, ...]:
    """Return the axes, of 0 and 2, to which the upright mirror planes of a surface are perpendicular."""
    low, high = mesh.box
    matched, diagonal, axes = {}, float(np.linalg.norm(high - low)), (0, 2)
    for axis, (mirrored, nearest) in zip(axes, NearestPoints.of_mirrored(mesh, _points_on(mesh), axes), strict=True):
        distances = nearest.distances(mirrored) / diagonal
        close = float((distances < NEAR).mean())
        if close >= _MATCHED or (distances < _NOT_FAR).mean() >= _NEARLY_ALL:
            matched[axis] = close
    return tuple(axis for axis, share in matched.items() if share >= max(matched.values()) - _AS_GOOD)


def plane_of(planes: Sequence[int], front_deg: float) -> tuple[int, ...]:
    """Return the plane to keep, of those with these normals: the one in which the front lies, if there are two."""
    containing = 0 if abs(math.cos(math.radians(front_deg))) > math.sqrt(0.5) else 2
    return (containing,) if containing in planes else tuple(planes[:1])


@dataclass(frozen=True)
class Nature:
    """What is known of a source and of what it is to become."""

    built: bool = False  # whether it is something that people build
    grown: bool = False  # whether it is to become something that nobody builds, such as an animal or a plant
    crooked: bool = False  # whether it is to be twisted, leaning or bent
    turned: bool = False  # whether it is to become something that is alike from all sides, such as a vase


UNKNOWN = Nature()


def structure_of(mesh: RestMesh, nature: Nature, front_deg: float, *, several: bool) -> Structure:
    """Return what few degrees of freedom keep of a mesh; `front_deg`: azimuth of its front; `several`: a lattice."""
    if nature.crooked:
        return Structure()
    planes = mirror_planes(mesh)
    # Splines alone cannot keep collinear faces from cutting their neighbours.
    turned = nature.turned and len(planes) == 2 and bool(mesh.areas.min() > 0)
    built = is_level(mesh) or (nature.built and not turned and not is_block(mesh))
    # A building can only become an animal if it bends, which the parts of an asset would not survive.
    level = built and (several or not nature.grown)
    return Structure(planes if turned else plane_of(planes, front_deg), level)


def is_level(mesh: RestMesh) -> bool:
    """Return whether most of the area faces along an axis, a part of it up or down and to a side: a built thing.

    A block is none: it is to be shaped, and has no wall or shelf that must stay one.
    """
    return _along_axes(mesh) and not is_convex(mesh)


def is_block(mesh: RestMesh) -> bool:
    """Return whether a mesh is a convex block along the axes, whatever it is taken for: clay to be shaped."""
    return _along_axes(mesh) and is_convex(mesh)


def _along_axes(mesh: RestMesh) -> bool:
    along = np.abs(mesh.normals) > _ALONG
    upright, level = (mesh.areas[faces].sum() / mesh.areas.sum() for faces in (along[:, ::2].any(1), along[:, 1]))
    return bool(upright + level > _BUILT and min(upright, level) > _EACH)


def is_convex(mesh: RestMesh) -> bool:
    """Return whether a surface is that of its convex hull; a single triangle encloses nothing, and has none."""
    verts = mesh.verts
    if len(verts) <= verts.shape[1]:
        return False
    hull = ConvexHull(verts, qhull_options="QJ")  # also of what is flat
    return bool(abs(float(mesh.areas.sum()) / hull.area - 1) < _CONVEX)


def _points_on(mesh: RestMesh) -> _Floats:
    """Return points (P, 3) spread evenly over the surface."""
    face, weights = even_samples(mesh.areas, _SAMPLES, seed=0)
    return np.asarray((weights[..., None] * mesh.verts[mesh.faces[face]]).sum(1))
