"""Place the vertices of a mesh in world space as viewers show them: by their node, or by the joints of their skin.

A mesh without a skin is placed by the product of the transforms of its node and the node's ancestors. A skinned mesh
ignores its node: a vertex p with weights w_j is shown at ``sum_j w_j W_j B_j p``, with the world matrices W_j and the
inverse bind matrices B_j of its joints, and so has an affine map of its own. What is changed where viewers show it is
taken back by the inverse of the vertex's own map. Where that cannot be inverted, because a joint is scaled to nothing
for instance, the vertex stays as the file has it.

In the bind pose ``W_j B_j`` is the same matrix for every joint. Vertices without weights are placed by that of the
joint that agrees best with all others.

Source: glTF 2.0 specification, sections 3.5.3 (Transformations) and 3.7.3 (Skins); EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_accessor, read_floats
from meshdeform.assets.codes import GPU_INSTANCING
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.scene_checks import Instance, instance_count
from meshdeform.errors import AssetError

Floats = NDArray[np.float64]
Matrix = NDArray[np.float64]
_INSTANCE_KEYS = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
_SINGULAR = 2e-3
"""Determinant of a blended map over the cube of its norm below which a vertex cannot be taken back: where bones twist
against each other the map flattens, and its inverse would turn a small change into a spike in every other pose."""


def local_matrix(node: Json) -> Matrix:
    """Return a node's own transform, (4, 4) float64, for column vectors."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = _unit(np.array(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), np.float64))
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", [1.0, 1.0, 1.0]), np.float64)
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def _unit(rotation: Matrix) -> Matrix:
    length = np.linalg.norm(rotation)
    if length < 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    # A rotation of unit length is returned unchanged, so that the identity stays exact.
    return rotation if abs(length - 1.0) < 1e-12 else rotation / length


def parents_of(nodes: Sequence[Json]) -> dict[int, int]:
    """Return the parent of each node that has one."""
    return {child: at for at, node in enumerate(nodes) for child in node.get("children", [])}


def upwards(node: int, parents: Mapping[int, int]) -> Iterator[int]:
    """Yield a node and those above it, up to the top."""
    at: int | None = node
    while at is not None:
        yield at
        at = parents.get(at)


def world_matrices(nodes: list[Json]) -> list[Matrix]:
    """Return every node's transform to world space, (4, 4) float64 each; the hierarchy must be checked already."""
    parents = parents_of(nodes)
    worlds: dict[int, Matrix] = {}
    for start in range(len(nodes)):
        path, at = [start], start
        while at not in worlds and at in parents:
            at = parents[at]
            path.append(at)
        for i in reversed(path):
            if i not in worlds:
                local = local_matrix(nodes[i])
                worlds[i] = worlds[parents[i]] @ local if i in parents else local
    return [worlds[i] for i in range(len(nodes))]


def placement_matrix(document: Document, instance: Instance, worlds: Sequence[Matrix]) -> Matrix:
    """Return the matrix from an instance's mesh space to world space, (4, 4) float64; of a skin in its bind pose."""
    if instance.skin is None:
        return worlds[instance.node] @ _first_instance(document, instance.node)
    joints = joint_matrices(document, instance.skin, worlds)
    distance = np.abs(joints - joints.mean(axis=0)).sum(axis=(1, 2))
    return np.asarray(joints[int(np.argmin(distance))])


def joint_matrices(document: Document, skin: int, worlds: Sequence[Matrix]) -> Floats:
    """Return ``W_j B_j`` (J, 4, 4) of a skin's joints: the matrices from its meshes' space to the pose of the nodes."""
    described = document.root["skins"][skin]
    joints = np.stack([worlds[joint] for joint in described["joints"]])
    return np.asarray(joints @ inverse_binds(document, described))


