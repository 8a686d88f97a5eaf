"""Find what a deformation should keep of an asset: its mirror planes, and whether it stands level and upright.

A plane counts if most of the surface has a mirror image close by, so that a few parts may lack one, or if nearly all of
it has one not far off, as an animal in the middle of a step; a second plane only if it is as good. Things that are
built have most of their area along few directions, and of those every wall should stay upright and every shelf level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.geometry.nearest_places import NearestPlaces
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.samples import even_samples

__all__ = ["Structure", "is_level", "mirror_planes", "plane_of"]

_SAMPLES = 5000
_NEAR = 0.006
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

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Structure:
    """What few controls keep of an asset.

    Attributes
    ----------
    plane : int, optional
        The axis to which the mirror plane, through the middle of the box, is perpendicular.
    level : bool
        Whether what is level stays level, and what is upright upright.
    """

    plane: int | None = None
    level: bool = False

    def to_tensor(self) -> Tensor:
        """Return the members as int64, for checkpoints."""
        return torch.tensor([-1 if self.plane is None else self.plane, int(self.level)])

    @classmethod
    def from_tensor(cls, values: Tensor) -> Self:
        """Return what `to_tensor` stored."""
        plane, level = values.tolist()
        return cls(None if plane < 0 else plane, bool(level))


def mirror_planes(mesh: RestMesh) -> tuple[int, ...]:
    """Return the axes, of 0 and 2, to which the upright mirror planes of a surface are perpendicular."""
    low, high = mesh.box
    points, diagonal = _places(mesh), float(np.linalg.norm(high - low))
    matched = {}
    for axis in (0, 2):
        mirrored = points.copy()
        mirrored[:, axis] = low[axis] + high[axis] - points[:, axis]
        distances = NearestPlaces(mesh, mirrored, np.zeros_like(mirrored)).distances(mirrored) / diagonal
        close = float((distances < _NEAR).mean())
        if close >= _MATCHED or (distances < _NOT_FAR).mean() >= _NEARLY_ALL:
            matched[axis] = close
    return tuple(axis for axis, share in matched.items() if share >= max(matched.values()) - _AS_GOOD)


def plane_of(planes: Sequence[int], front_deg: float) -> int | None:
    """Return the plane to keep, of those with these normals: the one in which the front lies, if there are two."""
    containing = 0 if abs(math.cos(math.radians(front_deg))) > math.sqrt(0.5) else 2
    return containing if containing in planes else next(iter(planes), None)


def is_level(mesh: RestMesh) -> bool:
    """Return whether most of the area faces along an axis, and a part of it up or down and to a side: a built thing."""
    along = np.abs(mesh.normals.numpy()) > _ALONG
    upright, level = (mesh.areas[faces].sum() / mesh.areas.sum() for faces in (along[:, ::2].any(1), along[:, 1]))
    return bool(upright + level > _BUILT and min(upright, level) > _EACH)


def _places(mesh: RestMesh) -> _Floats:
    """Return places (P, 3) spread evenly over the surface."""
    face, weights = even_samples(mesh.areas, _SAMPLES, seed=0)
    return np.asarray((weights[..., None] * mesh.verts.numpy()[mesh.faces.numpy()[face]]).sum(1))
