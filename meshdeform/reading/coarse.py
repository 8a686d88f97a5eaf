"""Read a large mesh by a coarser one: vertices in one place of a grid are one vertex.

Source: Rossignac and Borrel 1993, Multi-resolution 3D approximations for rendering complex scenes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.reading.evidence import Evidence
from meshdeform.reading.result import NO_PART

__all__ = ["MOST_FACES", "Coarse", "coarse"]

MOST_FACES = 400_000
"""Faces up to which a mesh is read as it is."""
_FINEST = 400
"""Places of the grid along the longest axis, before it is made coarser."""


@dataclass(frozen=True)
class Coarse:
    """A coarser mesh, and where the vertices (V,) and the faces (F,) of the mesh are in it.

    `of_face` (F,) int64 is -1 for faces that all but vanished: they lie at their vertices.
    """

    body: Part
    of_vert: Index
    of_face: Index

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


def coarse(body: Part) -> Coarse:
    """Return a mesh of at most `MOST_FACES` faces."""
    used = np.unique(body.faces)
    low = body.verts[used].min(0)
    side = float(np.ptp(body.verts[used], axis=0).max()) / _FINEST
    while True:
        grid = ((body.verts - low) / side).astype(np.int64).clip(0, 2**20)
        key = (grid[:, 0] << 42) | (grid[:, 1] << 21) | grid[:, 2]
        of_vert = np.unique(key, return_inverse=True)[1]
        corners = of_vert[body.faces].astype(np.int32)
        kept = np.flatnonzero(
            (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
        )
        if len(kept) <= MOST_FACES:
            break
        side *= max(1.15, (len(kept) / MOST_FACES) ** 0.5)
    count = int(of_vert.max()) + 1
    each = np.bincount(of_vert, minlength=count)
    verts = np.stack([np.bincount(of_vert, body.verts[:, axis], count) for axis in range(3)], 1) / each[:, None]
    of_face = np.full(len(body.faces), -1, np.int64)
    of_face[kept] = np.arange(len(kept))
    return Coarse(Part(verts, corners[kept].astype(np.int64)), of_vert, of_face)
