"""The GLB container: every length is checked, and what is not understood is kept."""

from __future__ import annotations

import struct

import pytest

from meshdeform.assets.container import glb_layout, pack_glb
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError
from tests.cases import each_case
from tests.unit.assets.builders import pack, quad

LIMITS = Limits()


def test_chunks_are_found() -> None:
    glb = pack(b'{"a":1}', b"12345678", (b"XTRA", b"abcd"))
    layout = glb_layout(glb, LIMITS)
    assert glb[layout.json] == b'{"a":1} '
    assert layout.binary is not None
    assert glb[layout.binary] == b"12345678"
    assert glb[layout.rest] == struct.pack("<I4s4s", 4, b"XTRA", b"abcd")


def test_a_binary_chunk_counts_only_in_second_place() -> None:
    layout = glb_layout(pack(b"{}", None, (b"XTRA", b"abcd"), (b"BIN\0", b"1234")), LIMITS)
    assert layout.binary is None


def test_packing_pads_and_counts() -> None:
    glb = pack_glb(b"{}", [b"123", b"45"], b"")
    assert glb == pack(b"{}", b"12345")


def test_every_truncation_is_told() -> None:
    glb = quad()
    for length in range(len(glb)):
        with pytest.raises(AssetTruncatedError):
            glb_layout(glb[:length], LIMITS)


@each_case("at", [12, -12])
@each_case("lie", [0xFFFFFFFF, 0x7FFFFFFF])
def test_a_chunk_length_that_lies_is_told(at: int, lie: int) -> None:
    glb = bytearray(pack(b"{}", b"1234"))
    struct.pack_into("<I", glb, at % len(glb), lie)
    with pytest.raises(AssetTruncatedError):
        glb_layout(bytes(glb), LIMITS)


@each_case(
    ("data", "error"),
    [
        (b"glTF" + struct.pack("<II", 1, 20) + bytes(8), AssetFormatError),
        (b"GLTF" + struct.pack("<II", 2, 20) + bytes(8), AssetFormatError),
        (b"glTF" + struct.pack("<II", 2, 12), AssetError),
        (b"glTF" + struct.pack("<II", 2, 20) + struct.pack("<I4s", 0, b"BIN\0"), AssetError),
    ],
)
def test_what_is_not_a_glb_is_told(data: bytes, error: type[AssetError]) -> None:
    with pytest.raises(error):
        glb_layout(data, LIMITS)


def test_the_json_chunk_has_a_limit() -> None:
    with pytest.raises(AssetTooLargeError, match="MESHDEFORM_MAX_JSON_BYTES"):
        glb_layout(quad(), Limits(max_json_bytes=100))
