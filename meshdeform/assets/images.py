"""How many pixels an asset's images decode to, read from their headers alone. Pure Python.

Meshdeform decodes no image: each comes back byte for byte. Whoever shows the result does decode them, so a small file
that unfolds to a huge picture is refused at the door. An image whose header is none of these formats, or is broken, is
left alone: its bytes count towards the file's limit, and its pixels are not known.

Sources: PNG (ISO/IEC 15948, section 11.2.2), JPEG (ITU-T T.81, annex B), WebP (RFC 9649), KTX 2.0 (Khronos, section 3).
"""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Callable
from urllib.parse import unquote_to_bytes

from meshdeform.assets.json_text import Json
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetTooLargeError

__all__ = ["Read", "check_images", "image_pixels"]

Read = Callable[[int, int], bytes]
"""`read(start, count)` returns bytes of an image, fewer where it ends."""

_PNG = b"\x89PNG\r\n\x1a\n"
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
_MAX_SEGMENTS = 4096  # a JPEG has a few dozen before its frame
_MAX_ESCAPED = 64 * 1024  # bytes of a percent-encoded data URI that are looked at


def check_images(root: Json, binary: Read | None, limits: Limits) -> None:
    """Add up the pixels of a document's images; its storage has been checked before.

    Parameters
    ----------
    root : dict
        The parsed JSON.
    binary : callable or None
        Reads from the GLB's binary chunk.
    limits : Limits
        `max_image_pixels` for each image, `max_total_pixels` for all.

    Raises
    ------
    AssetTooLargeError
        It names the image, and the limit.
    """
    total = 0
    for i, image in enumerate(root.get("images", [])):
        read = _reader(root, image, binary)
        pixels = image_pixels(read) if read is not None else None
        if pixels is None:
            continue
        if pixels > limits.max_image_pixels:
            raise AssetTooLargeError(
                f"images[{i}] has {pixels} pixels; the limit is {limits.max_image_pixels} "
                "(MESHDEFORM_MAX_IMAGE_PIXELS).",
                advice="Scale the image down, or raise the limit that the message names.",
            )
        total += pixels
        if total > limits.max_total_pixels:
            raise AssetTooLargeError(
                f"The images have more than {limits.max_total_pixels} pixels together, counted up to images[{i}] "
                "(MESHDEFORM_MAX_TOTAL_PIXELS).",
                advice="Scale the images down, or raise the limit that the message names.",
            )


def _reader(root: Json, image: Json, binary: Read | None) -> Read | None:
    if "uri" in image:
        return _uri_reader(image["uri"])
    if "bufferView" not in image:
        return None
    view = root["bufferViews"][image["bufferView"]]
    start, length = view.get("byteOffset", 0), view["byteLength"]
    uri = root["buffers"][view["buffer"]].get("uri")
    whole = binary if uri is None and view["buffer"] == 0 else _uri_reader(uri) if uri is not None else None
    if whole is None:
        return None
    return lambda at, count: whole(start + at, max(0, min(count, length - at)))


def _uri_reader(uri: str) -> Read:
    header, comma, _ = uri[:1024].partition(",")
    begin = len(header) + 1 if comma else len(uri)
    if not header.lower().endswith(";base64"):
        escaped = unquote_to_bytes(uri[begin : begin + _MAX_ESCAPED])
        return lambda at, count: escaped[at : at + count]

    def read(at: int, count: int) -> bytes:
        group = at // 3
        text = uri[begin + 4 * group : begin + 4 * ((at + count + 2) // 3)]
        try:
            return base64.b64decode(text, validate=True)[at - 3 * group :][:count]
        except (binascii.Error, ValueError):
            return b""

    return read


def image_pixels(read: Read) -> int | None:
    """Return how many pixels an image decodes to, every layer, face and mipmap of it; None where nobody can tell."""
    head = read(0, 48)
    if head.startswith(_PNG):
        return _product(head[16:24], ">II")
    if head.startswith(b"\xff\xd8"):
        return _jpeg(read)
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return _webp(head)
    if head.startswith(_KTX2):
        return _ktx2(head)
    return None


def _product(data: bytes, layout: str) -> int | None:
    if len(data) < struct.calcsize(layout):
        return None
    width, height = struct.unpack(layout, data[: struct.calcsize(layout)])
    return int(width * height)


def _jpeg(read: Read) -> int | None:
    """Go from segment to segment until the frame header, which says the height and the width."""
    at = 2
    for _ in range(_MAX_SEGMENTS):
        segment = read(at, 9)
        if len(segment) < 4 or segment[0] != 0xFF:
            return None
        marker = segment[1]
        if marker == 0xFF:  # any number of these may stand before a marker
            at += 1
        elif marker == 0x01 or 0xD0 <= marker <= 0xD8:  # no length follows
            at += 2
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return _product(segment[5:9], ">HH")
        elif marker in (0xD9, 0xDA):  # the picture ends, or its data begin, before it has a size
            return None
        else:
            at += 2 + int.from_bytes(segment[2:4], "big")
    return None


def _webp(head: bytes) -> int | None:
    kind, body = head[12:16], head[20:]
    if kind == b"VP8 " and body[3:6] == b"\x9d\x01\x2a" and len(body) >= 10:
        width, height = struct.unpack("<HH", body[6:10])
        return int((width & 0x3FFF) * (height & 0x3FFF))
    if kind == b"VP8L" and body[:1] == b"\x2f" and len(body) >= 5:
        bits = int.from_bytes(body[1:5], "little")
        return ((bits & 0x3FFF) + 1) * ((bits >> 14 & 0x3FFF) + 1)
    if kind == b"VP8X" and len(body) >= 10:
        width, height = (int.from_bytes(body[at : at + 3], "little") + 1 for at in (4, 7))
        return width * height
    return None


def _ktx2(head: bytes) -> int | None:
    if len(head) < 44:
        return None
    width, height, depth, layers, faces, levels = struct.unpack("<6I", head[20:44])
    pixels: int = 0
    for level in range(max(1, min(levels, 32))):
        pixels += max(width >> level, 1) * max(height >> level, 1) * max(depth >> level, 1)
    return int(pixels * max(layers, 1) * max(faces, 1))
