"""Draw silhouettes: the share of each pixel that a mesh covers, differentiable in its vertices."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import edges_of
from meshdeform.rendering.antialiasing import SilhouetteEdges, antialias
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.rasterizer import projected, rasterize


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
        edges = edges_of(faces.cpu().numpy())
        self.side = side
        self._n_verts = n_verts
        self._faces = faces.to(device)
        self._edges = SilhouetteEdges(*(torch.from_numpy(each).to(device) for each in (edges.edges, edges.opposite)))

    def render(self, verts: Tensor, cameras: Cameras) -> Tensor:
        """Draw the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame.
        cameras : Cameras
            B cameras.

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
        clip = projected(verts, cameras)
        fragments = rasterize(clip, self._faces, self.side, self.side)
        covered = (fragments.face_ids >= 0).to(verts.dtype)[..., None]
        return antialias(covered, clip, self._edges, fragments.depth)[..., 0]
