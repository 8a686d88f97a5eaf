"""Deform what stands for the surface outside its scene: levels of detail, and meshes that only collide.

They are read as the surface is, and every vertex moves by the map of the deformation around the nearest vertices of
the surface (`geometry.interpolation.mapped`), so that each level keeps its own triangles, skin and morph targets.

Sources: MSFT_lod; KHR_physics_rigid_bodies and KHR_collision_shapes, as proposed; OMI_physics_shape.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, parents_of, unit_rows
from meshdeform.assets.references import colliders
from meshdeform.assets.scene_checks import Instance, nodes_below, shown_nodes
from meshdeform.assets.surface import Block, Surface, read_surface, transformed_normals
from meshdeform.assets.unchecked import is_index, member_of
from meshdeform.errors import AssetError

_MOST = 8
"""Vertices of companions for each one of the surface, up to which they are read."""
_FEW = 100_000

__all__ = ["Companions", "read_companions"]


@dataclass(frozen=True)
class Companions:
    """Meshes that stand for the surface outside its scene."""

    surface: Surface
    blocks: list[Block]
    loose: list[Block]
    nodes: list[Json]  # those of the document, with each level where it is shown

    def deformed(self, source: Surface, positions: Floats, jacobians: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return new positions, normals and tangents, and the map (N, 3, 3) around each vertex.

        `positions` (V, 3) and `jacobians` (V, 3, 3): of the source's vertices, new, and the map around them.
        """
        from meshdeform.geometry.interpolation import mapped

        used, old = np.unique(source.triangles), self.surface
        moved = positions - source.positions
        shift, maps = mapped(source.positions[used], moved[used], jacobians[used], old.positions)
        changed = (maps != np.eye(3)).any((1, 2))[:, None]
        normals = np.where(changed, transformed_normals(maps, old.normals), old.normals)
        turned = unit_rows(np.einsum("vij,vj->vi", maps, old.tangents[:, :3]))
        tangents = np.column_stack([np.where(changed, turned, old.tangents[:, :3]), old.tangents[:, 3]])
        return old.positions + shift, normals, tangents, maps


def read_companions(
    document: Document, surface: Surface, excluded: Collection[int]
) -> tuple[Companions | None, tuple[str, ...]]:
    """Return the meshes that stand for a surface outside its scene, and a sentence about those that cannot be read."""
    shown = set(shown_nodes(document.root))
    copy = document.fork()
    instances = dict.fromkeys([*_levels(copy.root, shown, excluded), *_collisions(document.root, shown, excluded)])
    if not instances:
        return None, ()
    try:
        _check_size(document.root, instances, _MOST * len(surface.positions) + _FEW)
        return Companions(*read_surface(copy, instances=list(instances)), copy.root["nodes"]), ()
    except AssetError as error:
        return None, (f"Levels of detail and colliders stay as they are: {error.detail.rstrip('.')}.",)


def _levels(root: Json, shown: set[int], excluded: Collection[int]) -> Iterator[Instance]:
    """Yield the meshes of the levels of shown nodes; a level without a parent is given that of its node."""
    nodes = root.get("nodes", [])
    parents = parents_of(nodes)
    for at in sorted(shown - set(excluded)):
        levels = member_of(nodes[at], "extensions", "MSFT_lod").get("ids")
        for level in levels if isinstance(levels, list) else []:
            if not is_index(level, len(nodes)) or level in shown or level in excluded:
                continue
            if level not in parents and at in parents:
                nodes[parents[at]]["children"].append(level)
                parents[level] = parents[at]
            for below in nodes_below(root, [level]):
                if "mesh" in nodes[below] and below not in shown:
                    yield Instance(below, nodes[below]["mesh"], nodes[below].get("skin"))


def _collisions(root: Json, shown: set[int], excluded: Collection[int]) -> Iterator[Instance]:
    """Yield the meshes that collide at shown nodes and that the scene does not show there."""
    nodes, meshes = root.get("nodes", []), len(root.get("meshes", []))
    for collider in colliders(root):
        if collider.node not in shown or collider.node in excluded:
            continue
        mesh, other = collider.mesh_holder.get("mesh"), collider.geometry.get("node")
        if is_index(mesh, meshes) and nodes[collider.node].get("mesh") != mesh:
            yield Instance(collider.node, mesh, None)
        if is_index(other, len(nodes)) and other not in shown and "mesh" in nodes[other]:
            yield Instance(other, nodes[other]["mesh"], nodes[other].get("skin"))


def _check_size(root: Json, instances: Collection[Instance], most: int) -> None:
    """Refuse instances with too many vertices."""
    numbers = [
        primitive["attributes"]["POSITION"]
        for instance in instances
        for primitive in root["meshes"][instance.mesh].get("primitives", [])
        if "POSITION" in primitive.get("attributes", {})
    ]
    if sum(root["accessors"][number]["count"] for number in numbers) > most:
        raise AssetError("they have many more vertices than what is shown")


def rough_jacobians(surface: Surface, positions: Floats) -> NDArray[np.float64]:
    """Return the linear map (N, 3, 3) around each vertex of a surface: the mean of those of its faces, by their area.

    An affine map is fitted to all vertices first, so that one of the whole is found exactly. What is left of the map of
    a face takes its edges to the new ones, and its unit normal to the new one times the root of the growth of its area.
    """
    used = np.unique(surface.triangles)
    arms, pulls = (each[used] - each[used].mean(0) for each in (surface.positions, positions - surface.positions))
    stiff = 1e-9 * np.trace(arms.T @ arms) * np.eye(3)
    whole = np.eye(3) + np.linalg.solve(arms.T @ arms + stiff, arms.T @ pulls).T
    rest, moved = (surface.positions @ whole.T)[surface.triangles], positions[surface.triangles]
    before, after = _frames(rest), _frames(moved)
    area = np.linalg.norm(np.cross(before[:, :, 0], before[:, :, 1]), axis=1)
    flat = ~(np.linalg.det(before) > 1e-12 * np.abs(before[:, :, :2]).max((1, 2), initial=0.0) ** 2)
    before[flat] = after[flat] = np.eye(3)
    maps = after @ np.linalg.inv(before) - np.eye(3)
    corners, count = surface.triangles.ravel(), len(surface.positions)
    weighted = np.repeat((area[:, None, None] * maps).reshape(-1, 9), 3, axis=0)
    total = np.stack([np.bincount(corners, weighted[:, k], count) for k in range(9)], 1).reshape(-1, 3, 3)
    weight = np.bincount(corners, np.repeat(area, 3), count)
    return np.asarray((np.eye(3) + total / np.maximum(weight, 1e-300)[:, None, None]) @ whole)


def _frames(corners: Floats) -> Floats:
    """Return two edges and the normal of triangles (T, 3, 3), with the root of its area as length, as columns."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(one, two)
    length = np.maximum(np.sqrt(np.linalg.norm(cross, axis=1, keepdims=True)), 1e-300)
    return np.stack([one, two, cross / length], axis=2)
