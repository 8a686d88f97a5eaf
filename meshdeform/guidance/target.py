"""A second mesh as guidance: both meshes are drawn by the same cameras and the pictures are compared.

::

    loss = 1 / (n + 1)  sum_{k=0..n}  mean (blur_k(image) - blur_k(target))^2

`blur_k` averages blocks of 2^k pixels, up to an eighth of a view; blocks never reach from one view into the next.
The blurred levels feel a limb that does not overlap its goal yet, where the sharp one is flat; the sharp level
places the outline. Views show camera-space normals on black: a surface seen by the camera has blue of at least one
half, so the one picture compares orientation and silhouette.

Source: the multi-scale image loss of inverse rendering, e.g. Hasselgren et al. 2021, Appearance-driven automatic
3D model simplification, section 4.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.guidance.base import StepContext
from meshdeform.shading import Renderer, RenderStyle, combine_views

if TYPE_CHECKING:
    from meshdeform.mesh import TriangleMesh

__all__ = ["TARGET_STYLE", "TargetGuidance"]

TARGET_STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
_COARSEST_SHARE = 8


class TargetGuidance:
    """Pulls the views towards those of a target mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        The target, in the frame of the mesh that is deformed: the caller centres and scales both the same way.
    style : RenderStyle
    device : str or torch.device
        Where the views are drawn.
    identity : dict of str to str, optional
        What the report calls the target; a hash of its vertices and faces unless given.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        *,
        style: RenderStyle = TARGET_STYLE,
        device: str | torch.device = "cpu",
        identity: dict[str, str] | None = None,
    ) -> None:
        self.style = style
        self.identity = identity or {"id": "target", "revision": "", "sha256": _sha256(mesh)}
        self._verts = mesh.verts.to(device)
        self._renderer = Renderer(mesh.faces, mesh.verts.shape[0], style, device)
        self._levels = max(style.view_size // _COARSEST_SHARE, 1).bit_length()

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Compare with the target as the same cameras see it.

        Returns
        -------
        The loss above (the mean squared difference of colours in [0, 1], 0 where the pictures are the same), and
        `target_mse`, that of the sharp level alone.

        Raises
        ------
        ShapeError
            `image` has not the size that `style` says.
        NumericalError
            The loss is not finite.
        """
        with torch.no_grad():
            target = combine_views(self._renderer.render(self._verts, context.cameras))
        if image.shape != target.shape:
            raise ShapeError(f"expected an image {tuple(target.shape)}, got {tuple(image.shape)}")
        difference = image - target
        terms = []
        for level in range(self._levels):
            if level:
                difference = functional.avg_pool2d(difference, 2)
            terms.append(difference.square().mean())
        loss = torch.stack(terms).mean()
        if not torch.isfinite(loss):
            raise NumericalError(f"The views cannot be compared with the target at step {context.step + 1}.")
        return loss, {"target_mse": terms[0].item()}


def _sha256(mesh: TriangleMesh) -> str:
    digest = hashlib.sha256(mesh.verts.numpy().tobytes())
    digest.update(mesh.faces.numpy().tobytes())
    return digest.hexdigest()
