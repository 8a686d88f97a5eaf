"""Write a new shape into a document, giving each deformed primitive new accessors in its mesh's space.

Points and lines are carried along: they have no faces to deform, but belong to the object. Each of their vertices moves
like the nearest vertices of triangles (`geometry/interpolation.py`). Data URIs move into the binary chunk, where
viewers expect them: as base64 text they cost a third more bytes, and validators warn about it.

The morph targets that a mesh has are carried along with its surface: a smile stays a smile on a fat face. With J the
linear map of the deformation around a vertex, in the space of the mesh, a target's displacement d becomes ``J d``.
Normals and tangents of a target are those of the target's shape, so they are transformed as such, with the cofactors of
J and with J itself, before the new base is subtracted.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.codes import MESHOPT_EXTENSIONS
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document, decode_data_uri
from meshdeform.assets.materials import image_type
from meshdeform.assets.morph import NewTargets, add_morph_targets
from meshdeform.assets.moved_nodes import move_nodes, world_shifts
from meshdeform.assets.placement import Floats, unit_rows, world_matrices
from meshdeform.assets.references import follow_copies, share_positions
from meshdeform.assets.surface import Block, LocalShape, Surface, handedness, transformed_normals
from meshdeform.assets.usage import Usage
from meshdeform.errors import AssetError, NumericalError, ShapeError

if TYPE_CHECKING:
    from meshdeform.assets.companions import Companions
    from meshdeform.assets.rig import NodeMove


@dataclass(frozen=True)
class ShapeChange:
    """The original surface and its new shape, both in world space; rows as in `Surface`.

    With `jacobians`, morph targets, joints and other nodes follow; `joints` says where joints go, if it is known.
    """

    surface: Surface
    positions: Floats
    normals: Floats | None
    tangents: Floats | None
    jacobians: Floats | None = None
    joints: Mapping[int, NodeMove] | None = None

    @classmethod
    def checked(
        cls,
        surface: Surface,
        positions: Floats,
        normals: Floats | None,
        tangents: Floats | None,
        jacobians: Floats | None = None,
        joints: Mapping[int, NodeMove] | None = None,
    ) -> Self:
        """Return a deformation after checking array shapes and that positions are finite."""
        count = len(surface.positions)
        for name, array, columns in (("positions", positions, 3), ("normals", normals, 3), ("tangents", tangents, 4)):
            if array is not None and np.shape(array) != (count, columns):
                raise ShapeError(f"{name} must have shape ({count}, {columns}), not {np.shape(array)}")
        if not np.isfinite(positions).all():
            raise NumericalError("The new positions are not all finite.")
        if jacobians is not None and np.shape(jacobians) != (count, 3, 3):
            raise ShapeError(f"jacobians must have shape ({count}, 3, 3), not {np.shape(jacobians)}")
        normals, tangents, jacobians = (
            None if array is None else np.asarray(array, np.float64) for array in (normals, tangents, jacobians)
        )
        return cls(surface, np.asarray(positions, np.float64), normals, tangents, jacobians, joints)


def _local_shape(block: Block, shape: ShapeChange, node_shift: Floats, scale: float | None) -> LocalShape:
    """Transform a block's new vertices back to mesh space; `node_shift`, (3,): that of its node, in world space."""
    # Vertices that did not move keep their exact bits: positions are the source plus the displacement, and directions
    # are replaced only where they changed.
    placement = block.placement
    moved = placement.moves_back(shape.positions[block.rows] - shape.surface.positions[block.rows] - node_shift)
    maps = None
    if block.rest is not None and shape.jacobians is not None:
        # The targets follow, and what they add at rest with them: the new shape has it already.
        maps = placement.maps_back(shape.jacobians[block.rows])
        moved += block.rest.positions - np.einsum("vij,vj->vi", maps, block.rest.positions)
    if scale is not None and placement.linear.ndim == 3:
        moved = (scale - 1.0) * block.positions.astype(np.float64)
    with np.errstate(over="ignore"):
        positions = (block.positions + moved).astype(np.float32)
    if not np.isfinite(positions).all():
        raise NumericalError("The new positions are too large for the 32-bit floats of a glTF file.")
    normals = tangents = None
    if block.normals is not None and shape.normals is not None:
        new = placement.normals_back(shape.normals[block.rows])
        if block.rest is not None and block.rest.normals is not None:
            new = _base_normals(new, block.rest.normals) if maps is None else transformed_normals(maps, block.normals)
        normals = _where_changed(block.normals, new, shape.normals[block.rows], shape.surface.normals[block.rows])
    if block.tangents is not None and shape.tangents is not None:
        world = shape.tangents[block.rows]
        turned = handedness(world[:, 3], mirrors=placement.mirrors)
        new = np.column_stack([placement.directions_back(world[:, :3]), turned])
        tangents = _where_changed(block.tangents, new, world, shape.surface.tangents[block.rows])
    return LocalShape(positions, normals, tangents)


