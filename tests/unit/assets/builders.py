"""Hand-built GLBs, written without the code under test."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from meshdeform.assets import Asset

COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

QUAD_VERTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], np.float32)
QUAD_NORMALS = np.array([[0, 0, 1], [0, 0, 1], [0, 0, 1], [0.6, 0, 0.8]], np.float32)
QUAD_TANGENTS = np.array([[1, 0, 0, 1]] * 3 + [[0.8, 0, -0.6, -1]], np.float32)
QUAD_FACES = np.array([[0, 1, 2], [2, 1, 3]], np.uint16)


def pack(root: dict[str, Any] | bytes, binary: bytes | None = None, *chunks: tuple[bytes, bytes]) -> bytes:
    """Write a GLB from its JSON, binary chunk and further chunks."""
    text = root if isinstance(root, bytes) else json.dumps(root).encode()
    parts = [(b"JSON", text + b" " * (-len(text) % 4))]
    if binary is not None:
        parts.append((b"BIN\0", binary + b"\0" * (-len(binary) % 4)))
    body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in [*parts, *chunks])
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def unpack(glb: bytes) -> tuple[dict[str, Any], bytes, bytes]:
    """Return a GLB's JSON, its binary chunk and what follows."""
    assert struct.unpack("<4sII", glb[:12]) == (b"glTF", 2, len(glb))
    (length,) = struct.unpack("<I", glb[12:16])
    root = json.loads(glb[20 : 20 + length])
    rest = glb[20 + length :]
    if rest[4:8] != b"BIN\0":
        return root, b"", rest
    (size,) = struct.unpack("<I", rest[:4])
    return root, rest[8 : 8 + size], rest[8 + size :]


class Builder:
    """Collects accessors and meshes, then writes a GLB."""

    def __init__(self) -> None:
        self.binary = b""
        self.root: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
            "buffers": [],
        }

    def view(self, data: bytes, **more: Any) -> int:
        """Add a buffer view."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.root["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(self.root["bufferViews"]) - 1

    def accessor(self, values: Any, *, bounds: bool = False, view: dict[str, Any] | None = None, **more: Any) -> int:
        """Add a packed accessor of an array."""
        array = np.asarray(values)
        rows = array.reshape(len(array), -1)
        item = {
            "bufferView": self.view(rows.tobytes(), **(view or {})),
            "componentType": COMPONENTS[str(array.dtype)],
            "count": len(rows),
            "type": TYPES[rows.shape[1]],
            **more,
        }
        if bounds:
            item |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.root["accessors"].append(item)
        return len(self.root["accessors"]) - 1

    def primitive(self, verts: Any = QUAD_VERTS, faces: Any = QUAD_FACES, **attributes: Any) -> dict[str, Any]:
        """Return a primitive with accessors of its own; further arrays become attributes of their names."""
        made = {"POSITION": self.accessor(np.asarray(verts, np.float32), bounds=True, view={"target": 34962})}
        for name, values in attributes.items():
            made[name] = self.accessor(values, view={"target": 34962})
        primitive: dict[str, Any] = {"attributes": made}
        if faces is not None:
            primitive["indices"] = self.accessor(np.asarray(faces).reshape(-1), view={"target": 34963})
        return primitive

    def mesh(self, *primitives: dict[str, Any], **more: Any) -> int:
        """Add a mesh."""
        self.root["meshes"].append({"primitives": list(primitives), **more})
        return len(self.root["meshes"]) - 1

    def node(self, mesh: int | None = None, *, in_scene: bool = True, **more: Any) -> int:
        """Add a node, at the top of the scene unless told otherwise."""
        self.root["nodes"].append({**({} if mesh is None else {"mesh": mesh}), **more})
        at = len(self.root["nodes"]) - 1
        if in_scene:
            self.root["scenes"][0]["nodes"].append(at)
        return at

    def glb(self, *chunks: tuple[bytes, bytes]) -> bytes:
        """Write the GLB."""
        root = {key: value for key, value in self.root.items() if value != []}
        if self.binary:
            root["buffers"] = [{"byteLength": len(self.binary)}, *self.root["buffers"]]
        return pack(root, self.binary or None, *chunks)


def quad(**more: Any) -> bytes:
    """Return a GLB of one quad with normals and tangents."""
    builder = Builder()
    mesh = builder.mesh(builder.primitive(NORMAL=QUAD_NORMALS, TANGENT=QUAD_TANGENTS))
    builder.node(mesh, **more)
    return builder.glb()


def notable(asset: Asset) -> tuple[str, ...]:
    """The warnings about an asset, but for the one that small test shapes are too coarse to bend."""
    return tuple(text for text in asset.summary.warnings if "cannot bend" not in text)
