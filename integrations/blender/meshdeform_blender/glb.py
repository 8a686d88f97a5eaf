"""Convert meshes to a GLB and back, vertex by vertex. Uses numpy, which Blender ships, but not bpy.

Blender's own exporter splits vertices at seams of UVs and normals, which loses the mapping back to the mesh. Here
vertex i of a mesh is element i of its POSITION accessor, and the service keeps their order, so nothing needs matching.
Blender's +Z up becomes glTF's +Y up by swapping and negating coordinates, which is exact in both directions.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import AddonError

_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # glTF = _UP @ Blender
_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_ORTHOGONAL = 1e-5  # the Khronos validator's tolerance for a matrix of rotation and scale


@dataclass(frozen=True)
class Part:
    """One mesh with its placement in the scene."""

    name: str
    positions: NDArray[np.float32]  # (N, 3) float32: in the mesh's own space, +Z up
    triangles: NDArray[np.uint32]  # (T, 3) uint32
    matrix: NDArray[np.float64]  # (4, 4) float64: maps column vectors from the mesh's space to the world's


def write_glb(parts: Sequence[Part]) -> bytes:
    """Write a scene, one mesh and one node for each part."""
    if not parts:
        raise AddonError("No mesh is selected.", "Select one or more mesh objects.")
    binary = bytearray()
    root: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Meshdeform for Blender"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(parts)))}],
        "nodes": [],
        "meshes": [],
        "accessors": [],
        "bufferViews": [],
    }
    for number, part in enumerate(parts):
        if len(part.triangles) == 0:
            raise AddonError(f"“{part.name}” has no faces.", "Only surfaces are deformed: select another object.")
        baked, placement = _split(part)
        positions = (part.positions.astype(np.float64) @ (_UP @ baked).T).astype(np.float32)
        if not np.isfinite(positions).all():
            raise AddonError(f"“{part.name}” has vertices that are not finite.", "Remove them: Mesh > Clean Up.")
        # Readers account for a node that mirrors; a baked mirror turns the faces inside out.
        triangles = part.triangles[:, ::-1] if np.linalg.det(baked) < 0.0 else part.triangles
        corners = np.ascontiguousarray(triangles, "<u4").reshape(-1)
        attributes = {"POSITION": _accessor(root, binary, positions.astype("<f4"), "VEC3", _FLOAT, _ARRAY_BUFFER)}
        root["accessors"][-1] |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
        indices = _accessor(root, binary, corners, "SCALAR", _UNSIGNED_INT, _ELEMENT_ARRAY_BUFFER)
        root["meshes"].append({"name": part.name, "primitives": [{"attributes": attributes, "indices": indices}]})
        matrix = {} if np.array_equal(placement, np.eye(4)) else {"matrix": placement.T.reshape(-1).tolist()}
        root["nodes"].append({"name": part.name, "mesh": number, **matrix})
    root["buffers"] = [{"byteLength": len(binary)}]
    return _pack(root, bytes(binary))


def read_positions(glb: bytes, parts: Sequence[Part]) -> list[NDArray[np.float32]]:
    """Read the new positions, each in its mesh's own space, from the deformed file of `write_glb` for these parts."""
    try:
        root, binary = _unpack(glb)
        coordinates = [_positions(root, binary, root["nodes"][number]["mesh"]) for number in range(len(parts))]
    except (KeyError, IndexError, TypeError, ValueError, struct.error) as error:
        raise AddonError("The result cannot be read.", "Update the add-on or the service.") from error
    for part, positions in zip(parts, coordinates, strict=True):
        if positions.shape != part.positions.shape or not np.isfinite(positions).all():
            raise AddonError(f"The result does not fit “{part.name}”.", "Update the add-on or the service.")
    return [
        (positions.astype(np.float64) @ np.linalg.inv(_UP @ _split(part)[0]).T).astype(np.float32)
        for part, positions in zip(parts, coordinates, strict=True)
    ]


def _split(part: Part) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the map to bake into the positions (3, 3), and the node's matrix (4, 4), +Y up."""
    # A glTF node can rotate, scale and translate but not shear, as a rotated child of an unevenly scaled parent does. A
    # sheared part gets its linear map baked into the positions.
    linear, offset = part.matrix[:3, :3], part.matrix[:3, 3]
    lengths = np.linalg.norm(linear, axis=0)
    if not np.isfinite(part.matrix).all() or abs(np.linalg.det(linear)) <= 1e-9 * max(float(lengths.max()) ** 3, 1e-30):
        raise AddonError(f"The scale of “{part.name}” is zero along an axis.", "Give it a thickness and try again.")
    axes = linear / lengths
    sheared = np.abs(axes.T @ axes - np.eye(3)).max() > _ORTHOGONAL
    placement = np.eye(4)
    placement[:3, 3] = _UP @ offset
    if sheared:
        return linear, placement
    placement[:3, :3] = _UP @ linear @ _UP.T
    return np.eye(3), placement


def _accessor(
    root: dict[str, Any], binary: bytearray, values: NDArray[Any], kind: str, component: int, use: int
) -> int:
    data = values.tobytes()
    root["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), "target": use})
    binary += data  # 4-byte numbers: everything stays aligned
    item = {"bufferView": len(root["bufferViews"]) - 1, "componentType": component, "count": len(values), "type": kind}
    root["accessors"].append(item)
    return len(root["accessors"]) - 1


def _pack(root: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(root, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _unpack(glb: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", glb)
    if magic != b"glTF" or version != 2 or length != len(glb):
        raise ValueError("not a GLB")
    (size,) = struct.unpack_from("<I", glb, 12)
    root = json.loads(glb[20 : 20 + size])
    start = 20 + size
    (binary_size,) = struct.unpack_from("<I", glb, start)
    return root, glb[start + 8 : start + 8 + binary_size]


def _positions(root: dict[str, Any], binary: bytes, mesh: int) -> NDArray[np.float32]:
    item = root["accessors"][root["meshes"][mesh]["primitives"][0]["attributes"]["POSITION"]]
    view = root["bufferViews"][item["bufferView"]]
    if item["componentType"] != _FLOAT or item["type"] != "VEC3" or view.get("byteStride", 12) != 12:
        raise ValueError("not the accessor that was sent")
    start = view.get("byteOffset", 0) + item.get("byteOffset", 0)
    return np.frombuffer(binary, "<f4", 3 * item["count"], start).reshape(-1, 3)