def _base_normals(shown: Floats, added: Floats) -> Floats:
    """Return the unit normals (V, 3) to which targets add so much that viewers show these, or nearly these."""
    along = np.einsum("vi,vi->v", shown, added)
    length = along + np.sqrt(np.maximum(1.0 + along**2 - np.einsum("vi,vi->v", added, added), 0.0))
    return unit_rows(length[:, None] * shown - added)


def _where_changed(
    source: NDArray[np.float32], new: Floats, world: Floats, world_before: Floats
) -> NDArray[np.float32]:
    changed = (world != world_before).any(axis=1) & np.isfinite(new).all(axis=1)
    return np.where(changed[:, None], new, source).astype(np.float32)


@dataclass(frozen=True)
class Finish:
    """How a document is completed after its shape has been written."""

    source: Usage | None = None  # what the document used when it was read; then data that became unused is dropped
    provenance: Mapping[str, Any] | None = None  # JSON to store as `asset.extras.meshdeform`


def write_shape(
    document: Document,
    blocks: list[Block],
    loose: list[Block],
    shape: ShapeChange,
    finish: Finish,
    companions: Companions | None = None,
) -> bytes:
    """Write a new shape into the document and return it as a GLB; `Asset.replace` documents the rest.

    `loose` are the points and lines, and `companions` what stands outside the scene, which follow the surface.
    """
    moves, scale = _node_moves(document, blocks, shape), _uniform_scale(shape)
    shifts = world_shifts(document.root["nodes"], moves)
    layers = [(blocks, loose, shape, shifts)]
    if companions is not None:
        of_companions = world_shifts(companions.nodes, moves)
        layers.append((companions.blocks, companions.loose, _along(companions, shape), of_companions))
    locals_ = [_local_shapes(*layer, scale) for layer in layers]
    owners = _own_meshes(document, [block for layer in layers for block in (*layer[0], *layer[1])])
    follow_copies(document.root, owners)
    replaced: list[tuple[int, int]] = []
    for (own, points, new, _), own_locals in zip(layers, locals_, strict=True):
        replaced += _write_layer(document, own, points, new, own_locals, owners)
    for mesh in dict.fromkeys(owners.values()):
        share_positions(document.root, document.root["meshes"][mesh])
    if shape.jacobians is not None:
        _follow_volumes(document, shape, shifts)
    _write_bounds(document, shape)
    skins = {document.root["nodes"][block.node].get("skin") for layer in layers for block in layer[0]} - {None}
    return _finished(document, finish, replaced + move_nodes(document, moves, skins, scale))


def _write_layer(
    document: Document,
    blocks: list[Block],
    loose: list[Block],
    shape: ShapeChange,
    locals_: list[LocalShape],
    owners: Mapping[tuple[int, int], int],
) -> list[tuple[int, int]]:
    """Give blocks their new vertices, and the targets of those with triangles; return replaced accessors."""
    meshes, replaced = document.root["meshes"], list[tuple[int, int]]()
    for block, local in zip([*blocks, *loose], locals_, strict=True):
        replaced += _replace(document, block, local, meshes[owners[block.node, block.mesh]])
    if shape.jacobians is not None:
        for block, local in zip(blocks, locals_, strict=False):  # those of points and lines come last
            mesh = meshes[owners[block.node, block.mesh]]
            jacobians = shape.jacobians[block.rows]
            replaced += carry_targets(document, block, mesh, jacobians, local.normals, local.tangents)
    return replaced


