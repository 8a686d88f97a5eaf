"""OBJ and MTL are read as their programs wrote them, whatever the spelling; what cannot be read is named."""

from __future__ import annotations

import contextlib
import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.errors import AssetError, AssetTooLargeError
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import unpack
from tests.unit.assets.test_replace import DOT, accessor

CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
SIDES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
L_SHAPE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]
DART = [(0.0, 0.0), (2.0, 0.4), (0.0, 2.0), (0.4, 0.4)]  # area 1.6; its other diagonal gives more


def vertices(points: list[tuple[float, ...]]) -> str:
    return "".join(f"v {' '.join(map(str, point))}\n" for point in points)


def boxes_in_blocks() -> str:
    """Return three boxes, each with its corners and then its sides, which count back from their own line."""
    blocks = []
    for k in range(3):
        blocks.append(vertices([(x + 2 * k, y * (k + 1), z) for x, y, z in CUBE]))
        blocks += [f"f {' '.join(str(corner - 9) for corner in side)}\n" for side in SIDES]
    return "".join(blocks)


def prism(first: int = 0) -> tuple[list[tuple[float, ...]], list[list[int]]]:
    """Return the corners and sides of an L-shaped prism of height 1; its L begins at another corner."""
    outline = L_SHAPE[first:] + L_SHAPE[:first]
    points = [(*place, z) for z in (0, 1) for place in outline]
    walls = [[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    return points, [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11], *walls]


def area_and_volume(data: bytes, name: str = "a.obj") -> tuple[float, float]:
    surface = load_asset(data, name).surface
    a, b, c = surface.positions[surface.triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return float(area), float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_polygons_are_filled_and_relative_indices_count_back_from_their_own_line() -> None:
    data = boxes_in_blocks().encode()
    surface = load_asset(data, "a.obj").surface
    assert (len(surface.triangles), len(surface.positions)) == (36, 24)
    assert (surface.positions.min(0).tolist(), surface.positions.max(0).tolist()) == ([0, 0, 0], [5, 3, 1])
    assert area_and_volume(data) == pytest.approx((6 + 10 + 14, 6))
    for first in range(6):
        points, sides = prism(first)
        text = vertices(points) + "".join(f"f {' '.join(str(i + 1) for i in side)}\n" for side in sides)
        assert area_and_volume(text.encode()) == pytest.approx((22, 5))
    for first in range(4):
        text = vertices([(*place, 0) for place in DART[first:] + DART[:first]]) + "f 1 2 3 4\n"
        assert area_and_volume(text.encode())[0] == pytest.approx(1.6)
    warnings = load_asset(text.encode(), "a.obj").summary.warnings
    assert warnings[0] == "1 polygon with more than three corners became triangles."


BODY = """# made by hand
o box
v 0 0 0
v 1e0 0 +.0
v 1. 1 0.5
v 0 1 0
vt 0 0
vt 1 0
vn 0 0 1
g top
usemtl red
f 1/1/1 2/2/1 3/1/1 4/2/1
f -4//1 -1//1 -2//1
f 1 2 4
"""


@each_case(
    ("old", "new"),
    [
        (" ", "\t"),
        ("\n", "\r"),
        ("\n", " \t\n\n"),
        (" 2", " \\\n 2"),
        (" 2", "\\\r\n\t2"),
        ("# made", "\ufeff# made"),
        (" 1\n", " 1 # one\n"),
        ("# made by hand", "# in C:\\made\\"),
    ],
)
def test_the_spelling_does_not_matter(old: str, new: str) -> None:
    assert old in BODY
    assert (
        load_asset(BODY.replace(old, new).encode(), "a.obj").to_bytes() == load_asset(BODY.encode(), "a.obj").to_bytes()
    )


@st.composite
def soups(draw: st.DrawFn) -> tuple[bytes, list[tuple[str, list[tuple[float, ...]]]]]:
    """Return an OBJ of triangles in blocks, in some spelling, and its triangles by object, as positions and UVs."""
    blank, line = draw(st.sampled_from([" ", "\t", "  "])), draw(st.sampled_from(["\n", "\r\n", "\r"]))
    broken, relative = draw(st.sampled_from([" ", f" \\{line}"])), draw(st.booleans())
    lines, triangles, points, texcoords = [], [], [], []
    number = st.integers(-999, 999).map(lambda k: k / 8)
    for block in range(draw(st.integers(1, 3))):
        points += (more := draw(st.lists(st.tuples(number, number, number), min_size=3, max_size=6)))
        texcoords += (more_uvs := draw(st.lists(st.tuples(number, number), min_size=1, max_size=3)))
        lines += [blank.join(["v", *map(str, point)]) for point in more]
        lines += [blank.join(["vt", *map(str, pair)]) for pair in more_uvs]
        lines.append(f"o{blank}part {block}")
        for _ in range(draw(st.integers(1, 4))):
            corners = [(draw(st.integers(1, len(points))), draw(st.integers(1, len(texcoords)))) for _ in range(3)]
            back = (len(points) + 1, len(texcoords) + 1) if relative else (0, 0)
            words = [f"{v - back[0]}/{vt - back[1]}" for v, vt in corners]
            lines.append(f"f{blank}{words[0]}{broken}{blank.join(words[1:])}")
            triangles.append((f"part {block}", [(*points[v - 1], *texcoords[vt - 1]) for v, vt in corners]))
    start = draw(st.sampled_from(["", "\ufeff", "# head" + line]))
    return (start + line.join([*lines, ""])).encode(), triangles


@settings(max_examples=100, deadline=None)
@given(soups())
def test_what_is_written_is_read_in_order(soup: tuple[bytes, list[tuple[str, list[tuple[float, ...]]]]]) -> None:
    data, triangles = soup
    root, binary, _ = unpack(load_asset(data, "a.obj").to_bytes())
    found = []
    for node in reversed(root["nodes"]):
        primitive = root["meshes"][node["mesh"]]["primitives"][0]
        positions, uvs = (accessor(root, binary, primitive["attributes"][key]) for key in ("POSITION", "TEXCOORD_0"))
        view = root["bufferViews"][root["accessors"][primitive["indices"]]["bufferView"]]
        faces = np.frombuffer(binary, "<u2", view["byteLength"] // 2, view["byteOffset"]).reshape(-1, 3)
        rows = np.column_stack([positions, uvs[:, 0], 1.0 - uvs[:, 1]])
        found += [(node["name"], [tuple(row) for row in corners]) for corners in rows[faces].tolist()]
    assert found == triangles


@each_case(
    ("old", "new", "message"),
    [
        ("v 1. 1", "v 1.x 1", r"Line 5 of the OBJ file: '1\.x' cannot be read"),
        ("vn 0 0 1", "vn 0 0", "Line 9 of the OBJ file: a normal has at least 3 numbers, not 2"),
        ("f 1 2 4", "f 1 2 5", "Line 14 of the OBJ file: a face uses vertex 5; the file has 4"),
        ("f 1 2 4", "f 1 2 -5", "Line 14 of the OBJ file: a face uses vertex -5; the file has 4"),
        ("f 1 2 4", "\n\\\nf 1 \\\n2 -5", "Line 15 of the OBJ file: a face uses vertex -5; the file has 4"),
        ("f 1 2 4", "f 1 2/3 4", "Line 14 of the OBJ file: a face uses texture coordinate 3; the file has 2"),
        ("f 1 2 4", "f 1 2//-2 4", "Line 14 of the OBJ file: a face uses normal -2; the file has 1"),
        ("f 1 2 4", "f 1 2.5 4", r"Line 14 of the OBJ file: '2\.5' cannot be read"),
        ("f 1 2 4", "f 1 2/1/1/1 4", "Line 14 of the OBJ file: '2/1/1/1' cannot be read"),
        ("f 1 2 4", "f /1 2 4", "Line 14 of the OBJ file: '/1' cannot be read"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(old: str, new: str, message: str) -> None:
    with pytest.raises(AssetError, match=message):
        load_asset(BODY.replace(old, new).encode(), "a.obj")


def test_only_attributes_that_the_file_lists_are_read() -> None:
    data = "".join(line for line in BODY.splitlines(True) if not line.startswith(("vt", "vn"))).encode()
    root, _, _ = unpack(load_asset(data, "a.obj").to_bytes())
    assert set(root["meshes"][0]["primitives"][0]["attributes"]) == {"POSITION"}


def test_texture_coordinates_and_colors_stay_together() -> None:
    data = b"v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nusemtl red\nf 1/1 2/2 3/1\n"
    root, binary, _ = unpack(load_asset(data, "a.obj").to_bytes())
    attributes = root["meshes"][0]["primitives"][0]["attributes"]
    assert accessor(root, binary, attributes["COLOR_0"]).tolist() == [[1, 0, 0, 1], [0, 1, 0, 1], [1, 1, 1, 1]]
    assert accessor(root, binary, attributes["TEXCOORD_0"]).tolist() == [[0, 1], [0.5, 1], [0, 1]]


TEXTURED = "mtllib lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl wood\nf 1/1 2/1 3/1\n"


def material(files: dict[str, str]) -> tuple[list[float] | None, int]:
    """Return the base colour of an OBJ's material, and how many images it has."""
    every = {**{name: text.encode() for name, text in files.items()}, "wood red.png": DOT}
    root, _, _ = unpack(load_asset(packed(every), "a.zip").to_bytes())
    color: list[float] | None = root["materials"][0]["pbrMetallicRoughness"].get("baseColorFactor")
    return color, len(root.get("images", []))


@each_case(
    ("obj", "mtl"),
    [
        (TEXTURED, "newmtl wood\nmap_Kd wood red.png\n"),
        ("\ufeff" + TEXTURED, "\ufeffnewmtl wood\nmap_Kd wood red.png\n"),
        (TEXTURED.replace(" ", "\t"), "newmtl\twood\n\tmap_Kd\twood red.png\n"),
        (TEXTURED.replace("\n", "\r"), "newmtl wood\rmap_Kd wood red.png\r"),
        (TEXTURED.replace("lib.mtl", "none.mtl lib.mtl"), "newmtl wood\nmap_Kd wood red.png\n"),
        (TEXTURED.replace("lib.mtl", ".\\lib.mtl"), "newmtl wood\nmap_Kd C:\\Users\\me\\wood red.png\n"),
        (TEXTURED, "newmtl wood\nmap_Kd -s 1 1 1 -o 0 0 -clamp on -mm 0 1 wood red.png\n"),
    ],
)
def test_a_texture_is_found_however_it_is_named(obj: str, mtl: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    assert material({"a.obj": obj, "lib.mtl": mtl})[1] == 1
    folder = tmp_path_factory.mktemp("files")
    (folder / "a.obj").write_bytes(obj.encode())
    (folder / "lib.mtl").write_bytes(mtl.encode())
    (folder / "wood red.png").write_bytes(DOT)
    beside = load_asset(read_with_files(folder / "a.obj", Limits()), "a.zip")
    assert len(unpack(beside.to_bytes())[0]["images"]) == 1


@each_case("encoding", ["utf-16", "utf-16-be", "utf-8-sig", "cp1252"])
def test_texts_of_windows_are_read(encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    obj, mtl = mark + TEXTURED.replace("wood", "grün"), mark + "newmtl grün\nKd 1 0 0\nmap_Kd grün.png\n"
    every = {"a.obj": obj.encode(encoding), "lib.mtl": mtl.encode(encoding), "grün.png": DOT}
    root, _, _ = unpack(load_asset(packed(every), "a.zip").to_bytes())
    assert (root["materials"][0]["name"], len(root["images"])) == ("grün", 1)


def test_a_texture_replaces_colors_of_vertices_and_these_the_color_of_a_material() -> None:
    colored = TEXTURED.replace("v 0 0 0\n", "v 0 0 0 1 0 0\n")
    for mtl, colors, factor in (
        ("Kd 0 1 0\nd 0.5\n", True, [1, 1, 1, 0.5]),
        ("Kd 1 1 1\nmap_Kd wood red.png\n", False, [1, 1, 1, 1]),
    ):
        every = {"a.obj": colored.encode(), "lib.mtl": f"newmtl wood\n{mtl}".encode(), "wood red.png": DOT}
        asset = load_asset(packed(every), "a.zip")
        root, _, _ = unpack(asset.to_bytes())
        assert ("COLOR_0" in root["meshes"][0]["primitives"][0]["attributes"]) == colors
        assert root["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == factor
        assert any("colours were left out" in warning for warning in asset.summary.warnings) != colors


@each_case(
    ("lines", "alpha"),
    [("d 0.25", 0.25), ("Tr 0.25", 0.75), ("Tr 0\nd 1", 1), ("d 1\nTr 1", 1), ("Tr 1\nd 1", 1), ("d\t0.5", 0.5)],
)
def test_opacity_counts_before_transparency(lines: str, alpha: float) -> None:
    color, _ = material({"a.obj": TEXTURED, "lib.mtl": f"newmtl wood\nKd 1 0 0\n{lines}\n"})
    assert color == [1, 0, 0, alpha]


NINE = vertices([(k % 3, k // 3, k % 2) for k in range(9)]).encode()


@pytest.mark.timeout(300)  # minutes, if a line is read again for each of its signs
@each_case(
    "data",
    [
        NINE + b"f" + b" 1 5 3 9 2" * 100_000,
        NINE + b"f 1 2 3 4 5 6 7 8 9 8 7 6 5 4 3 2 7 1 6\n" * 26_000,
        NINE + b"f 1 2 3" + b"\\\n" * 500_000,
        NINE + b"f 1 2 " + b"1" * 1_000_000,
        NINE + b"f 1 2 " + b"/" * 1_000_000,
        NINE + b"v 1 2 " + b"1" * 1_000_000 + b"x\nf 1 2 3\n",
        b"\\\n" + NINE + b"f 1 2 3\n" + b"\\" * 1_000_000,
        NINE + b"f 1 2 3" + b"\n " * 500_000,
        NINE + b"f 1 2 3 #" + b" #" * 500_000,
    ],
    ids=["face", "crossing", "continued", "digits", "slashes", "number", "backslashes", "blank lines", "comment"],
)
def test_a_megabyte_takes_neither_minutes_nor_gigabytes(data: bytes) -> None:
    tracemalloc.start()
    with contextlib.suppress(AssetError):
        load_asset(data, "a.obj")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**29


@pytest.mark.timeout(300)  # minutes, if each link is looked for in all files
def test_a_hundred_thousand_links_into_a_full_archive_take_no_minutes() -> None:
    links = b"mtllib" + b"".join(b" a%d" % k for k in range(50_000)) + b"\nmtllib lib.mtl\n"
    pictures = b"newmtl wood\n" + b"".join(b"map_Kd c:/b%d\n" % k for k in range(50_000))
    files = {"a.obj": links + TEXTURED.encode(), "lib.mtl": pictures, **{f"{k}.png": b"" for k in range(900)}}
    assert unpack(load_asset(packed(files), "a.zip").to_bytes())[0]["materials"][0]["name"] == "wood"


def test_an_obj_has_no_more_parts_than_a_scene_may_have() -> None:
    data = NINE + b"".join(b"g %d\nf 1 2 3\n" % k for k in range(20))
    with pytest.raises(AssetTooLargeError, match="20 primitives"):
        load_asset(data, "a.obj", Limits(max_primitives=19))


def test_metal_and_roughness_are_read() -> None:
    files = {"a.obj": TEXTURED.encode(), "lib.mtl": b"newmtl wood\nPm 0.25\nPr 0.5\n"}
    root, _, _ = unpack(load_asset(packed(files), "a.zip").to_bytes())
    look = root["materials"][0]["pbrMetallicRoughness"]
    assert (look["metallicFactor"], look["roughnessFactor"]) == (0.25, 0.5)


def test_smoothing_groups_have_the_mean_of_their_faces_normals() -> None:
    corners = list(itertools.product((-1, 1), repeat=3))
    verts = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\n"
    caps = "f 1 3 7 5\nf 2 6 8 4\n"
    smooth = load_asset(f"{verts}s 1\n{faces}{caps}".encode(), "a.obj").surface
    np.testing.assert_allclose(smooth.normals, smooth.positions / np.sqrt(3), atol=1e-7)
    for flat in ("s off", "s 0"):
        tube = load_asset(f"{verts}s 1\n{faces}{flat}\n{caps}".encode(), "a.obj").surface
        ends = np.abs(tube.normals[:, 2]) > 0.9
        np.testing.assert_allclose(tube.normals[ends], tube.positions[ends] * [0, 0, 1])
        np.testing.assert_allclose(tube.normals[~ends], tube.positions[~ends] * [1, 1, 0] / np.sqrt(2), atol=1e-7)
        assert (len(tube.normals), ends.sum()) == (16, 8)
    apart = load_asset(f"{verts}s 1\n{faces}s 2\n{caps}".encode(), "a.obj").surface
    assert len(apart.normals) == 16
    assert np.isnan(load_asset(f"{verts}{faces}{caps}".encode(), "a.obj").surface.normals).all()
