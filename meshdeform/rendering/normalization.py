"""The frame of the cameras: the source around the origin, small enough that it has room to grow."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh

__all__ = ["RADIUS", "Frame"]

RADIUS = 0.6
"""Radius of the source in the frame where the cameras see the unit sphere: room to grow into."""


@dataclass(frozen=True)
class Frame:
    """The similarity between the world and the frame of the cameras.

    Attributes
    ----------
    centre : (3,) float64
        Of the bounding box, in the world.
    scale : float
        Camera units per world unit.
    """

    centre: Tensor
    scale: float

    @classmethod
    def around(cls, verts: Tensor) -> Frame:
        """The frame in which `verts` (V, 3) are centred and the farthest lies at `RADIUS`."""
        centre = (verts.amin(0) + verts.amax(0)) / 2
        return cls(centre, RADIUS / float((verts - centre).norm(dim=1).max()))

    def enter(self, verts: Tensor) -> Tensor:
        """From the world into the frame."""
        return (verts - self.centre) * self.scale

    def leave(self, verts: Tensor) -> Tensor:
        """From the frame into the world."""
        return verts / self.scale + self.centre

    def place(self, mesh: TriangleMesh) -> TriangleMesh:
        """The mesh, in the frame."""
        return TriangleMesh(self.enter(mesh.verts), mesh.faces)