def _along(companions: Companions, shape: ShapeChange) -> ShapeChange:
    """Return how companions are deformed by the map of a surface."""
    from meshdeform.assets.companions import rough_jacobians

    maps = shape.jacobians
    if maps is None:
        maps = rough_jacobians(shape.surface, shape.positions)
    positions, normals, tangents, own = companions.deformed(shape.surface, shape.positions, maps)
    follows = None if shape.jacobians is None else own
    return ShapeChange.checked(companions.surface, positions, normals, tangents, follows)


def _follow_volumes(document: Document, shape: ShapeChange, shifts: Sequence[Floats]) -> None:
    from meshdeform.assets.rig import RigMotion
    from meshdeform.assets.volumes import Volumes

    source, jacobians = shape.surface.positions, shape.jacobians
    assert jacobians is not None
    motion, worlds = RigMotion(source, shape.positions - source, jacobians), world_matrices(document.root["nodes"])
    Volumes(document.root, worlds, shifts, motion, np.unique(shape.surface.triangles)).follow()


def _write_bounds(document: Document, shape: ShapeChange) -> None:
    """Write the box of the surface where the scenes state it (FB_geometry_metadata)."""
    for scene in document.root.get("scenes", []):
        stated = scene.get("extensions", {}).get("FB_geometry_metadata")
        if isinstance(stated, dict) and "sceneBounds" in stated:
            points = shape.positions[np.unique(shape.surface.triangles)]
            stated["sceneBounds"] = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}


def _uniform_scale(shape: ShapeChange) -> float | None:
    """Return the scale of a deformation that is one of everything, without a turn, in which the rig follows."""
    if shape.jacobians is None:
        return None
    used = np.unique(shape.surface.triangles)
    jacobian, source = shape.jacobians[used[0]], shape.surface.positions[used]
    scale = float(jacobian[0, 0])
    if scale == 1.0 or not (shape.jacobians[used] == scale * np.eye(3)).all():
        return None
    beside = shape.positions[used] - scale * source
    return scale if np.ptp(beside, axis=0).max() <= 1e-9 * np.ptp(source, axis=0).max() else None


def _node_moves(document: Document, blocks: list[Block], shape: ShapeChange) -> dict[int, NodeMove]:
    """Return how the nodes of the file move with its surface."""
    if shape.jacobians is None:
        return {}
    from meshdeform.assets.attached import node_moves
    from meshdeform.assets.rig import RigMotion

    positions = shape.surface.positions
    motion = RigMotion(positions, shape.positions - positions, shape.jacobians)
    return node_moves(document, shape.surface, blocks, motion, shape.joints)


def write_targets(
    document: Document,
    blocks: list[Block],
    loose: list[Block],
    shapes: Sequence[ShapeChange],
    new: NewTargets,
    finish: Finish,
) -> bytes:
    """Write shapes as morph targets into the document and return it as a GLB; `Asset.morph` documents the rest."""
    shifts = [np.zeros(3)] * len(document.root["nodes"])
    locals_ = [_local_shapes(blocks, loose, shape, shifts, None) for shape in shapes]
    blocks = [*blocks, *loose]
    owners = _own_meshes(document, blocks)
    follow_copies(document.root, owners)
    add_morph_targets(document, blocks, locals_, {node: mesh for (node, _), mesh in owners.items()}, new)
    return _finished(document, finish, [])


