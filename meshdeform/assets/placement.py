"""Compute the affine matrix from an instance's mesh space to world space.

A mesh is placed by the product of the transforms of its node and the node's ancestors. A skinned mesh ignores its
node; it is deformed in its bind pose, where `joint_world @ inverse_bind` is the same matrix for every joint. If the
file's nodes are in another pose, these matrices differ; then the joint that agrees best with all others places the
mesh, and the skin bends the result as it bent the source. A mesh that EXT_mesh_gpu_instancing draws many times has the
place of its first instance.

Source: glTF 2.0 specification, sections 3.5.3 (Transformations) and 3.7.3 (Skins); EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.document import Document
from meshdeform.assets.json_text import Json
from meshdeform.assets.scenegraph import GPU_INSTANCING, Instance, instance_count

__all__ = [
    "bind_placement",
    "instance_matrices",
    "is_invertible",
    "local_matrix",
    "placement_matrix",
    "world_matrices",
]

Matrix = NDArray[np.float64]
_INSTANCE_KEYS = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}


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


def world_matrices(nodes: list[Json]) -> list[Matrix]:
    """Return every node's transform to world space, (4, 4) float64 each; the hierarchy must be checked already."""
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
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


def placement_matrix(document: Document, instance: Instance, worlds: list[Matrix]) -> Matrix:
    """Return the matrix from an instance's mesh space to world space, (4, 4) float64."""
    if instance.skin is None:
        return worlds[instance.node] @ _first_instance(document, instance.node)
    return bind_placement(document, document.root["skins"][instance.skin], worlds)


def bind_placement(document: Document, skin: Json, worlds: Sequence[Matrix]) -> Matrix:
    """Return the matrix from the space of a skin's meshes to world space in its bind pose, (4, 4) float64."""
    joints = np.stack([worlds[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        inverse_binds = read_floats(document, skin["inverseBindMatrices"])[: len(joints)].astype(np.float64)
        joints = joints @ inverse_binds.reshape(-1, 4, 4).transpose(0, 2, 1)
    distance = np.abs(joints - joints.mean(axis=0)).sum(axis=(1, 2))
    return np.asarray(joints[int(np.argmin(distance))])


def instance_matrices(document: Document, node: int) -> list[Matrix]:
    """Return the transform of each copy that EXT_mesh_gpu_instancing draws of a node's mesh, relative to the node.

    Returns
    -------
    (4, 4) float64 each; the identity alone for a node without the extension.
    """
    count = instance_count(document.root, node)
    if count is None:
        return [np.eye(4)]
    rows = _instance_rows(document, node)
    return [
        local_matrix({_INSTANCE_KEYS[name]: values[i].tolist() for name, values in rows.items()}) for i in range(count)
    ]


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
