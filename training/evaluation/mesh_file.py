"""Read and write the benchmark's meshes: binary PLY with float64 positions, lossless and readable by any viewer.

Source of the format: Turk 1994, The PLY Polygon File Format.
"""

from __future__ import annotations

import io

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.errors import AssetFormatError
from meshdeform.geometry.mesh import TriangleMesh

__all__ = ["read_ply", "read_texels", "write_ply", "write_texels"]

_HEADER = """ply
format binary_little_endian 1.0
element vertex {verts}
property double x
property double y
property double z
element face {faces}
property list uchar int vertex_indices
end_header
"""
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_ply(mesh: TriangleMesh) -> bytes:
    """Serialise a mesh as PLY."""
    faces = np.empty(len(mesh.faces), _FACE)
    faces["count"], faces["corners"] = 3, mesh.faces.numpy()
    header = _HEADER.format(verts=len(mesh.verts), faces=len(faces)).encode()
    return header + mesh.verts.numpy().astype("<f8").tobytes() + faces.tobytes()


def read_ply(data: bytes) -> TriangleMesh:
    """Read a mesh that `write_ply` wrote, bit for bit.

    Raises
    ------
    AssetFormatError
        The file is incomplete or of another kind.
    """
    head, _, body = data.partition(b"end_header\n")
    counts = [int(line.split()[2]) for line in head.splitlines() if line.startswith(b"element")]
    if len(counts) != 2 or head + b"end_header\n" != _HEADER.format(verts=counts[0], faces=counts[1]).encode():
        raise AssetFormatError(
            "This is not a PLY file of a benchmark.", advice="Run the benchmark again to recreate it."
        )
    middle = counts[0] * 24
    if len(body) != middle + counts[1] * _FACE.itemsize:
        raise AssetFormatError("The PLY file is incomplete.", advice="Run the benchmark again to recreate it.")
    verts = np.frombuffer(body[:middle], "<f8").reshape(-1, 3).astype(np.float64)
    corners = np.frombuffer(body[middle:], _FACE)["corners"].astype(np.int64)
    return TriangleMesh(torch.from_numpy(verts), torch.from_numpy(corners))


def write_texels(texels: NDArray[np.float64]) -> bytes:
    """Serialise the corners (F, 3, 2) of faces in a texture as NPY."""
    out = io.BytesIO()
    np.save(out, texels, allow_pickle=False)
    return out.getvalue()


def read_texels(data: bytes) -> NDArray[np.float64]:
    """Read a file of `write_texels`."""
    texels: NDArray[np.float64] = np.load(io.BytesIO(data), allow_pickle=False)
    return texels
