"""Move the joints of skins with the volume around them, so that a character still animates after its shape has changed.

A joint's displacement is that of an affine map, fitted by weighted least squares to the displacements d_v of the
vertices that follow it, at its place p::

    w_v = (weight of the joint at v) / (|x_v - p|^2 + e^2)
    D   = (K + l H) (C + l I)^-1        C, K the weighted covariances of x with x and of d with x, H the mean of J_v - I
    p'  = p + mean(d) + D (p - mean(x))

so that every affine deformation, a scaling for instance, moves joints exactly, and near joints count near vertices. A
joint that no vertex follows, such as the end of a finger, is moved by all vertices of its skins.

Joints keep their axes; only places change: of the nodes, of the bind poses, and of animated translations, whose
distance from the bind pose grows as the volume around the joint does. In the bind pose, the skin therefore leaves every
vertex where it is. A motion of the pose that viewers show takes that pose for the bind pose: there it is exact.

Sources: glTF 2.0 specification, section 3.7.3 (Skins); Schaefer et al. 2006, Image deformation using moving least
squares, section 2.1 (affine deformations).

Viewers show skins in the pose of the file's nodes, not in their bind pose. A vertex p of a skinned mesh, with weights
w_j of joints whose world matrices are W_j and inverse bind matrices B_j, is shown at ``sum_j w_j W_j B_j p``; the
node's own transform does not count (glTF 2.0 specification, section 3.7.3.3).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json
from meshdeform.assets.document import Document, read_accessor, read_floats, read_triangles
from meshdeform.assets.surface import (
    Block,
    Matrix,
    Surface,
    bind_placement,
    is_invertible,
    local_matrix,
    unit_rows,
    world_matrices,
)
from meshdeform.errors import AssetError

_NEAR = 0.1
"""Distance within which vertices count alike, as a share of the spread of those that follow a joint."""
_STIFFNESS = 0.1
"""How much the mean of the Jacobians counts in the fit, relative to the spread of the vertices."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RigMotion:
    """How the surface moves, in world space; rows as in `Surface`."""

    # (N, 3) float64: places at rest, and displacements
    positions: _Floats
    moved: _Floats
    jacobians: _Floats  # (N, 3, 3) float64: the linear map of the deformation around each vertex
    posed: bool = False
    """Whether these are places in the pose of the nodes, which viewers show, and not in the bind pose."""


@dataclass(frozen=True)
class JointMove:
    """A joint's place (3,) in the bind pose and its displacement (3,), in world space.

    `growth` is that of the volume around it along one axis.
    """

    place: _Floats
    shift: _Floats
    growth: float


def joint_moves(document: Document, blocks: Sequence[Block], motion: RigMotion) -> dict[int, JointMove]:
    """Return how the joints of all skins of the deformed meshes move with the surface, by their nodes."""
    worlds = world_matrices(document.root.get("nodes", []))
    used, bind_of = _used_binds(document, blocks, worlds, posed=motion.posed)
    return _joint_moves(document, blocks, motion, {joint: bind_of[joint] for joint in used}) if used else {}


def move_joints(
    document: Document, blocks: Sequence[Block], moves: Mapping[int, JointMove], *, posed: bool = False
) -> list[tuple[int, int]]:
    """Move joints of the deformed meshes' skins, and return each replaced accessor with its new one.

    `document`: changed in place: nodes, inverse bind matrices, and animations of translations; `moves`: by the joints'
    nodes; `posed`: whether they are moves in the pose of the nodes, and not in the bind pose.
    """
    moves = {joint: move for joint, move in moves.items() if move.shift.any() or move.growth != 1.0}
    if not moves:
        return []
    nodes = document.root["nodes"]
    worlds = world_matrices(nodes)
    _, bind_of = _used_binds(document, blocks, worlds, posed=posed)
    replaced = []
    for skin in document.root["skins"]:
        replaced += _rebind(document, skin, worlds, moves, posed=posed)
    offsets = _place_nodes(nodes, worlds, bind_of, moves)
    return replaced + _move_animations(document, nodes, offsets)


