"""List what the deformed surface consists of: nodes, meshes, materials, which triangles belong to each, and its rig."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block

__all__ = ["Parts", "Rig", "read_parts", "read_rig", "rig_accessors"]


_MAX_NAME = 200


@dataclass(frozen=True)
class Parts:
    """The named parts of a surface.

    Attributes
    ----------
    nodes : list of dict
        `index` and `name` of each node with triangles in or below it. A node without a name has that of its mesh, and
        names are cut after 200 characters.
    materials : list of dict
        `index` and `name` of each material in use.
    meshes : list of dict
        `index` and `name` of each mesh in use.
    joints : list of dict
        `index` and `name` of each node that is a joint of a skin in use.
    node_of_triangle : (T,) int64
        Node of each triangle of the surface.
    mesh_of_triangle : (T,) int64
        Its mesh.
    material_of_triangle : (T,) int64
        Its material; -1 if it has none.
    children : dict of int to list of int
        Children of each node that has some.
    """

    nodes: list[dict[str, Any]]
    materials: list[dict[str, Any]]
    meshes: list[dict[str, Any]]
    joints: list[dict[str, Any]]
    node_of_triangle: NDArray[np.int64]
    mesh_of_triangle: NDArray[np.int64]
    material_of_triangle: NDArray[np.int64]
    children: dict[int, list[int]]

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


def read_parts(document: Document, blocks: Sequence[Block]) -> Parts:
    """Read the parts of the surface that `read_surface` gathered in `blocks`."""
    root = document.root
    nodes, meshes = root["nodes"], root["meshes"]
    # Materials have not been checked: nothing else reads them here.
    materials = root["materials"] if isinstance(root.get("materials"), list) else []
    children = {at: node["children"] for at, node in enumerate(nodes) if node.get("children")}
    counts = [count for block in blocks for count in block.triangles]
    owners = [block.node for block in blocks for _ in block.triangles]
    looks = [
        _material(meshes[block.mesh]["primitives"][primitive]) for block in blocks for primitive in block.primitives
    ]
    shown = _with_ancestors({block.node for block in blocks if sum(block.triangles)}, children)
    used = sorted({look for look, count in zip(looks, counts, strict=True) if count and look >= 0})
    return Parts(
        [{"index": at, "name": _name(nodes[at]) or _name(_mesh(nodes[at], meshes))} for at in shown],
        [{"index": at, "name": _name(materials[at]) if at < len(materials) else ""} for at in used],
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
    found: set[int] = set()
    for node in nodes:
        at: int | None = node
        while at is not None and at not in found:
            found.add(at)
            at = parents.get(at)
    return sorted(found)


def _mesh(node: dict[str, Any], meshes: list[dict[str, Any]]) -> dict[str, Any]:
    return meshes[node["mesh"]] if "mesh" in node else {}


def _material(primitive: dict[str, Any]) -> int:
    found = primitive.get("material")
    return found if type(found) is int and found >= 0 else -1


def _name(item: Any) -> str:
    name = item.get("name", "") if isinstance(item, dict) else ""
    return name[:_MAX_NAME] if isinstance(name, str) else ""


@dataclass(frozen=True)
class Rig:
    """What a surface has that would have to follow it.

    Attributes
    ----------
    joints : int
        Joints of its skins.
    morph_targets : int
        Morph targets of its meshes; each counts once however many primitives have it.
    animations : int
        Animations in the file.
    """

    joints: int
    morph_targets: int
    animations: int

    def __bool__(self) -> bool:
        return bool(self.joints or self.morph_targets)


def read_rig(document: Document, blocks: Sequence[Block]) -> Rig:
    """Count what the deformed meshes have."""
    nodes, skins, meshes = document.root["nodes"], document.root.get("skins", []), document.root["meshes"]
    used = {nodes[block.node]["skin"] for block in blocks if "skin" in nodes[block.node]}
    joints = {joint for skin in used for joint in skins[skin]["joints"]}
    shown = {block.mesh for block in blocks}
    targets = sum(max(len(each.get("targets", [])) for each in meshes[mesh]["primitives"]) for mesh in shown)
    return Rig(len(joints), targets, len(document.root.get("animations", [])))


def rig_accessors(document: Document, blocks: Sequence[Block]) -> Iterator[int]:
    """Yield the accessors of their morph targets and inverse bind matrices."""
    nodes = document.root["nodes"]
    for block in blocks:
        for number in block.primitives:
            for target in document.root["meshes"][block.mesh]["primitives"][number].get("targets", []):
                yield from (target[name] for name in ("POSITION", "NORMAL", "TANGENT") if name in target)
        if "skin" in nodes[block.node]:
            skin = document.root["skins"][nodes[block.node]["skin"]]
            if "inverseBindMatrices" in skin:
                yield skin["inverseBindMatrices"]
