"""Find how the nodes of a file move with its surface: joints, nodes of meshes, and what hangs on the surface.

- A joint moves with the volume around it (`meshdeform.assets.rig`).
- The node of a deformed mesh without a skin goes where the surface of that mesh around it goes, so that a wheel still
  turns about its centre, and a door about its hinge.
- A group of meshes, or a bone without a skin, goes where its meshes go, so that it turns them as before.
- Any other node whose origin is within the surface, or within 2 % of its diagonal of it, goes where the surface around
  it goes: a light in its shade, a socket on a hand, a helper, a collider.
- What hangs on a node that moves, and does not move by itself, goes along.

What belongs to the scene stays: a mesh that is not deformed, a camera or a directional light at the top, and a node
that no animation acts on if it carries the whole surface or has the origin of the scene: there the asset stands, and
nothing turns about it. So does the node of a mesh that did not move everywhere, such as one that is kept: to move it
would round what is to keep its numbers.

The displacement of a node is that of an affine map which is fitted to those of the vertices around it, as for joints.
Of all vertices of an asset the near ones are to count: their weights fall with the fourth power of the distance.

Sources: glTF 2.0 specification, section 3.5; KHR_lights_punctual; Jacobson et al. 2013, Robust inside-outside
segmentation using generalized winding numbers, section 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.codes import GPU_INSTANCING
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, parents_of, upwards, world_matrices
from meshdeform.assets.rig import NodeMove, RigMotion, fitted_move, joint_moves
from meshdeform.assets.scene_checks import shown_nodes
from meshdeform.assets.surface import Block, Surface
from meshdeform.assets.unchecked import animated, channels_of, is_index, member_of, pointer_of

_NEAR = 0.02
"""Distance from the surface, as a share of its diagonal, up to which a node hangs on it."""
_MOVING = ("translation", "rotation", "scale")
_MOST = 256
"""Nodes that are compared with the surface; others go with their parents."""
_ROUNDING = 1e-7
"""Distance, as a share of the surface's diagonal, that counts as none."""


def node_moves(
    document: Document,
    surface: Surface,
    blocks: Sequence[Block],
    motion: RigMotion,
    joints: Mapping[int, NodeMove] | None = None,
) -> dict[int, NodeMove]:
    """Return how nodes move with the surface; nodes that are not named go with their parents.

    `joints`: how joints move; default: as `joint_moves` returns.
    """
    moves = dict(joint_moves(document, blocks, motion) if joints is None else joints)
    if not motion.moved.any():
        return moves
    everything = np.unique(surface.triangles)
    near = _Near(surface.positions[surface.triangles])
    hierarchy = _Hierarchy(document, blocks, set(moves), _ROUNDING * near.diagonal)

    def carry(node: int, rows: NDArray[np.int64], power: int = 1) -> None:
        if node not in moves:
            stays = hierarchy.is_of_scene(node) or hierarchy.holds_still(node, motion)
            origin = hierarchy.origin(node)
            moves[node] = _still(origin) if stays else fitted_move(origin, rows, np.ones(len(rows)), motion, power)

    for node, rows in hierarchy.own_rows.items():
        carry(node, rows)
    for node, rows in hierarchy.rows_below(directly=True).items():
        carry(node, rows)
    candidates = [node for node in hierarchy.others(moves) if near.may_hold(hierarchy.origin(node))]
    for node in candidates[:_MOST]:
        if near.holds(hierarchy.origin(node)):
            carry(node, everything, power=2)
    for node, rows in hierarchy.rows_below(directly=False).items():
        carry(node, rows)
    for node in hierarchy.meshes_that_stay(moves):
        moves[node] = _still(hierarchy.origin(node))
    least = _ROUNDING * near.diagonal
    return {
        node: move if np.abs(move.shift).max() > least else _still(move.origin, move.growth)
        for node, move in moves.items()
    }


def _still(origin: Floats, growth: float = 1.0) -> NodeMove:
    return NodeMove(origin, np.zeros(3), growth)


