"""Give a read-only view of the default scene: nodes, their primitives as arrays, and materials.

Used to write other formats; the deformation itself reads `surface`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.container import Json, index, objects
from meshdeform.assets.document import Document
from meshdeform.assets.materials import Image, Material, read_image, read_materials
from meshdeform.assets.scenegraph import GPU_INSTANCING, MODE_NAMES, TRIANGLES, instances_of
from meshdeform.assets.surface import Matrix, instance_matrices, placement_matrix, world_matrices
from meshdeform.errors import AssetError

__all__ = ["SceneNode", "ScenePrimitive", "SceneView"]


@dataclass(frozen=True)
class SceneNode:
    """A node of the default scene that shows a mesh.

    Attributes
    ----------
    number : int
        Its index in the file.
    name, mesh_name : str
    mesh : int
    places : tuple of (4, 4) float64
        Transforms of the mesh to world space, for column vectors: one, or one for each copy that
        EXT_mesh_gpu_instancing draws. A skinned mesh, which ignores its node, has that of its bind pose.
    """

    number: int
    name: str
    mesh_name: str
    mesh: int
    places: tuple[Matrix, ...]


@dataclass(frozen=True)
class ScenePrimitive:
    """Triangles with one material, in mesh space.

    Attributes
    ----------
    positions : (V, 3) float32
        The vertices that triangles use, in the file's order.
    triangles : (T, 3) int64
        In the file's winding.
    normals : (V, 3) float32 or None
    texcoords : dict of int to (V, 2) float32
        By set number; v downwards.
    colors : (V, 4) float32 or None
        COLOR_0, linear; alpha is 1 if the file has none.
    material : int or None
    """

    positions: NDArray[np.float32]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float32] | None
    texcoords: dict[int, NDArray[np.float32]]
    colors: NDArray[np.float32] | None
    material: int | None


class SceneView:
    """The default scene of a document, as returned by `Asset.scene`.

    Parameters
    ----------
    document : Document

    Attributes
    ----------
    nodes : list of SceneNode
        Depth first.
    materials : list of Material
    left_out : dict of str to int
        Features of the document that this view does not include, with their counts.

    Raises
    ------
    AssetError
        A material, texture or image is not valid.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._cached: tuple[int, dict[int, NDArray[np.float32]]] = (-1, {})
        self.materials: list[Material] = read_materials(document)
        self.left_out: dict[str, int] = {}
        self.nodes: list[SceneNode] = self._nodes()
        self._count_the_rest()
        for number, primitive in self._triangle_primitives():
            index(primitive, "material", len(self.materials), f"a primitive of meshes[{number}]")

    def image(self, at: int) -> Image:
        """Read one image."""
        return read_image(self._document, at)

    def primitives(self, mesh: int) -> Iterator[ScenePrimitive]:
        """Yield the triangle primitives of a mesh, except those without a triangle."""
        for p, primitive in enumerate(self._document.root["meshes"][mesh].get("primitives", [])):
            if _shows_triangles(primitive):
                read = self._primitive(mesh, primitive, f"meshes[{mesh}].primitives[{p}]")
                if len(read.triangles):
                    yield read

    def _nodes(self) -> list[SceneNode]:
        root = self._document.root
        items, meshes = root.get("nodes", []), root.get("meshes", [])
        worlds = world_matrices(items)
        found = []
        for instance in instances_of(root):
            if not any(_shows_triangles(p) for p in meshes[instance.mesh].get("primitives", [])):
                continue
            node, world = items[instance.node], worlds[instance.node]
            places: tuple[Matrix, ...] = (world,)
            if instance.skin is not None:
                self._leave_out("skins")
                places = (placement_matrix(self._document, instance, worlds),)
            elif GPU_INSTANCING in node.get("extensions", {}):
                places = tuple(world @ copy for copy in instance_matrices(self._document, instance.node)) or places
            names = _name(node), _name(meshes[instance.mesh])
            found.append(SceneNode(instance.node, *names, mesh=instance.mesh, places=places))
        return found

    def _primitive(self, mesh: int, primitive: Json, where: str) -> ScenePrimitive:
        attributes = primitive["attributes"]
        positions = self._floats(mesh, attributes["POSITION"])
        count = len(positions)
        triangles = read_triangles(self._document, primitive, count, where)
        used = np.unique(triangles)
        numbers = np.zeros(count, np.int64)
        numbers[used] = np.arange(len(used))

        def rows(name: str, widths: tuple[int, ...]) -> NDArray[np.float32] | None:
            if name not in attributes:
                return None
            try:
                values = self._floats(mesh, attributes[name])
            except AssetError:  # the deformation did not need this attribute: leave it out instead of failing
                values = np.empty((0, 0), np.float32)
            if len(values) != count or values.shape[1] not in widths:
                self._leave_out(f"invalid {name}")
                return None
            return values[used]

        sets = sorted(int(name[9:]) for name in attributes if name.startswith("TEXCOORD_") and name[9:].isdecimal())
        texcoords = {n: values for n in sets if (values := rows(f"TEXCOORD_{n}", (2,))) is not None}
        colors = rows("COLOR_0", (3, 4))
        if colors is not None and colors.shape[1] == 3:
            colors = np.column_stack([colors, np.ones(len(colors), np.float32)])
        material = primitive.get("material")
        return ScenePrimitive(positions[used], numbers[triangles], rows("NORMAL", (3,)), texcoords, colors, material)

    def _floats(self, mesh: int, accessor: int) -> NDArray[np.float32]:
        """Read an accessor, cached while its mesh is being read, since a mesh's primitives may share it."""
        if self._cached[0] != mesh:
            self._cached = (mesh, {})
        if accessor not in self._cached[1]:
            self._cached[1][accessor] = read_floats(self._document, accessor)
        return self._cached[1][accessor]

    def _leave_out(self, what: str, count: int = 1) -> None:
        if count:
            self.left_out[what] = self.left_out.get(what, 0) + count

    def _triangle_primitives(self) -> Iterator[tuple[int, Json]]:
        for mesh in {node.mesh for node in self.nodes}:
            for primitive in self._document.root["meshes"][mesh]["primitives"]:
                if _shows_triangles(primitive):
                    yield mesh, primitive

    def _count_the_rest(self) -> None:
        root = self._document.root
        self._leave_out("animations", len(objects(root, "animations")))
        self._leave_out("cameras", len(objects(root, "cameras")))
        lights = root.get("extensions", {}).get("KHR_lights_punctual", {})
        self._leave_out("lights", len(lights.get("lights", [])) if isinstance(lights, dict) else 0)
        self._leave_out("morph targets", sum(len(p.get("targets", [])) for _, p in self._triangle_primitives()))
        for instance in instances_of(root):
            for primitive in root["meshes"][instance.mesh].get("primitives", []):
                mode = primitive.get("mode", TRIANGLES)
                if mode < TRIANGLES:
                    self._leave_out(MODE_NAMES[mode])
        for material in self.materials:
            for name in material.extensions:
                self._leave_out(name)


def _shows_triangles(primitive: Json) -> bool:
    return primitive.get("mode", TRIANGLES) >= TRIANGLES and "POSITION" in primitive.get("attributes", {})


def _name(item: Json) -> str:
    name: Any = item.get("name")
    return name if isinstance(name, str) else ""
