"""Test that a character of Blender's own exporter still plays without tearing after its shape has changed."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from test_files import imported

ROOT = Path(__file__).parents[3]
FRAMES = (1, 6, 11, 16, 21)
JOINTS = {
    "hips": (0, 0, 1.0), "chest": (0, 0, 1.5), "head": (0, 0, 2.0),
    "elbow.L": (0.5, 0, 1.5), "hand.L": (1.0, 0, 1.5), "elbow.R": (-0.5, 0, 1.5), "hand.R": (-1.0, 0, 1.5),
    "knee.L": (0.25, 0, 0.5), "foot.L": (0.3, 0, 0.0), "knee.R": (-0.25, 0, 0.5), "foot.R": (-0.3, 0, 0.0),
}  # fmt: skip
"""Places in Blender's world, with Z up."""
BONES = {
    "spine": ("hips", "chest", None), "neck": ("chest", "head", "spine"),
    "arm.L": ("chest", "elbow.L", "spine"), "forearm.L": ("elbow.L", "hand.L", "arm.L"),
    "arm.R": ("chest", "elbow.R", "spine"), "forearm.R": ("elbow.R", "hand.R", "arm.R"),
    "thigh.L": ("hips", "knee.L", "spine"), "shin.L": ("knee.L", "foot.L", "thigh.L"),
    "thigh.R": ("hips", "knee.R", "spine"), "shin.R": ("knee.R", "foot.R", "thigh.R"),
}  # fmt: skip
"""Joints at both ends, and the parent."""
TURNS = {
    "arm.L": (0, 0, 0.9),
    "forearm.L": (0, 0, 0.7),
    "arm.R": (0.8, 0, 0),
    "thigh.L": (0.8, 0, 0),
    "shin.L": (-0.9, 0, 0),
}
"""Euler angles in the middle of the animation."""
TALLER = np.array([1.4, 1.5, 1.2])
"""The target in glTF's axes, relative to the character."""


def body() -> Any:
    """Return a skin around the bones: one closed surface, as Blender's skin modifier makes it."""
    names = list(JOINTS)
    mesh = bpy.data.meshes.new("body")
    mesh.from_pydata(list(JOINTS.values()), [(names.index(a), names.index(b)) for a, b, _ in BONES.values()], [])
    made = bpy.data.objects.new("body", mesh)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.objects.active = made
    made.select_set(True)
    made.modifiers.new("skin", "SKIN")
    for vertex, name in zip(mesh.skin_vertices[0].data, names, strict=True):
        vertex.radius = (0.22, 0.22) if name in ("hips", "chest", "head") else (0.11, 0.11)
    made.modifiers.new("smooth", "SUBSURF").levels = 2
    for modifier in ("skin", "smooth"):
        bpy.ops.object.modifier_apply(modifier=modifier)
    return made


def armature() -> Any:
    """Return a skeleton with its keyframes: at rest, turned, at rest."""
    bpy.ops.object.armature_add()
    rig = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.data.edit_bones
    bones.remove(bones[0])
    for name, (head, tail, parent) in BONES.items():
        bone = bones.new(name)
        bone.head, bone.tail = JOINTS[head], JOINTS[tail]
        bone.parent = bones[parent] if parent else None
    bpy.ops.object.mode_set(mode="POSE")
    for name, turn in TURNS.items():
        bone = rig.pose.bones[name]
        bone.rotation_mode = "XYZ"
        for frame, angles in ((FRAMES[0], (0, 0, 0)), (FRAMES[2], turn), (FRAMES[-1], (0, 0, 0))):
            bone.rotation_euler = angles
            bone.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


def write_character(path: Path) -> None:
    """Bind the skin with Blender's automatic weights and write it with Blender's exporter."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    skin, rig = body(), armature()
    bpy.ops.object.select_all(action="DESELECT")
    skin.select_set(True)
    rig.select_set(True)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    assert {group.name for group in skin.vertex_groups} == set(BONES)
    bpy.context.scene.frame_end = FRAMES[-1]
    assert bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB") == {"FINISHED"}


def played(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Import a file and return what Blender shows: positions (frames, n, 3) and edges (e, 2)."""
    found = imported(path)
    assert (found["bones"], found["actions"]) == (len(BONES), 1)
    (shape,) = (each for each in bpy.context.scene.objects if each.type == "MESH")
    places = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        mesh = shape.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        local = np.array([vertex.co for vertex in mesh.vertices])
        to_world = np.array(shape.matrix_world)
        places.append(local @ to_world[:3, :3].T + to_world[:3, 3])
    edges = np.array([tuple(edge.vertices) for edge in shape.data.edges])
    return np.array(places), edges


def stretched(path: Path) -> np.ndarray:
    """Return |ln(length / length at rest)| of every edge in every frame, (frames, e)."""
    places, edges = played(path)
    found = np.linalg.norm(places[:, edges[:, 0]] - places[:, edges[:, 1]], axis=2)
    return np.abs(np.log(found / found[0]))


def deform(source: Path, target: Path, rig: str) -> Path:
    """Run a few steps towards the target in the project's own environment."""
    result = source.with_name(f"{rig}.glb")
    command = [ROOT / ".venv/bin/python", "-P", "-m", "meshdeform", "run", source, "--target", target]
    options = ["--steps", "30", "--set", "align=none", "--rig", rig, "-o", result]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return result


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The character, and the same deformed towards a larger one with its rig kept and followed."""
    folder = tmp_path_factory.mktemp("character")
    source, target = folder / "character.glb", folder / "target.obj"
    write_character(source)
    shape = next(each for each in bpy.context.scene.objects if each.type == "MESH")
    at = np.array([vertex.co for vertex in shape.data.vertices])[:, [0, 2, 1]] * [1, 1, -1] * TALLER
    lines = [f"v {x} {y} {z}" for x, y, z in at.tolist()]
    lines += ["f " + " ".join(str(corner + 1) for corner in face.vertices) for face in shape.data.polygons]
    target.write_text("\n".join(lines))
    return {"source": source, **{rig: deform(source, target, rig) for rig in ("keep", "follow")}}


def test_a_deformed_character_of_blenders_exporter_plays_without_tearing(files: dict[str, Path]) -> None:
    rest = {name: played(path)[0][0] for name, path in files.items()}
    moved = np.linalg.norm(rest["follow"] - rest["source"], axis=1)
    assert moved.mean() > 0.15 * np.linalg.norm(np.ptp(rest["source"], axis=0))
    np.testing.assert_allclose(rest["follow"], rest["keep"], atol=1e-5)  # the same shape, bound to other joints
    found = {name: stretched(path) for name, path in files.items()}
    most = {name: np.percentile(each, 99, axis=1) for name, each in found.items()}
    assert most["source"].max() > 0.5  # elbows and knees do bend
    assert (most["follow"] <= 1.05 * most["source"] + 1e-3).all()
    assert found["follow"].max() < 1.15 * found["source"].max()
    # What this would look like otherwise: edges of the same shape, turned about joints that stayed behind.
    assert most["keep"].max() > 1.1 * most["source"].max()
    assert found["keep"].max() > 1.3 * found["source"].max()
