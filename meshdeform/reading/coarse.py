"""Read a large mesh by a coarser one: vertices of a component in one cell of a grid are one.

Source: Rossignac and Borrel 1993, Multi-resolution 3D approximations for rendering complex scenes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.labels import Floats, Index, solids_of
from meshdeform.reading.evidence import Evidence
from meshdeform.reading.result import NO_PART
from meshdeform.reading.samples import area_vectors

__all__ = ["MOST_FACES", "Coarse", "coarse"]

MOST_FACES = 400_000
"""Faces up to which a mesh is read as it is."""
_FEWER = 150_000
"""Faces by which a larger mesh is read."""
_MOST_JOINED = 2_000_000
"""Faces up to which components are told apart: that takes 200 bytes a face."""
_MEASURED = 200_000
_FINEST = 500
"""Most cells of the grid along the longest axis."""


@dataclass(frozen=True)
class Coarse:
    """A coarser mesh, and where the vertices (V,) and the faces (F,) of the mesh are in it.

    `of_face` (F,) is -1 for faces that all but vanished: they lie at their vertices.
    """

    body: Part
    of_vert: NDArray[np.int32]
    of_face: NDArray[np.int32]

    def evidence(self, evidence: Evidence) -> Evidence:
        """Return what a file says of the vertices of the coarser mesh."""
        each = np.maximum(np.bincount(self.of_vert, minlength=len(self.body.verts)), 1)

        def mean(values: Floats) -> Floats:
            return np.asarray(np.bincount(self.of_vert, values, len(self.body.verts)) / each)

        return Evidence(
            {name: mean(shares) for name, shares in evidence.joints.items()},
            {name: mean(flags.astype(float)) > 0.5 for name, flags in evidence.names.items()},
        )

    def labels(self, labels: Index, faces: Index) -> Index:
        """Return the labels (F,) of the mesh's own faces (F, 3), by those of the coarser one."""
        of_vert = np.full(len(self.body.verts), NO_PART, np.int64)
        of_vert[self.body.faces] = labels[:, None]
        return np.where(self.of_face >= 0, labels[self.of_face], of_vert[self.of_vert[faces[:, 0]]])


def coarse(body: Part, fewer: int = _FEWER) -> Coarse:
    """Return a mesh of at most so many faces; components stay apart in one of up to two million."""
    faces = np.asarray(body.faces)
    told_apart = len(faces) <= _MOST_JOINED
    components = solids_of(Part(body.verts, faces)) if told_apart else np.zeros(len(body.verts), np.int64)
    used = np.zeros(len(body.verts), bool)
    used[faces] = True
    low, longest = body.verts[used].min(0), float(np.ptp(body.verts[used], axis=0).max())
    side = max(float(np.sqrt(2 * _area(body.verts, faces) / fewer)), longest / _FINEST)
    while True:
        of_vert = _cell_numbers(body.verts, low, side, components)
        corners = of_vert[faces]
        kept = np.flatnonzero(
            (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
        )
        if len(kept) <= fewer or side > longest:
            break
        side *= max(1.15, float(np.sqrt(len(kept) / fewer)))
    count = int(of_vert.max()) + 1
    each = np.bincount(of_vert, minlength=count)
    verts = np.stack([np.bincount(of_vert, body.verts[:, axis], count) for axis in range(3)], 1) / each[:, None]
    of_face = np.full(len(faces), -1, np.int32)
    of_face[kept] = np.arange(len(kept))
    return Coarse(Part(verts, corners[kept].astype(np.int64)), of_vert, of_face)


def _area(verts: Floats, faces: Index) -> float:
    """Return the area of a mesh, by some of its faces."""
    few = faces[:: max(len(faces) // _MEASURED, 1)]
    return float(np.linalg.norm(area_vectors(verts, few), axis=1).mean() / 2) * len(faces)


def _cell_numbers(verts: Floats, low: Floats, side: float, components: Index) -> NDArray[np.int32]:
    """Return a number (V,) for each vertex that those of one component in one cell of the grid have in common."""
    grid = ((verts - low) / side).astype(np.int64).clip(0, 2 * _FINEST)
    key = ((components * (2 * _FINEST + 1) + grid[:, 0]) * (2 * _FINEST + 1) + grid[:, 1]) * (2 * _FINEST + 1) + grid[
        :, 2
    ]
    return np.asarray(np.unique(key, return_inverse=True)[1], np.int32)
