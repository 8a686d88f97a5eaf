"""Let silhouettes guide: alone, or beside a guidance by pictures such as score distillation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.base import Guidance, HeavyGuidance, StepContext
from meshdeform.guidance.silhouettes import SilhouetteTerm
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.shading import RenderStyle

_UNSEEN = RenderStyle(view_size=8, supersample=1)


class SilhouetteGuidance:
    """Guides by silhouettes alone; the views of the steps are not looked at, so they are as small as can be."""

    style = _UNSEEN
    offset = torch.zeros(3, dtype=torch.float64)

    def __init__(self, term: SilhouetteTerm, weight: float, identity: dict[str, str]) -> None:
        self._term, self._weight, self.identity = term, weight, identity

    def begin(self, mesh: TriangleMesh) -> None:
        """Prepare for the mesh at rest that is deformed."""
        self._term.begin(mesh)

    def loss(self, image: Tensor, _context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return 0: only the shape is compared."""
        return image.sum() * 0.0, {}

    def shape_loss(self, verts: Tensor, _context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return the weighted loss of the silhouettes, and `silhouette_iou`."""
        value, logs = self._term.loss(verts)
        return self._weight * value, logs

    @property
    def state(self) -> dict[str, Tensor]:
        """Nothing: the masks are placed anew at every step."""
        return {}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state`, which has nothing for this guidance."""


class BesideSilhouettes(SilhouetteGuidance):
    """Guides by pictures of the steps, and by silhouettes.

    Parameters
    ----------
    guidance : Guidance
        One that can grade orientations (`deformation.orientation.Grader`).
    weight : float
        Of the silhouettes, relative to the guidance.
    """

    def __init__(self, guidance: Guidance, term: SilhouetteTerm, weight: float, identity: dict[str, str]) -> None:
        super().__init__(term, weight, identity)
        self._guidance = guidance
        self.style = guidance.style

    @property
    def is_heavy(self) -> bool:
        """Whether the guidance is."""
        return isinstance(self._guidance, HeavyGuidance) and self._guidance.is_heavy

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return the loss of the guidance on the views."""
        return self._guidance.loss(image, context)

    def losses(self, image: Tensor, context: StepContext) -> tuple[list[Tensor], dict[str, float]]:
        """Return the losses of the guidance on the views, if it has several."""
        found: tuple[list[Tensor], dict[str, float]] = self._guidance.losses(image, context)  # type: ignore[attr-defined]
        return found

    def grades(self, image: Tensor, poses: Sequence[Cameras], fraction: float, generator: torch.Generator) -> Tensor:
        """Grade several azimuths of the same picture, as the guidance does."""
        found: Tensor = self._guidance.grades(image, poses, fraction, generator)  # type: ignore[attr-defined]
        return found
