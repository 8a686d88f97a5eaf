"""PLY is read in each of its encodings, with what programs of photogrammetry put in."""

from __future__ import annotations

import struct
import tracemalloc
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.ply_reader import read_elements
from meshdeform.errors import AssetError, AssetTruncatedError
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import notable, unpack
from tests.unit.assets.test_replace import DOT, accessor

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
RED, GREEN = (255, 0, 0), (0, 255, 0)


def header(encoding: str, vertex: int, face: int, *lines: str, vertex_lines: str = "", comments: str = "") -> bytes:
    """Return a header of vertices with places, and of faces with a list of indices and further properties."""
    places = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat {encoding} 1.0\n{comments}element vertex {vertex}\n{places}{vertex_lines}"
        f"element face {face}\nproperty list uchar int vertex_indices\n{''.join(line + chr(10) for line in lines)}"
        "end_header\n"
    ).encode()


def binary(order: str, faces: list[tuple[int, ...]], colors: list[tuple[int, ...]] | None = None) -> bytes:
    """Return a binary PLY of the square, with colours of its faces."""
    encoding = "binary_little_endian" if order == "<" else "binary_big_endian"
    lines = [f"property uchar {band}" for band in ("red", "green", "blue")] if colors else []
    data = header(encoding, 4, len(faces), *lines) + b"".join(struct.pack(f"{order}3f", *place) for place in SQUARE)
    for at, face in enumerate(faces):
        data += struct.pack(f"{order}B{len(face)}i", len(face), *face)
        data += bytes(colors[at]) if colors else b""
    return data


def attribute(data: bytes, name: str, *, file: str = "a.ply", mesh: int = 0) -> Any:
    """Return an attribute of a part of what a file becomes; None if it has none."""
    root, chunk, _ = unpack(load_asset(data, file).to_bytes())
    at = root["meshes"][mesh]["primitives"][0]["attributes"].get(name)
    return None if at is None else accessor(root, chunk, at)


def area(data: bytes, file: str = "a.ply") -> float:
    surface = load_asset(data, file).surface
    a, b, c = surface.positions[surface.triangles].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@each_case("order", ["<", ">"])
@each_case("faces", [[(0, 1, 2), (0, 2, 3)], [(0, 1, 2, 3)], [(0, 1, 2), (0, 1, 2, 3), (1, 2)]])
def test_texts_and_binaries_of_either_order_are_read(order: str, faces: list[tuple[int, ...]]) -> None:
    data = binary(order, faces)
    rows = [" ".join(map(str, row)) for row in [*SQUARE, *((len(face), *face) for face in faces)]]
    text = header("ascii", 4, len(faces)) + "\n".join(rows).encode() + b"\n"
    for written in (data, text):
        np.testing.assert_array_equal(load_asset(written, "a.ply").surface.positions, SQUARE)
        assert area(written) == pytest.approx(sum(0.5 * (len(face) - 2) for face in faces))


@each_case("order", ["<", ">"])
def test_colors_of_faces_split_the_vertices(order: str) -> None:
    data = binary(order, [(0, 1, 2), (0, 2, 3)], [RED, GREEN])
    colors = attribute(data, "COLOR_0")
    corners = load_asset(data, "a.ply").surface.triangles
    assert colors[corners].tolist() == [[[1, 0, 0, 1]] * 3, [[0, 1, 0, 1]] * 3]
    same = binary(order, [(0, 1, 2), (0, 2, 3)], [RED, RED])
    assert len(attribute(same, "COLOR_0")) == 4


def test_strips_become_triangles_that_face_the_same_way() -> None:
    head = header("ascii", 4, 0, vertex_lines="").replace(
        b"element face 0\nproperty list uchar int", b"element tristrips 1\nproperty list int int"
    )
    places = "".join(f"{x} {y} {z}\n" for x, y, z in [SQUARE[0], SQUARE[1], SQUARE[3], SQUARE[2]]).encode()
    for strip, triangles in ((b"4 0 1 2 3\n", 2), (b"9 0 1 2 -1 1 3 2 2 2\n", 2), (b"3 0 1 2\n", 1)):
        data = head + places + strip
        surface = load_asset(data, "a.ply").surface
        a, b, c = surface.positions[surface.triangles].transpose(1, 0, 2)
        assert (len(surface.triangles), area(data)) == (triangles, 0.5 * triangles)
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_lines_that_are_longer_than_declared_are_read_line_by_line() -> None:
    """MeshLab wrote nine numbers where its header has four bytes."""
    lines = ["property list uchar float texcoord", *(f"property uchar {band}" for band in ("red", "green", "blue"))]
    data = header("ascii", 4, 2, *lines) + "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE).encode()
    data += b"3 0 1 2 6 0 0 1 0 1 1 9 1 1 1 1 1 1 1 1 1\n3 0 2 3 6 0 0 1 1 0 1 9 1 1 1 1 1 1 1 1 1\n"
    assert area(data) == 1
    assert attribute(data, "TEXCOORD_0").shape == (4, 2)
    assert attribute(data, "COLOR_0") is None
    assert any("more numbers than its header declares" in warning for warning in notable(load_asset(data, "a.ply")))
    plain = header("ascii", 4, 1) + "".join(f"{x}\n{y} {z}\n" for x, y, z in SQUARE).encode() + b"4 0\n1 2 3\n"
    assert area(plain) == 1  # rows need not be lines