def _used_binds(
    document: Document, blocks: Sequence[Block], worlds: Sequence[Matrix], *, posed: bool
) -> tuple[list[int], dict[int, Matrix]]:
    """Return the joints of the blocks' skins, and the world matrix of each joint of the file in the bind pose."""
    # With `posed`, the pose of the nodes counts as the bind pose.
    nodes, skins = document.root.get("nodes", []), document.root.get("skins", [])
    used = {nodes[block.node]["skin"] for block in blocks if "skin" in nodes[block.node]}
    binds = {
        number: {joint: worlds[joint] for joint in skin["joints"]} if posed else _bind_worlds(document, skin, worlds)
        for number, skin in enumerate(skins)
    }
    bind_of = {joint: world for number in [*(set(binds) - used), *used] for joint, world in binds[number].items()}
    return [joint for number in used for joint in binds[number]], bind_of


def _bind_worlds(document: Document, skin: Json, worlds: Sequence[Matrix]) -> dict[int, Matrix]:
    """Return the world matrix of each joint in the bind pose; joints that cannot be inverted are left out."""
    placement = bind_placement(document, skin, worlds)
    inverse = _inverse_binds(document, skin)
    return {
        joint: placement @ np.linalg.inv(matrix)
        for joint, matrix in zip(skin["joints"], inverse, strict=True)
        if is_invertible(matrix)
    }


def _inverse_binds(document: Document, skin: Json) -> _Floats:
    count = len(skin["joints"])
    if "inverseBindMatrices" not in skin:
        return np.tile(np.eye(4), (count, 1, 1))
    rows = read_floats(document, skin["inverseBindMatrices"])[:count].astype(np.float64)
    return np.asarray(rows.reshape(-1, 4, 4).transpose(0, 2, 1))


def _joint_moves(
    document: Document, blocks: Sequence[Block], motion: RigMotion, joints: Mapping[int, Matrix]
) -> dict[int, JointMove]:
    everything: dict[int, list[NDArray[np.int64]]] = {}
    nodes, skins = document.root["nodes"], document.root["skins"]
    for block in blocks:
        if "skin" in nodes[block.node]:
            for joint in skins[nodes[block.node]["skin"]]["joints"]:
                everything.setdefault(joint, []).append(np.arange(block.rows.start, block.rows.stop))
    at, owners, share = joint_shares(document, blocks, rigid=motion.posed)
    order = np.argsort(owners, kind="stable")
    owners, at, share = owners[order], at[order], share[order]
    moves = {}
    for joint, bind in joints.items():
        first, last = np.searchsorted(owners, [joint, joint + 1])
        own, by = at[first:last], share[first:last]
        if not by.sum() > 0:
            own = np.concatenate(everything.get(joint, [np.empty(0, np.int64)]))
            by = np.ones(len(own))
        if len(own):
            moves[joint] = _carried(bind[:3, 3], own, by, motion)
    return moves


def _carried(point: _Floats, rows: NDArray[np.int64], weights: _Floats, motion: RigMotion) -> JointMove:
    """Return how an affine map fitted to weighted vertices moves a point."""
    if not motion.moved[rows].any():
        return JointMove(point, np.zeros(3), 1.0)
    positions, moved = motion.positions[rows], motion.moved[rows]
    spread = float(((positions - np.average(positions, axis=0, weights=weights)) ** 2).sum(1).mean())
    weights = weights / (((positions - point) ** 2).sum(1) + _NEAR**2 * spread + 1e-300)
    weights = weights / weights.sum()
    middle, shift = weights @ positions, weights @ moved
    arms, pulls = positions - middle, moved - shift
    slope = np.einsum("v,vij->ij", weights, motion.jacobians[rows]) - np.eye(3)
    spread_matrix, pull_matrix = (weights[:, None] * arms).T @ arms, (weights[:, None] * pulls).T @ arms
    stiff = _STIFFNESS * float(np.trace(spread_matrix)) / 3
    if stiff > 0:
        slope = np.linalg.solve(spread_matrix + stiff * np.eye(3), (pull_matrix + stiff * slope).T).T
    growth = float(np.cbrt(max(np.linalg.det(np.eye(3) + slope), 0.0)))
    return JointMove(point, shift + slope @ (point - middle), growth)


def _rebind(
    document: Document, skin: Json, worlds: Sequence[Matrix], moves: Mapping[int, JointMove], *, posed: bool
) -> list[tuple[int, int]]:
    """Give a skin inverse bind matrices for the moved joints, so that they leave vertices where they are."""
    if not any(joint in moves for joint in skin["joints"]):
        return []
    linear = bind_placement(document, skin, worlds)[:3, :3]
    matrices = _inverse_binds(document, skin)
    for matrix, joint in zip(matrices, skin["joints"], strict=True):
        if joint in moves:
            over = worlds[joint][:3, :3] @ matrix[:3, :3] if posed else linear
            if is_invertible(over):
                matrix[:3, 3] -= matrix[:3, :3] @ np.linalg.solve(over, moves[joint].shift)
    old = skin.get("inverseBindMatrices")
    values = matrices.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    like = None if old is None else document.root["accessors"][old]
    skin["inverseBindMatrices"] = document.append_accessor(values, like=like, vertex=False)
    return [] if old is None else [(old, skin["inverseBindMatrices"])]


