"""What docs/assets.md says that each format keeps, tells and refuses: one file for each cell of its table."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.errors import AssetError
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_NORMALS, QUAD_VERTS, Builder, notable, unpack
from tests.unit.assets.test_ply_reader import SQUARE, header
from tests.unit.assets.test_replace import DOT
from tests.unit.assets.test_shown import FAR, hidden, obj, ply, smiling, sphere
from tests.unit.assets.test_stl_reader import TEXT, binary

UVS = QUAD_VERTS[:, :2].copy()
COLORS = np.float32([[1, 0, 0, 1]] * 4)


def glb(*, images: list[dict[str, Any]] | None = None, **attributes: Any) -> bytes:
    builder = Builder()
    builder.node(builder.mesh({**builder.primitive(**attributes), "material": 0}, name="m"), name="n")
    builder.root["materials"] = [{"name": "wood", "pbrMetallicRoughness": {}}]
    if images:
        builder.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        builder.root |= {"textures": [{"source": 0}], "images": images}
    return builder.glb()


def wavefront(faces: str = "f 1/1/1 2/2/1 3/3/1\n", colors: str = "", mtl: str | None = "Kd 1 0 0\n") -> bytes:
    head = "mtllib a.mtl\no chair\n" + "".join(f"v {x} {y} {z}{colors}\n" for x, y, z in SQUARE)
    head += "vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nusemtl wood\n"
    files = {"a.obj": (head + faces).encode(), "wood.png": DOT, "wood.xcf": b"gimp xcf file"}
    return packed(files if mtl is None else {**files, "a.mtl": f"newmtl wood\n{mtl}".encode()})


def polygon(
    vertex: str = "", row: str = "", face: str = "", behind: str = "", comments: str = "", elements: str = ""
) -> bytes:
    lines = [face] if face else []
    data = header("ascii", 4, 1, *lines, vertex_lines=vertex, comments=comments).replace(
        b"end_header", elements.encode() + b"end_header"
    )
    rows = "".join(f"{x} {y} {z}{row}\n" for x, y, z in SQUARE)
    return data + f"{rows}4 0 1 2 3{behind}\n{'1 2' if elements else ''}\n".encode()


RGB = "".join(f"property uchar {band}\n" for band in ("red", "green", "blue"))
UV = "property list uchar float texcoord"
SKIN = "comment TextureFile skin.png\n"
FLOATS = "".join(f"property float {axis}\n" for axis in ("nx", "ny", "nz"))
EDGES = "element edge 1\nproperty int a\nproperty int b\n"


def far_binary(name: str) -> bytes:
    import trimesh

    verts, faces = sphere()
    data: bytes = trimesh.Trimesh(verts + FAR, faces, process=False).export(file_type=name)
    return data


Kept = Callable[[dict[str, Any], bytes], bool]
Case = tuple[str, bytes, Any]
"""The name of a file, the file, and what is kept (a predicate), told (words) or refused (words)."""


def has(name: str) -> Kept:
    return lambda root, _: all(name in each["attributes"] for mesh in root["meshes"] for each in mesh["primitives"])


def named(root: dict[str, Any], _: bytes) -> bool:
    return any(node.get("name", "").startswith(("chair", "n", "left arm")) for node in root["nodes"])


def placed(root: dict[str, Any], _: bytes) -> bool:
    return bool(np.abs(root["nodes"][0]["translation"] - FAR).max() <= 1.0)


def pictured(root: dict[str, Any], _: bytes) -> bool:
    return "baseColorTexture" in root["materials"][0]["pbrMetallicRoughness"] and len(root["images"]) == 1


LINES = "f 1 2 3\nl 1 2\np 4\n"
OUTSIDE = [{"uri": "none.png"}]
PNG = [{"uri": "data:image/png;base64," + base64.b64encode(DOT).decode()}]
CASES: dict[str, dict[str, Case]] = {
    "texture coordinates": {
        "GLB": ("a.glb", glb(TEXCOORD_0=UVS), has("TEXCOORD_0")),
        "OBJ": ("a.zip", wavefront(), has("TEXCOORD_0")),
        "PLY": ("a.ply", polygon(face=UV, behind=" 8 0 0 1 0 1 1 0 1"), has("TEXCOORD_0")),
    },
    "normals": {
        "GLB": ("a.glb", glb(NORMAL=QUAD_NORMALS), has("NORMAL")),
        "OBJ": ("a.zip", wavefront(), has("NORMAL")),
        "PLY": ("a.ply", polygon(vertex=FLOATS, row=" 0 0 1"), has("NORMAL")),
    },
    "colours of vertices or faces": {
        "GLB": ("a.glb", glb(COLOR_0=COLORS), has("COLOR_0")),
        "OBJ": ("a.zip", wavefront(colors=" 1 0 0"), has("COLOR_0")),
        "PLY": ("a.ply", polygon(vertex=RGB, row=" 255 0 0"), has("COLOR_0")),
        "STL": ("a.stl", binary(0x8000 | 31, 0x8000), has("COLOR_0")),
    },
    "colours beside a texture": {
        "GLB": ("a.glb", glb(images=PNG, TEXCOORD_0=UVS, COLOR_0=COLORS), has("COLOR_0")),
        "OBJ": ("a.zip", wavefront(colors=" 1 0 0", mtl="map_Kd wood.png\n"), "colours were left out"),
        "PLY": (
            "a.zip",
            packed({"a.ply": polygon(RGB, " 9 9 9", UV, " 8 0 0 1 0 1 1 0 1", SKIN), "skin.png": DOT}),
            "colours were left out",
        ),
    },
    "base colour texture": {
        "GLB": ("a.glb", glb(images=PNG, TEXCOORD_0=UVS), pictured),
        "OBJ": ("a.zip", wavefront(mtl="map_Kd wood.png\n"), pictured),
        "PLY": (
            "a.zip",
            packed({"a.ply": polygon(face=UV, behind=" 8 0 0 1 0 1 1 0 1", comments=SKIN), "skin.png": DOT}),
            pictured,
        ),
    },
    "a texture that did not come along": {
        "GLB": ("a.glb", glb(images=OUTSIDE, TEXCOORD_0=UVS), "none.png"),
        "OBJ": ("a.zip", wavefront(mtl="map_Kd none.png\n"), "Textures not found"),
        "PLY": ("a.ply", polygon(face=UV, behind=" 8 0 0 1 0 1 1 0 1", comments=SKIN), "Textures not found"),
    },
    "a texture that cannot be read": {
        "OBJ": ("a.zip", wavefront(mtl="map_Kd wood.xcf\n"), "Textures cannot be read"),
        "PLY": (
            "a.zip",
            packed({"a.ply": polygon(face=UV, behind=" 8 0 0 1 0 1 1 0 1", comments=SKIN), "skin.png": b"no"}),
            "Textures cannot be read",
        ),
    },
    "other textures": {"OBJ": ("a.zip", wavefront(mtl="map_Bump wood.png\n"), "map_bump")},
    "materials that did not come along": {"OBJ": ("a.zip", wavefront(mtl=None), "Material libraries not found")},
    "a material that is wholly transparent": {"OBJ": ("a.zip", wavefront(mtl="d 0\n"), "wholly transparent")},
    "names of objects": {
        "GLB": ("a.glb", glb(), named),
        "OBJ": ("a.zip", wavefront(), named),
        "STL": ("a.stl", b"solid left arm\n" + TEXT + b"endsolid\n", named),
    },
    "polygons": {
        "OBJ": ("a.zip", wavefront("f 1 2 3 4\n"), "1 polygon with more than three corners"),
        "PLY": ("a.ply", polygon(), "1 polygon with more than three corners"),
    },
    "points, lines and curves": {
        "GLB": ("a.glb", glb(), lambda root, _: True),
        "OBJ": ("a.zip", wavefront(LINES), "lines of the OBJ were left out: p, l"),
        "PLY": ("a.ply", polygon(elements=EDGES), "left out: edge"),
    },
    "further properties": {
        "GLB": ("a.glb", glb(_HEAT=UVS), has("_HEAT")),
        "PLY": ("a.ply", polygon("property float quality\n", " 1"), "left out: vertex quality"),
    },
    "more numbers than the header declares": {
        "PLY": ("a.ply", polygon(behind=" 9 9"), "more numbers than its header declares"),
    },
    "bytes after the end": {
        "GLB": ("a.glb", glb() + b"more", AssetError("4 bytes after the end")),
        "STL": ("a.stl", binary(0, 0, behind=b"made by a scanner"), lambda root, _: True),
    },
    "places far from the origin, as text": {
        "OBJ": ("a.obj", obj(sphere()[0] + FAR, sphere()[1]), placed),
        "PLY": ("a.ply", ply(sphere()[0] + FAR, sphere()[1]), placed),
    },
    "places far from the origin, as 32-bit floats": {
        "GLB": ("a.glb", far_binary("glb"), "rounds them to steps"),
        "PLY": ("a.ply", far_binary("ply"), "rounds them to steps"),
        "STL": ("a.stl", far_binary("stl"), "rounds them to steps"),
    },
    "weights of morph targets at rest": {
        "GLB": ("a.glb", smiling(node=[0.5]).glb(), lambda root, _: root["nodes"][0]["weights"] == [0.5])
    },
    "hidden nodes": {"GLB": ("a.glb", hidden(visible=False).glb(), "KHR_node_visibility hides")},
    "a required extension that is not understood": {
        "GLB": (
            "a.gltf",
            json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_other_geometry"]}).encode(),
            AssetError("EXT_other_geometry"),
        )
    },
    "no triangles": {
        "GLB": ("a.gltf", b'{"asset": {"version": "2.0"}}', AssetError("no mesh")),
        "OBJ": ("a.obj", b"v 0 0 0\n", AssetError("no faces")),
        "PLY": ("a.ply", polygon().replace(b"face 1", b"face 0"), AssetError("no triangles")),
        "STL": ("a.stl", bytes(84), AssetError("no faces")),
    },
    "a number that is not finite": {
        "OBJ": ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", AssetError("not finite")),
        "PLY": ("a.ply", polygon().replace(b"1 1 0", b"1 inf 0"), AssetError("not finite")),
        "STL": ("a.stl", b"solid\n" + TEXT.replace(b"1 0 0", b"1 nan 0"), AssetError("not finite")),
    },
}
FORMATS = ("GLB", "OBJ", "PLY", "STL")


def cell(case: Case | None) -> str:
    if case is None:
        return ""
    return "kept" if callable(case[2]) else "told" if isinstance(case[2], str) else "refused"


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, row in CASES.items() for kind in row])
def test_a_file_becomes_what_its_cell_says(name: str, kind: str) -> None:
    filename, data, outcome = CASES[name][kind]
    if isinstance(outcome, AssetError):
        with pytest.raises(AssetError, match=outcome.detail):
            load_asset(data, filename)
        return
    asset = load_asset(data, filename)
    if isinstance(outcome, str):
        assert any(outcome in warning for warning in notable(asset))
        return
    root, chunk, _ = unpack(asset.to_bytes())
    assert outcome(root, chunk)
    words = ("left out", "cannot be read", "not found", "rounds")
    assert not any(word in warning for warning in notable(asset) for word in words)


def test_the_table_is_that_of_the_cases(repository: Path) -> None:
    text = (repository / "docs/assets.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| ") and line.count("|") == len(FORMATS) + 2]
    table = {cells[0]: cells[1:] for row in rows if (cells := [each.strip() for each in row.strip("|").split("|")])}
    for name, row in CASES.items():
        assert table.pop(name) == [cell(row.get(kind)) for kind in FORMATS], name


def test_polygons_are_written_down_in_the_order_of_their_triangles() -> None:
    faces = "f 1 2 3 4\nf 2 3 4 1\nf 1 2 3\nf 1 4 3 2\n"
    for filename, data in (("a.zip", wavefront(faces)), ("a.obj", (vertices() + faces).encode())):
        asset = load_asset(data, filename)
        assert asset.polygons() == [{"node": 0, "primitive": 0, "runs": [[4, 2], [3, 1], [4, 1]]}]
        written = load_asset(asset.replace(asset.surface.positions * 2))
        assert written.polygons() == asset.polygons()
        corners = written.surface.positions[written.surface.triangles]
        at = 0
        for size, count in asset.polygons()[0]["runs"]:
            for _ in range(count):
                outline = {tuple(place) for place in corners[at : at + size - 2].reshape(-1, 3)}
                assert len(outline) == size
                at += size - 2
        assert at == len(corners)
    assert load_asset(wavefront("f 1 2 3\nf 1 3 4\n"), "a.zip").polygons() == []
    divided, done = load_asset(data, "a.obj").subdivided(1000)
    assert done.triangles_after > 4
    assert divided.polygons() == []


def vertices() -> str:
    return "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE)
