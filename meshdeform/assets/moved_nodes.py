"""Write where nodes have moved into a document: joints, and what hangs on the surface.

Nodes keep their axes; only positions change: of the nodes, of the bind poses of joints, and of animated translations,
whose distance from the node's origin grows as the volume around it does. In the pose of the nodes, a skin therefore
leaves every vertex where it is. What hangs on a node that moved, and is not moved itself, goes along.

Source: glTF 2.0 specification, sections 3.7.3 (Skins) and 3.11 (Animations); KHR_animation_pointer.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, Matrix, inverse_binds, is_invertible, parents_of, world_matrices
from meshdeform.assets.rig import NodeMove
from meshdeform.assets.unchecked import animated, is_index, objects_in


def world_shifts(nodes: Sequence[Json], moves: Mapping[int, NodeMove]) -> list[Floats]:
    """Return how far each node moves in world space, (3,) float64 each: one without a move goes with its parent."""
    parents = parents_of(nodes)
    shifts: dict[int, Floats] = {number: move.shift for number, move in moves.items()}
    for start in range(len(nodes)):
        path = [start]
        while path[-1] not in shifts and path[-1] in parents:
            path.append(parents[path[-1]])
        shift = shifts.get(path[-1], np.zeros(3))
        shifts.update(dict.fromkeys(path, shift))
    return [shifts[number] for number in range(len(nodes))]


def move_nodes(
    document: Document, moves: Mapping[int, NodeMove], skins: Collection[int] = (), scale: float | None = None
) -> list[tuple[int, int]]:
    """Move nodes, and return each replaced accessor with its new one.

    `document`: changed in place: nodes, inverse bind matrices, and animations of translations; `moves`: by node;
    `skins`: those of the deformed meshes, which are scaled as they were bound if there is a `scale`.
    """
    nodes = document.root.get("nodes", [])
    shifts = world_shifts(nodes, moves)
    if not any(shift.any() for shift in shifts) and all(move.growth == 1.0 for move in moves.values()):
        return []
    worlds = world_matrices(nodes)
    replaced = []
    for number, skin in enumerate(document.root.get("skins", [])):
        replaced += _rebind(document, skin, worlds, shifts, scale if number in skins else None)
    offsets = _place_nodes(nodes, worlds, shifts, moves)
    return replaced + _move_animations(document, offsets)


def _rebind(
    document: Document, skin: Json, worlds: Sequence[Matrix], shifts: Sequence[Floats], scale: float | None
) -> list[tuple[int, int]]:
    """Give a skin inverse bind matrices for the moved joints, so that they leave vertices where they are."""
    if not any(shifts[joint].any() for joint in skin["joints"]):
        return []
    matrices = inverse_binds(document, skin)
    for matrix, joint in zip(matrices, skin["joints"], strict=True):
        over = worlds[joint][:3, :3] @ matrix[:3, :3]
        if scale is not None:
            matrix[:3, 3] *= scale
        elif shifts[joint].any() and is_invertible(over):
            matrix[:3, 3] -= matrix[:3, :3] @ np.linalg.solve(over, shifts[joint])
    old = skin.get("inverseBindMatrices")
    values = matrices.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    like = None if old is None else document.root["accessors"][old]
    skin["inverseBindMatrices"] = document.append_accessor(values, like=like, vertex=False)
    return [] if old is None else [(old, skin["inverseBindMatrices"])]


@dataclass(frozen=True)
class _Offset:
    """A node's translation before and after, and the growth of its distance from it."""

    before: Floats
    after: Floats
    growth: float

    def applied(self, translations: Floats) -> Floats:
        return np.asarray(self.after + self.growth * (translations - self.before))


def _place_nodes(
    nodes: list[Json], worlds: Sequence[Matrix], shifts: Sequence[Floats], moves: Mapping[int, NodeMove]
) -> dict[int, _Offset]:
    """Move nodes, and return how their translations changed."""
    parents = parents_of(nodes)
    offsets: dict[int, _Offset] = {}
    for number, node in enumerate(nodes):
        parent = parents.get(number)
        change = shifts[number] - (0.0 if parent is None else shifts[parent])
        growth = moves[number].growth if number in moves else 1.0
        over = np.eye(4) if parent is None else worlds[parent]
        if (not change.any() and growth == 1.0) or not is_invertible(over):
            continue
        before = np.asarray(node["matrix"][12:15] if "matrix" in node else node.get("translation", [0.0] * 3), float)
        offsets[number] = _Offset(before, before + np.linalg.solve(over[:3, :3], change), growth)
        _translate(node, offsets[number].after)
    return offsets


def _translate(node: Json, translation: Floats) -> None:
    values = [float(value) for value in translation]
    if "matrix" in node:
        node["matrix"] = [*node["matrix"][:12], *values, *node["matrix"][15:]]
    elif "translation" in node or any(values):
        node["translation"] = values


def _move_animations(document: Document, offsets: Mapping[int, _Offset]) -> list[tuple[int, int]]:
    """Replace the animated translations of moved nodes."""
    replaced = []
    for animation in objects_in(document.root.get("animations")):
        samplers, channels = animation.get("samplers"), animation.get("channels")
        if not isinstance(samplers, list) or not isinstance(channels, list):
            continue
        users = [channel.get("sampler") for channel in objects_in(channels)]
        for channel in objects_in(channels):
            (array, node, prop), sampler = animated(channel), channel.get("sampler")
            if (array, prop) != ("nodes", "translation") or node not in offsets:
                continue
            if not is_index(sampler, len(samplers)) or not isinstance(samplers[sampler], dict):
                continue
            output = _moved_output(document, samplers[sampler], offsets[node])
            if output is None:
                continue
            replaced.append((samplers[sampler]["output"], output))
            if users.count(sampler) == 1:
                samplers[sampler]["output"] = output
            else:
                samplers.append({**samplers[sampler], "output": output})
                channel["sampler"] = len(samplers) - 1
    return replaced


def _moved_output(document: Document, sampler: Json, offset: _Offset) -> int | None:
    output, accessors = sampler.get("output"), document.root.get("accessors", [])
    if not isinstance(output, int) or not is_index(output, len(accessors)) or accessors[output]["type"] != "VEC3":
        return None
    values = read_floats(document, output).astype(np.float64)
    moved = offset.applied(values)
    if sampler.get("interpolation") == "CUBICSPLINE":  # in-tangent, value, out-tangent of each key
        moved[0::3], moved[2::3] = offset.growth * values[0::3], offset.growth * values[2::3]
    return document.append_accessor(moved.astype(np.float32), like=accessors[output], vertex=False)
