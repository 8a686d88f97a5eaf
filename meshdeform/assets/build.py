"""Write a plain GLB from arrays: for meshes of other formats, for the examples and for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.materials import image_type
from meshdeform.geometry.srgb import linear_from_srgb

Up = Literal["y", "z"]
CLAMP_TO_EDGE = 33071
_FAR = 32.0
"""Distance from the origin, in diagonals, from which 32-bit floats round a mesh by more than a 500,000th of it."""


@dataclass(frozen=True)
class Picture:
    """An encoded image of a material, and how it lies on the surface, in glTF's convention."""

    data: bytes  # PNG or JPEG; others are left out
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False  # whether it ends at its border in place of repeating


@dataclass(frozen=True)
class Primitive:
    """One mesh of the scene."""

    verts: NDArray[Any]  # (V, 3) array: positions
    faces: NDArray[Any]  # (F, 3) array of int: triangles, counter-clockwise from outside
    normals: NDArray[Any] | None = None  # (V, 3) array
    uvs: NDArray[Any] | None = None  # (V, 2) array: glTF's convention: v grows downwards
    colors: NDArray[Any] | None = None  # (V, 3) or (V, 4) array of uint8, or of floats in 0..1
    name: str = ""  # name of the node and the mesh
    material: str = ""
    """Name of the material. If empty, no material is written."""
    base_color: tuple[float, float, float, float] | None = None
    """Linear RGBA of the material. A material that is not opaque is blended."""
    # Of the material
    metallic: float = 0.0
    roughness: float = 0.8
    texture: Picture | None = None  # of the base colour
    normal_map: Picture | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear; above 1 with KHR_materials_emissive_strength
    emission_texture: Picture | None = None
    polygons: tuple[tuple[int, int], ...] = ()
    """The polygons that the triangles were cut from, in their order: of how many corners, and how many of these follow
    each other. One of n corners has n - 2 triangles. Written as `extras.polygons`; empty if there are none."""


@dataclass(frozen=True)
class Converted:
    """A mesh file as a GLB, in its own axes and unit."""

    glb: bytes
    notices: tuple[str, ...]  # what became of the file
    unit: float | None = None  # metres of its unit; None if its format leaves that open
    up: Up | None = None  # the axis that points up, in the same way


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
    A valid GLB with float32 attributes, and 16-bit indices where they suffice. Meshes far from the origin keep their
    precision: their nodes have the way there as a translation, and the positions are small numbers.
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
    origin = far_origin([each.verts for each in primitives])
    moved = {} if origin is None else {"translation": origin.tolist()}
    materials: dict[tuple[str, Any], int] = {}
    for i, primitive in enumerate(primitives):
        written = _write(document, primitive, origin)
        if primitive.material:
            key = (primitive.material, primitive.base_color)
            if key not in materials:
                materials[key] = len(materials)
                document.items("materials").append(_material(document, primitive))
            written["material"] = materials[key]
        title = {"name": primitive.name} if primitive.name else {}
        root["nodes"].append({**title, "mesh": i, **moved})
        root["meshes"].append({**title, "primitives": [written]})
    return document.to_bytes()


def far_origin(positions: Sequence[NDArray[Any]]) -> NDArray[np.float64] | None:
    """Return a round point near meshes that 32-bit floats would round too much; None for meshes that they hold.

    Parameters
    ----------
    positions : sequence of (V, 3) arrays
    """
    used = [np.asarray(each, np.float64) for each in positions if len(each)]
    if not used:
        return None
    low, high = (np.stack([extreme(each, axis=0) for each in used]) for extreme in (np.min, np.max))
    low, high = low.min(axis=0), high.max(axis=0)
    size = float(np.linalg.norm(high - low))
    if not 0.0 < size < np.inf or np.abs([low, high]).max() < _FAR * size:
        return None
    step = 10.0 ** np.floor(np.log10(size))
    return np.asarray(np.round((low + high) / 2 / step) * step)


