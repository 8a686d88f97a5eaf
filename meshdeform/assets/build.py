"""Write a plain GLB from arrays: for meshes of other formats, for the examples and for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.container import Json
from meshdeform.assets.document import ELEMENT_ARRAY_BUFFER, Document
from meshdeform.assets.materials import image_type
from meshdeform.assets.storage import UNSIGNED_INT, UNSIGNED_SHORT

__all__ = ["Primitive", "build_glb"]


@dataclass(frozen=True)
class Primitive:
    """One mesh of the scene.

    Attributes
    ----------
    verts : (V, 3) array
        Positions.
    faces : (F, 3) array of int
        Triangles, counter-clockwise from outside.
    normals : (V, 3) array, optional
    uvs : (V, 2) array, optional
        glTF's convention: v grows downwards.
    colors : (V, 3) or (V, 4) array of uint8, or of floats in 0..1, optional
    name : str
        Name of the node and the mesh.
    material : str
        Name of the material. If empty, no material is written.
    base_color : tuple of 4 floats, optional
        Linear RGBA of the material. A material that is not opaque is blended.
    metallic, roughness : float
        Of the material.
    texture : bytes
        The material's encoded base colour image, PNG or JPEG; others and empty ones are left out.
    """

    verts: NDArray[Any]
    faces: NDArray[Any]
    normals: NDArray[Any] | None = None
    uvs: NDArray[Any] | None = None
    colors: NDArray[Any] | None = None
    name: str = ""
    material: str = ""
    base_color: tuple[float, float, float, float] | None = None
    metallic: float = 0.0
    roughness: float = 0.8
    texture: bytes = b""


def build_glb(
    verts: NDArray[Any] | Sequence[Primitive],
    faces: NDArray[Any] | None = None,
    *,
    normals: NDArray[Any] | None = None,
    uvs: NDArray[Any] | None = None,
    colors: NDArray[Any] | None = None,
    name: str = "",
    material: str = "",
    base_color: tuple[float, float, float, float] | None = None,
) -> bytes:
    """Write a GLB of one mesh, or of several `Primitive`s on separate nodes.

    Parameters
    ----------
    verts, faces, normals, uvs, colors, name, material, base_color
        The fields of `Primitive`. Alternatively, `verts` alone: a sequence of `Primitive`s.

    Returns
    -------
    A valid GLB with float32 attributes, and 16-bit indices where they suffice.
    """
    if faces is None:
        primitives = list(verts)
    else:
        primitives = [Primitive(np.asarray(verts), faces, normals, uvs, colors, name, material, base_color)]
    root: Json = {
        "asset": {"version": "2.0", "generator": f"Meshdeform {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(primitives)))}],
        "nodes": [],
        "meshes": [],
    }
    document = Document(root, None, b"")
    materials: dict[tuple[str, Any], int] = {}
    for i, primitive in enumerate(primitives):
        written = _write(document, primitive)
        if primitive.material:
            key = (primitive.material, primitive.base_color)
            if key not in materials:
                materials[key] = len(materials)
                document.items("materials").append(_material(document, primitive))
            written["material"] = materials[key]
        title = {"name": primitive.name} if primitive.name else {}
        root["nodes"].append({**title, "mesh": i})
        root["meshes"].append({**title, "primitives": [written]})
    return document.to_bytes()


def _material(document: Document, primitive: Primitive) -> Json:
    shading: Json = {"metallicFactor": primitive.metallic, "roughnessFactor": primitive.roughness}
    if primitive.base_color is not None:
        shading["baseColorFactor"] = [float(value) for value in primitive.base_color]
    kind = image_type(primitive.texture)
    if kind in {"image/png", "image/jpeg"} and primitive.uvs is not None:
        shading["baseColorTexture"] = {"index": _texture(document, primitive.texture, kind)}
        if primitive.base_color is not None:  # the texture takes the place of the colour
            shading["baseColorFactor"] = [1.0, 1.0, 1.0, float(primitive.base_color[3])]
    material: Json = {"name": primitive.material, "pbrMetallicRoughness": shading}
    if primitive.base_color is not None and primitive.base_color[3] < 1.0:
        material["alphaMode"] = "BLEND"
    return material


def _texture(document: Document, data: bytes, kind: str) -> int:
    """Append an image and a texture, unless there is one of the same image; return the texture's index."""
    images, textures = document.items("images"), document.items("textures")
    for i, image in enumerate(images):
        if bytes(document.view_bytes(image["bufferView"])) == data:
            return next(t for t, texture in enumerate(textures) if texture["source"] == i)
    images.append({"bufferView": document.append_view(data), "mimeType": kind})
    textures.append({"source": len(images) - 1})
    return len(textures) - 1


def _write(document: Document, primitive: Primitive) -> Json:
    verts = np.asarray(primitive.verts, np.float32)
    attributes = {"POSITION": document.append_accessor(verts, bounds=True)}
    if primitive.normals is not None:
        attributes["NORMAL"] = document.append_accessor(np.asarray(primitive.normals, np.float32))
    if primitive.uvs is not None:
        attributes["TEXCOORD_0"] = document.append_accessor(np.asarray(primitive.uvs, np.float32))
    if primitive.colors is not None:
        attributes["COLOR_0"] = document.append_accessor(_colors(np.asarray(primitive.colors)))
    corners = np.asarray(primitive.faces).reshape(-1)
    small = len(verts) < 2**16  # 65535 itself is not a valid 16-bit index
    view = document.append_view(corners.astype("<u2" if small else "<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
    component = UNSIGNED_SHORT if small else UNSIGNED_INT
    document.items("accessors").append(
        {"bufferView": view, "componentType": component, "count": len(corners), "type": "SCALAR"}
    )
    return {"attributes": attributes, "indices": len(document.items("accessors")) - 1}


def _colors(colors: NDArray[Any]) -> NDArray[np.float32]:
    """Return colours as linear floats, as glTF requires; bytes are taken as sRGB."""
    if colors.dtype.kind == "f":
        return colors.astype(np.float32)
    values = colors / 255.0
    values[:, :3] = np.where(values[:, :3] <= 0.04045, values[:, :3] / 12.92, ((values[:, :3] + 0.055) / 1.055) ** 2.4)
    return values.astype(np.float32)
