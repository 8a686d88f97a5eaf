"""Test that results of the service pass through Blender's importer and exporter with their counts unchanged."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
import pytest
from files_seen import FOLDER, document, triangles

NAMES = sorted(path.stem for path in FOLDER.glob("*.glb")) if os.environ.get("MESHDEFORM_RESULTS") else []


def counted() -> dict[str, Any]:
    """Count the contents of the scene."""
    objects = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    for obj in objects:
        obj.data.calc_loop_triangles()
    return {
        "meshes": len(objects),
        "triangles": sum(len(obj.data.loop_triangles) for obj in objects),
        "shape keys": sum(len(obj.data.shape_keys.key_blocks) - 1 for obj in objects if obj.data.shape_keys),
        "bones": sum(len(obj.data.bones) for obj in bpy.context.scene.objects if obj.type == "ARMATURE"),
        "actions": len(bpy.data.actions),
        "materials": sorted(material.name.partition(".")[0] for material in bpy.data.materials if material.users),
        "uv layers": sum(len(obj.data.uv_layers) for obj in objects),
        "groups": sorted(group.name for obj in objects for group in obj.vertex_groups),
    }


def imported(path: Path) -> dict[str, Any]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.import_scene.gltf(filepath=str(path), disable_bone_shape=True) == {"FINISHED"}
    return counted()


def test_there_is_something_to_look_at() -> None:
    assert NAMES, "scripts/test-blender makes the files and names their folder in MESHDEFORM_RESULTS"


@pytest.mark.parametrize("name", NAMES)
def test_a_result_comes_in_and_goes_out(name: str, tmp_path: Path) -> None:
    source, again = FOLDER / f"{name}.glb", tmp_path / "again.glb"
    root = document(source)
    found = imported(source)
    assert found["triangles"] == triangles(root)
    assert found["bones"] == sum(len(skin["joints"]) for skin in root.get("skins", []))
    targets = sum(
        max(len(p.get("targets", [])) for p in root["meshes"][node["mesh"]]["primitives"])
        for node in root["nodes"]
        if "mesh" in node
    )
    assert found["shape keys"] == targets
    assert bpy.ops.export_scene.gltf(filepath=str(again), export_format="GLB") == {"FINISHED"}
    assert triangles(document(again)) == triangles(root)
    assert len(document(again).get("skins", [])) == len(root.get("skins", []))
    assert {**imported(again), "actions": 0} == {**found, "actions": 0}