def _local_shapes(
    blocks: list[Block], loose: list[Block], shape: ShapeChange, shifts: Sequence[Floats], scale: float | None
) -> list[LocalShape]:
    """Return the new vertices of the blocks, then of the points and lines, in the spaces of their meshes.

    `shifts`: how far each node moves in world space; a skin does not follow its node. `scale`: of a uniform scaling,
    whose skins are scaled as they were bound, so that they are in every pose.
    """
    moved = shape.positions - shape.surface.positions
    shift_of = {
        block.node: np.zeros(3) if block.placement.linear.ndim == 3 else shifts[block.node]
        for block in [*blocks, *loose]
    }
    carried = carried_positions(shape.surface, moved, loose, [shift_of[block.node] for block in loose])
    return [
        *(_local_shape(block, shape, shift_of[block.node], scale) for block in blocks),
        *(LocalShape(positions, None, None) for positions in carried),
    ]


def _finished(document: Document, finish: Finish, replaced: list[tuple[int, int]]) -> bytes:
    embed_data_uris(document)
    if finish.source is not None:
        from meshdeform.assets.compact import compact

        compact(document, finish.source, replaced)
    if finish.provenance is not None:
        _record(document, finish.provenance)
    return document.to_bytes()


def _record(document: Document, provenance: Mapping[str, Any]) -> None:
    """Store the provenance in `asset.extras`; extras that are not an object cannot hold it and stay."""
    extras = document.root["asset"].setdefault("extras", {})
    if isinstance(extras, dict):
        extras["meshdeform"] = clone(dict(provenance))


def _own_meshes(document: Document, blocks: list[Block]) -> dict[tuple[int, int], int]:
    """Give every deformed node its own mesh, and return it by the node and its mesh before.

    A block's node may collide with another mesh than it shows.
    """
    # The first node of a mesh keeps the original, unless a node that is not deformed (in another scene, or drawn by GPU
    # instancing) also shows the mesh and needs the original.
    nodes, meshes = document.root["nodes"], document.items("meshes")
    deformed: dict[int, dict[int, None]] = defaultdict(dict)
    for block in blocks:
        deformed[block.mesh][block.node] = None
    shown: dict[int, set[int]] = defaultdict(set)
    for i, node in enumerate(nodes):
        if "mesh" in node:
            shown[node["mesh"]].add(i)
    owners: dict[tuple[int, int], int] = {}
    for mesh, users in deformed.items():
        others = shown[mesh] - set(users)
        for number, node in enumerate(users):
            owners[node, mesh] = mesh
            if number or others:
                owners[node, mesh] = document.add("meshes", clone(meshes[mesh]))
                if nodes[node].get("mesh") == mesh:
                    nodes[node]["mesh"] = owners[node, mesh]
    return owners


def _replace(document: Document, block: Block, local: LocalShape, mesh: Json) -> list[tuple[int, int]]:
    """Give a block new accessors; return each old one with its new one."""
    accessors = document.root["accessors"]
    new: dict[str, int] = {}
    pairs: list[tuple[int, int]] = []
    for name, old, values in zip(
        ("POSITION", "NORMAL", "TANGENT"),
        block.accessors,
        (local.positions, local.normals, local.tangents),
        strict=True,
    ):
        if old is not None and values is not None:
            new[name] = document.append_accessor(values, like=accessors[old], bounds=name == "POSITION")
            pairs.append((old, new[name]))
    for p in block.primitives:
        mesh["primitives"][p]["attributes"].update(new)
    return pairs


def carried_positions(
    surface: Surface, moved: Floats, blocks: list[Block], shifts: Sequence[Floats]
) -> list[NDArray[np.float32]]:
    """Return the new positions of points and lines, in the space of their meshes.

    `moved`, (N, 3) float64: displacement of its vertices, in world space; `shifts`: those (3,) of the blocks' nodes.
    Returns a (V, 3) float32 array for each block.
    """
    if not blocks:
        return []
    from meshdeform.geometry.interpolation import interpolate

    used = np.unique(surface.triangles)
    world = [block.placement.points(block.positions.astype(np.float64)) for block in blocks]
    ends = np.cumsum([len(positions) for positions in world])[:-1]
    moves = np.split(interpolate(surface.positions[used], moved[used], np.concatenate(world)), ends)
    return [
        (block.positions + block.placement.moves_back(move - shift)).astype(np.float32)
        for block, move, shift in zip(blocks, moves, shifts, strict=True)
    ]


