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
from tests.unit.assets.test_replace import DOT, accessor
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


def threemf(
    triangles: str = '<triangle v1="0" v2="1" v3="2"/><triangle v1="1" v2="3" v3="2"/>',
    resources: str = "",
    items: str = '<item objectid="1"/>',
    *,
    model: str = 'unit="inch"',
    shift: float = 0.0,
) -> bytes:
    """Return a 3MF of a square."""
    verts = "".join(f'<vertex x="{x + shift}" y="{y + shift}" z="{z}"/>' for x, y, z in QUAD_VERTS.tolist())
    mesh = f"<mesh><vertices>{verts}</vertices><triangles>{triangles}</triangles></mesh>"
    text = f"<model {model} xmlns:m='m' xmlns:p='p'><resources>{resources}"
    text += f'<object id="1" name="chair">{mesh}</object></resources><build>{items}</build></model>'
    return packed({"[Content_Types].xml": b"<Types/>", "3D/3dmodel.model": text.encode()})


COLORED = '<triangle v1="0" v2="1" v3="2" pid="2" p1="0"/><triangle v1="1" v2="3" v3="2" pid="2" p1="0" p2="1" p3="1"/>'
COLORS_3MF = '<m:colorgroup id="2"><m:color color="#FF0000"/><m:color color="#0000FF80"/></m:colorgroup>'
BASES = '<basematerials id="2"><base name="wood" displaycolor="#FF0000"/></basematerials>'
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


def vertices(more: str = "") -> str:
    return "".join(f"v {x} {y} {z}{more}\n" for x, y, z in SQUARE)


def bytes_of_colour(root: dict[str, Any], chunk: bytes) -> bool:
    colour = accessor(root, chunk, root["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"])[0]
    return bool(np.allclose(colour, [0.577580, 0.127438, 0.031896, 1], atol=1e-5))  # 200, 100 and 50 of sRGB


def lies(root: dict[str, Any], _: bytes) -> bool:
    """Whether (u, v) of the OBJ shows the texel at (4 u + 0.5, 2 v), v upwards: glTF's v is 1 - v."""
    use = root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    sampler = root["samplers"][root["textures"][use["index"]]["sampler"]]
    placed = use["extensions"]["KHR_texture_transform"]
    return (placed, sampler) == ({"offset": [0.5, -1.0], "scale": [4.0, 2.0]}, {"wrapS": 33071, "wrapT": 33071})


def lit(*names: str) -> Kept:
    return lambda root, _: all("index" in root["materials"][0][name] for name in names)


def glows(root: dict[str, Any], _: bytes) -> bool:
    material = root["materials"][0]
    strength = material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    return (material["emissiveFactor"], strength) == ([1.0, 0.0, 1.0], 2.0)


def shines(root: dict[str, Any], _: bytes) -> bool:
    look = root["materials"][0]["pbrMetallicRoughness"]
    return (look["metallicFactor"], look["roughnessFactor"]) == (0.5, 0.5)  # 1 - sqrt(Ns / 1000), as Blender has it


def smooth(root: dict[str, Any], chunk: bytes) -> bool:
    """Whether the normals of both faces are those of their planes: only one is in a group."""
    normals = accessor(root, chunk, root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"])
    return len(normals) == 6


def two_scenes() -> bytes:
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh)
    builder.root["scenes"].append({"nodes": [builder.node(mesh, in_scene=False)]})
    del builder.root["scene"]
    return builder.glb()


def as_gltf(data: bytes) -> bytes:
    root, chunk, _ = unpack(data)
    root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(chunk).decode()
    return json.dumps(root).encode()


