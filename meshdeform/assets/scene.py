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
from meshdeform.assets.scenegraph import (
    GPU_INSTANCING,
    MODE_NAMES,
    TRIANGLES,
    Instance,
    instances_of,
)
from meshdeform.assets.surface import Matrix, instance_matrices, local_matrix, placement_matrix, world_matrices
from meshdeform.errors import AssetError

__all__ = ["SceneNode", "ScenePrimitive", "SceneView"]


@dataclass(frozen=True)
class SceneNode:
    """A node of the default scene that shows a mesh, or an ancestor of one.

    Attributes
    ----------
    number : int
        Its index in the file.
    name, mesh_name : str
    parent : int or None
        The parent's number.
    local, world : (4, 4) float64
        Transforms for column vectors.
    placement : (4, 4) float64 or None
        For a skinned mesh, which ignores its node: the transform of its bind pose to world space.
    mesh : int or None
    copies : tuple of (4, 4) float64
        Transforms to world space of the copies that EXT_mesh_gpu_instancing draws, if it does and they are wanted.
    """

    number: int
    name: str
    mesh_name: str
    parent: int | None
    local: Matrix
    world: Matrix
    placement: Matrix | None
    mesh: int | None
    copies: tuple[Matrix, ...] = ()


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
    copies : bool
        Whether to show what EXT_mesh_gpu_instancing draws; otherwise it is left out.

    Attributes
    ----------
    nodes : list of SceneNode
        Parents before their children.
    materials : list of Material
    left_out : dict of str to int
        Features of the document that this view does not include, with their counts.

    Raises
    ------
    AssetError
        A material, texture or image is not valid.
    """

    def __init__(self, document: Document, *, copies: bool = False) -> None:
        self._document, self._copies = document, copies
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
        parents = {child: i for i, node in enumerate(items) for child in node.get("children", [])}
        worlds = world_matrices(items)
        shown: dict[int, Instance] = {}
        kept: dict[int, None] = {}  # in order
        for instance in instances_of(root):
            if not self._copies and GPU_INSTANCING in items[instance.node].get("extensions", {}):
                self._leave_out(GPU_INSTANCING)
                continue
            if not any(_shows_triangles(p) for p in meshes[instance.mesh].get("primitives", [])):
                continue
            shown[instance.node] = instance
            path, at = [instance.node], instance.node
            while at in parents and parents[at] not in kept:
                at = parents[at]
                path.append(at)
            kept.update(dict.fromkeys(reversed(path)))
        found = []
        for i in kept:
            shows = shown.get(i)
            skinned = shows is not None and shows.skin is not None
            many = shows is not None and not skinned and GPU_INSTANCING in items[i].get("extensions", {})
            copies = [worlds[i] @ copy for copy in instance_matrices(self._document, i)] if many else []
            found.append(
                SceneNode(
                    number=i,
                    name=_name(items[i]),
                    mesh_name=_name(meshes[shows.mesh]) if shows else "",
                    parent=parents.get(i),
                    local=local_matrix(items[i]),
                    world=worlds[i],
                    placement=placement_matrix(self._document, shows, worlds) if shows and skinned else None,
                    mesh=shows.mesh if shows else None,
                    copies=tuple(copies),
                )
            )
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
        for mesh in {node.mesh for node in self.nodes if node.mesh is not None}:
            for primitive in self._document.root["meshes"][mesh]["primitives"]:
                if _shows_triangles(primitive):
                    yield mesh, primitive

    def _count_the_rest(self) -> None:
        root = self._document.root
        self._leave_out("animations", len(objects(root, "animations")))
        self._leave_out("cameras", len(objects(root, "cameras")))
        lights = root.get("extensions", {}).get("KHR_lights_punctual", {})
        self._leave_out("lights", len(lights.get("lights", [])) if isinstance(lights, dict) else 0)
        self._leave_out("skins", sum(node.placement is not None for node in self.nodes))
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
