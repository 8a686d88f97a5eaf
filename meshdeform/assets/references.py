"""Find what extensions name by a number that a new shape changes: accessors, meshes, and shapes that collide.

A mesh that stands on several nodes gets a copy for each (`assets/writer.py`). What named the one then names all:
pointers of animations, expressions and first-person rules of VRM 0, which name meshes and not nodes. A collider that
names a mesh gets that of its own node.

Sources: KHR_animation_pointer; VRM 0.x; EXT_mesh_manifold; KHR_physics_rigid_bodies, KHR_collision_shapes and
OMI_physics_shape, as proposed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from meshdeform.assets.container import Json, clone
from meshdeform.assets.unchecked import follow_pointers, member_of

__all__ = ["MANIFOLD", "Collider", "colliders", "drop_manifold", "follow_copies", "own_shape", "share_positions"]

MANIFOLD = "EXT_mesh_manifold"
_BODIES = (
    *("KHR_physics_rigid_bodies", "EXT_physics_rigid_bodies", "KHR_rigid_bodies", "MSFT_rigid_bodies"),
    "OMI_physics_body",
)
_SHAPES = (
    *("KHR_implicit_shapes", "EXT_implicit_shapes", "KHR_collision_shapes", "EXT_collision_shapes"),
    *("MSFT_collision_primitives", "OMI_physics_shape"),
)


@dataclass(frozen=True)
class Collider:
    """What collides at a node."""

    node: int
    name: str  # of the extension of the node
    role: str  # its member: `collider` or `trigger`
    geometry: Json  # what names a shape, a mesh or a node
    shapes: list[Json]  # those of the document that `geometry` may name

    @property
    def shape(self) -> Json | None:
        """The shape of the document that it has; None if it names something else."""
        number = _number(self.geometry, "shape")
        return self.shapes[number] if number is not None and number < len(self.shapes) else None

    @property
    def mesh_holder(self) -> Json:
        """What holds the number of its mesh as `mesh`, if it has one."""
        shape = self.shape
        if shape is None:
            return self.geometry
        kinds = (shape.get(kind) for kind in ("convex", "trimesh", "mesh"))
        return next((kind for kind in kinds if isinstance(kind, dict)), {})


def colliders(root: Json) -> Iterator[Collider]:
    """Yield what collides at the nodes of a document."""
    lists = {name: _items(member_of(root, "extensions", name), "shapes") for name in _SHAPES}
    for number, node in enumerate(_items(root, "nodes")):
        for name in _BODIES:
            body = member_of(node, "extensions", name)
            own = [lists[each] for each in _SHAPES if each[:3] == name[:3] and lists[each]]
            shapes = next(iter([*own, *filter(None, lists.values())]), [])
            for role in ("collider", "trigger"):
                holder = body.get(role)
                if isinstance(holder, dict):
                    geometry = holder.get("geometry")
                    yield Collider(number, name, role, geometry if isinstance(geometry, dict) else holder, shapes)


def own_shape(collider: Collider, shape: Json) -> None:
    """Give a collider a shape of its own, unless there is an equal one."""
    if shape not in collider.shapes:
        collider.shapes.append(shape)
    collider.geometry["shape"] = collider.shapes.index(shape)


def follow_copies(root: Json, owners: Mapping[tuple[int, int], int]) -> None:
    """Let everything that names a mesh name its copies too, in place.

    `owners`: the mesh that each node (first) now has in place of a mesh (second).
    """
    copies: dict[int, list[int]] = {}
    for (_, mesh), own in owners.items():
        if own != mesh:
            copies.setdefault(mesh, []).append(own)
    if not copies:
        return
    follow_pointers(root, "meshes", copies)
    avatar = member_of(root, "extensions", "VRM")
    groups = _items(member_of(avatar, "blendShapeMaster"), "blendShapeGroups")
    for holder, key in [*((group, "binds") for group in groups), (member_of(avatar, "firstPerson"), "meshAnnotations")]:
        named = holder.get(key)
        if isinstance(named, list):
            named += [{**clone(each), "mesh": mesh} for each in named for mesh in copies.get(_mesh(each), [])]
    for collider in list(colliders(root)):
        _follow(collider, owners)


def _follow(collider: Collider, owners: Mapping[tuple[int, int], int]) -> None:
    """Let a collider name the mesh that its node has in place of the one that it names."""
    mesh, shape = _mesh(collider.mesh_holder), collider.shape
    own = owners.get((collider.node, mesh), mesh)
    if own == mesh:
        return
    if shape is None:
        collider.geometry["mesh"] = own
        return
    copy = clone(shape)
    for kind in ("convex", "trimesh", "mesh"):
        if _mesh(copy.get(kind)) == mesh:
            copy[kind]["mesh"] = own
    own_shape(collider, copy)


def share_positions(root: Json, mesh: Json) -> None:
    """Give the solid of a mesh the positions of its primitives; without those that all share, it is removed."""
    solid = member_of(mesh, "extensions", MANIFOLD, "manifoldPrimitive").get("attributes")
    if not isinstance(solid, dict):
        return
    used = {member_of(primitive, "attributes").get("POSITION") for primitive in _items(mesh, "primitives")}
    if len(used) == 1:
        solid["POSITION"] = used.pop()
    else:
        drop_manifold(root, mesh)


def drop_manifold(root: Json, mesh: Json) -> bool:
    """Remove the solid of a mesh, whose vertices are others now; return whether it had one."""
    from meshdeform.assets.compressed import drop_extension

    if not member_of(mesh, "extensions", MANIFOLD):
        return False
    del mesh["extensions"][MANIFOLD]
    if not mesh["extensions"]:
        del mesh["extensions"]
    if not any(member_of(each, "extensions", MANIFOLD) for each in _items(root, "meshes")):
        drop_extension(root, MANIFOLD)
    return True


def _mesh(holder: Any) -> int:
    """Return the number of the mesh that an object names; -1 if it names none."""
    number = _number(holder, "mesh")
    return -1 if number is None else number


def _number(holder: Any, key: str) -> int | None:
    value = holder.get(key) if isinstance(holder, dict) else None
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None


def _items(parent: Json, key: str) -> list[Json]:
    items = parent.get(key)
    return items if isinstance(items, list) and all(isinstance(item, dict) for item in items) else []
