"""Write the scene as a USD stage: nodes as Xforms, and each primitive as a Mesh with its material bound.

Source: UsdGeom's schema documentation (Pixar), Mesh, PrimvarsAPI and Xformable.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Vt

from meshdeform import __version__
from meshdeform.assets.materials import Material
from meshdeform.assets.scene import SceneNode, ScenePrimitive, SceneView
from meshdeform.assets.usd.layer import Layer, attribute
from meshdeform.assets.usd.materials import Materials, texcoord_name
from meshdeform.assets.usd.names import Names
from meshdeform.assets.usd.textures import Textures

__all__ = ["StageWriter"]

_TYPES = Sdf.ValueTypeNames
_ROOT = "/Root"
_MATERIALS = f"{_ROOT}/Materials"
_MAX_DEPTH = 64  # USD traverses prims recursively; deeper nodes are moved up and keep their world transforms
_COLORS = "vertex colors that a texture hides"


class StageWriter:
    """Writes one scene into a new layer.

    Parameters
    ----------
    scene : SceneView
    path : Path
        The `.usdc` file to create. Textures go to the folder `textures` beside it.

    Attributes
    ----------
    meshes : int
        Number of meshes written.
    left_out : dict of str to int
        Features of the asset that are not in the stage, with their counts.
    """

    def __init__(self, scene: SceneView, path: Path) -> None:
        self._scene = scene
        self._names = Names()
        # By node: the path for its children, that path's depth, and the matrix from the node to that path.
        self._places: dict[int, tuple[str, int, NDArray[np.float64]]] = {}
        self._layer = Layer(path, _ROOT, f"Meshdeform {__version__}")
        self._textures = Textures(scene, path.parent)
        self._materials = Materials(self._layer, _MATERIALS, scene, self._textures)
        self._hidden_colors = 0
        self.meshes = 0

    @property
    def textures(self) -> list[str]:
        """Paths of the textures, relative to the layer, in the order in which materials needed them."""
        return self._textures.written

    @property
    def left_out(self) -> dict[str, int]:
        """Features of the asset that are not in the stage, with their counts."""
        own = {
            "images that are broken or of a kind that USDZ does not allow": self._textures.left_out,
            _COLORS: self._hidden_colors,
        }
        return {**self._scene.left_out, **{what: count for what, count in own.items() if count}}

    def write(self) -> None:
        """Write the layer."""
        self._layer.prim(_MATERIALS, "Scope")
        self._names.make(_ROOT, "Materials", "Materials")
        for node in self._scene.nodes:
            self._node(node)
        self._layer.save()

    def _node(self, node: SceneNode) -> None:
        above, depth, missing = self._places[node.parent] if node.parent is not None else (_ROOT, 0, np.eye(4))
        local = missing @ node.local
        place = self._xform(above, node.name, local)
        if depth < _MAX_DEPTH:
            self._places[node.number] = (place, depth + 1, np.eye(4))
        else:
            self._places[node.number] = (above, depth, local)
        if node.mesh is None:
            return
        if node.placement is not None:  # a skinned mesh is placed by its joints, not by its node
            place = self._xform(_ROOT, f"{node.name}_mesh" if node.name else node.mesh_name, node.placement)
        for primitive in self._scene.primitives(node.mesh):
            self._mesh(place, node.mesh_name, primitive)

    def _xform(self, parent: str, name: str, matrix: NDArray[np.float64]) -> str:
        path = f"{parent}/{self._names.make(parent, name, 'Node')}"
        prim = self._layer.prim(path, "Xform", name)
        if not np.array_equal(matrix, np.eye(4)):
            rows = Gf.Matrix4d(matrix.T.tolist())  # USD multiplies rows
            attribute(prim, "xformOp:transform", _TYPES.Matrix4d, rows)
            order = Vt.TokenArray(["xformOp:transform"])
            attribute(prim, "xformOpOrder", _TYPES.TokenArray, order, uniform=True)
        return path

    def _mesh(self, parent: str, name: str, primitive: ScenePrimitive) -> None:
        prim = self._layer.prim(f"{parent}/{self._names.make(parent, name, 'Mesh')}", "Mesh", name)
        look = self._materials.of(primitive.material)
        self._shape(prim, primitive, look)
        for number, values in primitive.texcoords.items():
            upwards = np.ascontiguousarray(np.stack([values[:, 0], 1.0 - values[:, 1]], axis=1), np.float32)
            rows = Vt.Vec2fArray.FromNumpy(upwards)
            name = f"primvars:{texcoord_name(number)}"
            attribute(prim, name, _TYPES.TexCoord2fArray, rows, interpolation="vertex")
        if primitive.colors is not None:
            self._colors(prim, primitive.colors, look)
        colored = primitive.colors is not None and "base_color" not in look.textures
        self._materials.bind(prim, primitive.material, colored=colored)
        self.meshes += 1

    def _shape(self, prim: Sdf.PrimSpec, primitive: ScenePrimitive, look: Material) -> None:
        positions, triangles = primitive.positions, primitive.triangles
        attribute(prim, "points", _TYPES.Point3fArray, _vectors(positions))
        attribute(prim, "faceVertexCounts", _TYPES.IntArray, _integers(np.full(len(triangles), 3)))
        attribute(prim, "faceVertexIndices", _TYPES.IntArray, _integers(triangles.reshape(-1)))
        attribute(prim, "subdivisionScheme", _TYPES.Token, "none", uniform=True)
        attribute(prim, "doubleSided", _TYPES.Bool, look.double_sided, uniform=True)
        bounds = np.stack([positions.min(axis=0), positions.max(axis=0)])
        attribute(prim, "extent", _TYPES.Float3Array, _vectors(bounds))
        if primitive.normals is not None:
            normals, interpolation = primitive.normals, "vertex"
        else:  # glTF requires flat shading for a mesh without normals
            normals, interpolation = np.repeat(_face_normals(primitive), 3, axis=0), "faceVarying"
        attribute(prim, "normals", _TYPES.Normal3fArray, _vectors(normals), interpolation=interpolation)

    def _colors(self, prim: Sdf.PrimSpec, colors: NDArray[np.float32], look: Material) -> None:
        if "base_color" in look.textures:
            self._hidden_colors += bool((colors != 1.0).any())
        else:  # a preview surface cannot multiply the two: write their product
            colors = (colors * np.array(look.base_color)).astype(np.float32)
        rows = _vectors(colors[:, :3])
        attribute(prim, "primvars:displayColor", _TYPES.Color3fArray, rows, interpolation="vertex")
        if look.alpha_mode != "OPAQUE":
            alpha = Vt.FloatArray.FromNumpy(np.ascontiguousarray(colors[:, 3]))
            attribute(prim, "primvars:displayOpacity", _TYPES.FloatArray, alpha, interpolation="vertex")


def _vectors(rows: NDArray[np.floating]) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows, np.float32))


def _integers(values: NDArray[np.int64]) -> Vt.IntArray:
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


def _face_normals(primitive: ScenePrimitive) -> NDArray[np.float64]:
    """Return the triangles' unit normals, (T, 3), zero for triangles without area."""
    a, b, c = (primitive.positions[primitive.triangles[:, i]].astype(np.float64) for i in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0))
