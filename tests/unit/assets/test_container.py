"""The GLB container: every length is checked, and what is not understood is kept."""

from __future__ import annotations

import json
import struct

import pytest

from meshdeform.assets.container import clone, dump_json, glb_layout, pack_glb, parse_json
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError
from tests.cases import each_case
from tests.unit.assets.builders import pack, quad

LIMITS = Limits()


def test_chunks_are_found_and_packed() -> None:
    glb = pack(b'{"a":1}', b"12345678", (b"XTRA", b"abcd"))
    layout = glb_layout(glb, LIMITS)
    assert glb[layout.json] == b'{"a":1} '
    assert layout.binary is not None
    assert glb[layout.binary] == b"12345678"
    assert glb[layout.rest] == struct.pack("<I4s4s", 4, b"XTRA", b"abcd")
    # A binary chunk counts only in second place.
    assert glb_layout(pack(b"{}", None, (b"XTRA", b"abcd"), (b"BIN\0", b"1234")), LIMITS).binary is None
    assert pack_glb(b"{}", [b"123", b"45"], b"") == pack(b"{}", b"12345")


def test_every_truncation_and_every_length_that_lies_is_told() -> None:
    glb = quad()
    for length in range(len(glb)):
        with pytest.raises(AssetTruncatedError):
            glb_layout(glb[:length], LIMITS)
    for at in (12, -12):
        for lie in (0xFFFFFFFF, 0x7FFFFFFF):
            lying = bytearray(pack(b"{}", b"1234"))
            struct.pack_into("<I", lying, at % len(lying), lie)
            with pytest.raises(AssetTruncatedError):
                glb_layout(bytes(lying), LIMITS)
    with pytest.raises(AssetTooLargeError, match="MESHDEFORM_MAX_JSON_BYTES"):
        glb_layout(glb, Limits(max_json_bytes=100))


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


# JSON that comes back with the values that it had, within limits.


TEXT = (
    r'{"asset": {"version" : "2.0"}, "a": [1.0, 1, 0.1000, 1e5, 1E+05, -0, -0.0, 12345678901234567890.0,'
    r" 12345678901234567890],"
    '\n "nodes": [ {"translation": [0.10, 2, 3.0], "extras": {"kept": 1.50}} , {"b": "\\u00e9\\/é"} ], "z": null}'
)


def test_an_unchanged_document_keeps_every_value_and_the_order() -> None:
    written = dump_json(clone(parse_json(TEXT.encode(), LIMITS))).decode()
    assert json.loads(written) == json.loads(TEXT)
    assert list(json.loads(written)) == ["asset", "a", "nodes", "z"]
    # Integers stay integers and floats stay floats, however large.
    assert '"a":[1.0,1,0.1,100000.0,100000.0,0,-0.0,1.2345678901234567e+19,12345678901234567890]' in written
    for number in (1 / 3, 5e-324, 1.7976931348623157e308, -0.0, float(2**53 + 2)):
        root = parse_json(f'{{"v": {number:.30e}}}'.encode(), LIMITS)
        assert json.loads(dump_json(root))["v"].hex() == number.hex()
    text = r'{"name": "\ud800", "other": "é", "n": ' + "9" * 4000 + "}"  # a lone surrogate, a large integer
    assert dump_json(parse_json(text.encode(), LIMITS)).decode().endswith("9" * 4000 + "}")
    assert parse_json(dump_json(parse_json(text.encode(), LIMITS)), LIMITS) == parse_json(text.encode(), LIMITS)
    assert dump_json(parse_json(b'{"a": 1, "a": [2.50]}', LIMITS)) == b'{"a":[2.5]}'


@each_case(
    "text",
    [
        b"",
        b"[]",
        b"nonsense",
        b'{"a": NaN}',
        b'{"a": -Infinity}',
        b'{"a": 1e999}',
        b'{"a": -1e999}',
        b'{"a": "\xff"}',
        b'{"a": ' + b"9" * 5000 + b"}",
        b'{"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
        b'{"a": ' + b"[" * 100_000,
        b'{"a": ' + b'{"a":' * 100_000,
        b'{"unterminated',
        b'{"a": 1} {"b": 2}',
    ],
)
def test_what_is_not_a_json_object_is_one_clear_error(text: bytes) -> None:
    with pytest.raises(AssetError):
        parse_json(text, LIMITS)


def test_depth_and_values_are_counted_before_they_are_made() -> None:
    text = json.dumps({"a": "[" * 1000 + '"' + "\\" * 3 + '"{'}).encode()
    assert parse_json(text, Limits(max_json_depth=3))["a"].startswith("[[")
    with pytest.raises(AssetTooLargeError):
        parse_json(b'{"a": [' + b"[]," * 1000 + b"1]}", Limits(max_json_values=1000))