@dataclass(frozen=True)
class _Offset:
    """A node's translation in the bind pose before and after, and the growth of its distance from it."""

    before: _Floats
    after: _Floats
    growth: float

    def applied(self, translations: _Floats) -> _Floats:
        return np.asarray(self.after + self.growth * (translations - self.before))


def _place_nodes(
    nodes: list[Json], worlds: Sequence[Matrix], binds: Mapping[int, Matrix], moves: Mapping[int, JointMove]
) -> dict[int, _Offset]:
    """Move the joints' nodes, hold what is attached to them, and return how the translations of nodes changed."""
    skeleton = _Skeleton(nodes, worlds, binds, moves)
    offsets: dict[int, _Offset] = {}
    for number, node in enumerate(nodes):
        parent = skeleton.parents.get(number)
        against = np.zeros(3) if parent is None else skeleton.shift_of(parent)
        change = skeleton.shift_of(number) - against
        growth = moves[number].growth if number in moves else 1.0
        if not change.any() and growth == 1.0:
            continue
        own, over = skeleton.bind_of(number), np.eye(4) if parent is None else skeleton.bind_of(parent)
        if not is_invertible(over):
            continue
        before = np.asarray(np.linalg.solve(over[:3, :3], own[:3, 3] - over[:3, 3]), np.float64)
        offsets[number] = _Offset(before, before + np.linalg.solve(over[:3, :3], change), growth)
        _translate(node, offsets[number])
    return offsets


class _Skeleton:
    """The nodes in the bind pose, and how far each of them moves."""

    def __init__(
        self,
        nodes: list[Json],
        worlds: Sequence[Matrix],
        binds: Mapping[int, Matrix],
        moves: Mapping[int, JointMove],
    ) -> None:
        self._nodes, self._worlds, self._binds, self._moves = nodes, worlds, binds, moves
        self.parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", [])}

    def shift_of(self, number: int) -> _Floats:
        """Return how far a node moves in world space: other nodes than joints move with the joint above them.

        A mesh below a joint was deformed where it is, so that its node stays.
        """
        for at in self._path(number):
            if at in self._binds:
                return self._moves[at].shift if at in self._moves else np.zeros(3)
            if _draws(self._nodes, at, self._binds):
                break
        return np.zeros(3)

    def bind_of(self, number: int) -> Matrix:
        """Return the world matrix of a node in the bind pose."""
        below = np.eye(4)
        for at in self._path(number):
            if at in self._binds:
                return np.asarray(self._binds[at] @ below)
            below = local_matrix(self._nodes[at]) @ below
        return self._worlds[number]

    def _path(self, number: int) -> Iterator[int]:
        at: int | None = number
        while at is not None:
            yield at
            at = self.parents.get(at)


def _draws(nodes: list[Json], number: int, joints: Mapping[int, Matrix]) -> bool:
    """Return whether a node or one below it that is no joint shows a mesh of its own."""
    node = nodes[number]
    if "mesh" in node and "skin" not in node:
        return True
    return any(child not in joints and _draws(nodes, child, joints) for child in node.get("children", []))


def _translate(node: Json, offset: _Offset) -> None:
    if "matrix" in node:
        moved = offset.applied(np.array(node["matrix"][12:15], np.float64))
        node["matrix"] = [*node["matrix"][:12], *(float(value) for value in moved), *node["matrix"][15:]]
        return
    moved = offset.applied(np.array(node.get("translation", [0.0, 0.0, 0.0]), np.float64))
    node["translation"] = [float(value) for value in moved]


def _move_animations(document: Document, nodes: list[Json], offsets: Mapping[int, _Offset]) -> list[tuple[int, int]]:
    """Replace the animated translations of moved nodes."""
    replaced = []
    for animation in document.root.get("animations", []):
        samplers, channels = animation.get("samplers"), animation.get("channels")
        if not isinstance(samplers, list) or not isinstance(channels, list):
            continue
        users = [channel.get("sampler") for channel in channels if isinstance(channel, dict)]
        for channel in channels:
            node, sampler = _translation_of(channel, len(nodes), samplers)
            if node is None or node not in offsets:
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


