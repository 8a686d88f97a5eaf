"""Pack the meshes of `bench.inputs` as the files that exporters and kits write.

Each function takes the plain GLB of a mesh, with UVs and a material, and returns the file that is deformed.
"""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.assets.accessors import read_accessor
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits

__all__ = ["FILES"]

_DRACO = "KHR_draco_mesh_compression"
_INSTANCING = "EXT_mesh_gpu_instancing"


def _png() -> bytes:
    """Return a picture of 2 x 2 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"\0\xff\0\0\0\xff\0" + b"\0\0\0\xff\xff\xff\xff"
    header = struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0)
    parts = [chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _zip(files: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return packed.getvalue()


def _open(glb: bytes) -> tuple[Document, dict[str, Any]]:
    document = Document.parse(glb, Limits(), glb=True)
    return document, document.root["meshes"][0]["primitives"][0]


def _with_texture(root: dict[str, Any], uri: str) -> None:
    root["images"], root["textures"] = [{"uri": uri}], [{"source": 0}]
    root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}


def _draco_skin(glb: bytes) -> bytes:
    """Return the mesh with four joints whose weights Draco has rounded."""
    import DracoPy

    document, primitive = _open(glb)
    root, accessors = document.root, document.root["accessors"]
    verts, uvs = (read_accessor(document, primitive["attributes"][name]) for name in ("POSITION", "TEXCOORD_0"))
    faces = read_accessor(document, primitive["indices"])[:, 0].astype(np.uint32).reshape(-1, 3)
    weights = np.random.default_rng(0).random((len(verts), 4)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    joints = np.tile(np.arange(4, dtype=np.uint8), (len(verts), 1))
    generic = {1: uvs, 2: weights, 3: joints}
    stream = DracoPy.encode(verts, faces, quantization_bits=14, preserve_order=True, generic_attributes=generic)
    position = next(item["unique_id"] for item in DracoPy.decode(stream).attributes if item["attribute_type"] == 0)
    for name, component in (("WEIGHTS_0", 5126), ("JOINTS_0", 5121)):
        primitive["attributes"][name] = len(accessors)
        accessors.append({"componentType": component, "count": len(verts), "type": "VEC4"})
    for accessor in accessors:
        accessor.pop("bufferView", None)
    root["bufferViews"].clear()
    ids = {"POSITION": position, "TEXCOORD_0": 1, "WEIGHTS_0": 2, "JOINTS_0": 3}
    primitive["extensions"] = {_DRACO: {"bufferView": document.append_view(stream), "attributes": ids}}
    root |= {"extensionsUsed": [_DRACO], "extensionsRequired": [_DRACO], "skins": [{"joints": [2, 3, 4, 5]}]}
    root["nodes"][0]["skin"] = 0
    root["nodes"] += [{"children": [2, 3, 4, 5]}, {}, {}, {}, {}]
    root["scenes"][0]["nodes"].append(1)
    return document.to_bytes()


def _instanced(glb: bytes) -> bytes:
    """Return the mesh drawn 50 times in a row."""
    document, _ = _open(glb)
    places = np.outer(np.arange(50), [3.0, 0.0, 0.0]).astype(np.float32)
    many = {"attributes": {"TRANSLATION": document.append_accessor(places, vertex=False)}}
    document.root["nodes"][0]["extensions"] = {_INSTANCING: many}
    document.root["extensionsUsed"] = document.root["extensionsRequired"] = [_INSTANCING]
    return document.to_bytes()


def _broken_normals(glb: bytes) -> bytes:
    """Return the mesh with normals and tangents of which every tenth is NaN and every fifteenth zero."""
    document, primitive = _open(glb)
    normals = read_accessor(document, primitive["attributes"]["POSITION"]).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.ones((len(normals), 4), np.float32)
    tangents[:, :3] = np.cross(normals, [0.3, 0.5, 0.8])
    tangents[:, :3] /= np.linalg.norm(tangents[:, :3], axis=1, keepdims=True)
    for rows in (normals, tangents):
        rows[::10], rows[::15] = np.nan, 0.0
    for name, rows in (("NORMAL", normals), ("TANGENT", tangents)):
        primitive["attributes"][name] = document.append_accessor(rows)
    return document.to_bytes()


def _loose(glb: bytes) -> bytes:
    """Return the mesh with a cloud of points in and around it."""
    document, primitive = _open(glb)
    cloud = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    points = {"attributes": {"POSITION": document.append_accessor(cloud, bounds=True)}, "mode": 0}
    lines = {"attributes": {"POSITION": primitive["attributes"]["POSITION"]}, "mode": 3}
    document.root["meshes"][0]["primitives"] += [points, lines]
    return document.to_bytes()


def _backdrop(glb: bytes) -> bytes:
    """Return the mesh over a ground plane of ten times its width."""
    document, primitive = _open(glb)
    corner = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, -1], [1, 0, 1]], np.float32) * [10, 1, 10] - [0, 1.5, 0]
    plane = {
        "POSITION": document.append_accessor(corner.astype(np.float32), bounds=True),
        "TEXCOORD_0": document.append_accessor(corner[:, ::2].astype(np.float32)),
    }
    view = document.append_view(np.array([0, 1, 2, 2, 1, 3], np.uint16).tobytes(), 34963)
    document.items("accessors").append({"bufferView": view, "componentType": 5123, "count": 6, "type": "SCALAR"})
    indices = len(document.items("accessors")) - 1
    document.root["meshes"].append({"primitives": [{"attributes": plane, "indices": indices, "material": 0}]})
    document.root["nodes"].append({"mesh": 1, "name": "Ground"})
    document.root["scenes"][0]["nodes"].append(1)
    assert primitive["material"] == 0
    return document.to_bytes()


def _image_outside(glb: bytes) -> bytes:
    document, _ = _open(glb)
    _with_texture(document.root, "Textures/colormap.png")
    return document.to_bytes()


def _gltf(glb: bytes, buffer: Callable[[bytes], str], picture: str) -> bytes:
    document, _ = _open(glb)
    data = bytes(document.buffer_bytes(0))
    document.root["buffers"] = [{"byteLength": len(data), "uri": buffer(data)}]
    _with_texture(document.root, picture)
    return json.dumps(document.root).encode()


def _data_uris(glb: bytes) -> bytes:
    def text(data: bytes) -> str:
        return "data:application/octet-stream;base64," + base64.b64encode(data).decode()

    return _gltf(glb, text, "data:image/png;base64," + base64.b64encode(_png()).decode())


def _gltf_zip(glb: bytes) -> bytes:
    document, _ = _open(glb)
    text = _gltf(glb, lambda _: "mesh.bin", "textures/color.png")
    return _zip({"mesh.gltf": text, "mesh.bin": bytes(document.buffer_bytes(0)), "textures/color.png": _png()})


def _obj_zip(glb: bytes) -> bytes:
    """Return the mesh as an OBJ of two materials with its library and a texture."""
    surface = load_asset(glb).surface
    document, primitive = _open(glb)
    uvs = read_accessor(document, primitive["attributes"]["TEXCOORD_0"])
    lines = ["mtllib mesh.mtl", *("v {} {} {}".format(*row) for row in surface.positions)]
    lines += [f"vt {u} {1 - v}" for u, v in uvs]
    half = len(surface.triangles) // 2
    for name, part in (("wood", surface.triangles[:half]), ("stone", surface.triangles[half:])):
        lines += [f"g {name}", f"usemtl {name}", *(f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in part + 1)]
    library = b"newmtl wood\nmap_Kd color.png\nnewmtl stone\nKd 0.5 0.5 0.5\n"
    return _zip({"mesh.obj": "\n".join(lines).encode() + b"\n", "mesh.mtl": library, "color.png": _png()})


FILES: dict[str, Callable[[bytes], bytes]] = {
    "plain": bytes,
    "draco-skin": _draco_skin,
    "instanced": _instanced,
    "broken-normals": _broken_normals,
    "loose": _loose,
    "backdrop": _backdrop,
    "image-outside": _image_outside,
    "data-uris": _data_uris,
    "gltf-zip": _gltf_zip,
    "obj-zip": _obj_zip,
}
"""The ways to pack a mesh, by name."""
