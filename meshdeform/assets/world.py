"""Place the meshes of a scene in the world, for formats that have no nodes, and count the edges that leave it open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.scene import SceneNode, ScenePrimitive, SceneView
from meshdeform.assets.surface import Matrix, is_invertible
from meshdeform.errors import AssetNotFiniteError

__all__ = ["UNITS", "Edges", "Frame", "Unit", "Up", "WorldMesh", "count_edges", "place_meshes"]

Up = Literal["y", "z"]
Unit = Literal["m", "cm", "mm"]

UNITS: dict[Unit, tuple[str, float]] = {"m": ("metres", 1.0), "cm": ("centimetres", 100.0), "mm": ("millimetres", 1e3)}
"""The name of each unit, and how many of it are a metre."""

_Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Frame:
    """The axes and the unit of a file. The defaults are those of glTF.

    Attributes
    ----------
    up : str
        The axis that points up. For `z`, the asset's front, +Z in glTF, becomes -Y.
    unit : str
    """

    up: Up = "y"
    unit: Unit = "m"

    @property
    def matrix(self) -> Matrix:
        """The transform from glTF's world to this frame, (4, 4) float64 for column vectors."""
        scale = UNITS[self.unit][1]
        return np.diag([scale, scale, scale, 1.0]) @ (_Z_UP if self.up == "z" else np.eye(4))

    @property
    def words(self) -> str:
        """The frame in words: `metres, +Y up`."""
        return f"{UNITS[self.unit][0]}, +{self.up.upper()} up"


@dataclass(frozen=True)
class WorldMesh:
    """A primitive in a place of its own.

    Attributes
    ----------
    node : SceneNode
    copy : int
        Which of the node's copies it is.
    positions : (V, 3) float32
    triangles : (T, 3) int64
        Counter-clockwise from outside, also under mirrored nodes.
    normals : (V, 3) float32 or None
        Unit length, or zero where the file's are.
    primitive : ScenePrimitive
        What does not depend on the place: texture coordinates, colours and the material.
    """

    node: SceneNode
    copy: int
    positions: NDArray[np.float32]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float32] | None
    primitive: ScenePrimitive


@dataclass(frozen=True)
class Edges:
    """The edges where a surface is not closed, after welding corners at the same place.

    Attributes
    ----------
    open : int
        Edges of one triangle only.
    tangled : int
        Edges of more than two triangles, or of two that face different ways.
    """

    open: int
    tangled: int

    @property
    def closed(self) -> bool:
        """Whether every edge joins exactly two triangles that face the same way."""
        return self.open == 0 and self.tangled == 0

    @property
    def words(self) -> str:
        """The finding as a sentence without its full stop."""
        if self.closed:
            return "the surface is closed"
        return f"the surface is not closed: {self.open:,} open edges, {self.tangled:,} tangled edges"


def place_meshes(scene: SceneView, frame: Frame = Frame()) -> Iterator[WorldMesh]:
    """Yield each triangle primitive of a scene once for each place where it is drawn.

    Node transforms are applied. A skinned mesh stands in its bind pose, and a mesh with morph targets has its base
    shape. Nodes that flatten their mesh to a plane or less are passed over.

    Parameters
    ----------
    scene : SceneView
    frame : Frame

    Raises
    ------
    AssetNotFiniteError
        A position is not a finite 32-bit float in this frame.
    AssetError
        An index is out of range.
    """
    for node in scene.nodes:
        primitives = list(scene.primitives(node.mesh))
        for copy, place in enumerate(node.places):
            if is_invertible(place):
                for primitive in primitives:
                    yield _placed(node, copy, frame.matrix @ place, primitive)


def _placed(node: SceneNode, copy: int, matrix: Matrix, primitive: ScenePrimitive) -> WorldMesh:
    turn = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        positions = (primitive.positions.astype(np.float64) @ turn.T + matrix[:3, 3]).astype(np.float32)
    if not np.isfinite(positions).all():
        raise AssetNotFiniteError(f"nodes[{node.number}] has vertices that are not finite 32-bit floats in the world.")
    mirrored = np.linalg.det(turn) < 0.0
    triangles = primitive.triangles[:, ::-1] if mirrored else primitive.triangles
    normals = None
    if primitive.normals is not None:
        # Normals follow the inverse transpose, so that they stay perpendicular under uneven scales.
        rows = primitive.normals.astype(np.float64) @ np.linalg.inv(turn)
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        normals = np.divide(rows, length, out=np.zeros_like(rows), where=length > 0.0).astype(np.float32)
    return WorldMesh(node, copy, positions, triangles, normals, primitive)


def count_edges(corners: Sequence[NDArray[np.float32]]) -> Edges:
    """Count the edges where triangles do not close up.

    Parameters
    ----------
    corners : sequence of (T, 3, 3) float32
        The places of the triangles' corners. Corners at exactly the same place are one; triangles of which two corners
        are one do not count.
    """
    # Adding zero makes -0.0 and 0.0 the same.
    points = np.concatenate([part.reshape(-1, 3) for part in corners] or [np.empty((0, 3), np.float32)]) + np.float32(0)
    places, numbers = np.unique(points, axis=0, return_inverse=True)
    a, b, c = numbers.reshape(-1, 3).T
    whole = (a != b) & (b != c) & (c != a)
    ends = np.stack([np.concatenate([a, b, c])[np.tile(whole, 3)], np.concatenate([b, c, a])[np.tile(whole, 3)]])
    _, edge = np.unique(ends.min(axis=0) * len(places) + ends.max(axis=0), return_inverse=True)
    uses, forward = np.bincount(edge), np.bincount(edge, weights=ends[0] < ends[1])
    tangled = (uses > 2) | ((uses == 2) & (forward != 1))
    return Edges(int((uses == 1).sum()), int(tangled.sum()))
