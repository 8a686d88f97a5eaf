"""Test that Blender's importers see the same asset in the other formats of a result as in its GLB."""

from __future__ import annotations

import os
from typing import Any

import bpy
import pytest
from files_seen import FOLDER
from mathutils import Vector

NAMES = sorted(path.stem for path in FOLDER.glob("*-result.glb")) if os.environ.get("MESHDEFORM_RESULTS") else []
IMPORTERS = {
    "glb": lambda path: bpy.ops.import_scene.gltf(filepath=path, disable_bone_shape=True),
    "usdz": lambda path: bpy.ops.wm.usd_import(filepath=path),
    "obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    # STL says no axis; that of OBJ is asked for with the same words.
    "stl": lambda path: bpy.ops.wm.stl_import(filepath=path, forward_axis="NEGATIVE_Z", up_axis="Y"),
}


def seen(name: str, ending: str, seconds: float = 0.0) -> dict[str, Any]:
    """Return what Blender shows of a file at a time: triangles, their box, materials, pictures, and the rig."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert IMPORTERS[ending](str(FOLDER / f"{name}.{ending}")) == {"FINISHED"}
    per_second = 60 if ending == "usdz" else bpy.context.scene.render.fps
    bpy.context.scene.frame_set(round(seconds * per_second))
    graph, corners, triangles = bpy.context.evaluated_depsgraph_get(), [], 0
    objects = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    for obj in objects:
        shown = obj.evaluated_get(graph)
        mesh = shown.to_mesh()
        mesh.calc_loop_triangles()
        triangles += len(mesh.loop_triangles)
        used = {vertex for triangle in mesh.loop_triangles for vertex in triangle.vertices}
        corners += [shown.matrix_world @ Vector(mesh.vertices[vertex].co) for vertex in used]
    box = [limit(corner[axis] for corner in corners) for limit in (min, max) for axis in range(3)]
    return {
        "triangles": triangles,
        "box": box,
        # Of a material on meshes with and without colours, the importer of GLBs makes two.
        "materials": {slot.material.name.partition(".")[0] for obj in objects for slot in obj.material_slots},
        "pictures": sum(bool(image.users and image.size[0]) for image in bpy.data.images),
        "uv": all(obj.data.uv_layers for obj in objects),
        "shape keys": sum(len(obj.data.shape_keys.key_blocks) - 1 for obj in objects if obj.data.shape_keys),
        "bones": sum(len(obj.data.bones) for obj in bpy.context.scene.objects if obj.type == "ARMATURE"),
    }


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("ending", ["usdz", "obj", "stl"])
def test_a_format_shows_what_the_glb_does(name: str, ending: str) -> None:
    wanted, found = seen(name, "glb"), seen(name, ending)
    assert found["triangles"] == wanted["triangles"]
    assert found["box"] == pytest.approx(wanted["box"], abs=1e-3)
    if ending != "stl":
        assert found["materials"] == wanted["materials"]
        # Materials that only variants show come along in a GLB alone.
        assert found["pictures"] == wanted["pictures"] - (name == "extended-result")
        assert found["uv"]
    if ending == "usdz":
        middle = seen(name, "glb", 0.5)["box"]
        assert seen(name, "usdz", 0.5)["box"] == pytest.approx(middle, abs=1e-3)
        assert (middle != wanted["box"]) == (name in ("rigged-result", "morphing-result"))
        assert found["shape keys"] == wanted["shape keys"]
        assert found["bones"] >= wanted["bones"]
