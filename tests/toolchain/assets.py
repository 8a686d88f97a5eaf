"""Assets with what a production puts into them, written without the code under test."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.unit.assets.builders import Builder

SIDES, RINGS = 16, 12
TRIANGLES = 2 * SIDES * RINGS
"""Of one tube."""

_EXTENSIONS = [
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_variants",
    "KHR_texture_transform",
]


def tube(radius: float = 0.5, height: float = 2.0) -> tuple[dict[str, NDArray[Any]], NDArray[np.uint16]]:
    """Return the attributes and the faces of an open tube around Y, with a seam in its UVs."""
    around, up = np.meshgrid(np.linspace(0, 1, SIDES + 1), np.linspace(0, 1, RINGS + 1))
    angle = 2 * np.pi * around.reshape(-1)
    normals = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    normals[SIDES :: SIDES + 1] = normals[0 :: SIDES + 1]  # the seam is closed to the last bit
    verts = radius * normals + np.array([0, height, 0]) * up.reshape(-1, 1)
    quads = np.arange((SIDES + 1) * RINGS).reshape(RINGS, SIDES + 1)[:, :-1].reshape(-1, 1)
    faces = np.concatenate([quads + [0, SIDES + 1, 1], quads + [1, SIDES + 1, SIDES + 2]])
    uvs = np.stack([around.reshape(-1), up.reshape(-1)], axis=1)
    attributes = {"verts": verts, "NORMAL": normals, "TEXCOORD_0": uvs}
    return {name: values.astype(np.float32) for name, values in attributes.items()}, faces.astype(np.uint16)


def _material(builder: Builder, **more: Any) -> int:
    from PIL import Image

    with io.BytesIO() as file:
        Image.fromarray(np.random.default_rng(0).integers(0, 255, (16, 16, 3), np.uint8)).save(file, "PNG")
        view = builder.view(file.getvalue())
    builder.root.setdefault("images", []).append({"bufferView": view, "mimeType": "image/png"})
    builder.root.setdefault("textures", []).append({"source": len(builder.root["images"]) - 1})
    shading = {"baseColorTexture": {"index": len(builder.root["textures"]) - 1}, "metallicFactor": 0.0}
    materials = builder.root.setdefault("materials", [])
    materials.append({"name": f"m{len(materials)}", "pbrMetallicRoughness": shading, **more})
    return len(materials) - 1


def _animate(builder: Builder, name: str, channels: list[tuple[int, str, NDArray[np.float32]]]) -> None:
    times = builder.accessor(np.array([0, 0.5, 1], np.float32), bounds=True)
    made: dict[str, Any] = {"name": name, "samplers": [], "channels": []}
    for node, path, values in channels:
        made["samplers"].append({"input": times, "output": builder.accessor(values)})
        made["channels"].append({"sampler": len(made["samplers"]) - 1, "target": {"node": node, "path": path}})
    builder.root.setdefault("animations", []).append(made)


def rigged() -> bytes:
    """A tube on a chain of three joints that swing."""
    builder, (attributes, faces) = Builder(), tube()
    at = np.clip(attributes["verts"][:, 1], 0, 1.999)  # joints at 0, 1 and 2
    lower = np.floor(at).astype(np.uint8)
    joints = np.stack([lower, lower + 1, 0 * lower, 0 * lower], axis=1).astype(np.uint8)
    share = (at - lower).astype(np.float32)
    weights = np.stack([1 - share, share, 0 * share, 0 * share], axis=1).astype(np.float32)
    joints[weights == 0] = 0
    primitive = builder.primitive(faces=faces, **attributes, JOINTS_0=joints, WEIGHTS_0=weights)
    primitive["material"] = _material(builder)
    tip = builder.node(in_scene=False, name="tip", translation=[0, 1, 0])
    middle = builder.node(in_scene=False, name="middle", translation=[0, 1, 0], children=[tip])
    base = builder.node(name="base", children=[middle])
    bind = np.stack([np.eye(4, dtype=np.float32)] * 3)
    bind[:, 3, 1] = [0, -1, -2]  # columns are rows in the file
    matrices = builder.accessor(bind.reshape(3, 16))
    builder.root["skins"] = [{"joints": [base, middle, tip], "inverseBindMatrices": matrices, "skeleton": base}]
    builder.node(builder.mesh(primitive, name="tube"), name="tube", skin=0)
    swing = np.array([[0, 0, 0, 1], [0, 0, np.sin(0.3), np.cos(0.3)], [0, 0, 0, 1]], np.float32)
    _animate(builder, "swing", [(middle, "rotation", swing), (tip, "rotation", swing)])
    return builder.glb()


def morphing() -> bytes:
    """A tube with two morph targets and an animation of their weights."""
    builder, (attributes, faces) = Builder(), tube()
    primitive = builder.primitive(faces=faces, **attributes)
    primitive["material"] = _material(builder)
    verts, normals = attributes["verts"], attributes["NORMAL"]
    deltas = [0.3 * normals * np.sin(verts[:, 1:2]), np.float32([0.5, 0, 0]) * verts[:, 1:2]]
    primitive["targets"] = [{"POSITION": builder.accessor(each.astype(np.float32), bounds=True)} for each in deltas]
    mesh = builder.mesh(primitive, name="tube", weights=[0.0, 0.0], extras={"targetNames": ["bulge", "lean"]})
    node = builder.node(mesh, name="tube")
    _animate(builder, "breathe", [(node, "weights", np.array([0, 0, 1, 0.5, 0, 1], np.float32))])
    return builder.glb()


def scene() -> bytes:
    """A mesh of two coloured primitives on three nodes, one mirrored and scaled unevenly, beside a second mesh."""
    builder = Builder()
    primitives = []
    for radius in (0.5, 0.8):
        attributes, faces = tube(radius)
        colors = np.random.default_rng(3).integers(0, 255, (len(attributes["verts"]), 4), np.uint8)
        primitive = builder.primitive(faces=faces, **attributes, COLOR_0=colors)
        builder.root["accessors"][primitive["attributes"]["COLOR_0"]]["normalized"] = True
        primitives.append({**primitive, "material": _material(builder, doubleSided=True)})
    pair = builder.mesh(*primitives, name="pair")
    left = builder.node(pair, in_scene=False, name="left", translation=[-2, 0, 0])
    right = builder.node(pair, in_scene=False, name="right", translation=[2, 0, 0], scale=[-1, 0.5, 1.5])
    turn = [0.0, float(np.sin(0.4)), 0.0, float(np.cos(0.4))]
    builder.node(pair, name="parent", rotation=turn, children=[left, right])
    attributes, faces = tube(0.2)
    single = builder.primitive(faces=faces, **attributes)
    builder.node(builder.mesh({**single, "material": 0}, name="single"), name="single", translation=[0, 0, 3])
    return builder.glb()


def extended() -> bytes:
    """A tube with extensions on materials, textures, primitives and nodes, and a camera."""
    builder, (attributes, faces) = Builder(), tube()
    coat = {"clearcoatFactor": 0.5}
    extensions = {"KHR_materials_clearcoat": coat, "KHR_materials_emissive_strength": {"emissiveStrength": 2.0}}
    primitive = builder.primitive(faces=faces, **attributes)
    plain = _material(builder)
    primitive["material"] = shiny = _material(builder, emissiveFactor=[0.1, 0.1, 0.1], extensions=extensions)
    texture = builder.root["materials"][shiny]["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {"scale": [2, 2], "offset": [0.1, 0]}}
    mappings = [{"material": shiny, "variants": [0]}, {"material": plain, "variants": [1]}]
    primitive["extensions"] = {"KHR_materials_variants": {"mappings": mappings}}
    builder.node(builder.mesh(primitive, name="tube"), name="tube")
    builder.node(name="lamp", translation=[2, 2, 2], extensions={"KHR_lights_punctual": {"light": 0}})
    builder.node(name="eye", translation=[0, 1, 5], camera=0)
    builder.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    builder.root["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "point", "name": "lamp"}]},
        "KHR_materials_variants": {"variants": [{"name": "shiny"}, {"name": "plain"}]},
    }
    builder.root["extensionsUsed"] = list(_EXTENSIONS)
    return builder.glb()


ASSETS: dict[str, Callable[[], bytes]] = {
    "rigged": rigged,
    "morphing": morphing,
    "scene": scene,
    "extended": extended,
}
