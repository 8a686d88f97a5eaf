"""Read Blender's meshes for sending, and apply the result to them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import bpy
import numpy as np
from numpy.typing import NDArray

from .errors import AddonError
from .glb import Part

Apply = Literal["SHAPE_KEY", "REPLACE"]


@dataclass(frozen=True)
class Source:
    """One object that was sent."""

    uid: int  # identifies the object, even after undo, which invalidates references
    part: Part  # its mesh when it was sent
    connectivity: str  # hash of its faces


def gather(objects: Sequence[Any]) -> list[Source]:
    """Read the meshes of objects; of objects that share a mesh, only the first.

    Modifiers are not applied: they still apply to the result. For a mesh with shape keys, the reference key is read.
    """
    sources: dict[str, Source] = {}
    for obj in objects:
        if obj.type != "MESH" or obj.data.name_full in sources:
            continue
        if not obj.data.is_editable:
            raise AddonError(f"The mesh of “{obj.name}” is linked.", "Make it local: Object > Relations > Make Local.")
        if obj.mode != "OBJECT":
            raise AddonError(f"“{obj.name}” is being edited.", "Change to Object Mode.")
        matrix = np.array(obj.matrix_world, np.float64)
        part = Part(obj.name, _base_positions(obj.data), _triangles(obj.data), matrix)
        sources[obj.data.name_full] = Source(obj.session_uid, part, _hash(obj.data))
    return list(sources.values())


def group_weights(sources: Sequence[Source], group: str) -> list[NDArray[np.float32] | None]:
    """Return the weight of each vertex in a vertex group, for each source; None for an object without such a group."""
    columns: list[NDArray[np.float32] | None] = []
    for source in sources:
        obj = _find(source)
        at = obj.vertex_groups.find(group) if obj else -1
        if at < 0:
            columns.append(None)
            continue
        weights = np.zeros(len(source.part.positions), np.float32)
        for vertex in obj.data.vertices:
            for each in vertex.groups:
                if each.group == at:
                    weights[vertex.index] = each.weight
        columns.append(weights)
    return columns


def is_ready(sources: Sequence[Source]) -> bool:
    """Return whether the objects can be changed now, that is, none is being edited, sculpted or painted."""
    return all(obj is None or obj.mode == "OBJECT" for obj in map(_find, sources))


def apply(sources: Sequence[Source], positions: Sequence[NDArray[np.float32]], how: Apply, name: str) -> list[str]:
    """Apply new positions to the meshes: to all of them, or to none if one no longer matches.

    Parameters
    ----------
    positions : sequence of (N, 3) float32
    how : "SHAPE_KEY" or "REPLACE"
        Add a shape key with the value 1, or move the vertices of the mesh and of all its shape keys.
    name : str
        Name of the shape key.

    Returns
    -------
    Remarks for the user.
    """
    targets = []
    for source in sources:
        obj = _find(source)
        if obj is None:
            raise AddonError(f"“{source.part.name}” no longer exists.", "Undo, and deform it again.")
        same = len(obj.data.vertices) == len(source.part.positions)
        if not same or _hash(obj.data) != source.connectivity:
            raise AddonError(
                f"The faces of “{obj.name}” were changed while the job ran.", "Undo that, or deform it again."
            )
        if how == "SHAPE_KEY" and obj.data.shape_keys and not obj.data.shape_keys.use_relative:
            raise AddonError(
                f"The shape keys of “{obj.name}” are absolute.", "Make them relative, or replace the mesh."
            )
        targets.append(obj)
    remarks = []
    for obj, source, moved in zip(targets, sources, positions, strict=True):
        base = _base_positions(obj.data)
        if not np.array_equal(base, source.part.positions):
            # Keep what the user moved in the meantime.
            moved = (base.astype(np.float64) + moved - source.part.positions).astype(np.float32)
            remarks.append(f"“{obj.name}” was moved while the job ran: the deformation was added to that.")
        if how == "SHAPE_KEY":
            _add_shape_key(obj, moved, name)
        else:
            _replace(obj.data, base, moved)
        obj.data.update()
    return remarks


def _add_shape_key(obj: Any, positions: NDArray[np.float32], name: str) -> None:
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    key = obj.shape_key_add(name=name, from_mix=False)
    key.relative_key = obj.data.shape_keys.reference_key
    key.data.foreach_set("co", positions.reshape(-1))
    key.value = 1.0
    obj.active_shape_key_index = len(obj.data.shape_keys.key_blocks) - 1


def _replace(mesh: Any, base: NDArray[np.float32], positions: NDArray[np.float32]) -> None:
    keys = mesh.shape_keys
    for block in keys.key_blocks if keys else ():
        # Move every key by the same offsets, to preserve their deltas; the reference key becomes the result.
        others = np.empty_like(base)
        block.data.foreach_get("co", others.reshape(-1))
        there = positions if block == keys.reference_key else others + (positions - base)
        block.data.foreach_set("co", np.ascontiguousarray(there, np.float32).reshape(-1))
    mesh.vertices.foreach_set("co", positions.reshape(-1))


def _base_positions(mesh: Any) -> NDArray[np.float32]:
    points = mesh.shape_keys.reference_key.data if mesh.shape_keys else mesh.vertices
    positions = np.empty((len(points), 3), np.float32)
    points.foreach_get("co", positions.reshape(-1))
    return positions


def _triangles(mesh: Any) -> NDArray[np.uint32]:
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), np.uint32)
    mesh.loop_triangles.foreach_get("vertices", triangles.reshape(-1))
    return triangles


def _hash(mesh: Any) -> str:
    # Hash the polygons, not their triangles: how a quad is split depends on where its corners are.
    corners, sizes = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    return hashlib.sha256(sizes.tobytes() + corners.tobytes()).hexdigest()


def _find(source: Source) -> Any:
    return next((obj for obj in bpy.data.objects if obj.session_uid == source.uid and obj.type == "MESH"), None)