def inverse_binds(document: Document, skin: Json) -> Floats:
    """Return the inverse bind matrices (J, 4, 4) of a skin's joints."""
    count = len(skin["joints"])
    if "inverseBindMatrices" not in skin:
        return np.tile(np.eye(4), (count, 1, 1))
    rows = read_floats(document, skin["inverseBindMatrices"])[:count].astype(np.float64)
    return np.asarray(rows.reshape(-1, 4, 4).transpose(0, 2, 1))


def instance_matrices(document: Document, node: int) -> list[Matrix]:
    """Return the transforms of a node's GPU instances; the identity alone for a node without any."""
    count = instance_count(document.root, node)
    if count is None:
        return [np.eye(4)]
    rows = _instance_rows(document, node)
    return [local_matrix({_INSTANCE_KEYS[name]: rows[name][k].tolist() for name in rows}) for k in range(count)]


def _first_instance(document: Document, node: int) -> Matrix:
    """Return the transform of the first GPU instance that does not flatten the mesh, or the identity."""
    if instance_count(document.root, node) is None:
        return np.eye(4)
    rows = _instance_rows(document, node)
    first = 0
    if "SCALE" in rows:
        usable = np.isfinite(rows["SCALE"]).all(axis=1) & (rows["SCALE"] != 0.0).all(axis=1)
        first = int(usable.argmax())
    return local_matrix({_INSTANCE_KEYS[name]: values[first].tolist() for name, values in rows.items()})


def _instance_rows(document: Document, node: int) -> dict[str, NDArray[np.float32]]:
    attributes = document.root["nodes"][node]["extensions"][GPU_INSTANCING].get("attributes", {})
    return {name: read_floats(document, attributes[name]) for name in _INSTANCE_KEYS if name in attributes}


def is_invertible(matrix: Matrix) -> bool:
    """Return whether the matrix can be inverted: it is finite, and no axis vanishes relative to the others."""
    if not np.isfinite(matrix).all():
        return False
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[2] > 1e-9 * stretches[0] and stretches[0] > 0.0)


@dataclass(frozen=True)
class Placement:
    """The affine map from a mesh's space to world space: one for all vertices, or one for each vertex of a skin."""

    linear: Floats  # (3, 3) or (V, 3, 3) float64
    offset: Floats  # (3,) or (V, 3) float64
    inverse: Floats  # of `linear`; zero where it has none
    stays: NDArray[np.bool_] | None = None  # (V,) bool: vertices whose map cannot be inverted; None if there are none

    @classmethod
    def of_matrix(cls, matrix: Matrix) -> Self:
        """Place all vertices by one matrix (4, 4) that can be inverted."""
        linear = matrix[:3, :3]
        return cls(linear, matrix[:3, 3], np.asarray(np.linalg.inv(linear), np.float64))

    @classmethod
    def of_skin(cls, maps: Floats) -> Self | None:
        """Place each vertex by its own map (V, 3, 4); None if none of them can be inverted."""
        linear = np.ascontiguousarray(maps[:, :, :3])
        size = np.sqrt((linear**2).sum((1, 2)))
        with np.errstate(all="ignore"):
            usable = np.isfinite(maps).all((1, 2)) & (np.abs(np.linalg.det(linear)) > _SINGULAR * size**3)
        if not usable.any():
            return None
        inverse = np.zeros_like(linear)
        inverse[usable] = np.linalg.inv(linear[usable])
        return cls(linear, maps[:, :, 3], inverse, None if usable.all() else ~usable)

    @property
    def mirrors(self) -> bool:
        """Whether it turns the mesh inside out: then triangles change their winding."""
        determinants = np.linalg.det(self.linear)
        return bool((determinants < 0.0).sum() * 2 > determinants.size)

    @property
    def scale(self) -> float:
        """By how much it lengthens an axis of the mesh's space, at most."""
        return float(np.sqrt((self.linear**2).sum(-2)).max())

    def points(self, points: Floats) -> Floats:
        """Return where points (V, 3) of the mesh's space are in world space."""
        return np.asarray(_applied(self.linear, points) + self.offset)

    def directions(self, vectors: Floats) -> Floats:
        """Return the world-space unit vectors (V, 3) of directions along the surface; NaN where nothing is left."""
        return unit_rows(_applied(self.linear, vectors))

    def normals(self, normals: Floats) -> Floats:
        """Return the world-space unit normals (V, 3) of normals; NaN where nothing is left."""
        return unit_rows(_applied(np.swapaxes(self.inverse, -1, -2), normals))

    def moves_back(self, moves: Floats) -> Floats:
        """Return displacements (V, 3) of world space in the mesh's space; zero for vertices that stay."""
        return _applied(self.inverse, moves)

    def directions_back(self, vectors: Floats) -> Floats:
        """Return world-space directions (V, 3) in the mesh's space; NaN for vertices that stay."""
        return unit_rows(_applied(self.inverse, vectors))

    def normals_back(self, normals: Floats) -> Floats:
        """Return world-space normals (V, 3) in the mesh's space; NaN for vertices that stay."""
        back = unit_rows(_applied(np.swapaxes(self.linear, -1, -2), normals))
        return back if self.stays is None else np.where(self.stays[:, None], np.nan, back)

    def maps_back(self, jacobians: Floats) -> Floats:
        """Return linear maps (V, 3, 3) of world space in the mesh's space; the identity for vertices that stay."""
        maps = np.asarray(self.inverse @ jacobians @ self.linear)
        if self.stays is not None:
            maps[self.stays] = np.eye(3)
        return maps


