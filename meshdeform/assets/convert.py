"""Convert OBJ, PLY and STL to GLB with trimesh: same vertices and faces, with UVs and colours if present."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np

from meshdeform.assets.archive import Archive
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.assets.limits import Limits
from meshdeform.assets.obj_materials import LIBRARY, ObjMaterial, library_of_names, read_obj_materials
from meshdeform.assets.other_formats import inspect_foreign, is_ascii_stl
from meshdeform.errors import AssetEmptyError, AssetError, AssetNotFiniteError, AssetTooLargeError, DependencyError

__all__ = ["convert_to_glb"]


def convert_to_glb(data: bytes, kind: str, limits: Limits, archive: Archive | None = None) -> bytes:
    """Convert a mesh file.

    Parameters
    ----------
    data : bytes
        The file.
    kind : str
        `obj`, `ply` or `stl`.
    limits : Limits
        Upper bounds on the asset.
    archive : Archive, optional
        The ZIP that the file is in, with material libraries and textures.

    Returns
    -------
    A GLB with one mesh per object, group and material. Vertices are not merged. Normals are written only where the file
    has them. Materials have their names, and the colours and textures that are in the archive.

    Raises
    ------
    AssetError
        The file cannot be parsed, is empty, or exceeds a limit.
    """
    inspect_foreign(data, kind, limits)
    materials = read_obj_materials(data, archive) if kind == "obj" else {}
    primitives = [found for mesh in _parse(data, kind) if (found := _primitive(mesh, materials)) is not None]
    if not primitives:
        raise AssetEmptyError("The file has no faces.")
    faces = sum(len(primitive.faces) for primitive in primitives)
    if faces > limits.max_triangles:
        raise AssetTooLargeError(
            f"The file has {faces} triangles; the limit is {limits.max_triangles} (MESHDEFORM_MAX_TRIANGLES)."
        )
    return build_glb(primitives)


def _parse(data: bytes, kind: str) -> list[Any]:
    try:
        import trimesh
    except ImportError as error:
        raise DependencyError(f"Reading {kind.upper()} files needs trimesh, which is not installed.") from error
    file_type = "stl_ascii" if kind == "stl" and is_ascii_stl(data) else kind
    options: dict[str, Any] = {"process": False}
    if kind == "obj":
        library = library_of_names(data)
        options |= {"skip_materials": not library, "split_objects": True, "split_groups": True}
        if library:
            data = f"mtllib {LIBRARY}\n".encode() + data  # the first one counts
            options["resolver"] = {LIBRARY: library}
    try:
        # Silence warnings about odd numbers; the numbers are checked below.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, **options)
            return list(scene.geometry.items())
    except MemoryError:
        raise
    except Exception as error:  # trimesh's parsers raise exceptions of any type
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise AssetError(
            f"The {kind.upper()} file cannot be parsed: {reason}.", advice="Export it again, best as .glb."
        ) from error


def _primitive(named: tuple[str, Any], materials: dict[str, ObjMaterial]) -> Primitive | None:
    name, mesh = named
    faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))))
    if len(faces) == 0:
        return None
    verts = np.asarray(mesh.vertices, np.float64)
    if not (np.abs(verts) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    if faces.min() < 0 or faces.max() >= len(verts):
        raise AssetError(f"A face uses a vertex that the file does not have; it has {len(verts)}.")
    uvs = getattr(mesh.visual, "uv", None) if mesh.visual.kind == "texture" else None
    colors = mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else None
    material = str(getattr(getattr(mesh.visual, "material", None), "name", None) or "")
    look = materials.get(material)
    return Primitive(
        verts,
        faces,
        normals=_given_normals(mesh, len(verts)),
        # OBJ and PLY count v upwards, glTF downwards.
        uvs=None if uvs is None or len(uvs) != len(verts) else np.asarray(uvs) * [1.0, -1.0] + [0.0, 1.0],
        colors=colors,
        name=str(name),
        material=material if look else "",
        base_color=look.base_color if look else None,
        metallic=look.metallic if look else 0.0,
        roughness=look.roughness if look else 0.8,
        texture=look.texture if look else b"",
    )


def _given_normals(mesh: Any, count: int) -> Any:
    """Return the file's own normals; `mesh.vertex_normals` would compute missing ones."""
    normals = mesh._cache["vertex_normals"]
    if normals is None or np.shape(normals) != (count, 3):
        return None
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A zero-length normal would make the file invalid; without normals, viewers compute their own.
    return normals / length if (length > 1e-12).all() else None
