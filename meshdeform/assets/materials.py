"""Read what an asset's materials, textures and images show, for pictures.

Source: glTF 2.0 specification, section 3.9 (Materials) and 5.29 (Texture sampler); the KHR extensions named below.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

from meshdeform.assets.container import Json, extension, index, integer, member, numbers, objects, text
from meshdeform.assets.document import Document, decode_data_uri
from meshdeform.errors import AssetError

_WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST = 9728
_MAX_PIXELS = 2**26
_PORTABLE = ("BMP", "DDS", "GIF", "TGA", "TIFF", "WEBP")
"""Formats that Pillow may decode: some of its others start programs."""
IMAGE_EXTENSIONS = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds")
_SHADING_EXTENSIONS = {
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
}


@dataclass(frozen=True)
class Image:
    """An encoded image of the file."""

    data: bytes
    kind: str  # `png`, `jpg` or `webp`, detected from the bytes; "" for anything else


@dataclass(frozen=True)
class TextureUse:
    """A material's use of a texture."""

    image: int  # index into the document's images
    texcoord: int = 0  # number of the texture coordinate set
    wrap: tuple[str, str] = ("repeat", "repeat")  # `repeat`, `clamp` or `mirror`, for u and v
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    """In radians. KHR_texture_transform: uv' = offset + R(rotation) (scale * uv), with v downwards."""
    scale: tuple[float, float] = (1.0, 1.0)
    nearest: bool = False  # whether magnified texels stay squares


@dataclass(frozen=True)
class Material:
    """The base colour of a material. The defaults are those of a primitive without a material."""

    base_color: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # linear RGBA
    texture: TextureUse | None = None
    unlit: bool = False
    alpha_mode: str = "OPAQUE"  # `OPAQUE`, `MASK` or `BLEND`
    alpha_cutoff: float = 0.5
    double_sided: bool = False


def read_material(document: Document, at: int) -> Material:
    """Read one material; one of KHR_materials_pbrSpecularGlossiness gets its diffuse colour and texture."""
    root, where = document.root, f"materials[{at}]"
    items = objects(root, "materials")
    if not 0 <= at < len(items):
        raise AssetError(f"There is no {where}.")
    item = items[at]
    older = extension(item, "KHR_materials_pbrSpecularGlossiness", where)
    if older is None or "pbrMetallicRoughness" in item:
        shading, names = member(item, "pbrMetallicRoughness", where), ("baseColorFactor", "baseColorTexture")
    else:
        shading, names = older, ("diffuseFactor", "diffuseTexture")
    return Material(
        base_color=tuple(numbers(shading, names[0], 4, where) or (1.0,) * 4),
        texture=_texture(root, shading, names[1], where),
        unlit=extension(item, "KHR_materials_unlit", where) is not None,
        alpha_mode=text(item, "alphaMode", where) or "OPAQUE",
        alpha_cutoff=_number(item, "alphaCutoff", 0.5, where),
        double_sided=item.get("doubleSided") is True,
    )


@dataclass(frozen=True)
class Shading:
    """All of a material that other formats can hold."""

    name: str = ""
    base: Material = Material()
    metallic: float = 1.0
    roughness: float = 1.0
    emissive: tuple[float, ...] = (0.0, 0.0, 0.0)  # linear RGB, KHR_materials_emissive_strength included
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    textures: Mapping[str, TextureUse] = field(default_factory=dict)
    """By `base_color`, `metallic_roughness`, `emissive`, `normal` and `occlusion`: those that the material has."""
    normal_scale: float = 1.0
    occlusion_strength: float = 1.0
    left_out: tuple[str, ...] = ()  # extensions that are not read here


def read_shading(document: Document, at: int) -> Shading:
    """Read one material with metalness, roughness, emission, normals, occlusion and clear coat.

    KHR_materials_pbrSpecularGlossiness becomes a dielectric of the same diffuse colour and roughness.
    """
    base = read_material(document, at)
    root, where = document.root, f"materials[{at}]"
    item = objects(root, "materials")[at]
    metal = member(item, "pbrMetallicRoughness", where)
    older = extension(item, "KHR_materials_pbrSpecularGlossiness", where)
    coat = extension(item, "KHR_materials_clearcoat", where) or {}
    strength = extension(item, "KHR_materials_emissive_strength", where) or {}
    light = _number(strength, "emissiveStrength", 1.0, where)
    slots = {
        "metallic_roughness": (metal, "metallicRoughnessTexture"),
        "emissive": (item, "emissiveTexture"),
        "normal": (item, "normalTexture"),
        "occlusion": (item, "occlusionTexture"),
    }
    textures = {name: _texture(root, parent, key, where) for name, (parent, key) in slots.items()}
    extensions = item.get("extensions")
    known = extensions if isinstance(extensions, dict) else {}
    glossy = older is not None and "pbrMetallicRoughness" not in item
    return Shading(
        text(item, "name", where) or "",
        base,
        0.0 if glossy else _number(metal, "metallicFactor", 1.0, where),
        1.0 - _number(older or {}, "glossinessFactor", 1.0, where)
        if glossy
        else _number(metal, "roughnessFactor", 1.0, where),
        tuple(light * value for value in numbers(item, "emissiveFactor", 3, where) or (0.0, 0.0, 0.0)),
        _number(extension(item, "KHR_materials_ior", where) or {}, "ior", 1.5, where),
        _number(coat, "clearcoatFactor", 0.0, where),
        _number(coat, "clearcoatRoughnessFactor", 0.0, where),
        {name: use for name, use in {"base_color": base.texture, **textures}.items() if use is not None},
        _number(member(item, "normalTexture", where), "scale", 1.0, where),
        _number(member(item, "occlusionTexture", where), "strength", 1.0, where),
        tuple(sorted(set(known) - _SHADING_EXTENSIONS)),
    )


