"""ZIPs of an asset with its files become one GLB; unsafe ones are refused before anything is unpacked."""

from __future__ import annotations

import json
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import Limits, check_asset_subprocess, inspect_asset, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
)
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_VERTS, Builder, notable, pack, unpack
from tests.unit.assets.test_replace import DOT, position

UVS = QUAD_VERTS[:, :2].copy()


def textured() -> Builder:
    """Return a quad whose only image is `Textures/color map.png`."""
    builder = Builder()
    builder.node(builder.mesh({**builder.primitive(TEXCOORD_0=UVS), "material": 0}))
    builder.root["images"] = [{"uri": "Textures/color%20map.png"}]
    builder.root["textures"] = [{"source": 0}]
    builder.root["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    return builder


def scene() -> dict[str, bytes]:
    """Return the files of a .gltf with its buffer and image in other files."""
    builder = textured()
    root = {key: value for key, value in builder.root.items() if value}
    root["buffers"] = [{"byteLength": len(builder.binary), "uri": "scene.bin"}]
    return {
        "model/scene.gltf": json.dumps(root).encode(),
        "model/scene.bin": builder.binary,
        "model/Textures/color map.png": DOT,
        "__MACOSX/model/._scene.gltf": b"junk",
    }


def image(glb: bytes) -> bytes:
    root, binary, _ = unpack(glb)
    view = root["bufferViews"][root["images"][0]["bufferView"]]
    return binary[view["byteOffset"] :][: view["byteLength"]]


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_gltf_with_its_files_becomes_one_glb(method: int, tmp_path: Path) -> None:
    data = packed(scene(), method=method)
    asset = load_asset(data, "scene.zip")
    np.testing.assert_array_equal(asset.surface.positions, QUAD_VERTS)
    written = asset.replace(asset.surface.positions + 1)
    assert image(written) == image(asset.to_bytes()) == DOT
    assert b".bin" not in written
    assert len(unpack(written)[0]["buffers"]) == 1
    np.testing.assert_array_equal(position(written), QUAD_VERTS + 1)
    assert (asset.summary.format, notable(asset)) == ("zip", ())
    path = tmp_path / "scene.zip"
    path.write_bytes(data)
    assert check_asset_subprocess(path).triangles == 2


def test_a_glb_whose_images_lie_outside_keeps_the_links_and_a_zip_packs_them_in() -> None:
    glb = textured().glb()
    asset = load_asset(glb, "truck.glb")
    assert "Textures/color%20map.png" in asset.summary.warnings[0]
    assert unpack(asset.replace(asset.surface.positions))[0]["images"] == [{"uri": "Textures/color%20map.png"}]
    assert asset.appearance().left_out == {"image in another file": 1}
    packed_in = load_asset(packed({"truck.glb": glb, "textures/Color Map.png": DOT}), "truck.zip")
    assert image(packed_in.replace(packed_in.surface.positions)) == DOT
    assert notable(packed_in) == ()
    missing = load_asset(packed({"truck.glb": glb}), "truck.zip")
    assert missing.summary.warnings == asset.summary.warnings


OBJ = b"""mtllib lib/things.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 1 1 0.5
vt 0 0
vt 1 0
vt 0 1
vt 1 1
o body
g left
usemtl red
f 1/1 2/2 3/3
g right
usemtl my wood
f 3/3 2/2 4/4
"""
MTL = b"""newmtl red
Kd 0.5 0.25 0
d 0.5
newmtl my wood
map_Kd -s 1 1 1 wood.png
Pr 0.4
"""


def test_an_obj_keeps_groups_materials_and_textures() -> None:
    files = {"thing.obj": OBJ, "lib/things.mtl": MTL, "lib/wood.png": DOT}
    root, _, _ = unpack(load_asset(packed(files), "thing.zip").to_bytes())
    by_name = {material["name"]: material for material in root["materials"]}
    assert by_name["red"]["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.214041, 0.0508761, 0, 0.5])
    assert by_name["red"]["alphaMode"] == "BLEND"
    wood = by_name["my wood"]["pbrMetallicRoughness"]
    assert (wood["roughnessFactor"], root["textures"][wood["baseColorTexture"]["index"]]) == (0.4, {"source": 0})
    assert image(load_asset(packed(files), "thing.zip").to_bytes()) == DOT
    for node in root["nodes"]:
        primitive = root["meshes"][node["mesh"]]["primitives"][0]
        assert "body" in node["name"]
        expected = "red" if "left" in node["name"] else "my wood"
        assert root["materials"][primitive["material"]]["name"] == expected
        assert "TEXCOORD_0" in primitive["attributes"]


def declared(files: dict[str, bytes], **changes: int) -> bytes:
    """Return a ZIP whose first entry's directory record has other values."""
    data = bytearray(packed(files))
    at = data.index(b"PK\x01\x02")
    places = {"flags": (8, 2), "method": (10, 2), "size": (24, 4)}
    for name, value in changes.items():
        offset, width = places[name]
        data[at + offset : at + offset + width] = value.to_bytes(width, "little")
    return bytes(data)


QUAD = textured().glb()
DEEP = {"quad.glb": packed({"quad.glb": QUAD})}


@each_case(
    ("data", "error", "text"),
    [
        (packed({"../quad.glb": QUAD}), AssetError, "outside"),
        (packed({"a/..\\..\\quad.glb": QUAD}), AssetError, "outside"),
        (packed({"C:/quad.glb": QUAD}), AssetError, "outside"),
        (packed({"a.glb": QUAD, "b.glb": QUAD}), AssetError, "2 assets: a.glb, b.glb"),
        (packed({"read.me": b"hello"}), AssetEmptyError, "no asset"),
        (packed({f"{i}.txt": b"" for i in range(1001)}), AssetTooLargeError, "1001 entries"),
        (declared({"quad.glb": QUAD}, flags=1), AssetUnsupportedError, "encrypted"),
        (declared({"quad.glb": QUAD}, method=14), AssetUnsupportedError, "Deflate"),
        (packed({"quad.glb": QUAD})[:-30], AssetTruncatedError, "cannot be read"),
        (packed({k: v for k, v in scene().items() if not k.endswith(".bin")}), AssetExternalError, "scene.bin"),
        (packed({**scene(), "model/scene.bin": b"1234"}), AssetTruncatedError, "scene.bin"),
        (packed({"a.gltf": b'{"buffers": [{"uri": 3}]}'}), AssetError, "byteLength"),
        (packed(DEEP), AssetFormatError, "ZIP within a ZIP"),
    ],
)
def test_what_is_wrong_with_a_zip_is_said(data: bytes, error: type[AssetError], text: str) -> None:
    with pytest.raises(error, match=text):
        load_asset(data, "a.zip")


def test_a_zip_that_unpacks_to_too_much_or_to_more_than_it_declares_is_refused() -> None:
    with pytest.raises(AssetTooLargeError, match="unpacks to"):
        load_asset(packed({"quad.glb": QUAD, "zeros": bytes(101 * 2**20)}), "a.zip")
    bomb = declared({"quad.glb": bytes(64 * 2**20)}, size=1000)
    tracemalloc.start()
    with pytest.raises(AssetTruncatedError):
        load_asset(bomb, "a.zip")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 16 * 2**20


@each_case(
    ("head", "name", "command"),
    [
        (b"Kaydara FBX Binary  \0", "a.fbx", "FBX2glTF"),
        (b"PXR-USDC\0", "a.usd", "usd_import"),
        (packed({"a.usdc": b"PXR-USDC"}), "a.usdz", "in.usdz"),
        (b"BLENDER-v300", "a.blend", "export_scene.gltf"),
        (b"<?xml version='1.0'?>", "a.dae", "assimp export"),
        (b" BDV\0\0\0\0", "level_set", "to PLY: vdb_tool"),
        (b"", "a.vdb", "-ls2mesh"),
    ],
)
def test_other_formats_are_refused_with_the_command_that_converts_them(head: bytes, name: str, command: str) -> None:
    with pytest.raises(AssetFormatError) as raised:
        inspect_asset(head, name)
    assert command in raised.value.advice_text


def test_a_local_gltf_and_obj_come_with_the_files_beside_them(tmp_path: Path) -> None:
    thing = {"model/thing.obj": OBJ, "model/lib/things.mtl": MTL, "model/lib/wood.png": DOT}
    for name, data in {**scene(), **thing}.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    first = read_with_files(tmp_path / "model/scene.gltf", Limits())
    assert image(load_asset(first, "scene.gltf").to_bytes()) == DOT
    assert read_with_files(tmp_path / "model/scene.gltf", Limits()) == first
    obj = load_asset(read_with_files(tmp_path / "model/thing.obj", Limits()), "thing.obj")
    assert image(obj.to_bytes()) == DOT
    with pytest.raises(AssetTooLargeError):
        read_with_files(tmp_path / "model/scene.gltf", Limits(max_bytes=100))


def test_a_local_gltf_takes_no_file_of_another_folder_along(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(DOT)
    builder = textured()
    builder.root["images"] = [{"uri": "../secret.png"}]
    builder.root["buffers"] = []
    (tmp_path / "a").mkdir()
    path = tmp_path / "a" / "a.gltf"
    path.write_bytes(json.dumps(unpack(pack(builder.root))[0]).encode())
    (tmp_path / "a" / "link.png").symlink_to(tmp_path / "secret.png")
    assert read_with_files(path, Limits()) == path.read_bytes()
    builder.root["images"] = [{"uri": "link.png"}]
    path.write_bytes(json.dumps(builder.root).encode())
    assert read_with_files(path, Limits()) == path.read_bytes()
