"""Read how an asset looks, for drawing it: base colours, texture coordinates and vertex colours of its surface.

What a picture needs and nothing else: metalness, roughness, normal maps, occlusion and emission are left out. Nothing
here fails: a material, texture or attribute that cannot be read is replaced by a neutral one and counted.

Sources: glTF 2.0 specification, section 3.9 (Materials); KHR_texture_transform; KHR_materials_pbrSpecularGlossiness.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.materials import Image, Material, TextureUse, read_image, read_material
from meshdeform.assets.surface import Block
from meshdeform.errors import AssetError
from meshdeform.geometry.appearance import CLAY, Appearance, Paint, Texture

_MAX_SIDE = 1024
_MAX_TEXELS = 1 << 24
"""Of all textures together, after they were reduced: 64 MiB."""
_MAX_DECODED = 8192 * 8192
"""Pixels of one image before it is reduced."""
_MAX_DECODED_TOTAL = 2 * _MAX_DECODED
_UNREADABLE = np.full((1, 1, 4), (150, 150, 150, 255), np.uint8)
_FORMATS = ["PNG", "JPEG", "WEBP"]
_OTHER_KINDS = ((b"\xabKTX 20", "KTX2 texture"), (b"DDS ", "DDS texture"))
_FAILURES = (
    OSError,
    ValueError,
    SyntaxError,
    MemoryError,
    Picture.DecompressionBombError,
    Picture.DecompressionBombWarning,
)
_MAX_COORDINATE = 1e4
"""Larger texture coordinates are of no use in a picture, and lose their fraction in 32 bits."""


class ImageDecoder:
    """Decodes each image of the base colours once, within bounds on memory and time.

    Files may hold dozens of images of 8192 x 8192 pixels; a picture of the asset needs a thousandth of them. Every
    image is reduced as it is decoded, and all of them together fit a budget. `leave_out`: called with the description
    of each image that cannot be drawn.
    """

    def __init__(self, document: Document, leave_out: Callable[[str], None]) -> None:
        self._document, self._leave_out = document, leave_out
        self._side = _MAX_SIDE
        self._left = _MAX_DECODED_TOTAL
        self._decoded: dict[tuple[int, bool], NDArray[np.uint8]] = {}

    def plan(self, images: Iterable[int]) -> None:
        """Share the budget among the images that will be asked for."""
        count = max(1, len(set(images)))
        self._side = max(16, min(_MAX_SIDE, int((_MAX_TEXELS / count) ** 0.5)))

    def pixels(self, at: int, *, opaque: bool) -> NDArray[np.uint8]:
        """Return an image as (H, W, 4) uint8 sRGB and alpha, or one grey pixel if it cannot be drawn.

        `at`: index into the document's images; `opaque`: whether to ignore its alpha.
        """
        if (at, opaque) not in self._decoded:
            self._decoded[at, opaque] = self._read(at, opaque=opaque)
        return self._decoded[at, opaque]

    def _read(self, at: int, *, opaque: bool) -> NDArray[np.uint8]:
        try:
            image = read_image(self._document, at)
        except AssetError:
            outside = self._document.root["images"][at].get("uri", "data:")[:5].lower() != "data:"
            self._leave_out("image in another file" if outside else "invalid image")
            return _UNREADABLE
        if not image.kind:
            self._leave_out(next((what for magic, what in _OTHER_KINDS if image.data.startswith(magic)), "other image"))
            return _UNREADABLE
        try:
            return self._decode(image, opaque=opaque)
        except _FAILURES:
            self._leave_out(f"unreadable {image.kind} image")
            return _UNREADABLE

    def _decode(self, image: Image, *, opaque: bool) -> NDArray[np.uint8]:
        with Picture.open(io.BytesIO(image.data), formats=_FORMATS) as picture:
            picture.draft("RGB", (self._side, self._side))  # JPEG only: decodes at a half, a quarter or an eighth
            pixels = picture.width * picture.height
            if pixels > min(_MAX_DECODED, self._left):
                raise ValueError("too many pixels")
            self._left -= pixels
            picture.load()
            mode = "RGB" if opaque else "RGBA"
            # Reduced before the conversion where possible, which would need a second large picture.
            small: Picture.Image = picture
            if picture.mode not in ("RGB", "RGBA", "L"):
                small = picture.convert("RGBA")
            if opaque and small.mode == "RGBA":
                small = small.convert("RGB")  # else reducing would darken what is transparent
            factor = max(small.size) / self._side
            if factor >= 2:
                small = small.reduce(int(factor))
            if max(small.size) > self._side:
                small = small.resize(
                    tuple(max(1, round(side * self._side / max(small.size))) for side in small.size),  # type: ignore[arg-type]
                    Picture.Resampling.BOX,
                )
            return np.asarray(small.convert(mode).convert("RGBA"))


def read_appearance(document: Document, blocks: Sequence[Block]) -> Appearance:
    """Read the look of the surface that `read_surface` gathered in `blocks`."""
    return _Reader(document).read(blocks)


class _Reader:
    def __init__(self, document: Document) -> None:
        self._document = document
        self._left_out: dict[str, int] = {}
        self._pictures = ImageDecoder(document, self._leave_out)
        self._paints: list[Paint] = []
        self._numbers: dict[tuple[int | None, bool], tuple[int, TextureUse | None]] = {}

    def read(self, blocks: Sequence[Block]) -> Appearance:
        materials = [_material(p) for block in blocks for p in self._primitives(block)]
        self._materials = {at: self._material(at) for at in set(materials) if at is not None}
        self._pictures.plan([m.texture.image for m in self._materials.values() if m.texture])
        looks = [
            self._look(block, primitive, flip=block.placement.mirrors)
            for block in blocks
            for primitive in self._primitives(block)
        ]
        starts = np.cumsum([0, *(len(look.rows) for look in looks)])
        return Appearance(
            np.concatenate([look.rows for look in looks]),
            np.concatenate([start + look.triangles for start, look in zip(starts, looks, strict=False)]),
            np.concatenate([look.texcoords for look in looks]),
            np.concatenate([look.colors for look in looks]),
            np.concatenate([np.full(len(look.triangles), look.paint) for look in looks]),
            tuple(self._paints),
            self._left_out,
        )

    def _primitives(self, block: Block) -> list[Json]:
        primitives: list[Json] = self._document.root["meshes"][block.mesh]["primitives"]
        return [primitives[p] for p in block.primitives]

    def _material(self, at: int) -> Material:
        try:
            return read_material(self._document, at)
        except AssetError:
            self._leave_out("invalid material")
            return Material()

    def _look(self, block: Block, primitive: Json, *, flip: bool) -> _Look:
        count = len(block.positions)
        corners = read_triangles(self._document, primitive, count, "a primitive")
        if flip:
            corners = corners[:, ::-1]
        used, triangles = np.unique(corners, return_inverse=True)
        colors = self._attribute(primitive, "COLOR_0", count, (3, 4))
        paint, use = self._paint(_material(primitive), colored=colors is not None)
        texcoords = self._attribute(primitive, f"TEXCOORD_{use.texcoord}", count, (2,)) if use else None
        if use is not None and texcoords is None:
            self._leave_out("missing texture coordinates")
        return _Look(
            block.rows.start + used,
            triangles.reshape(-1, 3),
            np.zeros((len(used), 2), np.float32) if texcoords is None or use is None else _moved(texcoords[used], use),
            np.ones((len(used), 4), np.float32) if colors is None else _four(colors[used]),
            paint,
        )

    def _attribute(self, primitive: Json, name: str, count: int, widths: tuple[int, ...]) -> NDArray[np.float32] | None:
        if name not in primitive["attributes"]:
            return None
        try:
            values = read_floats(self._document, primitive["attributes"][name])
        except AssetError:  # the deformation did not need this attribute
            values = np.empty((0, 0), np.float32)
        if len(values) != count or values.shape[1] not in widths:
            self._leave_out(f"invalid {name}")
            return None
        return np.nan_to_num(values, nan=0.0, posinf=_MAX_COORDINATE, neginf=-_MAX_COORDINATE)

    def _paint(self, at: int | None, *, colored: bool) -> tuple[int, TextureUse | None]:
        """Return the number of a material's paint, and its texture if that can be drawn."""
        key = (at, colored)
        if key not in self._numbers:
            material = Material(double_sided=True) if at is None else self._materials[at]
            use = material.texture
            texture = None
            if use is not None:
                opaque = material.alpha_mode == "OPAQUE"
                texture = Texture(self._pictures.pixels(use.image, opaque=opaque), use.wrap, use.nearest)
            plain = use is None and not colored and material.base_color == (1.0, 1.0, 1.0, 1.0)
            self._paints.append(
                Paint(
                    CLAY if plain else material.base_color,
                    texture,
                    material.alpha_mode,
                    material.alpha_cutoff,
                    material.double_sided,
                    material.unlit,
                )
            )
            self._numbers[key] = (len(self._paints) - 1, use)
        return self._numbers[key]

    def _leave_out(self, what: str) -> None:
        self._left_out[what] = self._left_out.get(what, 0) + 1


@dataclass(frozen=True)
class _Look:
    """One primitive of one instance."""

    rows: NDArray[np.int64]
    triangles: NDArray[np.int64]
    texcoords: NDArray[np.float32]
    colors: NDArray[np.float32]
    paint: int


def _material(primitive: Json) -> int | None:
    number: Any = primitive.get("material")
    return number if isinstance(number, int) else None


def _moved(texcoords: NDArray[np.float32], use: TextureUse) -> NDArray[np.float32]:
    """Apply KHR_texture_transform, and bound what comes out."""
    moved = np.nan_to_num(moved_texcoords(texcoords, use))
    bounded: NDArray[np.float32] = np.clip(moved, -_MAX_COORDINATE, _MAX_COORDINATE).astype(np.float32)
    return bounded


def _four(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return colours with an alpha, clipped to 0..1."""
    alpha = colors[:, 3:] if colors.shape[1] == 4 else np.ones((len(colors), 1), np.float32)
    bounded: NDArray[np.float32] = np.clip(np.concatenate([colors[:, :3], alpha], 1), 0.0, 1.0)
    return bounded


def moved_texcoords(values: NDArray[np.floating], use: TextureUse) -> NDArray[np.float64]:
    """Return texture coordinates (V, 2), v downwards, as a use of a texture reads them.

    A scale, a rotation that is counter-clockwise in the picture, and an offset.
    """
    if (use.offset, use.rotation, use.scale) == ((0.0, 0.0), 0.0, (1.0, 1.0)):
        return np.asarray(values, np.float64)
    u, v = (values.astype(np.float64) * use.scale).T
    cosine, sine = np.cos(use.rotation), np.sin(use.rotation)
    return np.stack([cosine * u + sine * v + use.offset[0], cosine * v - sine * u + use.offset[1]], 1)
