"""List what a surface consists of: nodes, meshes, materials, which triangles belong to each, and its rig."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.document import Document
from meshdeform.assets.placement import parents_of, upwards
from meshdeform.assets.surface import Block, block_primitives
from meshdeform.assets.unchecked import animated, channels_of, pointer_of

_MAX_NAME = 200


@dataclass(frozen=True)
class SurfacePieces:
    """What a surface consists of: nodes, meshes, materials and joints."""

    nodes: list[dict[str, Any]]
    """`index` and `name` of each node with triangles in or below it. A node without a name has that of its mesh, and
    names are cut after 200 characters."""
    materials: list[dict[str, Any]]  # `index` and `name` of each material in use
    meshes: list[dict[str, Any]]  # `index` and `name` of each mesh in use
    joints: list[dict[str, Any]]  # `index` and `name` of each node that is a joint of a skin in use
    node_of_triangle: NDArray[np.int64]  # (T,) int64: node of each triangle of the surface
    mesh_of_triangle: NDArray[np.int64]  # (T,) int64: its mesh
    material_of_triangle: NDArray[np.int64]  # (T,) int64: its material; -1 if it has none
    children: dict[int, list[int]]  # children of each node that has some

    def in_node(self, node: int) -> NDArray[np.bool_]:
        """Return flags (T,) of the triangles in a node or below it."""
        below = [node]
        for at in below:  # grows while it is read; nodes form a forest
            below += self.children.get(at, [])
        return np.isin(self.node_of_triangle, below)

    def of_material(self, material: int) -> NDArray[np.bool_]:
        """Return flags (T,) of the triangles with a material."""
        return np.asarray(self.material_of_triangle == material)

    def of_mesh(self, mesh: int) -> NDArray[np.bool_]:
        """Return flags (T,) of the triangles of all instances of a mesh."""
        return np.asarray(self.mesh_of_triangle == mesh)


def read_pieces(document: Document, blocks: Sequence[Block]) -> SurfacePieces:
    """Read what the surface that `read_surface` gathered in `blocks` consists of."""
    root = document.root
    nodes, meshes = root["nodes"], root["meshes"]
    # Materials have not been checked: nothing else reads them here.
    materials = root["materials"] if isinstance(root.get("materials"), list) else []
    children = {at: node["children"] for at, node in enumerate(nodes) if node.get("children")}
    counts = [count for block in blocks for count in block.triangles]
    owners = [block.node for block in blocks for _ in block.triangles]
    looks = [_material(primitive, len(materials)) for _, _, primitive, _ in block_primitives(root, blocks)]
    shown = _with_ancestors({block.node for block in blocks if sum(block.triangles)}, children)
    used = sorted({look for look, count in zip(looks, counts, strict=True) if count and look >= 0})
    return SurfacePieces(
        [
            {"index": at, "name": _name(nodes[at]) or ("mesh" in nodes[at] and _name(meshes[nodes[at]["mesh"]])) or ""}
            for at in shown
        ],
        [{"index": at, "name": _name(materials[at])} for at in used],
        [{"index": at, "name": _name(meshes[at])} for at in sorted({block.mesh for block in blocks})],
        [{"index": at, "name": _name(nodes[at])} for at in _joints(document, blocks)],
        np.repeat(np.array(owners, np.int64), counts),
        np.repeat(np.array([block.mesh for block in blocks], np.int64), [sum(block.triangles) for block in blocks]),
        np.repeat(np.array(looks, np.int64), counts),
        children,
    )


def _joints(document: Document, blocks: Sequence[Block]) -> list[int]:
    nodes = document.root["nodes"]
    skins = {nodes[block.node]["skin"] for block in blocks if "skin" in nodes[block.node]}
    return sorted({joint for skin in skins for joint in document.root["skins"][skin]["joints"]})


def _with_ancestors(nodes: set[int], children: dict[int, list[int]]) -> list[int]:
    """Return these nodes and all above them, ascending."""
    parents = {child: at for at, below in children.items() for child in below}
    nodes_above: set[int] = set()
    for node in nodes:
        at: int | None = node
        while at is not None and at not in nodes_above:
            nodes_above.add(at)
            at = parents.get(at)
    return sorted(nodes_above)


def _material(primitive: dict[str, Any], count: int) -> int:
    """Return the number of a primitive's material; -1 if it is none of so many."""
    number = primitive.get("material")
    return number if type(number) is int and 0 <= number < count else -1


def _name(item: Any) -> str:
    name = item.get("name", "") if isinstance(item, dict) else ""
    return name[:_MAX_NAME] if isinstance(name, str) else ""


@dataclass(frozen=True)
class Rig:
    """Attachments that would have to follow a surface."""

    joints: int  # joints of its skins
    morph_targets: int  # morph targets of its meshes; each counts once however many primitives have it
    animations: int  # animations in the file

    def __bool__(self) -> bool:
        return bool(self.joints or self.morph_targets)


def read_rig(document: Document, blocks: Sequence[Block]) -> Rig:
    """Count the attachments of the deformed meshes."""
    nodes, skins, meshes = document.root["nodes"], document.root.get("skins", []), document.root["meshes"]
    used = {nodes[block.node]["skin"] for block in blocks if "skin" in nodes[block.node]}
    joints = {joint for skin in used for joint in skins[skin]["joints"]}
    shown = {block.mesh for block in blocks}
    targets = sum(max(len(each.get("targets", [])) for each in meshes[mesh]["primitives"]) for mesh in shown)
    return Rig(len(joints), targets, len(document.root.get("animations", [])))


def turned_nodes(document: Document, blocks: Sequence[Block]) -> list[str]:
    """Return the names of the nodes with blocks in or below them that animations turn or scale, joints apart."""
    nodes = document.root["nodes"]
    parents = parents_of(nodes)
    joints = {joint for skin in document.root.get("skins", []) for joint in skin["joints"]}
    turned: set[int] = set()
    for channel, _, _ in channels_of(document.root):
        array, node, prop = animated(channel)
        if array == "nodes" and prop in ("rotation", "scale") and node not in joints and not pointer_of(channel):
            turned.add(node)
    results = []
    for block in blocks:
        way = () if "skin" in nodes[block.node] else upwards(block.node, parents)
        at = next((at for at in way if at in turned or at in joints), None)
        if at is not None and at in turned:
            results.append(_name(nodes[at]) or f"node {at}")
    return list(dict.fromkeys(results))


def rig_accessors(document: Document, blocks: Sequence[Block]) -> Iterator[int]:
    """Yield the accessors of their morph targets and inverse bind matrices."""
    nodes = document.root["nodes"]
    for block in blocks:
        for _, _, primitive, _ in block_primitives(document.root, [block]):
            for target in primitive.get("targets", []):
                yield from (target[name] for name in ("POSITION", "NORMAL", "TANGENT") if name in target)
        if "skin" in nodes[block.node]:
            skin = document.root["skins"][nodes[block.node]["skin"]]
            if "inverseBindMatrices" in skin:
                yield skin["inverseBindMatrices"]
