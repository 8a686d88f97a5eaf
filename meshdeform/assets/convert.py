"""Convert OBJ, PLY and STL to GLB: same vertices and faces, with UVs and colours if present."""

from __future__ import annotations

import io
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.archive import Archive
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.assets.limits import Limits
from meshdeform.assets.obj_reader import read_obj
from meshdeform.assets.other_formats import inspect_foreign, is_ascii_stl
from meshdeform.assets.polygons import cut_polygons
from meshdeform.errors import AssetEmptyError, AssetError, AssetNotFiniteError, AssetTooLargeError, DependencyError

__all__ = ["convert_to_glb"]


def convert_to_glb(
    data: bytes, kind: str, limits: Limits, archive: Archive | None = None
) -> tuple[bytes, tuple[str, ...]]:
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
    A GLB with one mesh per object, group and material, and sentences about what became of the file. Vertices are not
    merged. Normals are written only where the file has them. Materials have their names, and the colours and textures
    that are in the archive.

    Raises
    ------
    AssetError
        The file cannot be parsed, is empty, or exceeds a limit.
    """
    inspect_foreign(data, kind, limits)
    notices: tuple[str, ...] = ()
    if kind == "obj":
        primitives, cut = read_obj(data, archive, limits.max_primitives)
        notices = cut.notices()
    else:
        meshes, notices = _parse(data, kind)
        primitives = [found for named in meshes if (found := _primitive(*named)) is not None]
    if not primitives:
        raise AssetEmptyError("The file has no faces.")
    faces = sum(len(primitive.faces) for primitive in primitives)
    if faces > limits.max_triangles:
        raise AssetTooLargeError(
            f"The file has {faces} triangles; the limit is {limits.max_triangles} (MESHDEFORM_MAX_TRIANGLES)."
        )
    return build_glb([_valid(each) for each in primitives]), notices


def _parse(data: bytes, kind: str) -> tuple[list[tuple[str, Any]], tuple[str, ...]]:
    """Return the meshes of a PLY or STL by name, and notices."""
    try:
        import trimesh
    except ImportError as error:
        raise DependencyError(f"Reading {kind.upper()} files needs trimesh, which is not installed.") from error
    try:
        # Silence warnings about odd numbers; the numbers are checked below.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if kind == "ply":
                return _parse_ply(data)
            file_type = "stl_ascii" if is_ascii_stl(data) else "stl"
            scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, process=False)
            return list(scene.geometry.items()), ()
    except (AssetError, MemoryError):
        raise
    except Exception as error:  # trimesh's parsers raise exceptions of any type
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise AssetError(
            f"The {kind.upper()} file cannot be parsed: {reason}.", advice="Export it again, best as .glb."
        ) from error


def _parse_ply(data: bytes) -> tuple[list[tuple[str, Any]], tuple[str, ...]]:
    """Return the mesh of a PLY, its polygons cut here instead of by trimesh, and notices."""
    import trimesh

    found = trimesh.exchange.ply.load_ply(io.BytesIO(data), skip_materials=True)
    polygons = found.get("faces")
    if polygons is None:
        return [], ()
    vertices = _finite(found["vertices"])
    listed = found["metadata"]["_ply_raw"]["face"]["data"]
    ragged = (
        next((rows for rows in listed.values() if rows.dtype == object), None) if isinstance(listed, dict) else None
    )
    if ragged is None:
        sizes, corners = np.full(len(polygons), polygons.shape[1]), polygons.reshape(-1)
    else:
        # Polygons of several sizes are triangles by now, and vertices may have been split at texture coordinates.
        sizes = np.array([len(row) for row in ragged])
        split = trimesh.geometry.triangulate_quads(ragged).reshape(-1)
        number = np.zeros(split.max(initial=-1) + 1, np.int64)
        number[split] = polygons.reshape(-1)
        corners = number[np.concatenate(ragged)[np.repeat(sizes >= 3, sizes)]]
        sizes = sizes[sizes >= 3]
    _check_range(corners, len(vertices))
    cut = cut_polygons(vertices[corners], sizes)
    found["faces"] = corners[cut.triangles]
    return [("geometry_0", trimesh.Trimesh(**found, process=False))], cut.notices()


def _finite(vertices: Any) -> NDArray[np.float64]:
    found = np.asarray(vertices, np.float64)
    if not (np.abs(found) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    return found


def _check_range(corners: NDArray[np.int64], count: int) -> None:
    if corners.min(initial=0) < 0 or corners.max(initial=-1) >= count:
        raise AssetError(f"A face uses a vertex that the file does not have; it has {count}.")


def _primitive(name: str, mesh: Any) -> Primitive | None:
    faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))))
    if len(faces) == 0:
        return None
    verts = _finite(mesh.vertices)
    _check_range(faces, len(verts))
    uvs = getattr(mesh.visual, "uv", None) if mesh.visual.kind == "texture" else None
    normals = mesh._cache["vertex_normals"]  # the file's own; `mesh.vertex_normals` would compute missing ones
    return Primitive(
        verts,
        faces,
        normals=normals if np.shape(normals) == verts.shape else None,
        # PLY counts v upwards, glTF downwards.
        uvs=None if uvs is None or len(uvs) != len(verts) else np.asarray(uvs) * [1.0, -1.0] + [0.0, 1.0],
        colors=mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else None,
        name=str(name),
    )


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
