"""Write a scene as a USD stage: nodes as Xforms, each primitive as a Mesh with its material, skins as UsdSkel.

Source: UsdGeom's schema documentation (Pixar), Mesh, PrimvarsAPI and Xformable.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Vt

from meshdeform import __version__
from meshdeform.assets.clips import read_clips
from meshdeform.assets.container import Json
from meshdeform.assets.placement import (
    Floats,
    Matrix,
    instance_matrices,
    is_invertible,
    local_matrix,
    parents_of,
    unit_rows,
)
from meshdeform.assets.scene import MaterialTriangles, Scene, moved
from meshdeform.assets.scene_checks import Instance, instances_of, shown_nodes
from meshdeform.assets.usd.layer import TYPES, Layer, floats, integers, matrix, vectors
from meshdeform.assets.usd.materials import Materials, texcoord_name
from meshdeform.assets.usd.motion import Motion
from meshdeform.assets.usd.rig import Rigs, Skeleton

_MAX_DEPTH = 64
"""USD traverses prims recursively; deeper nodes are moved up, with the transforms between."""


class StageWriter:
    """Writes a scene into a new layer. `textures`: the files beside it, relative to its folder."""

    def __init__(self, scene: Scene, path: Path, metres: float) -> None:
        clips = read_clips(scene.document)
        self._scene = scene
        self._nodes: list[Json] = scene.root.get("nodes", [])
        self._motion = Motion(clips[0] if clips else None)
        if len(clips) > 1:
            scene.lost["animations after the first one"] += len(clips) - 1
        if clips and clips[0].unread:
            scene.lost["what the animation does to other things than nodes and weights"] += clips[0].unread
        rigged = any(_rigged(scene, instance) for instance in instances_of(scene.root))
        kind = "SkelRoot" if rigged else "Xform"
        self._layer = Layer(path, "/Root", kind, f"Meshdeform {__version__}", metres)
        self._materials = Materials(self._layer, scene, path.parent)
        self._prims: dict[int, str] = {}  # the prim of each node
        self._rigs = Rigs(self._layer, scene, self._motion, self._prims)
        self._shown = {instance.node: instance for instance in instances_of(scene.root)}
        self.triangles = 0

    @property
    def textures(self) -> list[str]:
        """Paths of the textures, relative to the layer, in the order in which materials needed them."""
        return self._materials.written

    def write(self) -> None:
        """Write the layer."""
        parents = parents_of(self._nodes)
        joints = {joint for skin in self._scene.root.get("skins", []) for joint in skin["joints"]}
        shown = shown_nodes(self._scene.root)
        skins = {instance.skin for instance in self._shown.values() if instance.skin is not None}
        needed = {*self._shown, *(top for skin in skins if (top := self._rigs.above(skin)) is not None)}
        for node in reversed(shown):
            if node not in joints or any(child in needed for child in self._nodes[node].get("children", [])):
                needed.add(node)
        # By node: the prim of its children, its depth, and the matrix from the node to that prim.
        spaces: dict[int, tuple[str, int, Matrix]] = {}
        for node in shown:
            if node not in needed:  # a joint, which the skeleton has
                continue
            above, depth, missing = spaces.get(parents.get(node, -1), (self._layer.root, 0, np.eye(4)))
            local = missing @ local_matrix(self._nodes[node])
            self._prims[node] = path = self._xform(above, node, local)
            deep = depth >= _MAX_DEPTH
            spaces[node] = (above, depth, local) if deep else (path, depth + 1, np.eye(4))
            if deep and self._motion.moves(node):
                self._scene.lost["movements of nodes below a node that lies too deep"] += 1
        for instance in self._shown.values():
            self._meshes(instance)
        self._rigs.animate()
        if self._motion.end > self._motion.start:
            self._layer.play(self._motion.start, self._motion.end)
        self._layer.save(self._scene.sentences())

    def _xform(self, parent: str, node: int, local: Matrix) -> str:
        item = self._nodes[node]
        path = self._layer.prim(parent, str(item.get("name", "")), "Xform", "Node")
        if self._motion.moves(node):
            self._moving(path, node, item)
        elif not np.array_equal(local, np.eye(4)):
            self._transform(path, local)
        return path

    def _transform(self, path: str, local: Matrix) -> None:
        self._layer.set(path, "xformOp:transform", TYPES.Matrix4d, matrix(local))
        self._order(path, "transform")

    def _order(self, path: str, *names: str) -> None:
        order = Vt.TokenArray([f"xformOp:{name}" for name in names])
        self._layer.set(path, "xformOpOrder", TYPES.TokenArray, order, uniform=True)

    def _moving(self, path: str, node: int, item: Json) -> None:
        for name, prop, kind in (
            ("translate", "translation", TYPES.Double3),
            ("orient", "rotation", TYPES.Quatf),
            ("scale", "scale", TYPES.Float3),
        ):

            def at(seconds: float | None, prop: str = prop) -> object:
                values = self._motion.value(item, node, prop, seconds).tolist()
                if prop == "rotation":
                    return Gf.Quatf(values[3], *values[:3])
                return Gf.Vec3d(*values) if prop == "translation" else Gf.Vec3f(*values)

            made = self._layer.set(path, f"xformOp:{name}", kind, at(None))
            self._layer.samples(made, {time: at(time) for time in self._motion.times([node], prop)})
        self._order(path, "translate", "orient", "scale")

    def _meshes(self, instance: Instance) -> None:
        skeleton, prim = self._rigs.of(instance), self._prims[instance.node]
        parents = [skeleton.parent if skeleton else prim]  # a skin ignores its node
        copies = instance_matrices(self._scene.document, instance.node)
        if len(copies) != 1 or not np.array_equal(copies[0], np.eye(4)):
            parents = []
            for copy in copies:
                if is_invertible(copy):
                    parents.append(self._layer.prim(prim, "Copy", "Xform"))
                    self._transform(parents[-1], copy)
        for piece in self._scene.pieces(instance):
            for parent in parents:
                self._mesh(parent, piece, instance, skeleton)

    def _mesh(self, parent: str, piece: MaterialTriangles, instance: Instance, skeleton: Skeleton | None) -> None:
        layer, look = self._layer, self._scene.shading(piece.material)
        schemas = ["MaterialBindingAPI", *(["SkelBindingAPI"] if skeleton else [])]
        prim = layer.prim(parent, piece.name, "Mesh", schemas=schemas)
        shown = piece if skeleton is None else moved(piece, skeleton.to_points)
        positions, triangles, normals = shown.positions, shown.triangles, shown.normals
        self.triangles += len(triangles)
        layer.set(prim, "points", TYPES.Point3fArray, vectors(positions))
        layer.set(prim, "faceVertexCounts", TYPES.IntArray, integers(np.full(len(triangles), 3)))
        layer.set(prim, "faceVertexIndices", TYPES.IntArray, integers(triangles.reshape(-1)))
        layer.set(prim, "subdivisionScheme", TYPES.Token, "none", uniform=True)
        layer.set(prim, "doubleSided", TYPES.Bool, look.base.double_sided, uniform=True)
        bounds = np.stack([positions.min(axis=0), positions.max(axis=0)])
        layer.set(prim, "extent", TYPES.Float3Array, vectors(bounds))
        interpolation = "vertex"
        if normals is None:  # glTF requires flat shading for a mesh without normals
            normals, interpolation = np.repeat(_face_normals(positions, triangles), 3, axis=0), "faceVarying"
        layer.set(prim, "normals", TYPES.Normal3fArray, vectors(normals), primvar=interpolation)
        for number, values in piece.texcoords.items():
            upwards = np.ascontiguousarray(np.stack([values[:, 0], 1.0 - values[:, 1]], axis=1), np.float32)
            rows = Vt.Vec2fArray.FromNumpy(upwards)
            layer.set(prim, f"primvars:{texcoord_name(number)}", TYPES.TexCoord2fArray, rows, primvar="vertex")
        colored = self._colors(prim, piece)
        self._materials.bind(prim, piece.material, colored=colored)
        if skeleton is not None:
            self._rigs.attach(prim, skeleton, instance, piece)

    def _colors(self, prim: str, piece: MaterialTriangles) -> bool:
        """Write the colours of vertices, and return whether the material is to show them."""
        look = self._scene.shading(piece.material)
        if piece.colors is None:
            return False
        textured = "base_color" in look.textures
        if textured and (piece.colors != 1.0).any():
            self._scene.lost["colours of vertices beside a texture"] += 1
        # A preview surface cannot multiply the two: their product is written.
        colors = piece.colors if textured else piece.colors * np.array(look.base.base_color)
        rows = vectors(colors[:, :3])
        self._layer.set(prim, "primvars:displayColor", TYPES.Color3fArray, rows, primvar="vertex")
        if look.base.alpha_mode != "OPAQUE":
            alpha = floats(colors[:, 3])
            self._layer.set(prim, "primvars:displayOpacity", TYPES.FloatArray, alpha, primvar="vertex")
        return not textured


def _rigged(scene: Scene, instance: Instance) -> bool:
    primitives = scene.root["meshes"][instance.mesh].get("primitives", [])
    return instance.skin is not None or any(each.get("targets") for each in primitives)


def _face_normals(positions: Floats, triangles: NDArray[np.int64]) -> Floats:
    """Return the triangles' unit normals, (T, 3), zero for triangles without area."""
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    return np.nan_to_num(unit_rows(np.cross(b - a, c - a)))
