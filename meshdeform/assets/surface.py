"""Gather the triangle primitives of all instances into one world-space surface, with the data for writing it back.

The surface is what viewers show: skins in the pose of the file's nodes, morph targets with their weights at rest. A
mesh that EXT_mesh_gpu_instancing draws many times stands where its first instance does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.codes import TRIANGLES
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.inspect import LOOSE
from meshdeform.assets.placement import Floats, Placement, Placer, unit_rows
from meshdeform.assets.scene_checks import Instance, instances_of
from meshdeform.errors import AssetEmptyError, AssetNotFiniteError

_FLATTENED = "its transform flattens the mesh and cannot be inverted"


@dataclass(frozen=True)
class Surface:
    """The surface to optimise: one triangle soup in world space, +Y up."""

    positions: Floats  # (N, 3) float64: vertices in the file's units, split at seams as in the file
    triangles: NDArray[np.int64]  # (T, 3) int64: counter-clockwise from outside, also under mirrored nodes
    normals: Floats  # (N, 3) float64: unit length, or NaN where the file has none
    tangents: Floats  # (N, 4) float64: unit length with a handedness of +1 or -1, or NaN where the file has none
    instance_of_vertex: NDArray[np.int64]  # (N,) int64: the mesh instance of each vertex
    stays: NDArray[np.bool_]  # (N,) bool: vertices that cannot be moved, because the map of their joints has no inverse
    skipped: list[dict[str, Any]]  # primitives that are not deformed, and why


@dataclass(frozen=True)
class _RestTargets:
    """Displacements of a block at rest by morph targets, with the weights of its node or mesh, in mesh space."""

    positions: Floats  # (V, 3) float64
    # (V, 3) float64
    normals: Floats | None
    tangents: Floats | None


@dataclass(frozen=True)
class Block:
    """The vertices of one set of accessors in one node, written back as a unit.

    Primitives of a mesh that share their accessors share a block, so that they still share them afterwards.
    """

    node: int
    mesh: int
    primitives: tuple[int, ...]
    triangles: tuple[int, ...]  # of each primitive
    accessors: tuple[int, int | None, int | None]  # POSITION, NORMAL, TANGENT
    rows: slice
    placement: Placement
    positions: NDArray[np.float32]  # in mesh space, as in the file
    normals: NDArray[np.float32] | None
    tangents: NDArray[np.float32] | None
    rest: _RestTargets | None = None


def block_primitives(root: Json, blocks: Sequence[Block]) -> Iterator[tuple[Block, int, Json, slice]]:
    """Yield the primitives of blocks: each one's block, number in its mesh, JSON, and triangles of the surface."""
    start = 0
    for block in blocks:
        for number, count in zip(block.primitives, block.triangles, strict=True):
            yield block, number, root["meshes"][block.mesh]["primitives"][number], slice(start, start + count)
            start += count


@dataclass(frozen=True)
class LocalShape:
    """A block's new vertices in mesh space, as stored in the file."""

    positions: NDArray[np.float32]
    normals: NDArray[np.float32] | None
    tangents: NDArray[np.float32] | None


def read_surface(
    document: Document, excluded: frozenset[int] = frozenset(), instances: Sequence[Instance] | None = None
) -> tuple[Surface, list[Block], list[Block]]:
    """Gather the default scene's surface, or that of other instances.

    `excluded`: nodes whose meshes do not belong to it. Returns the surface, its blocks, and the blocks of points and
    lines, whose `rows` are empty. Raises AssetNotFiniteError: a position is NaN or infinite. Raises AssetEmptyError:
    the scene has no triangles. Raises AssetError: an index is out of range.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # overflows are reported below as values that are not finite
        shown = instances_of(document.root) if instances is None else instances
        return _read_surface(document, [each for each in shown if each.node not in excluded])


def _read_surface(document: Document, shown: Sequence[Instance]) -> tuple[Surface, list[Block], list[Block]]:
    placer = Placer(document)
    blocks: list[Block] = []
    loose: list[Block] = []
    triangles: list[NDArray[np.int64]] = []
    owner: list[int] = []
    skipped: list[dict[str, Any]] = []
    start = 0
    for number, instance in enumerate(shown):
        if instance.skin is None and placer.of_node(instance) is None:
            skipped.append({"node": instance.node, "mesh": instance.mesh, "reason": _FLATTENED})
            continue
        for accessors, primitives in _groups(document, instance, skipped).items():
            placement = _placement(document, placer, instance, primitives[0], skipped)
            if placement is None:
                continue
            block = _read_block(document, instance, accessors[:3], primitives, placement, start)
            block = dataclasses.replace(block, rest=_rest_targets(document, instance, block))
            count = len(block.positions)
            faces = [_faces(document, block, p, count, skipped) for p in primitives]
            block = dataclasses.replace(block, triangles=tuple(map(len, faces)))
            triangles += [start + (each[:, ::-1] if placement.mirrors else each) for each in faces]
            blocks.append(block)
            owner.append(number)
            start += count
        loose += _loose_blocks(document, placer, instance, skipped)
    joined = np.concatenate(triangles) if triangles else np.empty((0, 3), np.int64)
    if len(joined) == 0:
        problems = {item["reason"] for item in skipped} | ({LOOSE} if loose else set())
        reasons = "; ".join(sorted(problems)[:5])
        raise AssetEmptyError("The default scene shows no triangles" + (f": {reasons}." if reasons else "."))
    return _join(blocks, joined, owner, skipped), blocks, loose


def _placement(
    document: Document, placer: Placer, instance: Instance, number: int, skipped: list[dict[str, Any]]
) -> Placement | None:
    """Return the placement of a primitive's vertices; None if it flattens them, which `skipped` then says."""
    primitive = document.root["meshes"][instance.mesh]["primitives"][number]
    count = document.root["accessors"][primitive["attributes"]["POSITION"]]["count"]
    placement = placer.of_vertices(instance, primitive, count)
    if placement is None:
        told = {"node": instance.node, "mesh": instance.mesh, "primitive": number}
        skipped.append({**told, "reason": _FLATTENED})
    return placement


