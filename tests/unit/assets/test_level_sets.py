"""Level sets: what OpenVDB wrote is read to the last bit, and what is no closed level set is refused.

The files are those of integrations/blender/write_level_sets.py.
"""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets.blosc import unpack_blosc
from meshdeform.assets.surface_files import DistanceGrid, read_surface_file
from meshdeform.assets.vdb_file import read_level_set
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError
from meshdeform.fields.surface_sources import surface_of
from tests.cases import each_case

FOLDER = Path(__file__).parent / "level_sets"
CENTRE = [1.83, 1.7, 2.0]


def file(name: str) -> bytes:
    return (FOLDER / f"{name}.vdb").read_bytes()


def odd_value(x: int, y: int, z: int) -> float:
    """Return a voxel's value of the grid `odd`: active ones, and each way of storing the others by x // 8."""
    if (7 * x + 13 * y + 29 * z) % 3 == 0:
        return ((31 * x + 17 * y + 7 * z) % 64 - 32) / 64
    choices = [(0.5,), (-0.5,), (0.75,), (0.5, -0.5), (0.5, 0.75), (0.75, -0.625), (0.75, -0.625, 0.25, 0.5)][x // 8]
    return choices[(x + y + z) % len(choices)]


@each_case("name", ["odd", "odd_half", "odd_double", "odd_zip", "odd_zip_all", "odd_plain"])
def test_every_way_of_storing_values_is_read_to_the_last_bit(name: str) -> None:
    values, origin, spacing = read_level_set(file(name), 256**3)
    wanted = np.full((60, 20, 12), 0.5)  # the background, two voxels of it around what is active
    for at in itertools.product(range(56), range(8), range(8)):
        wanted[tuple(np.add(at, 2))] = odd_value(*at)
    wanted[2:10, 10:18, 2:10] = -0.25
    wanted[10:18, 10:18, 2:10] = 0.25
    assert np.array_equal(values, wanted)
    assert spacing == pytest.approx([0.5, 0.25, 2])
    assert origin == pytest.approx([0, 1.5, -1])


def test_a_level_set_becomes_its_ball_beyond_its_band_too() -> None:
    grid = read_surface_file(file("ball"), "ball.vdb")
    assert isinstance(grid, DistanceGrid)
    assert np.unique(np.abs(grid.values)).max() == pytest.approx(0.75)  # three voxels
    surface = surface_of(grid)
    assert surface.reference.topology.characteristics == (2,)
    directions = np.concatenate([np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)])
    for radius in (0.15, 0.6, 1.0, 1.45):  # 0.15 and 1.45 at the corner are beyond the band
        place, normal = surface.project(CENTRE + radius * directions, np.zeros_like(directions))
        assert np.linalg.norm(place - CENTRE, axis=1) == pytest.approx(1, abs=0.02)
        assert np.linalg.norm(place - CENTRE - directions, axis=1).max() < 0.1
        assert (normal * directions).sum(1).min() > 0.99


@each_case(
    ("name", "change", "error", "message"),
    [
        ("fog", None, AssetError, r"only: density \(fog volume"),
        ("two", None, AssetError, "2 level sets: ball, other"),
        ("turned", None, AssetError, "turns, shears"),
        ("ball", (8, struct.pack("<I", 223)), AssetFormatError, "version 223"),
        ("ball", (20, b"\0"), AssetFormatError, "as a stream"),
        ("ball", (0, b"PK"), AssetFormatError, "not an OpenVDB file"),
        ("ball", (-3000, b""), AssetTruncatedError, "damaged"),
    ],
)
def test_what_is_no_level_set_is_refused_with_the_reason(
    name: str, change: tuple[int, bytes] | None, error: type[AssetError], message: str
) -> None:
    data = file(name)
    if change is not None:
        at, put = change
        data = data[:at] + put + data[at + len(put) :] if put else data[:at]
    with pytest.raises(error, match=message):
        read_surface_file(data, f"{name}.vdb")


def test_a_level_set_in_a_large_box_and_a_damaged_one_are_refused() -> None:
    with pytest.raises(AssetTooLargeError, match="60x20x12 voxels; the limit is 9000"):
        read_level_set(file("odd"), 9000)
    data = file("ball")
    random = np.random.default_rng(0)
    for at in np.concatenate([random.integers(0, len(data), 100), random.integers(0, 2000, 100)]):
        broken = bytearray(data)
        broken[at] ^= 1 << random.integers(0, 8)
        try:  # the format has no checksums, so a wrong bit may be a wrong value; it is never another exception
            read_surface_file(bytes(broken), "ball.vdb")
        except AssetError:
            continue


def test_a_blosc_chunk_is_never_read_outside_itself() -> None:
    literal, overlap = bytes([0x30, *b"abc", 3, 0]), bytes([0x3F, *b"abc", 3, 0, 6, 0x10, *b"!"])
    header = struct.Struct("<4B3I")

    def chunk(stream: bytes, size: int) -> bytes:
        at = header.size + 4
        packed = struct.pack("<II", at, len(stream)) + stream
        return header.pack(2, 1, 1 << 5, 1, size, size, header.size + len(packed)) + packed

    assert unpack_blosc(chunk(overlap, 29), 29) == b"abc" * 9 + b"a!"
    for stream, size in ((overlap, 28), (overlap, 30), (literal, 7), (overlap[:-1], 29), (b"\xf0\xff", 9), (b"", 9)):
        with pytest.raises(ValueError, match=r"Blosc|LZ4"):
            unpack_blosc(chunk(stream, size), size)
    with pytest.raises(ValueError, match="another compressor"):
        unpack_blosc(header.pack(2, 1, 0, 1, 9, 9, header.size), 9)