class _Hierarchy:
    """The nodes of a document, and what is known about each."""

    def __init__(self, document: Document, blocks: Sequence[Block], joints: set[int], rounding: float) -> None:
        self._joints, self._rounding = joints, rounding
        self._nodes: list[Json] = document.root.get("nodes", [])
        self._blocks = blocks
        self._worlds = world_matrices(self._nodes)
        self._parents = parents_of(self._nodes)
        self._shown = shown_nodes(document.root)
        self._animated = {
            node
            for channel, _, _ in channels_of(document.root)
            for array, node, prop in [animated(channel)]
            if array == "nodes" and (prop in _MOVING or not pointer_of(channel))
        }
        self._directional = _directional_lights(document.root)
        self._whole = set.intersection(*(set(self._above(block.node)) for block in blocks))

    def origin(self, node: int) -> Floats:
        """Return a node's origin (3,) in world space."""
        return self._worlds[node][:3, 3]

    @cached_property
    def own_rows(self) -> dict[int, NDArray[np.int64]]:
        """The rows of the surface that each node without a skin has, unless it is drawn many times."""
        rows: dict[int, list[NDArray[np.int64]]] = {}
        for block in self._blocks:
            node = self._nodes[block.node]
            if "skin" not in node and GPU_INSTANCING not in node.get("extensions", {}):
                rows.setdefault(block.node, []).append(np.arange(block.rows.start, block.rows.stop))
        return {node: np.concatenate(each) for node, each in rows.items()}

    def rows_below(self, *, directly: bool) -> dict[int, NDArray[np.int64]]:
        """Return the rows of the meshes without a skin below each group; `directly`: of its own children alone."""
        rows: dict[int, list[NDArray[np.int64]]] = {}
        for node, own in self.own_rows.items():
            groups = self._above(node)[1:2] if directly else self._above(node)[1:]
            for group in groups:
                if not self.is_of_scene(group) and "mesh" not in self._nodes[group]:
                    rows.setdefault(group, []).append(own)
        return {group: np.concatenate(each) for group, each in rows.items()}

    def is_of_scene(self, node: int) -> bool:
        """Whether a node has no origin of its own: that of the scene, or where somebody placed the whole asset."""
        if node in self._animated:
            return False
        return node in self._whole or bool(np.abs(self.origin(node)).max() <= self._rounding)

    def holds_still(self, node: int, motion: RigMotion) -> bool:
        """Whether some of a node's mesh is to stay exactly where it is, which a moved node would round."""
        own = self.own_rows.get(node)
        return own is not None and node not in self._animated and not motion.moved[own].any(axis=1).all()

    def _above(self, node: int) -> list[int]:
        """Return a node and those above it."""
        return list(upwards(node, self._parents))

    def others(self, moves: Mapping[int, NodeMove]) -> list[int]:
        """Return the shown nodes without a mesh that may hang on the surface."""
        return [
            node
            for node in self._shown
            if node not in moves and "mesh" not in self._nodes[node] and not self._goes_along(node)
        ]

    def _goes_along(self, node: int) -> bool:
        """Whether a node belongs to a skeleton, to the scene, or is a group of things that move by themselves."""
        described = self._nodes[node]
        if self._below_joint(node):
            return True
        if node not in self._parents and ("camera" in described or node in self._directional):
            return True
        return bool(described.get("children")) and self.is_of_scene(node)

    def _below_joint(self, node: int) -> bool:
        return not self._joints.isdisjoint(self._above(node))

    def meshes_that_stay(self, moves: Mapping[int, NodeMove]) -> list[int]:
        """Return the nodes whose meshes are not deformed, unless they belong to a skeleton."""
        return [
            number
            for number, node in enumerate(self._nodes)
            if "mesh" in node and "skin" not in node and number not in moves and not self._below_joint(number)
        ]


def _directional_lights(root: Json) -> set[int]:
    """Return the nodes of directional lights, which shine alike everywhere."""
    lights = member_of(root, "extensions", "KHR_lights_punctual").get("lights")
    if not isinstance(lights, list) or not all(isinstance(light, dict) for light in lights):
        return set()
    nodes = set()
    for number, node in enumerate(root.get("nodes", [])):
        light = member_of(node, "extensions", "KHR_lights_punctual").get("light")
        if is_index(light, len(lights)) and lights[light].get("type") == "directional":
            nodes.add(number)
    return nodes


class _Near:
    """Tells whether points are within a surface, given by its triangles (T, 3, 3), or near it."""

    def __init__(self, corners: Floats) -> None:
        self._corners = corners
        self._low, self._high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.diagonal = float(np.linalg.norm(self._high - self._low))
        self._reach = _NEAR * self.diagonal

    def may_hold(self, point: Floats) -> bool:
        """Whether a point (3,) is in the surface's bounding box, or near it."""
        return bool((point >= self._low - self._reach).all() and (point <= self._high + self._reach).all())

    def holds(self, point: Floats) -> bool:
        """Whether a point (3,) is within the surface, or near it."""
        if not self.may_hold(point):
            return False
        corners = self._corners - point
        reachable = (corners.min(axis=1) <= self._reach).all(1) & (corners.max(axis=1) >= -self._reach).all(1)
        if reachable.any() and float(_distances(corners[reachable]).min()) <= self._reach:
            return True
        return abs(_winding_number(corners)) > 0.5


def _distances(corners: Floats) -> Floats:
    """Return the distance (T,) of the origin from triangles (T, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    nearest = np.full(len(corners), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        length = np.maximum((along**2).sum(1), 1e-300)
        share = np.clip(-(start * along).sum(1) / length, 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(start + share[:, None] * along, axis=1))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    sides = [(np.cross(end - start, -start) * normal).sum(1) for start, end in ((a, b), (b, c), (c, a))]
    above = (np.min(sides, axis=0) >= 0.0) & (size > 0.0)
    height = np.abs((a * normal).sum(1)) / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.where(above, np.minimum(nearest, height), nearest))


def _winding_number(corners: Floats) -> float:
    """Return how often triangles (T, 3, 3) wind around the origin (van Oosterom and Strackee 1983, eq. 8)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(1)
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(volume, below).sum() / (2.0 * np.pi))
