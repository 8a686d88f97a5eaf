"""Bake a pose: give every mesh the vertices that viewers show at a moment, without skins, morph targets and animations.

A skin's vertex is shown at ``sum_j w_j W_j B_j p`` (`assets/placement.py`), with the targets' displacements added to p
first. It is written in the space of its node, so that the tree of nodes stays as it is.

Source: glTF 2.0 specification, sections 3.7.2.2 (Morph targets), 3.7.3 (Skins) and 3.11 (Animations).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.clips import find_clip, read_clips
from meshdeform.assets.codes import TRIANGLES
from meshdeform.assets.compressed import drop_extension
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, Matrix, Placement, Placer, is_invertible, unit_rows, world_matrices
from meshdeform.assets.pose import Pose
from meshdeform.assets.scene_checks import Instance, instances_of
from meshdeform.assets.surface import handedness
from meshdeform.errors import AssetError, ParameterError

_KEYS = ("POSITION", "NORMAL", "TANGENT")
_OF_RIGS = ("VRM", "VRMC_vrm", "VRMC_springBone", "VRMC_vrm_animation", "KHR_animation_pointer", "KHR_character")
_SHAPED = "EXT_mesh_manifold"
_AGREE = 1e-9


def bake(document: Document, pose: Pose | None = None) -> list[str]:
    """Bake a pose into a document, in place; return sentences about what is lost.

    `pose`: None is that of the nodes. Raises ParameterError: there is no such clip, or it has no such time.
    """
    lost = Counter[str]()
    if pose is not None:
        _take(document, pose, lost)
    nodes = document.root.get("nodes", [])
    placer, worlds = Placer(document), world_matrices(nodes)
    shown = instances_of(document.root)
    users = Counter(node["mesh"] for node in nodes if "mesh" in node)
    for instance in shown:
        mesh = document.root["meshes"][instance.mesh]
        weights = nodes[instance.node].get("weights", mesh.get("weights", []))
        if instance.skin is None and not any("targets" in each for each in mesh.get("primitives", [])):
            continue
        if users[instance.mesh] > 1:
            users[instance.mesh] -= 1
            mesh = clone(mesh)
            nodes[instance.node]["mesh"] = document.add("meshes", mesh)
        _Baker(document, placer, instance, worlds[instance.node], weights, lost).bake(mesh)
    _drop_rig(document.root, lost)
    return [f"Without {what}: {count}." if count > 1 else f"Without {what}." for what, count in lost.items()]


def _take(document: Document, pose: Pose, lost: Counter[str]) -> None:
    """Give nodes and weights the values that a clip has at a time."""
    clips = read_clips(document)
    clip = find_clip(clips, pose.clip)
    if not clip.start - _AGREE <= pose.seconds <= clip.end + _AGREE:
        name = repr(clip.name) if clip.name else str(clip.number)
        detail = f"The clip {name} has no time {pose.seconds:g} s."
        raise ParameterError(detail, advice=f"It lasts from {clip.start:g} to {clip.end:g} s.")
    for track in clip.tracks:
        node = document.root["nodes"][track.node]
        matrix = node.pop("matrix", None)
        if matrix is not None and track.path != "weights":
            lost["the matrix of a node that the clip moves"] += 1
        elif matrix is not None:
            node["matrix"] = matrix
        node[track.path] = track.at(pose.seconds).tolist()
    if clip.unread:
        lost["what the clip does to other things than nodes and weights"] += clip.unread


class _Baker:
    """Bakes the mesh of one node."""

    def __init__(
        self,
        document: Document,
        placer: Placer,
        instance: Instance,
        world: Matrix,
        weights: Sequence[float],
        lost: Counter[str],
    ) -> None:
        self._document, self._placer, self._instance = document, placer, instance
        self._world, self._weights, self._lost = world, weights, lost
        self._done: dict[str, tuple[dict[str, int], bool] | None] = {}

    def bake(self, mesh: Json) -> None:
        """Bake all primitives of the mesh, which no other node shows, and take node and mesh off the rig."""
        node = self._document.root["nodes"][self._instance.node]
        kept = []
        for primitive in mesh["primitives"]:
            attributes = primitive.get("attributes", {})
            if "POSITION" in attributes:
                made = self._shared(primitive)
                if made is None:
                    self._lost["faces that their joints flatten"] += 1
                    continue
                new, mirrored = made
                if mirrored and primitive.get("mode", TRIANGLES) >= TRIANGLES:
                    self._turn(primitive)
                primitive["attributes"] = {
                    name: at for name, at in attributes.items() if not name.startswith(("JOINTS_", "WEIGHTS_"))
                } | new
                primitive.pop("targets", None)
            kept.append(primitive)
        mesh["primitives"] = kept
        _drop_weights(mesh, self._lost)
        node.pop("weights", None)
        if node.pop("skin", None) is not None and not is_invertible(self._world):
            self._to_the_top(node)
        if not kept:
            node.pop("mesh", None)

    def _to_the_top(self, node: Json) -> None:
        """Show the mesh by a new node at the top of the scene: its own one flattens what a skin did not mind."""
        root = self._document.root
        root["nodes"].append({key: node[key] for key in ("name", "mesh") if key in node})
        node.pop("mesh", None)
        for scene in root.get("scenes", [])[root.get("scene", 0) : root.get("scene", 0) + 1]:
            scene.setdefault("nodes", []).append(len(root["nodes"]) - 1)

    def _turn(self, primitive: Json) -> None:
        """Turn the faces of a primitive around: its joints mirror it, which its node does not."""
        count = self._document.root["accessors"][primitive["attributes"]["POSITION"]]["count"]
        triangles = read_triangles(self._document, primitive, count, "a primitive")[:, ::-1]
        primitive["indices"] = self._document.append_triangles(triangles, count)
        primitive.pop("mode", None)

    def _shared(self, primitive: Json) -> tuple[dict[str, int], bool] | None:
        """Return the new accessors of a primitive, and whether they mirror it: one for all of the same vertices."""
        attributes = primitive["attributes"]
        of_rig = sorted(item for item in attributes.items() if item[0].startswith(("JOINTS_", "WEIGHTS_")))
        key = repr([[attributes.get(name) for name in _KEYS], of_rig, primitive.get("targets")])
        if key not in self._done:
            self._done[key] = self._accessors(primitive)
        return self._done[key]

    def _accessors(self, primitive: Json) -> tuple[dict[str, int], bool] | None:
        attributes, accessors, mirrored = primitive["attributes"], self._document.root["accessors"], False
        rows = {
            name: read_floats(self._document, attributes[name]).astype(np.float64)
            for name in _KEYS
            if name in attributes
        }
        self._add_targets(primitive, rows)
        if self._instance.skin is not None:
            placement = self._placer.of_vertices(self._instance, primitive, len(rows["POSITION"]))
            if placement is None:
                return None
            mirrored = self._to_node(rows, placement)
        if not np.isfinite(rows["POSITION"]).all():
            raise AssetError("In this pose the asset has positions that are not finite.")
        made = {
            name: self._document.append_accessor(
                values.astype(np.float32), like=accessors[attributes[name]], bounds=name == "POSITION"
            )
            for name, values in rows.items()
        }
        return made, mirrored

    def _add_targets(self, primitive: Json, rows: dict[str, Floats]) -> None:
        for weight, target in zip(self._weights, primitive.get("targets", []), strict=False):
            for name in _KEYS if weight else ():
                if name in target and name in rows:
                    moves = read_floats(self._document, target[name])
                    if moves.shape == (len(rows[name]), 3) and np.isfinite(moves).all():
                        rows[name][:, :3] += weight * moves
        for name in _KEYS[1:]:
            if name in rows and "targets" in primitive:
                rows[name][:, :3] = _unit_or(rows[name][:, :3], rows[name][:, :3])

    def _to_node(self, rows: dict[str, Floats], placement: Placement) -> bool:
        """Place the vertices in the world, then in the space of the node; return whether that mirrors them."""
        back: Floats = np.eye(4)
        if is_invertible(self._world) and not np.array_equal(self._world, back):
            back = np.asarray(np.linalg.inv(self._world), np.float64)
        turn = back[:3, :3]
        rows["POSITION"] = placement.points(rows["POSITION"]) @ turn.T + back[:3, 3]
        mirrored = placement.mirrors != bool(np.linalg.det(turn) < 0)
        if "NORMAL" in rows:
            # Normals follow the inverse transpose; where a vertex's own map has none, they stay as they are.
            normals = placement.normals(rows["NORMAL"]) @ np.linalg.inv(turn)
            rows["NORMAL"] = _unit_or(normals, rows["NORMAL"])
        if "TANGENT" in rows:
            along = _unit_or(placement.directions(rows["TANGENT"][:, :3]) @ turn.T, rows["TANGENT"][:, :3])
            rows["TANGENT"] = np.column_stack([along, handedness(rows["TANGENT"][:, 3], mirrors=mirrored)])
        return mirrored


def _unit_or(vectors: Floats, otherwise: Floats) -> Floats:
    """Return the rows at unit length; those without a direction as others say."""
    unit = unit_rows(vectors)
    return np.where(np.isfinite(unit).all(axis=1, keepdims=True), unit, otherwise)


def _drop_weights(mesh: Json, lost: Counter[str]) -> None:
    mesh.pop("weights", None)
    extras: Any = mesh.get("extras")
    if isinstance(extras, dict) and extras.pop("targetNames", None) is not None and not extras:
        del mesh["extras"]
    if isinstance(mesh.get("extensions"), dict) and mesh["extensions"].pop(_SHAPED, None) is not None:
        lost[f"{_SHAPED}, which names vertices as they were"] += 1
        if not mesh["extensions"]:
            del mesh["extensions"]


def _drop_rig(root: Json, lost: Counter[str]) -> None:
    """Remove animations, skins that no node uses any more, and extensions about them."""
    animations = root.pop("animations", None)
    if animations:
        lost["animations"] += len(animations)
    skins = root.get("skins", [])
    if skins and not any("skin" in node for node in root.get("nodes", [])):
        lost["skins"] += len(skins)
        del root["skins"]
    for name in _OF_RIGS:
        if isinstance(root.get("extensions"), dict) and root["extensions"].pop(name, None) is not None:
            lost[f"the extension {name}"] += 1
        drop_extension(root, name)
    if root.get("extensions") == {}:
        del root["extensions"]
    if not any(_SHAPED in mesh.get("extensions", {}) for mesh in root.get("meshes", [])):
        drop_extension(root, _SHAPED)
