"""Move what stands for volumes around the nodes of a file: shapes that collide, and numbers of avatars.

A box, sphere, capsule or cylinder grows along the axes of its node as the volume around its middle does. Where that
middle goes elsewhere than its node, which stands for the whole asset for instance, the shape gets a node of its own
below. Offsets of an avatar's bones (its point of view, the colliders of its spring bones) go where an affine map takes
them that is fitted to the surface around them, and radii grow with the volume.

Sources: KHR_implicit_shapes and KHR_physics_rigid_bodies, as proposed; OMI_physics_shape; VRM 0.x, whose offsets have
the z axis of Unity; VRMC_vrm and VRMC_springBone 1.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from meshdeform.assets.container import Json, clone
from meshdeform.assets.placement import Floats, Matrix, is_invertible
from meshdeform.assets.references import Collider, colliders, own_shape
from meshdeform.assets.rig import NodeMove, RigMotion, fitted_move
from meshdeform.assets.unchecked import is_index, member_of, objects_in

__all__ = ["Volumes"]

_MOST = 256
"""How many points are compared with the surface; others stay."""
_ROUND = ("radius", "radiusTop", "radiusBottom")
_UNITY = np.array([1.0, 1.0, -1.0])
"""Signs of the axes of Unity in those of glTF."""


@dataclass
class Volumes:
    """The volumes of a document, and how the space around them moves.

    `worlds`: matrices (4, 4) of its nodes before they move; `shifts`: how far each moves (3,), in world space.
    """

    root: Json
    worlds: Sequence[Matrix]
    shifts: Sequence[Floats]
    motion: RigMotion
    rows: Any  # of the surface
    _known: dict[bytes, NodeMove] = field(default_factory=dict)

    def follow(self) -> None:
        """Move all of them, in place."""
        for collider in list(colliders(self.root)):
            if collider.node < len(self.worlds) and collider.shape is not None:
                self._follow_shape(collider)
        self._avatar_of_zero(member_of(self.root, "extensions", "VRM"))
        self._avatar(member_of(self.root, "extensions", "VRMC_vrm"))
        self._springs(member_of(self.root, "extensions", "VRMC_springBone"))

    def _move(self, point: Floats) -> NodeMove:
        key = point.tobytes()
        if key not in self._known:
            still = NodeMove(point, np.zeros(3), 1.0)
            full = len(self._known) >= _MOST
            weights = np.ones(len(self.rows))
            self._known[key] = still if full else fitted_move(point, self.rows, weights, self.motion, power=2)
        return self._known[key]

    def _follow_shape(self, collider: Collider) -> None:
        """Let an implicit shape grow, and go where its middle goes."""
        world = self.worlds[collider.node]
        if not is_invertible(world):
            return
        move, shape = self._move(world[:3, 3]), clone(collider.shape)
        axes = world[:3, :3] / np.linalg.norm(world[:3, :3], axis=0)
        _grow(shape, np.linalg.norm(move.linear @ axes, axis=0))
        own_shape(collider, shape)
        beside = move.shift - self.shifts[collider.node]
        if np.abs(beside).max() > 1e-6 * float(np.ptp(self.motion.positions, axis=0).max()):
            self._apart(collider, np.asarray(np.linalg.solve(world[:3, :3], beside)))

    def _apart(self, collider: Collider, translation: Floats) -> None:
        """Give what collides at a node a node of its own below it."""
        nodes = self.root["nodes"]
        node, body = nodes[collider.node], nodes[collider.node]["extensions"][collider.name]
        moved = {collider.role: body.pop(collider.role)}
        if not body:
            del node["extensions"][collider.name]
        name = f"{node.get('name', 'node')}_{collider.role}"
        described = {"name": name, "translation": translation.tolist(), "extensions": {collider.name: moved}}
        nodes.append(described)
        node.setdefault("children", []).append(len(nodes) - 1)

    def _offset(self, node: Any, holder: Json, key: str, *, of_unity: bool = False) -> None:
        """Move an offset from a node, and let the radius beside it grow."""
        offset = (_of_unity if of_unity else _of_list)(holder.get(key))
        if not is_index(node, len(self.worlds)) or offset is None:
            return
        world = self.worlds[node]
        if not is_invertible(world):
            return
        move = self._move(world[:3, :3] @ offset + world[:3, 3])
        changed = move.shift - self.shifts[node]
        if np.abs(changed).max() > 0.0:
            new = offset + np.linalg.solve(world[:3, :3], changed)
            holder[key] = dict(zip("xyz", (new * _UNITY).tolist(), strict=True)) if of_unity else new.tolist()
        if _is_number(holder.get("radius")) and key == "offset":
            holder["radius"] = holder["radius"] * move.growth

    def _radius(self, nodes: Any, holder: Json) -> None:
        """Let the radius of a spring's joints grow as the volume around the first one does."""
        node = next((each for each in nodes if is_index(each, len(self.worlds))), None)
        if node is not None and _is_number(holder.get("hitRadius")):
            holder["hitRadius"] = holder["hitRadius"] * self._move(self.worlds[node][:3, 3]).growth

    def _avatar_of_zero(self, body: Json) -> None:
        first = member_of(body, "firstPerson")
        bone = first.get("firstPersonBone")
        bones = objects_in(member_of(body, "humanoid").get("humanBones"))
        head = next((each.get("node") for each in bones if each.get("bone") == "head"), None)
        known = isinstance(bone, int) and bone >= 0
        self._offset(bone if known else head, first, "firstPersonBoneOffset", of_unity=True)
        springs = member_of(body, "secondaryAnimation")
        for group in objects_in(springs.get("colliderGroups")):
            for collider in objects_in(group.get("colliders")):
                self._offset(group.get("node"), collider, "offset", of_unity=True)
        for group in objects_in(springs.get("boneGroups")):
            self._radius(group["bones"] if isinstance(group.get("bones"), list) else [], group)

    def _avatar(self, body: Json) -> None:
        head = member_of(body, "humanoid", "humanBones", "head").get("node")
        self._offset(head, member_of(body, "lookAt"), "offsetFromHeadBone")

    def _springs(self, body: Json) -> None:
        for collider in objects_in(body.get("colliders")):
            for holder in _shapes(collider):
                self._offset(collider.get("node"), holder, "tail")
                self._offset(collider.get("node"), holder, "offset")
        for spring in objects_in(body.get("springs")):
            for joint in objects_in(spring.get("joints")):
                self._radius([joint.get("node")], joint)


