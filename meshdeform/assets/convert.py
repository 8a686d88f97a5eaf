"""Convert OBJ, PLY, STL and 3MF to GLB: same vertices and faces, with UVs, colours and textures if present."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshdeform.assets.archive import Archive
from meshdeform.assets.build import Converted, Primitive, build_glb
from meshdeform.assets.limits import Limits
from meshdeform.assets.obj_reader import read_obj
from meshdeform.assets.other_formats import inspect_foreign
from meshdeform.assets.ply_reader import read_ply
from meshdeform.assets.stl_reader import read_stl
from meshdeform.assets.threemf_reader import read_3mf
from meshdeform.errors import AssetEmptyError, AssetTooLargeError


def convert_to_glb(data: bytes, kind: str, limits: Limits, archive: Archive) -> Converted:
    """Convert a mesh file.

    `kind`: `obj`, `ply`, `stl` or `3mf`; `limits`: upper bounds on the asset; `archive`: the ZIP that it is in, with
    material libraries and textures; empty for a file that came alone. Returns a GLB with one mesh per object, group and
    material, and sentences about all that a GLB cannot hold. Vertices are not merged.
    Normals are written only where the file has them. Materials have their names, and the colours and textures that are
    in the archive.
    """
    unit: float | None = None
    if kind == "3mf":
        primitives, notices, unit = read_3mf(archive, limits)
    else:
        inspect_foreign(data, kind, limits)
    if kind == "obj":
        primitives, notices = read_obj(data, archive, limits.max_primitives)
    elif kind == "ply":
        primitives, notices = read_ply(data, archive)
    elif kind == "stl":
        primitives, notices = read_stl(data, limits.max_primitives)
    if not primitives:
        raise AssetEmptyError("The file has no faces.")
    faces = sum(len(primitive.faces) for primitive in primitives)
    if faces > limits.max_triangles:
        raise AssetTooLargeError(
            f"The file has {faces} triangles; the limit is {limits.max_triangles} (MESHDEFORM_MAX_TRIANGLES)."
        )
    return Converted(build_glb([_valid(each) for each in primitives]), notices, unit, "z" if kind == "3mf" else None)


def _valid(primitive: Primitive) -> Primitive:
    """Return a primitive with unit normals, or none if one has no direction, and with finite texture coordinates."""
    normals, uvs = primitive.normals, primitive.uvs
    if normals is not None:
        with np.errstate(all="ignore"):
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            normals = normals / length if ((length > 1e-12) & (length < np.inf)).all() else None
    if uvs is not None:
        uvs = np.where(np.abs(uvs) <= np.finfo(np.float32).max, uvs, 0.0)
    return replace(primitive, normals=normals, uvs=uvs)
