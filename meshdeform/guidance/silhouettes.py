"""Pull the silhouettes of a mesh to those in pictures taken from given directions.

With a_k the covered share of the pixels of view k, m_k the mask, and phi_k the signed distance to its outline in shares
of the view's side, positive outside::

    loss = mean over k of  (1 - sum a m / sum (a + m - a m)) + c sum (a - m) phi / sum m + c sum d / sum m

The first term, one minus the soft intersection over union, pulls at every point of the outline with the same force; the
second with a force that grows with the distance, so that what is far outside comes back. The third sums the distances d
from the pixels of the mask that are not covered to the nearest vertex of the mesh in the picture: it draws limbs out of
a surface that has none, which the other two hardly do, since they only see how the outline itself moves. All are 0 for
equal silhouettes only.

`masks.py` says how large and where the masks are.

Source of the soft intersection over union: Liu et al. 2019, Soft Rasterizer, eq. 8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import torch
from scipy import spatial
from torch import Tensor
from torch.nn import functional

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView
from meshdeform.geometry.tensors import faces_of
from meshdeform.guidance.base import Guidance, HeavyGuidance, StepContext
from meshdeform.guidance.masks import SIDE, PlacedMask, placed_masks
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.coverage import CoverageRenderer
from meshdeform.rendering.rasterizer import projected
from meshdeform.rendering.shading import RenderStyle

_DISTANCE_WEIGHT = 8.0
_UNSEEN = RenderStyle(view_size=8, supersample=1)


@dataclass(frozen=True)
class _Placed:
    """A view with its mask in the pixels of its camera."""

    cameras: Cameras
    mask: Tensor
    distance: Tensor
    centre: Tensor

    @classmethod
    def of(cls, placed: PlacedMask, device: str | torch.device) -> Self:
        """Return a view as tensors on a device."""
        mask, away = (torch.from_numpy(each).float().to(device) for each in (placed.mask, placed.distance))
        return cls(placed.cameras, mask, away, _centre_of(mask))

    def moved_to(self, covered: Tensor) -> tuple[Tensor, Tensor]:
        """Return mask and signed distance (S, S), moved so that the mask has the centre of `covered` (S, S)."""
        with torch.no_grad():
            shift = _centre_of(covered) - self.centre if bool(covered.any()) else torch.zeros_like(self.centre)
            side = len(self.mask)
            steps = (torch.arange(side, device=covered.device) + 0.5) * (2 / side) - 1
            rows, columns = steps - shift[0] * (2 / side), steps - shift[1] * (2 / side)
            grid = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), -1)[None]
            mask = functional.grid_sample(self.mask[None, None], grid, align_corners=False)
            distance = functional.grid_sample(
                self.distance[None, None], grid, padding_mode="border", align_corners=False
            )
        return mask[0, 0], distance[0, 0]


class SilhouetteTerm:
    """The difference between the silhouettes of a mesh and those of pictures.

    Parameters
    ----------
    side : int
        Side of a view in pixels.
    """

    def __init__(
        self, views: Sequence[SilhouetteView], *, device: str | torch.device = "cpu", side: int = SIDE
    ) -> None:
        self._views, self._device, self._side = list(views), device, side
        self._placed: list[_Placed] = []
        self._renderer: CoverageRenderer | None = None

    def begin(self, mesh: TriangleMesh) -> None:
        """Find scale and position of the masks for the mesh at rest that is deformed, in the cameras' frame.

        Raises
        ------
        SilhouetteError
            The pictures contradict their directions.
        """
        self._renderer = CoverageRenderer(faces_of(mesh), len(mesh.verts), self._side, self._device)
        self._placed = [_Placed.of(each, self._device) for each in placed_masks(self._views, mesh, self._side)]

    def loss(self, verts: Tensor, _context: StepContext | None = None) -> tuple[Tensor, dict[str, float]]:
        """Return the loss above, float64 and differentiable in the vertices (V, 3); and `silhouette_iou`, its mean."""
        assert self._renderer is not None, "begin() has not been called"
        points = verts.float().to(self._device)
        total, overlap = verts.sum() * 0.0, 0.0
        for placed in self._placed:
            covered = self._renderer.render(points, placed.cameras)[0]
            mask, distance = placed.moved_to(covered)
            common = (covered * mask).sum()
            iou = common / (covered + mask - covered * mask).sum().clamp_min(1e-6)
            area = mask.sum().clamp_min(1e-6)
            far = ((covered - mask) * distance).sum() + self._unreached(points, placed.cameras, covered, mask)
            total = total + (1 - iou + _DISTANCE_WEIGHT * far / area).double().cpu()
            overlap += iou.item()
        return total / len(self._placed), {"silhouette_iou": overlap / len(self._placed)}

    def _unreached(self, verts: Tensor, cameras: Cameras, covered: Tensor, mask: Tensor) -> Tensor:
        """Return the sum of the distances from uncovered pixels of the mask to the nearest vertices, in sides."""
        clip = projected(verts, cameras)[0]
        seen = torch.stack([1 - clip[:, 1] / clip[:, 3], 1 + clip[:, 0] / clip[:, 3]], 1) / 2  # row, column
        rows, columns = ((mask > 0.5) & (covered < 0.5)).nonzero(as_tuple=True)
        if not len(rows):
            return verts.sum() * 0.0
        missing = (torch.stack([rows, columns], 1) + 0.5) / self._side
        _, nearest = spatial.KDTree(seen.detach().cpu().numpy()).query(missing.cpu().numpy())
        apart = missing.to(seen) - seen[torch.from_numpy(nearest).to(seen.device)]
        return (apart.square().sum(1) + 1e-12).sqrt().sum()


def _centre_of(image: Tensor) -> Tensor:
    """Return the centre of area (row, column) of an image (S, S), in pixels from its middle."""
    steps = torch.arange(len(image), device=image.device, dtype=image.dtype) + 0.5 - len(image) / 2
    total = image.sum().clamp_min(1e-6)
    return torch.stack([(image.sum(1) * steps).sum() / total, (image.sum(0) * steps).sum() / total])


class SilhouetteGuide:
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


class BesideSilhouettes(SilhouetteGuide):
    """Guides by pictures of the steps, and by silhouettes.

    `weight`: of the silhouettes, relative to the guidance.
    """

    def __init__(self, guidance: Guidance, term: SilhouetteTerm, weight: float, identity: dict[str, str]) -> None:
        super().__init__(term, weight, identity)
        self._guidance = guidance
        self.style = guidance.style

    @property
    def is_heavy(self) -> bool:
        """Whether the guidance beside the pictures is heavy."""
        return isinstance(self._guidance, HeavyGuidance) and self._guidance.is_heavy

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return the loss of the guidance on the views."""
        return self._guidance.loss(image, context)

    def losses(self, image: Tensor, context: StepContext) -> tuple[list[Tensor], dict[str, float]]:
        """Return the losses of the guidance on the views, if it has several."""
        evaluated: tuple[list[Tensor], dict[str, float]] = self._guidance.losses(image, context)  # type: ignore[attr-defined]
        return evaluated
