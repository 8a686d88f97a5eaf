"""Play skinned, animated GLBs: linear-blend skinning in numpy, written without the code under test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.unit.assets.builders import unpack

Floats = NDArray[np.float64]
TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DTYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


@dataclass(frozen=True)
class Played:
    """Vertices (V, 3) of a skinned mesh at a time, and its edges (E, 2)."""

    verts: Floats
    edges: NDArray[np.int64]

    @property
    def lengths(self) -> Floats:
        ends = self.verts[self.edges]
        return np.asarray(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))


class Player:
    """Plays the first animation of a GLB, if it has one."""

    def __init__(self, glb: bytes, animation: int = 0) -> None:
        self.root, self.binary, _ = unpack(glb)
        self.animation = (self.root.get("animations") or [{"channels": [], "samplers": []}])[animation]

    def read(self, accessor: int) -> Any:
        item = self.root["accessors"][accessor]
        shape = item["count"], TYPES[item["type"]]
        if "bufferView" not in item:
            return np.zeros(shape)
        view = self.root["bufferViews"][item["bufferView"]]
        start = view.get("byteOffset", 0) + item.get("byteOffset", 0)
        dtype = np.dtype(DTYPES[item["componentType"]])
        stride = view.get("byteStride", dtype.itemsize * shape[1])
        rows = np.ndarray(shape, dtype, self.binary, start, (stride, dtype.itemsize))
        scale = np.iinfo(dtype).max if item.get("normalized") else 1
        return rows.astype(np.float64) / scale if dtype.kind == "f" or scale > 1 else rows.astype(np.int64)

    def worlds(self, time: float | None) -> list[Floats]:
        """World matrices of all nodes at a time; at rest if there is none."""
        changed: dict[int, dict[str, Any]] = {}
        for channel in self.animation["channels"] if time is not None else []:
            sampler = self.animation["samplers"][channel["sampler"]]
            times, values = self.read(sampler["input"])[:, 0], self.read(sampler["output"])
            if sampler.get("interpolation") == "CUBICSPLINE":
                values = values[1::3]
            target = channel["target"]
            if target["path"] != "weights":
                at = np.array([np.interp(time, times, column) for column in values.T])
                changed.setdefault(target["node"], {})[target["path"]] = at
        local = [_local({**node, **changed.get(i, {})}) for i, node in enumerate(self.root["nodes"])]
        parents = {c: i for i, node in enumerate(self.root["nodes"]) for c in node.get("children", [])}

        def world(i: int) -> Floats:
            return world(parents[i]) @ local[i] if i in parents else local[i]

        return [world(i) for i in range(len(local))]

    def at(self, time: float | None, node: int) -> Played:
        """The vertices of a node's first primitive in world space."""
        worlds, item = self.worlds(time), self.root["nodes"][node]
        primitive = self.root["meshes"][item["mesh"]]["primitives"][0]
        attributes = primitive["attributes"]
        verts = np.column_stack([self.read(attributes["POSITION"]), np.ones(self._count(attributes))])
        if "skin" not in item:
            placed = verts @ worlds[node].T
        else:
            skin = self.root["skins"][item["skin"]]
            binds = self.read(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
            maps = np.stack([worlds[j] for j in skin["joints"]]) @ binds
            joints, weights = self.read(attributes["JOINTS_0"]), self.read(attributes["WEIGHTS_0"])
            placed = np.einsum("vk,vkij,vj->vi", weights, maps[joints], verts)
        faces = self.read(primitive["indices"]).reshape(-1, 3)
        edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1), axis=0)
        return Played(placed[:, :3], edges)

    def _count(self, attributes: dict[str, int]) -> int:
        return int(self.root["accessors"][attributes["POSITION"]]["count"])


def _local(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), np.float64) / np.linalg.norm(node.get("rotation", [1]))
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ) * np.array(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix
