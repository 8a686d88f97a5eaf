"""Pixels are counted from headers, wherever an image lies, and an image that nobody can read is left alone."""

from __future__ import annotations

import base64
import io
import struct
import zlib
from urllib.parse import quote

import pytest
from PIL import Image

from meshdeform.assets import inspect_asset
from meshdeform.assets.images import image_pixels
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetTooLargeError
from meshdeform.settings import Settings
from tests.unit.assets.builders import Builder


def picture(kind: str, size: tuple[int, int] = (37, 21), **options: object) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", size, (200, 30, 90)).save(file, kind, **options)
    return file.getvalue()


def ktx2(width: int, height: int, depth: int = 0, layers: int = 0, faces: int = 1, levels: int = 1) -> bytes:
    return (
        b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<8I", 37, 1, width, height, depth, layers, faces, levels) + bytes(60)
    )


def bomb(side: int) -> bytes:
    """A PNG of a few bytes that says it has side * side pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n\0\0\0\r" + header + struct.pack(">I", zlib.crc32(header))


def pixels(data: bytes) -> int | None:
    return image_pixels(lambda at, count: data[at : at + count])


def asset(*images: bytes, how: str = "view") -> bytes:
    """Return a quad with images, in the binary chunk, in data URIs, or in a buffer that is one."""
    builder = Builder()
    builder.node(builder.mesh(builder.primitive()))
    found = builder.root["images"] = []
    for data in images:
        uri = "data:image/png;base64," + base64.b64encode(data).decode()
        if how == "view":
            found.append({"bufferView": builder.view(data), "mimeType": "image/png"})
        elif how == "uri":
            found.append({"uri": uri})
        elif how == "escaped":
            found.append({"uri": "data:image/png," + quote(data)})
        else:
            shifted = "data:application/octet-stream;base64," + base64.b64encode(b"xx" + data).decode()
            builder.root["buffers"].append({"byteLength": len(data) + 2, "uri": shifted})
            view = {"buffer": len(builder.root["buffers"]), "byteOffset": 2, "byteLength": len(data)}
            builder.root["bufferViews"].append(view)
            found.append({"bufferView": len(builder.root["bufferViews"]) - 1, "mimeType": "image/png"})
    return builder.glb()


@pytest.mark.parametrize(
    "data",
    [
        picture("PNG"),
        picture("JPEG"),
        picture("JPEG", progressive=True),
        picture("JPEG", icc_profile=bytes(200_000), exif=b"Exif\0\0" + bytes(50_000)),
        picture("WEBP"),
        picture("WEBP", lossless=True),
        picture("WEBP", exif=b"Exif\0\0" + bytes(10)),
        ktx2(37, 21),
    ],
    ids=["png", "jpeg", "progressive", "jpeg-long", "webp", "webp-lossless", "webp-extended", "ktx2"],
)
def test_every_format(data: bytes) -> None:
    assert pixels(data) == 37 * 21


def test_layers_faces_and_mipmaps_count() -> None:
    assert pixels(ktx2(4, 4, layers=3, faces=6)) == 16 * 18
    assert pixels(ktx2(4, 2, levels=3)) == 8 + 2 + 1
    assert pixels(ktx2(4, 4, depth=4, levels=2)) == 64 + 8
    assert pixels(ktx2(2**31, 2**31, levels=2**32 - 1)) > 2**62


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_cut_header_is_nobodys_error(kind: str) -> None:
    data = picture(kind)
    found = {pixels(data[:length]) for length in range(len(data))}
    assert found == {None, 37 * 21}


def test_a_picture_that_is_none_passes() -> None:
    assert inspect_asset(asset(b"\xff\xd8" + b"\xff" * 10_000)).triangles == 2
    assert inspect_asset(asset(b"\xff\xd8\xff\xe0\0\0" * 50)).triangles == 2


@pytest.mark.parametrize("how", ["view", "uri", "escaped", "buffer"])
def test_a_bomb_is_refused_wherever_it_lies(how: str) -> None:
    with pytest.raises(AssetTooLargeError, match=r"images\[1\] has 10000000000 pixels.*MAX_IMAGE_PIXELS") as raised:
        inspect_asset(asset(picture("PNG"), bomb(100_000), how=how))
    assert raised.value.status == 413


def test_all_images_together_have_a_limit() -> None:
    limits = Limits(max_image_pixels=100, max_total_pixels=250)
    inspect_asset(asset(*[bomb(10)] * 2), limits=limits)
    with pytest.raises(AssetTooLargeError, match=r"250 pixels together, counted up to images\[2\].*MAX_TOTAL_PIXELS"):
        inspect_asset(asset(*[bomb(10)] * 3), limits=limits)


def test_the_settings_are_the_limits() -> None:
    limits = Limits.from_settings(Settings(max_image_pixels=7, max_total_pixels=9))
    assert (limits.max_image_pixels, limits.max_total_pixels) == (7, 9)
    assert Limits.from_settings(Settings()) == Limits()
