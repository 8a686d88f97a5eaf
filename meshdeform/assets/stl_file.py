"""Write a scene as binary STL: its triangles in the world, and nothing else.

Source: 3D Systems, StereoLithography Interface Specification (1989), binary format.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.scene import SceneView
from meshdeform.assets.world import Edges, Frame, count_edges, place_meshes
from meshdeform.errors import AssetEmptyError

__all__ = ["Stl", "write_stl"]

_HEADER_BYTES = 80
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


@dataclass(frozen=True)
class Stl:
    """A binary STL, and what is known about its surface.

    Attributes
    ----------
    data : bytes
    triangles : int
    edges : Edges
    """

    data: bytes
    triangles: int
    edges: Edges


def write_stl(scene: SceneView, frame: Frame = Frame()) -> Stl:  # noqa: B008 - immutable
    """Write the triangles of a scene, each where it stands in the world.

    Parameters
    ----------
    scene : SceneView
    frame : Frame
        Axes and unit, which the format itself does not store; the header says them in words, together with the open
        edges.

    Returns
    -------
    The same bytes for the same scene. Triangles without area stay, with a zero normal.

    Raises
    ------
    AssetEmptyError
        The scene has no triangles.
    AssetError
        A position is not finite, or an index is out of range.
    """
    parts = [mesh.positions[mesh.triangles] for mesh in place_meshes(scene, frame)]
    if not parts:
        raise AssetEmptyError("The asset has no triangles that an STL could hold.")
    corners, edges = np.concatenate(parts), count_edges(parts)
    rows = np.zeros(len(corners), _TRIANGLE)
    rows["corners"], rows["normal"] = corners, _normals(corners)
    # It must not begin with "solid", by which readers recognise the text format.
    header = f"Meshdeform {__version__}; {frame.words}; open edges {edges.open}, tangled {edges.tangled}".encode()
    start = header[:_HEADER_BYTES].ljust(_HEADER_BYTES) + len(rows).to_bytes(4, "little")
    return Stl(start + rows.tobytes(), len(rows), edges)


def _normals(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the unit normals of triangles (T, 3, 3), zero for those without area."""
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0))
