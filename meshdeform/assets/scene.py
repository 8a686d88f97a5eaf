"""Give what the default scene shows as arrays, for writing other formats.

Source: glTF 2.0 specification, sections 3.5 (Scenes) and 3.7 (Meshes); EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.codes import TRIANGLES
from meshdeform.assets.container import Json, objects
from meshdeform.assets.document import Document
from meshdeform.assets.materials import Shading, read_image, read_shading
from meshdeform.assets.placement import Floats, Matrix, instance_matrices, is_invertible, unit_rows, world_matrices
from meshdeform.assets.scene_checks import Instance, instances_of
from meshdeform.assets.unchecked import member_of
from meshdeform.errors import AssetError, AssetNotFiniteError

Rows = NDArray[np.float32]
_LOOSE = {0: "points", 1: "lines", 2: "lines", 3: "lines"}
_BUILT_IN = ("POSITION", "NORMAL", "TANGENT", "TEXCOORD_", "COLOR_0", "JOINTS_", "WEIGHTS_")


@dataclass(frozen=True)
class MaterialTriangles:
    """Triangles with one material. The vertices are those that triangles use, in the file's order."""

    primitive: Json  # as in the file
    used: NDArray[np.int64]  # (V,) int64: the file's rows of the vertices
    positions: Floats  # (V, 3) float64
    triangles: NDArray[np.int64]  # (T, 3) int64: counter-clockwise from outside
    normals: Floats | None  # (V, 3) float64
    texcoords: dict[int, Rows]  # (V, 2) by the number of the set; v downwards
    colors: Rows | None  # (V, 4) linear RGBA in 0..1; alpha is 1 if the file has none
    material: int | None
    name: str = ""  # of the node that shows it, else of its mesh
    instance: tuple[int, int] = (0, 0)  # the node, and which of its GPU instances