def _grow(shape: Json, stretch: Floats) -> None:
    """Stretch an implicit shape along the axes of its node, in place; round sections keep their area's growth."""
    for kind, body in shape.items():
        if not isinstance(body, dict):
            continue
        if isinstance(body.get("size"), list) and len(body["size"]) == 3 and all(map(_is_number, body["size"])):
            body["size"] = [float(side * by) for side, by in zip(body["size"], stretch, strict=True)]
        if _is_number(body.get("height")):
            body["height"] = float(body["height"] * stretch[1])
        across = np.cbrt(stretch.prod()) if kind == "sphere" else np.sqrt(stretch[0] * stretch[2])
        for name in _ROUND:
            if _is_number(body.get(name)):
                body[name] = float(body[name] * across)


def _shapes(collider: Mapping[str, Any]) -> Iterator[Json]:
    """Yield the shapes of a collider of VRMC_springBone, those of its extension included."""
    extended = member_of(collider, "extensions", "VRMC_springBone_extended_collider")
    for shape in (member_of(collider, "shape"), member_of(extended, "shape")):
        yield from (each for each in shape.values() if isinstance(each, dict))


def _of_list(value: Any) -> Floats | None:
    good = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    return np.array(value, np.float64) if good else None


def _of_unity(value: Any) -> Floats | None:
    numbers = [value.get(axis, 0.0) for axis in "xyz"] if isinstance(value, dict) else []
    return np.array(numbers, np.float64) * _UNITY if numbers and all(map(_is_number, numbers)) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e30