def _applied(linear: Floats, rows: Floats) -> Floats:
    return np.asarray(rows @ linear.T if linear.ndim == 2 else np.einsum("vij,vj->vi", linear, rows))


def unit_rows(vectors: Floats) -> Floats:
    """Return the rows scaled to unit length; zero rows become NaN."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.full_like(vectors, np.nan), where=length > 0.0))


class Placer:
    """Places the meshes of a document, reading the matrices of nodes and skins once."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._worlds = world_matrices(document.root.get("nodes", []))
        self._joints: dict[int, Floats] = {}

    def of_node(self, instance: Instance) -> Placement | None:
        """Return the placement of an instance as a whole, of a skin in its bind pose; None if it flattens the mesh."""
        matrix = placement_matrix(self._document, instance, self._worlds)
        return Placement.of_matrix(matrix) if is_invertible(matrix) else None

    def of_vertices(self, instance: Instance, primitive: Json, count: int) -> Placement | None:
        """Return the placement of a primitive's vertices; None if it flattens all of them."""
        if instance.skin is None:
            return self.of_node(instance)
        if instance.skin not in self._joints:
            self._joints[instance.skin] = joint_matrices(self._document, instance.skin, self._worlds)
        joints = self._joints[instance.skin]
        vertex, joint, weight = skin_weights(self._document, primitive, count, len(joints))
        total = np.bincount(vertex, weight, count)
        in_bind_pose = self.of_node(instance)
        if not (total > 0).any():
            return in_bind_pose
        # Column by column: a quarter of the time of adding matrices.
        columns = joints[:, :3].reshape(-1, 12)[joint] * weight[:, None]
        blended: Floats = np.stack([np.bincount(vertex, columns[:, k], count) for k in range(12)], axis=1)
        blended[total > 0] /= total[total > 0, None]
        if in_bind_pose is not None:
            # Vertices that follow no joint stay in the bind pose, and so do those whose joints say nothing.
            whole = np.column_stack([in_bind_pose.linear, in_bind_pose.offset])
            blended[(total <= 0) | ~np.isfinite(blended).all(1)] = whole.reshape(-1)
        return Placement.of_skin(blended.reshape(-1, 3, 4))


def skin_weights(
    document: Document, primitive: Json, count: int, joints: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the vertices, the indices of joints in their skin, and the weights above 0, (K,) each.

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
    at, which, share = (np.concatenate(each) for each in zip(*groups, strict=True))
    return at, which, share