def embed_data_uris(document: Document) -> None:
    """Store the buffers and images with data URIs in the binary chunk, in place; broken or unknown images stay."""
    for image in document.root.get("images", []):
        _embed_image(document, image)
    buffers = document.root.get("buffers", [])
    moved = {
        i: document.append_bytes(bytes(document.buffer_bytes(i)[: buffer["byteLength"]]))
        for i, buffer in enumerate(buffers)
        if "uri" in buffer and i > 0 and not any(name in buffer.get("extensions", {}) for name in MESHOPT_EXTENSIONS)
    }
    if buffers and "uri" in buffers[0]:
        document.append_bytes(b"")  # makes buffer 0 the binary chunk
    for holder in document.buffer_holders():
        if holder["buffer"] in moved:
            holder["byteOffset"] = holder.get("byteOffset", 0) + moved[holder["buffer"]]
            holder["buffer"] = 0
    document.remove_buffers(set(moved))


def _embed_image(document: Document, image: Json) -> None:
    uri = image.get("uri", "")
    if uri[:5].lower() != "data:":
        return
    try:
        data = decode_data_uri(uri, "an image")
    except AssetError:
        return
    kind = image_type(data) or uri[5:].partition(",")[0].partition(";")[0].lower()
    if kind.startswith("image/") and data:
        del image["uri"]
        image |= {"bufferView": document.append_view(data), "mimeType": kind}


def carry_targets(
    document: Document,
    block: Block,
    mesh: Json,
    jacobians: Floats,
    normals: NDArray[np.float32] | None,
    tangents: NDArray[np.float32] | None,
) -> list[tuple[int, int]]:
    """Give the targets of a block's primitives new accessors; return each old one with its new one.

    `document`: changed in place; `mesh`: the block's mesh, which no other node uses; `jacobians`, (V, 3, 3) float64: in
    world space; `normals` is (V, 3) float32; `tangents`, (V, 4) float32: those of the new base, in mesh space.
    """
    moved = np.asarray((jacobians != np.eye(3)).any((1, 2)))
    if not moved.any():
        return []
    maps = block.placement.maps_back(jacobians)
    bases = {"NORMAL": (block.normals, normals), "TANGENT": (block.tangents, tangents)}
    copies: dict[tuple[str, int], int] = {}
    for number in block.primitives:
        for target in mesh["primitives"][number].get("targets", []):
            for name in ("POSITION", "NORMAL", "TANGENT"):
                old = target.get(name)
                if not isinstance(old, int):
                    continue
                if (name, old) not in copies:
                    before = read_floats(document, old)
                    if len(before) != len(maps) or before.shape[1] != 3:
                        continue
                    after = np.einsum("vij,vj->vi", maps, before.astype(np.float64))
                    if name != "POSITION":
                        after = _direction(name, before, maps, *bases[name])
                    with np.errstate(over="ignore"):
                        after = after.astype(np.float32)
                    changed = np.asarray(moved & np.isfinite(after).all(1))
                    values = np.where(changed[:, None], after, before)
                    like = document.root["accessors"][old]
                    copies[name, old] = document.append_accessor(values, like=like, bounds=name == "POSITION")
                target[name] = copies[name, old]
    return [(old, new) for (_, old), new in copies.items()]


def _direction(
    name: str,
    before: NDArray[np.float32],
    maps: Floats,
    base: NDArray[np.float32] | None,
    new_base: NDArray[np.float32] | None,
) -> Floats:
    """Return the new displacements (V, 3) of a target's normals or tangents; the old ones where there is no base."""
    if base is None or new_base is None:
        return before.astype(np.float64)
    shown = base[:, :3].astype(np.float64) + before
    turned = transformed_normals(maps, shown) if name == "NORMAL" else unit_rows(np.einsum("vij,vj->vi", maps, shown))
    return np.asarray(turned * np.linalg.norm(shown, axis=1, keepdims=True) - new_base[:, :3])