def _groups(
    document: Document, instance: Instance, skipped: list[dict[str, Any]]
) -> dict[tuple[int, int | None, int | None, str], list[int]]:
    """Return the primitives that share their accessors and, where targets or joints place them, these as well."""
    groups: dict[tuple[int, int | None, int | None, str], list[int]] = {}
    shows_targets = any(_rest_weights(document.root, instance))
    for p, primitive in enumerate(document.root["meshes"][instance.mesh].get("primitives", [])):
        attributes, mode = primitive.get("attributes", {}), primitive.get("mode", TRIANGLES)
        if mode < TRIANGLES:
            continue
        if "POSITION" not in attributes:
            reason = "no POSITION attribute"
            skipped.append({"node": instance.node, "mesh": instance.mesh, "primitive": p, "reason": reason})
            continue
        placed_by = repr(primitive.get("targets", [])) if shows_targets else ""
        if instance.skin is not None:
            placed_by += repr(sorted(item for item in attributes.items() if item[0].startswith(("JOINTS", "WEIGHTS"))))
        key = (attributes["POSITION"], attributes.get("NORMAL"), attributes.get("TANGENT"), placed_by)
        groups.setdefault(key, []).append(p)
    return groups


def _loose_blocks(document: Document, placer: Placer, instance: Instance, skipped: list[dict[str, Any]]) -> list[Block]:
    """Return the points and lines of an instance, by their positions; those that are not finite are skipped."""
    groups: dict[int, list[int]] = {}
    for p, primitive in enumerate(document.root["meshes"][instance.mesh].get("primitives", [])):
        if primitive.get("mode", TRIANGLES) < TRIANGLES and "POSITION" in primitive.get("attributes", {}):
            groups.setdefault(primitive["attributes"]["POSITION"], []).append(p)
    blocks = []
    for position, primitives in groups.items():
        positions = read_floats(document, position)
        placement = _placement(document, placer, instance, primitives[0], skipped)
        if placement is not None and np.isfinite(positions).all():
            accessors, rows = (position, None, None), slice(0, 0)
            named = instance.node, instance.mesh, tuple(primitives), (0,) * len(primitives)
            blocks.append(Block(*named, accessors, rows, placement, positions, None, None))
        elif placement is not None:
            reason = "points or lines whose positions are not finite"
            told = {"node": instance.node, "mesh": instance.mesh, "primitive": primitives[0]}
            skipped.append({**told, "reason": reason})
    return blocks


def _read_block(
    document: Document,
    instance: Instance,
    accessors: tuple[int, int | None, int | None],
    primitives: list[int],
    placement: Placement,
    start: int,
) -> Block:
    position, normal, tangent = accessors
    positions = read_floats(document, position)
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise AssetNotFiniteError(
            f"accessors[{position}] (POSITION of mesh {instance.mesh}) has {len(bad)} positions that are not finite, "
            f"the first at {bad[0]}."
        )
    return Block(
        instance.node,
        instance.mesh,
        tuple(primitives),
        (0,) * len(primitives),
        accessors,
        slice(start, start + len(positions)),
        placement,
        positions,
        None if normal is None else read_floats(document, normal),
        None if tangent is None else read_floats(document, tangent),
    )