def uncounted() -> bytes:
    data = binary(0, 0)
    return data[:80] + bytes(4) + data[84:]


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
        "3MF": ("a.3mf", threemf(COLORED, COLORS_3MF), has("COLOR_0")),
    },
    "colours from 0 to 255": {"OBJ": ("a.obj", (vertices(" 200 100 50") + "f 1 2 3\n").encode(), bytes_of_colour)},
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
    "other textures": {
        "OBJ": ("a.zip", wavefront(mtl="map_Bump -bm 2 wood.png\n"), "map_bump"),
        "3MF": ("a.3mf", threemf(resources="<m:texture2dgroup id='3'/>"), "left out: texture2dgroup"),
    },
    "how a texture lies": {
        "GLB": ("a.glb", glb(images=PNG, TEXCOORD_0=UVS), pictured),
        "OBJ": ("a.zip", wavefront(mtl="map_Kd -s 4 2 1 -o 0.5 0 0 -clamp on wood.png\n"), lies),
    },
    "other options of a texture": {"OBJ": ("a.zip", wavefront(mtl="map_Kd -mm 0 2 wood.png\n"), "map_kd -mm")},
    "several textures of one kind": {
        "OBJ": ("a.zip", wavefront(mtl="map_Kd wood.png\nmap_Kd wood.png\n"), "all but the last map_kd"),
    },
    "textures of normals and emission": {
        "OBJ": ("a.zip", wavefront(mtl="norm wood.png\nmap_Ke wood.png\n"), lit("normalTexture", "emissiveTexture")),
    },
    "emission": {"OBJ": ("a.zip", wavefront(mtl="Ke 2 0 2\n"), glows)},
    "metal, roughness, shininess": {"OBJ": ("a.zip", wavefront(mtl="Pm 0.5\nNs 250\n"), shines)},
    "specular colour, refraction": {"OBJ": ("a.zip", wavefront(mtl="Ks 0.9 0 0\nNi 2.4\n"), "left out: ks, ni")},
    "smoothing groups": {"OBJ": ("a.obj", (vertices() + "s 1\nf 1 2 3\ns off\nf 1 3 4\n").encode(), smooth)},
    "normals of some faces": {"OBJ": ("a.zip", wavefront("f 1/1/1 2/2/1 3/3/1\nf 1 3 4\n"), "Only some faces")},
    "materials without a library": {
        "OBJ": ("a.obj", (vertices() + "usemtl wood\nf 1 2 3\n").encode(), "Materials not found, and left out: wood"),
    },
    "material names and colours": {
        "GLB": ("a.glb", glb(), lambda root, _: root["materials"][0]["name"] == "wood"),
        "OBJ": ("a.zip", wavefront(), lambda root, _: root["materials"][0]["name"] == "wood"),
        "3MF": (
            "a.3mf",
            threemf(COLORED.replace(' p2="1" p3="1"', ""), BASES),
            lambda root, _: root["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 0, 0, 1],
        ),
    },
    "the unit and the upward axis": {"3MF": ("a.3mf", threemf(), "in inches, with +Z up")},
    "several scenes": {"GLB": ("a.glb", two_scenes(), "names none as its default")},
    "a byte order mark": {
        "GLB": ("a.gltf", b"\xef\xbb\xbf" + as_gltf(glb()), lambda root, _: len(root["meshes"]) == 1),
        "OBJ": ("a.obj", b"\xef\xbb\xbf" + (vertices() + "f 1 2 3\n").encode(), lambda root, _: True),
    },
    "fewer facets declared than there are": {"STL": ("a.stl", uncounted(), "declares 0 triangles and has 2")},
    "decimal commas": {
        "STL": ("a.stl", b"solid\n" + TEXT.replace(b"0 0 0", b"0,0 0,0 0,5"), "read as decimal points"),
    },
    "objects in several places": {
        "GLB": ("a.glb", glb(), named),
        "3MF": (
            "a.3mf",
            threemf(items='<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 9 0 0"/>'),
            lambda root, _: len(root["meshes"]) == 2,
        ),
    },
    "materials that did not come along": {"OBJ": ("a.zip", wavefront(mtl=None), "Material libraries not found")},
    "a material that is wholly transparent": {"OBJ": ("a.zip", wavefront(mtl="d 0\n"), "wholly transparent")},
    "names of objects": {
        "GLB": ("a.glb", glb(), named),
        "OBJ": ("a.zip", wavefront(), named),
        "STL": ("a.stl", b"solid left arm\n" + TEXT + b"endsolid\n", named),
        "3MF": ("a.3mf", threemf(), named),
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
        "STL": ("a.stl", binary(0, 0, behind=b"made by a scanner"), "17 bytes after the triangles"),
    },
    "places far from the origin, as text": {
        "OBJ": ("a.obj", obj(sphere()[0] + FAR, sphere()[1]), placed),
        "PLY": ("a.ply", ply(sphere()[0] + FAR, sphere()[1]), placed),
        "3MF": ("a.3mf", threemf(shift=5e6), lambda root, _: root["nodes"][0]["translation"][0] == 5e6),
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
        "3MF": ("a.3mf", threemf(triangles=""), AssetError("no faces")),
    },
    "a number that is not finite": {
        "OBJ": ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", AssetError("not finite")),
        "PLY": ("a.ply", polygon().replace(b"1 1 0", b"1 inf 0"), AssetError("not finite")),
        "STL": ("a.stl", b"solid\n" + TEXT.replace(b"1 0 0", b"1 nan 0"), AssetError("not finite")),
        "3MF": ("a.3mf", threemf(shift=float("nan")), AssetError("not finite")),
    },
}
FORMATS = ("GLB", "OBJ", "PLY", "STL", "3MF")


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