def _translation_of(channel: Any, count: int, samplers: list[Any]) -> tuple[int | None, int]:
    """Return the node whose translation a channel animates, if it does, and its sampler."""
    target = channel.get("target") if isinstance(channel, dict) else None
    sampler = channel.get("sampler") if isinstance(channel, dict) else None
    if not isinstance(sampler, int) or not 0 <= sampler < len(samplers) or not isinstance(samplers[sampler], dict):
        return None, 0
    if not isinstance(target, dict) or target.get("path") != "translation":
        return None, 0
    node = target.get("node")
    return (node, sampler) if isinstance(node, int) and 0 <= node < count else (None, 0)


def _moved_output(document: Document, sampler: Json, offset: _Offset) -> int | None:
    output, accessors = sampler.get("output"), document.root.get("accessors", [])
    if not isinstance(output, int) or not 0 <= output < len(accessors) or accessors[output]["type"] != "VEC3":
        return None
    values = read_floats(document, output).astype(np.float64)
    moved = offset.applied(values)
    if sampler.get("interpolation") == "CUBICSPLINE":  # in-tangent, value, out-tangent of each key
        moved[0::3], moved[2::3] = offset.growth * values[0::3], offset.growth * values[2::3]
    return document.append_accessor(moved.astype(np.float32), like=accessors[output], vertex=False)


def posed_surface(document: Document, surface: Surface, blocks: Sequence[Block]) -> Surface:
    """Return the surface with the positions and normals of skinned vertices in the pose of the nodes."""
    positions, normals = surface.positions.copy(), surface.normals.copy()
    for block, maps in _skinned(document, blocks):
        at = positions[block.rows]
        positions[block.rows] = np.einsum("nij,nj->ni", maps[:, :3, :3], at) + maps[:, :3, 3]
        normals[block.rows] = unit_rows(np.einsum("nij,nj->ni", _cofactors(maps), normals[block.rows]))
    return dataclasses.replace(surface, positions=positions, normals=normals)


def pose_maps(document: Document, surface: Surface, blocks: Sequence[Block]) -> _Floats:
    """Return the affine map (N, 3, 4) of each vertex from the bind pose in world space to the pose of the nodes."""
    maps = np.tile(np.eye(3, 4), (len(surface.positions), 1, 1))
    for block, of_block in _skinned(document, blocks):
        maps[block.rows] = of_block[:, :3]
    return maps


def _skinned(document: Document, blocks: Sequence[Block]) -> Iterator[tuple[Block, _Floats]]:
    """Yield the blocks with a skin, and the matrices (N, 4, 4) of their vertices."""
    worlds = np.stack(world_matrices(document.root.get("nodes", [])))
    for block in blocks:
        skin = document.root["nodes"][block.node].get("skin")
        if skin is not None:
            # From the bind pose in world space, where the surface is, by way of the mesh's own space.
            moves = _joint_matrices(document, skin, worlds) @ np.linalg.inv(block.placement)
            yield block, _blended(document, block, moves)


def _joint_matrices(document: Document, skin: int, worlds: _Floats) -> _Floats:
    """Return W_j B_j (J, 4, 4)."""
    described = document.root["skins"][skin]
    joints = worlds[described["joints"]]
    if "inverseBindMatrices" not in described:
        return np.asarray(joints)
    inverse_binds = read_floats(document, described["inverseBindMatrices"])[: len(joints)].astype(np.float64)
    return np.asarray(joints @ inverse_binds.reshape(-1, 4, 4).transpose(0, 2, 1))


def _blended(document: Document, block: Block, moves: _Floats) -> _Floats:
    """Return the matrix (N, 4, 4) of each vertex of a block; vertices that follow no joint stay in the bind pose."""
    count = len(block.positions)
    primitive = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]]
    vertex, joint, weight = skin_weights(document, primitive, count, len(moves))
    total = np.bincount(vertex, weight, count)
    maps = np.zeros((count, 4, 4))
    np.add.at(maps, vertex, weight[:, None, None] * moves[joint])
    maps[total > 0] /= total[total > 0, None, None]
    maps[total <= 0] = np.eye(4)
    return maps


