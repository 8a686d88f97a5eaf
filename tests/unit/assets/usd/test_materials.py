"""The look in a package is the asset's: factors, channels, samplers, transforms, and images byte for byte."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("pxr", reason="needs usd-core (the extra usd)")

from meshdeform.assets import load_asset
from meshdeform.errors import AssetError
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.usd.stages import COLORS, UVS, Stage, material, picture, quad, textured, value


def made(tmp_path: Path, builder: Builder, look: int | None, **attributes: Any) -> Stage:
    builder.node(builder.mesh(quad(builder, look=look, **attributes)))
    return Stage(builder.glb(), tmp_path)


def files(stage: Stage) -> dict[str, bytes]:
    """Return what lies in the package, each at a multiple of 64 bytes and not compressed."""
    found = {}
    with zipfile.ZipFile(stage.path) as package:
        for info in package.infolist():
            name, extra = (int.from_bytes(stage.usdz.data[info.header_offset + at :][:2], "little") for at in (26, 28))
            assert (info.header_offset + 30 + name + extra) % 64 == 0
            assert info.compress_type == zipfile.ZIP_STORED
            found[info.filename] = package.read(info)
    assert next(iter(found)).endswith(".usdc")
    return found


def image(stage: Stage, shader: Any) -> bytes:
    """Return the bytes that a texture shader reads."""
    path = shader.GetInput("file").Get().resolvedPath
    inside = path[path.index("[") + 1 : -1]
    return files(stage)[inside]


def test_factors(tmp_path: Path) -> None:
    builder = Builder()
    shading = {"baseColorFactor": [0.5, 0.25, 0.125, 0.75], "metallicFactor": 0.25, "roughnessFactor": 0.5}
    extensions = {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}, "KHR_materials_ior": {"ior": 1.25}}
    look = material(
        builder,
        name="glow",
        pbrMetallicRoughness=shading,
        emissiveFactor=[0.5, 0, 0],
        alphaMode="BLEND",
        doubleSided=True,
        extensions={**extensions, "KHR_materials_sheen": {}},
    )
    stage = made(tmp_path, builder, look)
    surface = stage.surface()
    assert str(surface.GetPath()) == "/Root/Materials/glow/Surface"
    assert value(surface, "diffuseColor") == [0.5, 0.25, 0.125]
    assert [value(surface, name) for name in ("metallic", "roughness", "opacity", "ior")] == [0.25, 0.5, 0.75, 1.25]
    assert value(surface, "emissiveColor") == [2.0, 0.0, 0.0]
    assert not surface.GetInput("opacityThreshold")
    assert stage.meshes[0].GetDoubleSidedAttr().Get() is True
    assert stage.usdz.left_out == [{"what": "KHR_materials_sheen", "count": 1}]


def test_a_primitive_without_material_has_gltfs_default(tmp_path: Path) -> None:
    stage = made(tmp_path, Builder(), None)
    surface = stage.surface()
    assert value(surface, "diffuseColor") == [1.0, 1.0, 1.0]
    assert [value(surface, name) for name in ("metallic", "roughness")] == [1.0, 1.0]
    assert stage.meshes[0].GetDoubleSidedAttr().Get() is False


def test_textures_keep_their_bytes_channels_and_samplers(tmp_path: Path) -> None:
    builder = Builder()
    pictures = [picture(seed=1), picture("JPEG", 2), picture(seed=3), picture(seed=4), picture(seed=5)]
    base = textured(builder, pictures[0], wrapS=33071, wrapT=33648)
    rough, normal, ao, glow = (textured(builder, data) for data in pictures[1:])
    look = material(
        builder,
        pbrMetallicRoughness={
            "baseColorTexture": {"index": base},
            "baseColorFactor": [1, 0.5, 1, 0.5],
            "metallicRoughnessTexture": {"index": rough, "texCoord": 1},
            "roughnessFactor": 0.5,
        },
        normalTexture={"index": normal},
        occlusionTexture={"index": ao, "strength": 0.25},
        emissiveTexture={"index": glow},
        emissiveFactor=[1, 0.5, 1],
        alphaMode="MASK",
        alphaCutoff=0.25,
    )
    stage = made(tmp_path, builder, look, TEXCOORD_1=UVS)
    surface = stage.surface()
    wanted = {
        "diffuseColor": ("rgb", 0, "sRGB"),
        "opacity": ("a", 0, "sRGB"),
        "roughness": ("g", 1, "raw"),
        "metallic": ("b", 1, "raw"),
        "normal": ("rgb", 2, "raw"),
        "occlusion": ("r", 3, "raw"),
        "emissiveColor": ("rgb", 4, "sRGB"),
    }
    found = {name: stage.source(surface, name) for name in wanted}
    for name, (output, number, space) in wanted.items():
        shader, channel = found[name]
        assert (channel, value(shader, "sourceColorSpace")) == (output, space)
        assert image(stage, shader) == pictures[number]
    assert value(surface, "opacityThreshold") == 0.25
    base_shader = found["diffuseColor"][0]
    assert [value(base_shader, side) for side in ("wrapS", "wrapT")] == ["clamp", "mirror"]
    assert value(base_shader, "scale") == [1, 0.5, 1, 0.5]
    assert value(found["roughness"][0], "scale") == [1, 0.5, 1, 1]
    assert value(found["roughness"][0], "wrapS") == "repeat"
    assert (value(found["normal"][0], "scale"), value(found["normal"][0], "bias")) == ([2, 2, 2, 1], [-1, -1, -1, 0])
    assert value(found["occlusion"][0], "scale")[0] == 0.25
    assert value(found["occlusion"][0], "bias")[0] == 0.75
    assert value(found["emissiveColor"][0], "scale") == [1, 0.5, 1, 1]
    variables = [value(stage.source(found[name][0], "st")[0], "varname") for name in ("diffuseColor", "roughness")]
    assert variables == ["st", "st1"]
    assert stage.usdz.left_out == []
    assert set(files(stage)) == {"result.usdc", *(f"textures/image{i}.{'jpg' if i == 1 else 'png'}" for i in range(5))}


def test_a_texture_transform_reads_the_same_texels(tmp_path: Path) -> None:
    """What UsdTransform2d makes of the flipped coordinates is the flip of what KHR_texture_transform asks for."""
    offset, rotation, scale = np.array([0.25, -0.5]), 0.7, np.array([2.0, 0.5])
    builder = Builder()
    move = {"offset": offset.tolist(), "rotation": rotation, "scale": scale.tolist()}
    info = {"index": textured(builder, picture()), "extensions": {"KHR_texture_transform": move}}
    stage = made(tmp_path, builder, material(builder, pbrMetallicRoughness={"baseColorTexture": info}))
    transform, _ = stage.source(stage.source(stage.surface(), "diffuseColor")[0], "st")
    assert transform.GetIdAttr().Get() == "UsdTransform2d"
    # The matrices as the extension prints them (by columns), rotating u towards -v.
    c, s = np.cos(rotation), np.sin(rotation)
    expected = UVS * scale @ np.array([[c, s], [-s, c]]).T + offset
    angle = np.radians(value(transform, "rotation"))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    st = stage.primvar(0, "st") * value(transform, "scale") @ turn.T + value(transform, "translation")
    np.testing.assert_allclose(st * [1, -1] + [0, 1], expected, atol=1e-6)


def test_webp_becomes_png_and_what_nobody_reads_is_left_out(tmp_path: Path) -> None:
    builder = Builder()
    base, ktx = textured(builder, picture("WEBP")), textured(builder, b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(64))
    builder.root["textures"][base] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    shading = {"baseColorTexture": {"index": base}, "metallicRoughnessTexture": {"index": ktx}, "roughnessFactor": 0.5}
    stage = made(tmp_path, builder, material(builder, pbrMetallicRoughness=shading))
    written = image(stage, stage.source(stage.surface(), "diffuseColor")[0])
    with Image.open(io.BytesIO(written)) as now, Image.open(io.BytesIO(picture("WEBP"))) as before:
        assert now.format == "PNG"
        np.testing.assert_array_equal(np.asarray(now), np.asarray(before))
    assert value(stage.surface(), "roughness") == 0.5
    (said,) = stage.usdz.left_out
    assert (said["count"], "images" in said["what"]) == (1, True)


def test_colors_of_vertices_times_the_factor_or_hidden_by_a_texture(tmp_path: Path) -> None:
    builder = Builder()
    plain = material(builder, pbrMetallicRoughness={"baseColorFactor": [0.5, 1, 1, 0.5]}, alphaMode="BLEND")
    stage = made(tmp_path, builder, plain, COLOR_0=COLORS)
    factor = np.array([0.5, 1, 1, 0.5])
    np.testing.assert_allclose(stage.primvar(0, "displayColor"), (COLORS * factor)[:, :3], atol=1e-6)
    np.testing.assert_allclose(stage.primvar(0, "displayOpacity"), (COLORS * factor)[:, 3], atol=1e-6)
    reader, _ = stage.source(stage.surface(), "opacity")
    assert value(reader, "varname") == "displayOpacity"
    builder = Builder()
    look = material(builder, pbrMetallicRoughness={"baseColorTexture": {"index": textured(builder, picture())}})
    stage = made(tmp_path, builder, look, COLOR_0=COLORS)
    assert stage.source(stage.surface(), "diffuseColor")[1] == "rgb"
    assert stage.usdz.left_out == [{"what": "vertex colors that a texture hides", "count": 1}]


def test_unlit_is_light_that_it_gives_off(tmp_path: Path) -> None:
    builder = Builder()
    shading = {"baseColorFactor": [0.5, 0.25, 1, 1]}
    look = material(builder, pbrMetallicRoughness=shading, extensions={"KHR_materials_unlit": {}})
    stage = made(tmp_path, builder, look)
    surface = stage.surface()
    assert value(surface, "emissiveColor") == [0.5, 0.25, 1.0]
    assert value(surface, "diffuseColor") == value(surface, "specularColor") == [0, 0, 0]


@each_case(
    "broken",
    [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 7}}},
        {"pbrMetallicRoughness": {"baseColorTexture": {}}},
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 1]}},
        {"pbrMetallicRoughness": {"roughnessFactor": "rough"}},
        {"emissiveTexture": 3},
        {"name": 3},
    ],
)
def test_a_broken_material_is_told(broken: dict[str, Any]) -> None:
    builder = Builder()
    builder.node(builder.mesh(quad(builder, look=material(builder, **broken))))
    asset = load_asset(builder.glb())  # the deformation does not mind
    with pytest.raises(AssetError, match=r"materials\[0\]"):
        asset.scene()