def test_bytes_of_colors_are_srgb_and_floats_are_too() -> None:
    bands = "".join(f"property {{}} {band}\n" for band in ("red", "green", "blue"))
    for kind, value in (("uchar", 188), ("float", 188 / 255), ("ushort", 188 * 257)):
        rows = "".join(f"{x} {y} {z} {value} 0 0\n" for x, y, z in SQUARE)
        data = header("ascii", 4, 1, vertex_lines=bands.format(kind, kind, kind)) + rows.encode() + b"4 0 1 2 3\n"
        assert attribute(data, "COLOR_0")[0].tolist() == pytest.approx([0.5029, 0, 0, 1], abs=1e-4)


def textured(*names: str, numbers: tuple[int, ...] = (), uvs: tuple[str, str] = ("", "")) -> bytes:
    """Return a square of two triangles with texture coordinates of corners, and of which texture each is."""
    comments = "".join(f"comment TextureFile {name}\n" for name in names)
    lines = ["property list uchar float texcoord"] + ["property int texnumber"] * bool(numbers)
    data = header("ascii", 4, 2, *lines, comments=comments)
    data += "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE).encode()
    first, second = uvs if any(uvs) else ("6 0 0 1 0 1 1", "6 0 0 1 1 0 0.25")
    ends = [f" {number}" for number in numbers] or ["", ""]
    return data + f"3 0 1 2 {first}{ends[0]}\n3 0 2 3 {second}{ends[1]}\n".encode()


def test_texture_coordinates_of_corners_and_the_texture_arrive() -> None:
    data = packed({"scan.ply": textured("my skin.png"), "my skin.png": DOT})
    root, _, _ = unpack(load_asset(data, "a.zip").to_bytes())
    assert root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] == {"index": 0}
    uvs = attribute(data, "TEXCOORD_0", file="a.zip")
    triangles = load_asset(data, "a.zip").surface.triangles
    assert uvs[triangles].tolist() == [[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0.75]]]
    # Faces of several textures become a part for each.
    data = packed({"scan.ply": textured("a.png", "b.png", numbers=(1, 0)), "a.png": DOT, "b.png": DOT})
    root, _, _ = unpack(load_asset(data, "a.zip").to_bytes())
    assert len(root["materials"]) == len(root["meshes"]) == 2
    assert area(data, "a.zip") == 1


@each_case(
    ("data", "words"),
    [
        (textured("skin.png"), "Textures not found, and left out: skin.png. Send the asset with"),
        (packed({"a.ply": textured("skin.png"), "skin.png": b"II*\0 no picture"}), "cannot be read"),
        (textured("", uvs=("6 0 0 1 0 1 1", "0")), "Some faces have no texture coordinates"),
    ],
)
def test_what_cannot_be_kept_is_said(data: bytes, words: str) -> None:
    name = "a.zip" if data.startswith(b"PK") else "a.ply"
    assert any(words in warning for warning in load_asset(data, name).summary.warnings)


@each_case(
    ("old", "new", "message"),
    [
        (b"element face 1", b"element face 900", "904"),
        (b"element face 1", b"element face -1", "count"),
        (b"property float x", b"property real x", "property real x"),
        (b"property float y\n", b"", "'y'"),
        (b"format ascii 1.0\n", b"", "no format"),
        (b"4 0 1 2 3", b"4 0 1 2 4", "does not have"),
        (b"4 0 1 2 3", b"4 0 1 2", "ends before"),
        (b"4 0 1 2 3", b"x 0 1 2 3", "cannot be read"),
        (b"end_header", b"", "end_header"),
        (b"1 1 0\n", b"1 nan 0\n", "finite"),
    ],
)
def test_what_is_wrong_is_said(old: bytes, new: bytes, message: str) -> None:
    data = header("ascii", 4, 1) + "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE).encode() + b"4 0 1 2 3\n"
    assert old in data
    with pytest.raises(AssetError, match=message):
        load_asset(data.replace(old, new, 1), "a.ply")


@each_case("encoding", ["ascii", "binary_little_endian"])
def test_counts_that_the_file_cannot_hold_ask_for_no_memory(encoding: str) -> None:
    head = header(encoding, 10, 10).replace(b"face 10", b"face 4000000000")
    tracemalloc.start()
    with pytest.raises(AssetTruncatedError):
        read_elements(head + bytes(1000))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20
