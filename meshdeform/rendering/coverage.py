"""Draw what a mesh covers, differentiably: silhouettes without shading."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import edges_of
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.rasterizer import SilhouetteEdges, antialias, rasterize


class CoverageRenderer:
    """Draws the silhouettes of the deformed states of one mesh.

    Parameters
    ----------
    faces : (F, 3) int64
        The fixed topology.
    side : int
        Side of a picture in pixels.
    """

    def __init__(self, faces: Tensor, n_verts: int, side: int, device: torch.device | str = "cpu") -> None:
        edges = edges_of(faces.cpu())
        self.side = side
        self._n_verts = n_verts
        self._faces = faces.to(device)
        self._edges = SilhouetteEdges(edges.edges.to(device), edges.opposite.to(device))

    def render(self, verts: Tensor, cameras: Cameras) -> Tensor:
        """Draw the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame.
        cameras : Cameras
            B cameras, on the mesh's device.

        Returns
        -------
        (B, side, side) of the vertices' type in [0, 1], the covered share of each pixel, differentiable in `verts`
        through the silhouettes.

        Raises
        ------
        ShapeError
            `verts` is not (n_verts, 3).
        """
        if verts.shape != (self._n_verts, 3):
            raise ShapeError(f"expected verts ({self._n_verts}, 3), got {tuple(verts.shape)}")
        matrices = cameras.view_proj.to(verts.dtype)
        clip = verts @ matrices[:, :, :3].mT + matrices[:, None, :, 3]
        fragments = rasterize(clip, self._faces, self.side, self.side)
        covered = (fragments.face_ids >= 0).to(verts.dtype)[..., None]
        return antialias(covered, clip, self._edges, fragments.depth)[..., 0]
