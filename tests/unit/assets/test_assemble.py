"""Parts of several assets in one GLB."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image

from meshdeform.assets import Primitive, build_glb, load_asset
from meshdeform.assets.assemble import AssetPart, assemble
from meshdeform.assets.build import Picture
from meshdeform.errors import AssetError


def picture(colour):
    out = io.BytesIO()
    Image.new("RGB", (4, 4), colour).save(out, "PNG")
    return out.getvalue()


def textured(colour, height):
    verts = np.array([[0, height, 0], [1, height, 0], [0, height, 1], [1, height, 1.0]])
    uvs = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.25]])
    normals = np.tile([0, 1.0, 0], (4, 1))
    faces = np.array([[0, 2, 1], [1, 2, 3]])
    made = Primitive(
        verts, faces, normals, uvs, name="top", material=f"cloth {colour}", texture=Picture(picture(colour))
    )
    plain = Primitive(verts + 2, faces, name="side", material="wood", base_color=(0.5, 0.2, 0.1, 0.4))
    return load_asset(build_glb([made, plain]))


def piece(asset, chosen, *, shift=0.0, name="part"):
    surface = asset.surface
    flags = np.zeros(len(surface.triangles), bool)
    flags[chosen] = True
    return AssetPart(asset, flags, surface.positions + shift, surface.normals, surface.tangents, name, {"n": 1})


def contents(glb):
    return json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])


def test_parts_keep_material_texture_and_coordinates():
    red, blue = textured("red", 0.0), textured("blue", 1.0)
    glb = assemble([piece(red, [1, 2], name="seat"), piece(blue, [0], shift=0.5, name="back")], {"kind": "test"})
    root, made = contents(glb), load_asset(glb)
    assert [node["name"] for node in root["nodes"]] == ["seat", "back"]
    assert [m["name"] for m in root["materials"]] == ["cloth red", "wood", "cloth blue"]
    assert root["materials"][1]["alphaMode"] == "BLEND"
    assert root["asset"]["extras"]["meshdeform"] == {"kind": "test"}
    assert len(root["images"]) == len(root["textures"]) == 2
    document = made._document
    assert [bytes(document.view_bytes(image["bufferView"])) for image in root["images"]] == [
        picture("red"), picture("blue"),
    ]  # fmt: skip
    # The second triangle of the red top has vertices 1, 2 and 3, and keeps their texture coordinates.
    attributes = root["meshes"][0]["primitives"][0]["attributes"]
    view = root["bufferViews"][root["accessors"][attributes["TEXCOORD_0"]]["bufferView"]]
    start = 28 + int.from_bytes(glb[12:16], "little") + view["byteOffset"]
    found = np.frombuffer(glb, "<f4", 6, start).reshape(3, 2)
    np.testing.assert_array_equal(found, [[1, 0], [0, 1], [0.5, 0.25]])
    expected = np.concatenate([red.surface.positions[red.surface.triangles[[1, 2]]].reshape(-1, 3),
                               blue.surface.positions[blue.surface.triangles[0]] + 0.5])  # fmt: skip
    np.testing.assert_array_equal(made.surface.positions[made.surface.triangles].reshape(-1, 3), expected)


def test_equal_materials_are_written_once_and_nothing_is_shared_with_the_source():
    one = textured("red", 0.0)
    before = json.dumps(one._document.root)
    root = contents(assemble([piece(one, [0]), piece(textured("red", 3.0), [0])]))
    assert len(root["materials"]) == len(root["textures"]) == len(root["images"]) == 1
    assert json.dumps(one._document.root) == before


def test_a_material_that_is_not_there_is_refused():
    asset = textured("red", 0.0)
    asset._document.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 7
    with pytest.raises(AssetError, match="cannot be copied"):
        assemble([piece(asset, [0])])