def _number(parent: Json, key: str, default: float, where: str) -> float:
    value = numbers({key: [parent[key]]}, key, 1, where) if key in parent else None
    return default if value is None else value[0]


def _pair(parent: Json, key: str, default: float, where: str) -> tuple[float, float]:
    first, second = numbers(parent, key, 2, where) or (default, default)
    return first, second


def _texture(root: Json, parent: Json, key: str, where: str) -> TextureUse | None:
    if key not in parent:
        return None
    info, where = member(parent, key, where), f"{where}.{key}"
    textures, samplers = objects(root, "textures"), objects(root, "samplers")
    at = index(info, "index", len(textures), where)
    if at is None:
        raise AssetError(f"{where}.index is missing.")
    image = _source(root, textures[at], f"textures[{at}]")
    if image is None:
        return None
    sampler = index(textures[at], "sampler", len(samplers), f"textures[{at}]")
    modes = {} if sampler is None else samplers[sampler]
    move = extension(info, "KHR_texture_transform", where) or {}
    texcoord = integer(info, "texCoord", where, default=0)
    return TextureUse(
        image=image,
        texcoord=integer(move, "texCoord", where, default=texcoord),
        wrap=(_wrap(modes, "wrapS", where), _wrap(modes, "wrapT", where)),
        offset=_pair(move, "offset", 0.0, where),
        rotation=_number(move, "rotation", 0.0, where),
        scale=_pair(move, "scale", 1.0, where),
        nearest=modes.get("magFilter") == _NEAREST,
    )


def _wrap(sampler: Json, key: str, where: str) -> str:
    return _WRAPS.get(integer(sampler, key, where, default=10497), "repeat")


def _source(root: Json, texture: Json, where: str) -> int | None:
    """Return a texture's image: the core glTF one if present, else the one from an extension."""
    images = objects(root, "images")
    plain = index(texture, "source", len(images), where)
    if plain is not None:
        return plain
    for name in IMAGE_EXTENSIONS:
        other = extension(texture, name, where)
        if other is not None:
            return index(other, "source", len(images), f"{where}.extensions.{name}")
    return None


def read_image(document: Document, at: int) -> Image:
    """Read an image's bytes."""
    image = document.root["images"][at]
    if "uri" in image:
        if image["uri"][:5].lower() != "data:":
            raise AssetError(f"images[{at}] is in another file.")
        data = decode_data_uri(image["uri"], f"images[{at}]")
    elif "bufferView" in image:
        data = bytes(document.view_bytes(image["bufferView"]))
    else:
        raise AssetError(f"images[{at}] has neither a uri nor a bufferView.")
    return Image(data, _kind(data))


def image_type(data: bytes) -> str:
    """Return the media type of an encoded image according to its first bytes, or "" if it is none of glTF's."""
    kind = _kind(data)
    if not kind and data.startswith(b"\xabKTX 20"):
        return "image/ktx2"
    return f"image/{'jpeg' if kind == 'jpg' else kind}" if kind else ""


def portable_picture(data: bytes) -> bytes:
    """Return a picture as PNG or JPEG, which every glTF viewer reads: TGA, BMP, TIFF and others become PNG.

    Empty if it cannot be read, is too large, or Pillow is not installed.
    """
    if _kind(data) in {"png", "jpg"}:
        return data
    try:
        from PIL import Image as Picture
        from PIL import UnidentifiedImageError
    except ImportError:
        return b""
    packed = io.BytesIO()
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # about damage that does not hinder reading
            Picture.open(io.BytesIO(data), formats=_PORTABLE) as picture,
        ):
            if picture.width * picture.height > _MAX_PIXELS:
                return b""
            picture.convert("RGBA" if picture.has_transparency_data else "RGB").save(packed, "PNG")
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, MemoryError, Picture.DecompressionBombError):
        return b""
    return packed.getvalue()


def _kind(data: bytes) -> str:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "png"
    if data.startswith(b"\xff\xd8\xff"):
        return "jpg"
    return "webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else ""