class Scene:
    """The default scene of a document.

    `lost`: what the scene has and the arrays do not, with counts; a writer adds to it what its format cannot hold.
    """

    def __init__(self, document: Document) -> None:
        self.document, self.root = document, document.root
        self.lost = Counter[str]()
        self._shadings: dict[int | None, Shading] = {None: Shading()}
        self._images: dict[int, tuple[bytes, str]] = {}
        self._read: dict[tuple[int, str], Rows] = {}
        self._count()

    def shading(self, material: int | None) -> Shading:
        """Return a material; the default one for None, and for one that cannot be read."""
        if material not in self._shadings:
            try:
                self._shadings[material] = read_shading(self.document, material or 0)
            except AssetError:
                self.lost["materials that cannot be read"] += 1
                self._shadings[material] = Shading()
            for name in self._shadings[material].left_out:
                self.lost[f"{name} of materials"] += 1
        return self._shadings[material]

    def image(self, at: int, kinds: tuple[str, ...] = ("png", "jpg")) -> tuple[bytes, str]:
        """Return an encoded image and its kind, `png` or `jpg`; empty ones if it cannot be read.

        `kinds`: those that may stay as they are; others that can be read become PNG.
        """
        if at not in self._images:
            self._images[at] = self._image(at, kinds)
        return self._images[at]

    def _image(self, at: int, kinds: tuple[str, ...]) -> tuple[bytes, str]:
        from meshdeform.assets.materials import image_type, portable_picture

        try:
            data = read_image(self.document, at).data
        except AssetError:
            data = b""
        kind = image_type(data).rpartition("/")[2].replace("jpeg", "jpg")
        if kind in kinds:
            return data, kind
        picture = portable_picture(data) if data else b""
        if not picture:
            self.lost["images that cannot be read"] += 1
        return picture, "png" if picture else ""

    def placed(self) -> Iterator[MaterialTriangles]:
        """Yield the triangles of each instance of a mesh, in the world; skins must be baked already.

        Nodes that flatten their mesh to a plane or less are passed over. AssetNotFiniteError: a position is not finite.
        """
        worlds = world_matrices(self.root.get("nodes", []))
        for instance in instances_of(self.root):
            pieces = list(self.pieces(instance))
            copies = instance_matrices(self.document, instance.node)
            for number, copy in enumerate(copies):
                matrix = worlds[instance.node] @ copy
                if is_invertible(matrix):
                    for piece in pieces:
                        yield replace(moved(piece, matrix), instance=(instance.node, number))

    def pieces(self, instance: Instance) -> Iterator[MaterialTriangles]:
        """Yield the triangles of a node's mesh in the space of the mesh."""
        mesh, node = self.root["meshes"][instance.mesh], self.root["nodes"][instance.node]
        name = _name(node) or _name(mesh)
        self._read.clear()  # primitives of one mesh may share their vertices
        for p, primitive in enumerate(mesh.get("primitives", [])):
            if primitive.get("mode", TRIANGLES) >= TRIANGLES and "POSITION" in primitive.get("attributes", {}):
                piece = self._piece(instance, primitive, f"meshes[{instance.mesh}].primitives[{p}]", name)
                if len(piece.triangles):
                    yield piece

    def _piece(self, instance: Instance, primitive: Json, where: str, name: str) -> MaterialTriangles:
        positions = self._floats(primitive, "POSITION", (3,))
        assert positions is not None
        triangles = read_triangles(self.document, primitive, len(positions), where)
        used, flat = np.unique(triangles, return_inverse=True)
        sets = sorted(int(key[9:]) for key in primitive["attributes"] if key[:9] == "TEXCOORD_" and key[9:].isdecimal())
        rows = {k: self._floats(primitive, f"TEXCOORD_{k}", (2,)) for k in sets}
        colors, normals = self._floats(primitive, "COLOR_0", (3, 4)), self._floats(primitive, "NORMAL", (3,))
        if colors is not None and colors.shape[1] == 3:
            colors = np.column_stack([colors, np.ones(len(colors), np.float32)])
        material = primitive.get("material")
        return MaterialTriangles(
            primitive,
            used,
            positions[used].astype(np.float64),
            flat.reshape(-1, 3).astype(np.int64),
            None if normals is None else normals[used].astype(np.float64),
            {k: values[used] for k, values in rows.items() if values is not None},
            None if colors is None else np.clip(colors[used], 0.0, 1.0),
            material if type(material) is int else None,
            name,
            (instance.node, 0),
        )

    def _floats(self, primitive: Json, name: str, widths: tuple[int, ...]) -> Rows | None:
        """Return the values of an attribute; None if the primitive has none, or none that fit."""
        at = primitive["attributes"].get(name)
        if at is None:
            return None
        if (at, name) not in self._read:
            try:
                self._read[at, name] = read_floats(self.document, at)
            except AssetError:
                self._read[at, name] = np.empty((0, 0), np.float32)
        values = self._read[at, name]
        count = self.root["accessors"][primitive["attributes"]["POSITION"]]["count"]
        if values.shape[1] not in widths or len(values) != count or not np.isfinite(values).all():
            if name == "POSITION":
                raise AssetNotFiniteError("The asset has positions that are not finite.")
            self.lost[f"{name} that is not valid"] += 1
            return None
        return values

    def _count(self) -> None:
        """Count what no other format gets."""
        root, lost = self.root, self.lost
        lost["cameras"] += sum("camera" in node for node in objects(root, "nodes"))
        known = member_of(root, "extensions")
        for name, what in (("KHR_lights_punctual", "lights"), ("KHR_materials_variants", "variants of materials")):
            lost[what] += name in known
        for mesh in {instance.mesh for instance in instances_of(root)}:
            for primitive in root["meshes"][mesh].get("primitives", []):
                if primitive.get("mode", TRIANGLES) in _LOOSE:
                    lost[_LOOSE[primitive.get("mode", TRIANGLES)]] += 1
                lost["further attributes of vertices"] += sum(
                    not name.startswith(_BUILT_IN) for name in primitive.get("attributes", {})
                )

    def sentences(self) -> list[str]:
        """Return what is lost, a sentence each."""
        found = {what: count for what, count in self.lost.items() if count}
        return [
            f"Left out: {what}, {count:,} of them." if count > 1 else f"Left out: {what}."
            for what, count in found.items()
        ]


def moved(piece: MaterialTriangles, matrix: Matrix) -> MaterialTriangles:
    """Return a piece under a matrix (4, 4) that can be inverted. AssetNotFiniteError: a position is not finite then."""
    if np.array_equal(matrix, np.eye(4)):
        return piece
    turn = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        positions = piece.positions @ turn.T + matrix[:3, 3]
        if not np.isfinite(positions.astype(np.float32)).all():
            raise AssetNotFiniteError(
                f"nodes[{piece.instance[0]}] has vertices that are no 32-bit floats in the world."
            )
    normals = piece.normals
    if normals is not None and not np.array_equal(turn, np.eye(3)):
        # Normals follow the inverse transpose, so that they stay perpendicular under uneven scales.
        normals = np.nan_to_num(unit_rows(normals @ np.linalg.inv(turn)))
    triangles = piece.triangles[:, ::-1] if np.linalg.det(turn) < 0 else piece.triangles
    return replace(piece, positions=positions, normals=normals, triangles=triangles)


def _name(item: Any) -> str:
    name = item.get("name") if isinstance(item, dict) else None
    return name if isinstance(name, str) else ""
