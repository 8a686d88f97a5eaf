"""Simplify a mesh by quadric edge collapses.

fast-simplification (MIT) does the work. pyfqmr wraps the same algorithm and gives the same mesh; it took 1.7 times as
long for a million faces, and 1.6 times the memory.

Source: Garland and Heckbert 1997, Surface Simplification Using Quadric Error Metrics.
"""

from __future__ import annotations

import fast_simplification
import numpy as np
import torch

from meshdeform.geometry.mesh import TriangleMesh

_MOST_AROUND = 200
"""Faces around the corners of a face, in the mean, up to which a mesh is simplified: each edge that is tried takes time
for every one. A smooth surface has 18."""


def simplified(mesh: TriangleMesh, count: int) -> TriangleMesh:
    """Return a mesh of about `count` faces with the shape of a larger one, and without unused vertices.

    It has more faces where they cannot be collapsed, and none if all were. Borders may move. Where very many faces meet
    at one vertex, as where copies lie in one place, the mesh is returned as it is.
    """
    around = np.bincount(mesh.faces.numpy().ravel())
    if float((around.astype(np.float64) ** 2).sum()) > _MOST_AROUND * len(mesh.faces):
        return mesh
    verts, faces = fast_simplification.simplify(
        mesh.verts.numpy(), mesh.faces.numpy().astype(np.int32), target_count=count
    )
    used, corners = np.unique(faces, return_inverse=True)
    return TriangleMesh(
        torch.from_numpy(np.asarray(verts, np.float64)[used]), torch.from_numpy(corners.reshape(-1, 3).astype(np.int64))
    )
