"""Guidance by a target mesh: its renders from the same cameras are what the views shall look like.

The pictures are compared at several scales (blurred by repeated halving): where source and target do not overlap yet,
only the coarse levels have a gradient that points the right way. Shading by normals carries the surface,
the background the silhouette.

Source of the idea: Laine et al. 2020, Modular Primitives, section 4; the pyramid: Burt and Adelson 1983.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import NumericalError
from meshdeform.guidance.base import StepContext
from meshdeform.mesh import TriangleMesh
from meshdeform.shading import Renderer, RenderStyle, combine_views

__all__ = ["TargetGuidance"]

_STYLE = RenderStyle(view_size=64, supersample=2, shading="normals")
_COARSEST = 8


class TargetGuidance:
    """Guidance by a mesh in place of a prompt.

    Parameters
    ----------
    target : TriangleMesh
        In the source's frame (the caller normalises both alike).
    style : RenderStyle
        How both are drawn.
    device : str
    identity : dict, optional
        What the report says of the target (its hash).
    """

    def __init__(
        self,
        target: TriangleMesh,
        *,
        style: RenderStyle = _STYLE,
        device: str = "cpu",
        identity: dict[str, str] | None = None,
    ) -> None:
        self.style = style
        self.identity = {"kind": "target", **(identity or {})}
        self._renderer = Renderer(target.faces, target.verts.shape[0], style, device)
        self._verts = target.verts.to(device)

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Mean squared difference of the views, averaged over the pyramid's levels; see `Guidance.loss`."""
        with torch.no_grad():
            wanted = combine_views(self._renderer.render(self._verts, context.cameras))
        difference = _views(image) - _views(wanted)
        levels = [difference.square().mean()]
        fine = levels[0].item()
        while difference.shape[-1] > _COARSEST:
            difference = functional.avg_pool2d(difference, 2)
            levels.append(difference.square().mean())
        total = torch.stack(levels).mean()
        if not torch.isfinite(total):
            raise NumericalError("The views of the mesh are not finite.")
        return total, {"image_mse": fine}


def _views(image: Tensor) -> Tensor:
    """(1, 3, 2S, 2S) back to (4, 3, S, S), so that blurring never mixes two views."""
    s = image.shape[-1] // 2
    return torch.cat([image[..., :s, :s], image[..., :s, s:], image[..., s:, :s], image[..., s:, s:]])
