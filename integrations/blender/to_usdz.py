"""Convert a GLB to USDZ with Blender: ``blender --background --python to_usdz.py -- result.glb result.usdz``.

Or ``python to_usdz.py result.glb result.usdz``, if Blender is installed as the Python module `bpy`. +Y is up and one
unit is a metre; hierarchy, normals, UVs, UsdPreviewSurface materials with their textures, skins, shape keys and the
first animation are kept.
"""

from __future__ import annotations

import sys

import bpy


def convert(source: str, target: str) -> None:
    """Read a GLB into an empty scene and write it as USDZ."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=source, disable_bone_shape=True)
    frames = [frame for action in bpy.data.actions for frame in action.frame_range]
    if frames:
        bpy.context.scene.frame_start, bpy.context.scene.frame_end = int(min(frames)), round(max(frames))
    done = bpy.ops.wm.usd_export(
        filepath=target,
        export_animation=bool(frames),
        convert_orientation=True,
        export_global_forward_selection="NEGATIVE_Z",
        export_global_up_selection="Y",
        generate_preview_surface=True,
        export_textures_mode="NEW",
        export_armatures=True,
        export_shapekeys=True,
    )
    if done != {"FINISHED"}:
        sys.exit(f"Blender did not write {target}.")


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if len(arguments) != 2:
        sys.exit(__doc__)
    convert(*arguments)