def _rest_weights(root: Json, instance: Instance) -> list[float]:
    """Return the weights of an instance's morph targets at rest (glTF 2.0, section 3.7.2.2)."""
    weights = root["nodes"][instance.node].get("weights", root["meshes"][instance.mesh].get("weights", []))
    return [float(weight) for weight in weights]


def _rest_targets(document: Document, instance: Instance, block: Block) -> _RestTargets | None:
    """Return the displacements of a block at rest by its morph targets; None if there are none."""
    targets = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]].get("targets", [])
    added: dict[str, Floats] = {}
    for weight, target in zip(_rest_weights(document.root, instance), targets, strict=False):
        for name in ("POSITION", "NORMAL", "TANGENT") if weight else ():
            accessor = target.get(name)
            # Accessors that only targets use are not checked otherwise.
            if accessor is None or document.root["accessors"][accessor]["count"] != len(block.positions):
                continue
            values = read_floats(document, accessor)
            if values.shape[1] == 3 and np.isfinite(values).all():
                added[name] = added.get(name, 0.0) + weight * values.astype(np.float64)
    if not added:
        return None
    none = np.zeros(block.positions.shape)
    return _RestTargets(added.get("POSITION", none), added.get("NORMAL"), added.get("TANGENT"))


def shown_vertices(block: Block) -> tuple[Floats, Floats | None, Floats | None]:
    """Return the positions (V, 3), normals (V, 3) and tangents (V, 3) that viewers show at rest, in mesh space."""
    rest = block.rest
    positions = block.positions.astype(np.float64) + (0.0 if rest is None else rest.positions)
    tangents = None if block.tangents is None else block.tangents[:, :3]
    return (
        positions,
        _shown(block.normals, None if rest is None else rest.normals),
        _shown(tangents, None if rest is None else rest.tangents),
    )


def _shown(directions: NDArray[np.float32] | None, added: Floats | None) -> Floats | None:
    if directions is None:
        return None
    return directions.astype(np.float64) + (0.0 if added is None else added)


def _faces(document: Document, block: Block, p: int, count: int, skipped: list[dict[str, Any]]) -> NDArray[np.int64]:
    primitive = document.root["meshes"][block.mesh]["primitives"][p]
    faces = read_triangles(document, primitive, count, f"meshes[{block.mesh}].primitives[{p}]")
    corners = document.root["accessors"][primitive["indices"]]["count"] if "indices" in primitive else count
    if primitive.get("mode", TRIANGLES) == TRIANGLES and corners % 3:
        reason = f"the last {corners % 3} indices make no whole triangle"
        skipped.append({"node": block.node, "mesh": block.mesh, "primitive": p, "reason": reason})
    return faces


def _join(
    blocks: list[Block], triangles: NDArray[np.int64], owner: list[int], skipped: list[dict[str, Any]]
) -> Surface:
    total = blocks[-1].rows.stop
    positions = np.empty((total, 3))
    normals, tangents = np.full((total, 3), np.nan), np.full((total, 4), np.nan)
    instances, stays = np.empty(total, np.int64), np.zeros(total, bool)
    for block, number in zip(blocks, owner, strict=True):
        placement = block.placement
        instances[block.rows] = number
        shown = shown_vertices(block)
        positions[block.rows] = placement.points(shown[0])
        if placement.stays is not None:
            stays[block.rows] = placement.stays
        if shown[1] is not None:
            normals[block.rows] = placement.normals(shown[1])
        if block.tangents is not None and shown[2] is not None:
            tangents[block.rows, :3] = placement.directions(shown[2])
            tangents[block.rows, 3] = handedness(block.tangents[:, 3], mirrors=placement.mirrors)
    if not np.isfinite(positions).all():
        raise AssetNotFiniteError("The node transforms make positions too large for a 64-bit float.")
    return Surface(positions, triangles, normals, tangents, instances, stays, skipped)


def transformed_normals(maps: Floats, normals: NDArray[Any]) -> Floats:
    """Return unit normals (V, 3) under linear maps (V, 3, 3), by the cofactors; NaN where a map leaves none."""
    a, b, c = maps[:, 0], maps[:, 1], maps[:, 2]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
    return unit_rows(np.einsum("vij,vj->vi", cofactors, normals.astype(np.float64)))


def handedness(w: NDArray[Any], *, mirrors: bool) -> Floats:
    """Return +1 or -1 per tangent; mirroring flips the sign."""
    mirror = -1.0 if mirrors else 1.0
    return np.where(np.asarray(w) < 0.0, -mirror, mirror)