def _material(document: Document, primitive: Primitive) -> Json:
    shading: Json = {"metallicFactor": primitive.metallic, "roughnessFactor": primitive.roughness}
    if primitive.base_color is not None:
        shading["baseColorFactor"] = [float(value) for value in primitive.base_color]
    material: Json = {"name": primitive.material, "pbrMetallicRoughness": shading}
    for holder, key, picture in (
        (shading, "baseColorTexture", primitive.texture),
        (material, "normalTexture", primitive.normal_map),
        (material, "emissiveTexture", primitive.emission_texture),
    ):
        kind = "" if picture is None else image_type(picture.data)
        if picture is not None and kind in {"image/png", "image/jpeg"} and primitive.uvs is not None:
            holder[key] = _texture(document, picture, kind)
    strength = max(primitive.emission)
    if strength > 0.0:
        material["emissiveFactor"] = [value / max(strength, 1.0) for value in primitive.emission]
    if strength > 1.0:
        _use(document, material, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
    if primitive.base_color is not None and primitive.base_color[3] < 1.0:
        material["alphaMode"] = "BLEND"
    return material


def _texture(document: Document, picture: Picture, kind: str) -> Json:
    """Append an image, a texture and a sampler, unless there are such ones; return the use of the texture."""
    images = document.items("images")
    same = (i for i, image in enumerate(images) if bytes(document.view_bytes(image["bufferView"])) == picture.data)
    source = next(same, len(images))
    if source == len(images):
        images.append({"bufferView": document.append_view(picture.data), "mimeType": kind})
    texture: Json = {"source": source}
    if picture.clamp:
        texture["sampler"] = _index_in(document.items("samplers"), {"wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE})
    use: Json = {"index": _index_in(document.items("textures"), texture)}
    if (picture.scale, picture.offset) != ((1.0, 1.0), (0.0, 0.0)):
        _use(document, use, "KHR_texture_transform", {"offset": list(picture.offset), "scale": list(picture.scale)})
    return use


def _index_in(items: list[Json], item: Json) -> int:
    """Return the index of an item in a list, to which it is appended unless it is there."""
    if item not in items:
        items.append(item)
    return items.index(item)


def _use(document: Document, holder: Json, name: str, body: Json) -> None:
    holder.setdefault("extensions", {})[name] = body
    if name not in document.items("extensionsUsed"):
        document.items("extensionsUsed").append(name)


def _write(document: Document, primitive: Primitive, origin: NDArray[np.float64] | None) -> Json:
    verts = np.asarray(primitive.verts if origin is None else primitive.verts - origin, np.float32)
    attributes = {"POSITION": document.append_accessor(verts, bounds=True)}
    if primitive.normals is not None:
        attributes["NORMAL"] = document.append_accessor(np.asarray(primitive.normals, np.float32))
    if primitive.uvs is not None:
        attributes["TEXCOORD_0"] = document.append_accessor(np.asarray(primitive.uvs, np.float32))
    if primitive.colors is not None:
        attributes["COLOR_0"] = document.append_accessor(_colors(np.asarray(primitive.colors)))
    indices = document.append_triangles(np.asarray(primitive.faces), len(verts))
    written: Json = {"attributes": attributes, "indices": indices}
    if primitive.polygons:
        written["extras"] = {"polygons": [list(run) for run in primitive.polygons]}
    return written


def linear_color(color: Sequence[float]) -> tuple[float, float, float]:
    """Return an sRGB colour, 0 .. 1, as linear numbers."""
    red, green, blue = linear_from_srgb(np.array(color, np.float64)).tolist()
    return red, green, blue


def _colors(colors: NDArray[Any]) -> NDArray[np.float32]:
    """Return colours as linear floats, as glTF requires; bytes are taken as sRGB."""
    if colors.dtype.kind == "f":
        return colors.astype(np.float32)
    values = colors / 255.0
    values[:, :3] = linear_from_srgb(values[:, :3])
    return values.astype(np.float32)
