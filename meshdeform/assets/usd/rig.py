"""Write skins and morph targets as UsdSkel: a Skeleton for each skin, with its joints and the nodes between them.

glTF shows a skin's vertex at ``sum_j w_j W_j B_j p``, USD at ``W_P sum_j w_j J_j inv(bind_j) q`` with the joints'
matrices J_j in the skeleton's space. The skeleton stands at the node P above all joints, so that
``J_j = inv(W_P) W_j``: a scale of P, which many armatures have, is none of a joint, as Blender needs it. With M the map
of the bind pose to that space, ``q = M p`` and ``bind_j = M inv(B_j)``: the points are then those that are shown
wherever bind pose and rest agree.

Source: UsdSkel schemas (Pixar).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Vt

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import Json
from meshdeform.assets.placement import (
    Floats,
    Matrix,
    inverse_binds,
    is_invertible,
    joint_matrices,
    local_matrix,
    parents_of,
    placement_matrix,
    skin_weights,
    upwards,
    world_matrices,
)
from meshdeform.assets.scene import MaterialTriangles, Scene
from meshdeform.assets.scene_checks import Instance
from meshdeform.assets.usd.layer import TYPES, Layer, floats, integers, matrices, valid_name, vectors
from meshdeform.assets.usd.motion import Motion

_ALONE, _BOUND = "joint", ("SkelBindingAPI",)


@dataclass
class Skeleton:
    """A skeleton in the layer."""

    path: str
    parent: str  # the prim that it stands at, as its meshes do
    nodes: dict[int, str]  # the joint of each node, those above first
    to_points: Matrix  # from the space of its meshes to that of its points, (4, 4)
    joints: NDArray[np.int64] | None = (
        None  # (J,) skeleton's joint of each joint of the skin; None: all follow the only one
    )
    rest: int = 0  # the joint of vertices that follow none
    shapes: dict[str, tuple[int, int]] = field(default_factory=dict)  # node and number of each morph target


class Rigs:
    """The skeletons of a scene."""

    def __init__(self, layer: Layer, scene: Scene, motion: Motion, prims: Mapping[int, str]) -> None:
        self._layer, self._scene, self._motion = layer, scene, motion
        self._nodes: list[Json] = scene.root.get("nodes", [])
        self._worlds = world_matrices(self._nodes)
        self._parents = parents_of(self._nodes)
        self._prims = prims  # the prim of each node
        self._skins: dict[int, Skeleton] = {}
        self._made: list[Skeleton] = []

    def above(self, skin: int) -> int | None:
        """Return the node above all joints of a skin that is nearest to them; None if nothing is."""
        joints = self._scene.root["skins"][skin]["joints"]
        ways = [list(upwards(joint, self._parents))[:0:-1] for joint in joints]
        shared = [steps[0] for steps in zip(*ways, strict=False) if len(set(steps)) == 1]
        return shared[-1] if shared else None

    def of(self, instance: Instance) -> Skeleton | None:
        """Return the skeleton that a mesh needs; None if it has neither a skin nor morph targets."""
        if instance.skin is not None:
            if instance.skin not in self._skins:
                self._skins[instance.skin] = self._skin(instance)
            return self._skins[instance.skin]
        primitives = self._scene.root["meshes"][instance.mesh].get("primitives", [])
        if not any(each.get("targets") for each in primitives):
            return None
        node = self._prims[instance.node]
        path = self._layer.prim(node, "Skeleton", "Skeleton", schemas=_BOUND)
        self._describe(path, [_ALONE], [np.eye(4)], [np.eye(4)])
        self._made.append(Skeleton(path, node, {}, np.eye(4)))
        return self._made[-1]

    def _skin(self, instance: Instance) -> Skeleton:
        assert instance.skin is not None
        skin = self._scene.root["skins"][instance.skin]
        above = self.above(instance.skin)
        if above is not None and not is_invertible(self._worlds[above]):
            above = None
        back = np.eye(4) if above is None else np.linalg.inv(self._worlds[above])
        to_points = back @ placement_matrix(self._scene.document, instance, self._worlds)
        to_points = to_points if is_invertible(to_points) else np.eye(4)
        ordered: dict[int, str] = {}
        for joint in skin["joints"]:
            self._with_parents(joint, above, ordered)
        at = {node: k for k, node in enumerate(ordered)}
        bind = [back @ self._worlds[node] for node in ordered]
        for joint, inverse in zip(skin["joints"], inverse_binds(self._scene.document, skin), strict=True):
            if is_invertible(inverse):
                bind[at[joint]] = to_points @ np.linalg.inv(inverse)
        parent = self._layer.root if above is None else self._prims[above]
        path = self._layer.prim(parent, str(skin.get("name", "")), "Skeleton", schemas=_BOUND)
        self._describe(path, list(ordered.values()), bind, [local_matrix(self._nodes[node]) for node in ordered])
        maps = joint_matrices(self._scene.document, instance.skin, self._worlds)
        rest = int(np.abs(maps - maps.mean(axis=0)).sum(axis=(1, 2)).argmin())
        joints = np.array([at[joint] for joint in skin["joints"]])
        self._made.append(Skeleton(path, parent, ordered, to_points, joints, rest))
        return self._made[-1]

    def _with_parents(self, joint: int, top: int | None, ordered: dict[int, str]) -> None:
        """Add a joint and the nodes above it, below `top`, each with its path, those above first."""
        way: list[int] = []
        at: int | None = joint
        while at is not None and at != top and at not in ordered:
            way.append(at)
            at = self._parents.get(at)
        for node in reversed(way):
            above = ordered.get(self._parents.get(node, -1), "")
            name = valid_name(str(self._nodes[node].get("name", "")), "joint")
            path = f"{above}/{name}" if above else name
            ordered[node] = f"{path}_{node}" if path in ordered.values() else path

    def _describe(self, path: str, joints: Sequence[str], bind: list[Matrix], rest: list[Matrix]) -> None:
        layer = self._layer
        layer.set(path, "joints", TYPES.TokenArray, Vt.TokenArray(list(joints)), uniform=True)
        layer.set(path, "bindTransforms", TYPES.Matrix4dArray, matrices(bind), uniform=True)
        layer.set(path, "restTransforms", TYPES.Matrix4dArray, matrices(rest), uniform=True)

    def attach(self, prim: str, skeleton: Skeleton, instance: Instance, piece: MaterialTriangles) -> None:
        """Make a mesh follow a skeleton, with its weights and morph targets."""
        layer = self._layer
        layer.link(prim, "skel:skeleton", skeleton.path)
        layer.set(prim, "primvars:skel:geomBindTransform", TYPES.Matrix4d, Gf.Matrix4d(1.0))
        joints, weights = self._influences(skeleton, piece)
        for name, kind, values in (
            ("jointIndices", TYPES.IntArray, integers(joints.reshape(-1))),
            ("jointWeights", TYPES.FloatArray, floats(weights.reshape(-1))),
        ):
            made = layer.set(prim, f"primvars:skel:{name}", kind, values, primvar="vertex")
            made.SetInfo("elementSize", joints.shape[1])
        self._targets(prim, skeleton, instance, piece)

    def _influences(self, skeleton: Skeleton, piece: MaterialTriangles) -> tuple[NDArray[np.int64], Floats]:
        """Return joints (V, K) and weights (V, K) of the vertices, the greatest first."""
        count = len(piece.used)
        if skeleton.joints is None:
            return np.zeros((count, 1), np.int64), np.ones((count, 1))
        file_rows = int(self._scene.root["accessors"][piece.primitive["attributes"]["POSITION"]]["count"])
        rows, joints, shares = skin_weights(self._scene.document, piece.primitive, file_rows, len(skeleton.joints))
        order = np.lexsort((-shares, rows))
        rows, joints, shares = rows[order], joints[order], shares[order]
        uses = np.bincount(rows, minlength=file_rows)
        column = np.arange(len(rows)) - np.repeat(np.cumsum(uses) - uses, uses)
        width = max(int(uses.max(initial=0)), 1)
        table, weights = np.full((file_rows, width), skeleton.rest), np.zeros((file_rows, width))
        table[rows, column], weights[rows, column] = joints, shares
        weights[uses == 0, 0] = 1.0
        weights /= weights.sum(axis=1, keepdims=True)
        return np.asarray(skeleton.joints[table[piece.used]], np.int64), weights[piece.used]

    def _targets(self, prim: str, skeleton: Skeleton, instance: Instance, piece: MaterialTriangles) -> None:
        targets = piece.primitive.get("targets", [])
        mesh = self._scene.root["meshes"][instance.mesh]
        extras = mesh.get("extras")
        names = extras.get("targetNames") if isinstance(extras, dict) else None
        tokens, paths = [], []
        turn = skeleton.to_points[:3, :3]
        for number, target in enumerate(targets):
            wanted = str(names[number]) if isinstance(names, list) and number < len(names) else f"target{number}"
            token = f"{valid_name(wanted, f'target{number}')}_{instance.node}_{number}"
            moves = self._moves(target, "POSITION", piece)
            turned = self._moves(target, "NORMAL", piece)
            rows = np.flatnonzero((moves != 0).any(axis=1) | (turned != 0).any(axis=1))
            path = self._layer.prim(prim, wanted, "BlendShape")
            self._layer.set(path, "offsets", TYPES.Vector3fArray, vectors(moves[rows] @ turn.T), uniform=True)
            if "NORMAL" in target and piece.normals is not None:
                turned = turned[rows] @ np.linalg.inv(turn)
                self._layer.set(path, "normalOffsets", TYPES.Vector3fArray, vectors(turned), uniform=True)
            self._layer.set(path, "pointIndices", TYPES.IntArray, integers(rows), uniform=True)
            skeleton.shapes[token] = instance.node, number
            tokens.append(token)
            paths.append(path)
        if tokens:
            self._layer.set(prim, "skel:blendShapes", TYPES.TokenArray, Vt.TokenArray(tokens), uniform=True)
            self._layer.link(prim, "skel:blendShapeTargets", *paths)

    def _moves(self, target: Json, name: str, piece: MaterialTriangles) -> Floats:
        """Return the displacements (V, 3) of a target, zero where it has none that fit."""
        if name in target:
            values = read_floats(self._scene.document, target[name]).astype(np.float64)
            if values.shape[1] == 3 and len(values) > piece.used.max() and np.isfinite(values).all():
                return np.asarray(values[piece.used])
        return np.zeros((len(piece.used), 3))

    def animate(self) -> None:
        """Give the skeletons their animations, once all meshes are attached."""
        for skeleton in self._made:
            moving = [node for node in skeleton.nodes if self._motion.moves(node)]
            if moving or skeleton.shapes:
                path = self._layer.prim(skeleton.path, "Animation", "SkelAnimation")
                self._layer.link(skeleton.path, "skel:animationSource", path)
                self._joints(path, skeleton, moving)
                self._weights(path, skeleton)

    def _joints(self, path: str, skeleton: Skeleton, nodes: list[int]) -> None:
        if not nodes:
            return
        tokens = Vt.TokenArray([skeleton.nodes[node] for node in nodes])
        self._layer.set(path, "joints", TYPES.TokenArray, tokens, uniform=True)
        for name, prop, kind, pack in (
            ("translations", "translation", TYPES.Float3Array, vectors),
            ("rotations", "rotation", TYPES.QuatfArray, _quaternions),
            ("scales", "scale", TYPES.Half3Array, _halves),
        ):

            def at(seconds: float | None, prop: str = prop, pack: Any = pack) -> Any:
                rows = [self._motion.value(self._nodes[node], node, prop, seconds) for node in nodes]
                return pack(np.array(rows).reshape(len(nodes), -1))

            made = self._layer.set(path, name, kind, at(None))
            self._layer.samples(made, {time: at(time) for time in self._motion.times(nodes, prop)})

    def _weights(self, path: str, skeleton: Skeleton) -> None:
        if not skeleton.shapes:
            return
        tokens = Vt.TokenArray(list(skeleton.shapes))
        self._layer.set(path, "blendShapes", TYPES.TokenArray, tokens, uniform=True)
        owners = list(dict.fromkeys(node for node, _ in skeleton.shapes.values()))

        def at(seconds: float | None) -> Any:
            rows = {node: self._weights_of(node, seconds) for node in owners}
            shares = [rows[node][k] if k < len(rows[node]) else 0.0 for node, k in skeleton.shapes.values()]
            return floats(np.array(shares))

        made = self._layer.set(path, "blendShapeWeights", TYPES.FloatArray, at(None))
        self._layer.samples(made, {time: at(time) for time in self._motion.times(owners, "weights")})

    def _weights_of(self, node: int, seconds: float | None) -> Floats:
        track = self._motion.track(node, "weights")
        if track is not None and seconds is not None:
            return track.at(seconds)
        item = self._nodes[node]
        mesh = self._scene.root["meshes"][item["mesh"]]
        return np.array(item.get("weights", mesh.get("weights", [])), np.float64)


def _quaternions(rows: Floats) -> Any:
    return Vt.QuatfArray([Gf.Quatf(w, x, y, z) for x, y, z, w in rows.tolist()])


def _halves(rows: Floats) -> Any:
    return Vt.Vec3hArray([Gf.Vec3h(*row) for row in rows.tolist()])
