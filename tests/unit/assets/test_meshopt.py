"""Our decoder against frozen streams and, where it is installed, against meshoptimizer's own encoder."""

from __future__ import annotations

import base64
import contextlib
from typing import Any

import numpy as np
import pytest

from meshdeform.assets.meshopt import apply_filter, decode_attributes, decode_indices, decode_triangles
from meshdeform.errors import AssetError
from tests.cases import each_case


@pytest.fixture
def encoder() -> Any:
    return pytest.importorskip("meshoptimizer", reason="meshoptimizer (test only) is not installed")


def _smooth(rng: np.random.Generator, count: int, stride: int) -> np.ndarray:
    """Elements that use every width of delta: noise of several sizes, steps, and runs that do not change."""
    noise = rng.integers(0, 256, (count, stride)) >> rng.integers(0, 8, stride)
    walk = np.cumsum(noise * (rng.random((count, stride)) < rng.random(stride)), axis=0)
    return walk.astype(np.uint8)


@each_case("version", [0, 1])
@each_case(("count", "stride"), [(1, 4), (15, 4), (16, 8), (17, 12), (256, 16), (257, 16), (1000, 64), (300, 256)])
def test_attributes_equal_the_encoders_input(encoder: Any, version: int, count: int, stride: int) -> None:
    rng = np.random.default_rng(count * stride)
    encoder.encode_vertex_version(version)
    floats = np.cumsum(rng.normal(size=(count, stride // 4)), axis=0).astype(np.float32).view(np.uint8)
    shorts = np.cumsum(rng.integers(-300, 300, (count, stride // 2)), axis=0).astype(np.int16).view(np.uint8)
    for elements in (
        _smooth(rng, count, stride),
        floats,
        shorts,
        rng.integers(0, 256, (count, stride)).astype(np.uint8),
    ):
        data = encoder.encode_vertex_buffer(np.ascontiguousarray(elements), count, stride)
        assert data[0] == 0xA0 + version
        np.testing.assert_array_equal(decode_attributes(data, count, stride), elements)


def _grid_triangles(side: int) -> np.ndarray:
    rows, columns = np.mgrid[0 : side - 1, 0 : side - 1]
    corner = (rows * side + columns).reshape(-1)
    quads = np.stack([corner, corner + 1, corner + side, corner + side, corner + 1, corner + side + 1], axis=1)
    return quads.reshape(-1).astype(np.uint32)


@each_case("shuffled", [False, True])
def test_triangles_equal_the_encoders_input(encoder: Any, shuffled: bool) -> None:
    triangles = _grid_triangles(20).reshape(-1, 3)
    if shuffled:
        triangles = np.random.default_rng(0).permutation(triangles)
    data = encoder.encode_index_buffer(np.ascontiguousarray(triangles.reshape(-1)), triangles.size, 400)
    decoded = decode_triangles(data, triangles.size).reshape(-1, 3)
    # The encoder may turn a triangle's corners around, but never its winding.
    first = decoded.argmin(axis=1)[:, None]
    turned = np.take_along_axis(decoded, (first + np.arange(3)) % 3, axis=1)
    first = triangles.argmin(axis=1)[:, None]
    np.testing.assert_array_equal(turned, np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1))
    np.testing.assert_array_equal(
        decoded.reshape(-1), np.asarray(encoder.decode_index_buffer(triangles.size, 4, data)).reshape(-1)
    )


@each_case("top", [10, 70_000, 2**29])
def test_index_sequences_equal_the_encoders_input(encoder: Any, top: int) -> None:
    indices = np.random.default_rng(top).integers(0, top, 500).astype(np.uint32)
    data = encoder.encode_index_sequence(indices, len(indices), top)
    np.testing.assert_array_equal(decode_indices(data, len(indices)), indices)


def test_the_16_bit_octahedral_filter_equals_the_library(encoder: Any) -> None:
    packed = np.random.default_rng(2).integers(-1023, 1024, (1000, 4)).astype(np.int16)
    packed[:, 2] = 1023
    theirs = np.asarray(encoder.decode_filter_oct(packed.copy(), len(packed), 8)).view(np.int16).reshape(-1, 4)
    np.testing.assert_array_equal(apply_filter("OCTAHEDRAL", packed.view(np.uint8)).view(np.int16), theirs)


def test_the_8_bit_octahedral_filter_rounds_every_input_exactly() -> None:
    x, y = np.mgrid[-127:128, -127:128].reshape(2, -1)
    packed = np.stack([x, y, np.full_like(x, 127), np.zeros_like(x)], 1).astype(np.int8)
    z = 127.0 - np.abs(x) - np.abs(y)
    fold = np.minimum(z, 0.0)
    vectors = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], 1)
    exact = np.rint(127 * vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
    np.testing.assert_array_equal(apply_filter("OCTAHEDRAL", packed.view(np.uint8)).view(np.int8)[:, :3], exact)


def test_quaternion_filter_equals_the_library(encoder: Any) -> None:
    rng = np.random.default_rng(4)
    for one in (511, 2047, 32767):
        packed = rng.integers(-one, one + 1, (20_000, 4)).astype(np.int16)
        packed[:, 3] = one & ~3 | rng.integers(0, 4, len(packed))
        theirs = np.asarray(encoder.decode_filter_quat(packed.copy(), len(packed), 8)).view(np.int16).reshape(-1, 4)
        np.testing.assert_array_equal(apply_filter("QUATERNION", packed.view(np.uint8)).view(np.int16), theirs)


def test_exponential_filter_is_exact() -> None:
    exponents, mantissas = np.meshgrid(np.arange(-100, 101), [0, 1, -1, 12345, -(2**23), 2**23 - 1], indexing="ij")
    packed = (exponents << 24 | mantissas & 0xFFFFFF).reshape(-1, 1).astype(np.int64).astype("<i4")
    decoded = apply_filter("EXPONENTIAL", packed.view(np.uint8).reshape(-1, 4)).view("<f4").reshape(exponents.shape)
    np.testing.assert_array_equal(decoded, (mantissas * 2.0**exponents).astype(np.float32))


@each_case("width", [1, 2])
def test_color_filter_gives_back_the_colors(width: int) -> None:
    bits = 8 * width
    rgb = np.random.default_rng(5).integers(0, 2 ** (bits - 1), (200, 3))
    red, green, blue = rgb.T
    # YCoCg-R style integers with y + co - cg = r, y + cg = g, y - co - cg = b, in K = bits - 1 bits.
    co, twice = (red - blue) // 2, (red + blue) // 2
    cg = (green - twice) // 2
    y = green - cg
    alpha = np.full(len(y), 2 ** (bits - 1) - 1)  # alpha 1 in K bits
    packed = np.stack([y, co, cg, alpha], axis=1).astype(f"<i{2 * width}").astype(f"<u{width}")
    decoded = apply_filter("COLOR", packed.view(np.uint8).reshape(200, 4 * width)).view(f"<u{width}").astype(int)
    scale = (2**bits - 1) / (2 ** (bits - 1) - 1)
    expected = np.stack([y + co - cg, y + cg, y - co - cg], axis=1) * scale
    assert np.abs(decoded[:, :3] - np.clip(expected, 0, 2**bits - 1)).max() <= 1.0
    assert (decoded[:, 3] == 2**bits - 1).all()


# Made with meshoptimizer 0.2.30a0 (its level 3 for the last one, which takes 4-byte XOR deltas).
FROZEN = {
    "attributes_v0": (
        "oCoO7u7u7u7u7u7u7u7u7u7u7u7u7gAAAAAQACAAAB8AAgYKDhIWGh4iJiouMjY6PkJGSk5SVlpeYmZqbnJ2ev//AAB+goaK"
        "jpKWmhSAAgCAgIAAAB8AyMhwyMhwyMhwyMhwyMhwyMhwyMhwyMhwyMhwyMhwyP//AADIcMjIcMjIcAAfAFhYWFhYWFhYWFhY"
        "WFhYWFhYWFhYWFhYWFhYWFhYWFj//wAAWFhYWFhYWFgVKuq6qwQEBKq6q6oEBLquAAAEBAAAAAAAAAAAAAAAAAAAAAAAAAAA"
        "AAAAAAAAAAAAAHjs"
    ),
    "attributes_v1": (
        "obl3Kg7u7u7u7u7u7u7u7u7u7u7u7u7uAAAAAAACBgoOEhYaHiImKi4yNjo+QkZKTlJWWl5iZmpucnZ6foKGio6SlpoAyMiP"
        "yMiPyMiPyMiPyMiPyMiPyMiPyMiPyMiPyMiPyMiPyMiPyMiPFQEEEEEEEEEEEEEAAABYWFhYWFhYWFhYWFhYWFhYWFhYWFhY"
        "WFhYWFhYWFhYWFhYWFhYWFgVKqqqqqqqqqqqqgAAAAAAAAAAAAAAAAAAAAAAAAAAAAB47AEB"
    ),
    "triangles": "4f4eEA4QDo4eFA4TDo4eEw4TDg8IAHaHVmd4qYZliWiYAWkAAA==",
    "indices": "0QAUDhQOFMGLEQ4UAwAAAAA=",
    "attributes_v1_xor": (
        "ob9qPwDmN1J6l+cT5YRZhAYRShQJiTe5jdoi+gAJopg3ruCeCcU+4BuUz0IfWY/A7ua/mQBqUEYeGhoYFhQUEhISEBIGCAgI"
        "BggGBgAyM/////////8zAP////8AZQBlZmbLzcvNy2VlZ2VlZWVnZWXMzswAZgBmZmbMzMzMzGZmZmZmZmZmZmbMzMwAmACa"
        "ZmgyNDI0NBgaGhoaGBoaGhoMDA4BBgB7AQAAAAAAAAAAAAAAgD8AAMA/AAAAAAEiAQ=="
    ),
}


def decoded(name: str, data: bytes) -> np.ndarray:
    """The elements of a frozen stream, or of one that was damaged."""
    if name.startswith("attributes"):
        return decode_attributes(data, *((24, 12) if name.endswith("xor") else (40, 8)))
    return decode_triangles(data, 54) if name == "triangles" else decode_indices(data, 10)


def test_frozen_streams_are_read() -> None:
    t = np.arange(40)
    elements = np.stack([t * 7, t * t, t % 3 * 100, t * 300 - 5000], axis=1).astype("<i2").view(np.uint8)
    t = np.arange(24)
    floats = np.stack([np.sqrt(t + 1.0), (t % 4 == 0) * 1.5, t * 0.1], axis=1).astype("<f4")
    expected = {"attributes_v0": elements, "attributes_v1": elements, "attributes_v1_xor": floats.view(np.uint8)}
    expected["indices"] = np.array([0, 5, 1, 6, 2, 7, 70_000, 3, 8, 69_999])
    for name, values in expected.items():
        np.testing.assert_array_equal(decoded(name, base64.b64decode(FROZEN[name])), values)
    triangles = decoded("triangles", base64.b64decode(FROZEN["triangles"]))
    np.testing.assert_array_equal(np.sort(triangles.reshape(-1, 3)), np.sort(_grid_triangles(4).reshape(-1, 3)))


@each_case("name", list(FROZEN))
def test_every_broken_stream_is_one_clear_error(name: str) -> None:
    data = base64.b64decode(FROZEN[name])
    for cut in range(len(data)):
        with pytest.raises(AssetError):
            decoded(name, data[:cut])
    rng, count = np.random.default_rng(0), len(decoded(name, data))
    for _ in range(300):
        broken = bytearray(data)
        broken[rng.integers(len(data))] ^= 1 << rng.integers(8)
        with contextlib.suppress(AssetError):
            assert len(decoded(name, bytes(broken))) == count