def _cofactors(maps: _Floats) -> _Floats:
    """Return the maps (N, 3, 3) of normals: the cofactors of the linear parts."""
    x, y, z = (maps[:, :3, column] for column in range(3))
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)


def corner_weights(document: Document, blocks: Sequence[Block], joints: Collection[int]) -> _Floats:
    """Return how much each corner (T, 3) of the surface's triangles follows these joints, 0 to 1.

    `blocks`: as `read_surface` gathered them; `joints`: indices of nodes.
    """
    return _gathered(document, blocks, lambda block, primitive: _weights(document, block, primitive, joints), 1)[..., 0]


def corner_colors(document: Document, blocks: Sequence[Block]) -> _Floats:
    """Return the linear vertex colour (T, 3, 3) of each corner of the surface's triangles; NaN where there is none."""
    return _gathered(document, blocks, lambda block, primitive: _colors(document, block, primitive), 3)


def _gathered(
    document: Document, blocks: Sequence[Block], values: Callable[[Block, Json], _Floats], width: int
) -> _Floats:
    gathered = [np.empty((0, 3, width))]
    for block in blocks:
        for number in block.primitives:
            primitive = document.root["meshes"][block.mesh]["primitives"][number]
            corners = read_triangles(document, primitive, len(block.positions), "a primitive")
            gathered.append(values(block, primitive)[corners])
    return np.concatenate(gathered)


def skin_weights(
    document: Document, primitive: Json, count: int, joints: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
    """Return the vertices, the places of joints in their skin, and the weights above 0, (K,) each.

    Returns three empty arrays if the attributes are not valid: the deformation does not need them.
    """
    nothing = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    attributes = primitive["attributes"]
    groups = [nothing]
    number = 0
    while f"JOINTS_{number}" in attributes and f"WEIGHTS_{number}" in attributes:
        try:
            indices = read_accessor(document, attributes[f"JOINTS_{number}"]).astype(np.int64)
            weights = read_floats(document, attributes[f"WEIGHTS_{number}"]).astype(np.float64)
        except AssetError:
            return nothing
        if weights.shape != indices.shape or len(indices) != count:
            return nothing
        rows, columns = np.nonzero(weights > 0)
        chosen = np.minimum(indices[rows, columns], joints - 1)
        groups.append((rows, chosen, weights[rows, columns]))
        number += 1
    at, which, share = (np.concatenate(part) for part in zip(*groups, strict=True))
    return at, which, share


def joint_shares(
    document: Document, blocks: Sequence[Block], *, rigid: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
    """Return the rows of the surface, the nodes of joints, and the weights above 0 of the ones for the others, (K,).

    With `rigid`, a mesh without a skin on or below a joint follows it as well.
    """
    nodes, skins = document.root["nodes"], document.root.get("skins", [])
    parents = {child: at for at, node in enumerate(nodes) for child in node.get("children", [])}
    all_joints = {joint for skin in skins for joint in skin["joints"]}
    groups = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    for block in blocks:
        skin, count, above = nodes[block.node].get("skin"), len(block.positions), block.node
        if skin is not None:
            joints = np.array(skins[skin]["joints"])
            primitive = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]]
            at, which, share = skin_weights(document, primitive, count, len(joints))
            groups.append((at + block.rows.start, joints[which], share))
        elif rigid:
            while above not in all_joints and above in parents:
                above = parents[above]
            if above in all_joints:
                groups.append((np.arange(block.rows.start, block.rows.stop), np.full(count, above), np.ones(count)))
    rows, owners, shares = (np.concatenate(part) for part in zip(*groups, strict=True))
    return rows, owners, shares


def _weights(document: Document, block: Block, primitive: Json, joints: Collection[int]) -> _Floats:
    total = np.zeros((len(block.positions), 1))
    skin = document.root["nodes"][block.node].get("skin")
    if skin is None:
        return total
    chosen = np.isin(np.array(document.root["skins"][skin]["joints"]), list(joints))
    at, which, share = skin_weights(document, primitive, len(total), len(chosen))
    np.add.at(total[:, 0], at, chosen[which] * share)
    return total


def _colors(document: Document, block: Block, primitive: Json) -> _Floats:
    missing = np.full((len(block.positions), 3), np.nan)
    if "COLOR_0" not in primitive["attributes"]:
        return missing
    try:
        values = read_floats(document, primitive["attributes"]["COLOR_0"])
    except AssetError:
        return missing
    return values[:, :3].astype(np.float64) if len(values) == len(missing) and values.shape[1] >= 3 else missing
