"""Print a summary of a USD file as JSON, using Pixar's own library: ``python look_at_usd.py FILE``."""

from __future__ import annotations

import json
import sys

from pxr import Gf, Usd, UsdGeom, UsdShade, UsdSkel, UsdValidation

stage = Usd.Stage.Open(sys.argv[1])
prims = list(stage.Traverse())
meshes = [UsdGeom.Mesh(prim) for prim in prims if prim.IsA(UsdGeom.Mesh)]
shaders = [UsdShade.Shader(prim) for prim in prims if prim.IsA(UsdShade.Shader)]
skeletons = [UsdSkel.Skeleton(prim) for prim in prims if prim.IsA(UsdSkel.Skeleton)]
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(validators).Validate(stage)
files = [shader.GetInput("file").Get() for shader in shaders if shader.GetInput("file")]
cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default", "render"])
box = Gf.Range3d()
for mesh in meshes:
    box.UnionWith(cache.ComputeWorldBound(mesh.GetPrim()).ComputeAlignedRange())
found = {
    "validators": len(validators),
    "errors": [[error.GetName(), error.GetMessage()] for error in errors],
    "up": UsdGeom.GetStageUpAxis(stage),
    "unit": UsdGeom.GetStageMetersPerUnit(stage),
    "root": str(stage.GetDefaultPrim().GetPath()),
    "meshes": len(meshes),
    "triangles": sum(count - 2 for mesh in meshes for count in mesh.GetFaceVertexCountsAttr().Get()),
    "normals": all(mesh.GetNormalsAttr().Get() for mesh in meshes),
    "uvs": all(mesh.GetPrim().GetAttribute("primvars:st").Get() for mesh in meshes),
    "materials": sum(prim.IsA(UsdShade.Material) for prim in prims),
    "textures": len(files),
    "found": all(file.resolvedPath for file in files),
    "joints": [len(skeleton.GetJointsAttr().Get()) for skeleton in skeletons],
    "moves": stage.GetEndTimeCode() > stage.GetStartTimeCode(),
    "shapes": sum(prim.IsA(UsdSkel.BlendShape) for prim in prims),
    "box": [list(box.GetMin()), list(box.GetMax())],
}
print(json.dumps(found))
