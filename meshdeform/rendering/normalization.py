"""Map the source into the cameras' frame: centred at the origin, small enough to be able to grow."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh

__all__ = ["RADIUS", "Frame"]

RADIUS = 0.6
"""Radius of the source in the cameras' frame, where they see the unit sphere: it leaves space for growth."""


@dataclass(frozen=True)
class Frame:
    """Similarity between the world and the cameras' frame.

    Attributes
    ----------
    centre : (3,) float64
        Centre of the bounding box, in the world.
    scale : float
        Camera units per world unit.
    """

    centre: Tensor
    scale: float

    @classmethod
    def around(cls, verts: Tensor) -> Frame:
        """Return the frame in which `verts` (V, 3) are centred and the farthest is at `RADIUS`."""
        centre = (verts.amin(0) + verts.amax(0)) / 2
        return cls(centre, RADIUS / float((verts - centre).norm(dim=1).max()))

    def enter(self, verts: Tensor) -> Tensor:
        """Transform positions (V, 3) from the world into the frame."""
        return (verts - self.centre) * self.scale

    def leave(self, verts: Tensor) -> Tensor:
        """Transform positions (V, 3) from the frame into the world."""
        return verts / self.scale + self.centre

    def place(self, mesh: TriangleMesh) -> TriangleMesh:
        """Transform a mesh from the world into the frame."""
        return TriangleMesh(self.enter(mesh.verts), mesh.faces)
