"""Pull the silhouettes of a mesh to those in pictures taken from given directions.

With a_k the covered share of the pixels of view k, m_k the mask, and phi_k the signed distance to its outline in shares
of the view's side, positive outside::

    loss = mean over k of  (1 - sum a m / sum (a + m - a m)) + c sum (a - m) phi / sum m + c sum d / sum m

The first term, one minus the soft intersection over union, pulls at every point of the outline with the same force; the
second with a force that grows with the distance, so that what is far outside comes back. The third sums the distances d
from the pixels of the mask that are not covered to the nearest vertex of the mesh in the picture: it draws limbs out of
a surface that has none, which the other two hardly do, since they only see how the outline itself moves. All are 0 for
equal silhouettes only.

**Scale.** A picture says nothing about the size of what it shows, but two pictures of one object agree: with an
ellipsoid of squared half axes A, view k sees the squared width ``4 r_k A r_k`` and height ``4 u_k A u_k``, r and u the
view's right and up. A and the squared scales of the pictures follow by non-negative least squares, so that a front and
a side get the same height, and a front and a top the same width. The size of all together is that with which the masks
spread on average as the asset does from the same directions.

**Place.** Before every comparison the mask is moved so that both silhouettes have the same centre of area, since the
solve keeps the asset's centre of mass in place.

Source of the soft intersection over union: Liu et al. 2019, Soft Rasterizer, eq. 8.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import spatial
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import SilhouetteError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.base import Guidance, HeavyGuidance, StepContext
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.rasterizer import CoverageRenderer
from meshdeform.rendering.shading import RenderStyle

_SIDE = 128
_MARGIN = 1.25
"""Radius that just fits the view, relative to the farthest point of asset or mask."""
_DISTANCE_WEIGHT = 8.0
_CONTRADICTION = 0.2
"""Relative error of a width or height above which pictures contradict their directions."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SilhouetteView:
    """A mask and the direction from which it was seen."""

    mask: NDArray[np.bool_]  # (H, W) bool: row 0 at the top
    # As in `cameras.fixed_cameras`
    azimuth_deg: float
    elevation_deg: float = 0.0
    fov_deg: float = 20.0


@dataclass(frozen=True)
class _Placed:
    """A view with its mask in the pixels of its camera."""

    cameras: Cameras
    mask: Tensor
    distance: Tensor
    centre: Tensor

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
        self, views: Sequence[SilhouetteView], *, device: str | torch.device = "cpu", side: int = _SIDE
    ) -> None:
        self._views, self._device, self._side = list(views), device, side
        self._placed: list[_Placed] = []
        self._renderer: CoverageRenderer | None = None

    def begin(self, mesh: TriangleMesh) -> None:
        """Find scale and place of the masks for the mesh at rest that is deformed, in the cameras' frame.

        Raises
        ------
        SilhouetteError
            The pictures contradict their directions.
        """
        self._renderer = CoverageRenderer(mesh.faces, len(mesh.verts), self._side, self._device)
        scales = picture_scales(self._views)
        spreads = [_spread(view.mask) * scale for view, scale in zip(self._views, scales, strict=True)]
        reach = float(mesh.verts.norm(dim=1).max())
        own = [_spread(mask) * unit for mask, unit in self._rest_masks(mesh, reach)]
        size = math.exp(float(np.mean(np.log(np.array(own) / np.array(spreads)))))
        self._placed = []
        for view, scale in zip(self._views, scales * size, strict=True):
            radius = _MARGIN * max(reach, _half_diagonal(view.mask) * scale)
            self._placed.append(self._place(view, scale, radius))

    def _rest_masks(self, mesh: TriangleMesh, reach: float) -> list[tuple[NDArray[np.bool_], float]]:
        """Return the coverage of each view by the mesh, and the length of a pixel in the plane of the origin."""
        assert self._renderer is not None
        masks = []
        for view in self._views:
            cameras = _cameras(view, _MARGIN * reach).to(self._device)
            with torch.no_grad():
                covered = self._renderer.render(mesh.verts.float().to(self._device), cameras)[0]
            masks.append((covered.cpu().numpy() > 0.5, _view_width(view, _MARGIN * reach) / self._side))
        return masks

    def _place(self, view: SilhouetteView, scale: float, radius: float) -> _Placed:
        width = _view_width(view, radius) / scale  # in pixels of the picture
        height, wide = view.mask.shape
        centre = _centre(view.mask)
        # A picture with the mask's centre of area in its middle, sampled finer than the view and averaged down.
        fine = 4
        steps = (np.arange(self._side * fine) + 0.5) / (self._side * fine) - 0.5
        rows, columns = centre[0] + steps * width, centre[1] + steps * width
        inside = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < wide))[None]
        at_rows, at_columns = (
            np.clip(np.floor(at).astype(int), 0, most - 1) for at, most in ((rows, height), (columns, wide))
        )
        sampled = view.mask[at_rows[:, None], at_columns[None]] & inside
        mask = sampled.reshape(self._side, fine, self._side, fine).mean((1, 3))
        from scipy import ndimage  # a part of scipy that no other run needs

        outside = ndimage.distance_transform_edt(~sampled) - ndimage.distance_transform_edt(sampled)
        distance = outside.reshape(self._side, fine, self._side, fine).mean((1, 3)) / (self._side * fine)
        goal, away = (torch.from_numpy(each).float().to(self._device) for each in (mask, distance))
        return _Placed(_cameras(view, radius).to(self._device), goal, away, _centre_of(goal))

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
        clip = verts @ cameras.view_proj[0, :, :3].to(verts.dtype).T + cameras.view_proj[0, :, 3].to(verts.dtype)
        places = torch.stack([1 - clip[:, 1] / clip[:, 3], 1 + clip[:, 0] / clip[:, 3]], 1) / 2  # row, column
        rows, columns = ((mask > 0.5) & (covered < 0.5)).nonzero(as_tuple=True)
        if not len(rows):
            return verts.sum() * 0.0
        missing = (torch.stack([rows, columns], 1) + 0.5) / self._side
        _, nearest = spatial.KDTree(places.detach().cpu().numpy()).query(missing.cpu().numpy())
        apart = missing.to(places) - places[torch.from_numpy(nearest).to(places.device)]
        return (apart.square().sum(1) + 1e-12).sqrt().sum()

    def overlaps(self, verts: Tensor) -> list[float]:
        """Return the intersection over union of every view's silhouettes for vertices (V, 3)."""
        return [float((a & m).sum() / max((a | m).sum(), 1)) for a, m in self.masks(verts)]

    @torch.no_grad()
    def masks(self, verts: Tensor) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Return for every view what vertices (V, 3) cover and what they should cover, (S, S) each."""
        assert self._renderer is not None, "begin() has not been called"
        masks = []
        for placed in self._placed:
            covered = self._renderer.render(verts.float().to(self._device), placed.cameras)[0]
            pair = (covered, placed.moved_to(covered)[0])
            masks.append(tuple(np.asarray(each.cpu().numpy() > 0.5) for each in pair))
        return masks  # type: ignore[return-value]


def picture_scales(views: Sequence[SilhouetteView]) -> _Floats:
    """Return lengths (K,) of a pixel of each picture, relative to one another.

    Raises SilhouetteError: the widths and heights of the masks contradict their directions.
    """
    # Unknown: the three squared half axes, then the squared scales. The first scale is 1.
    count = len(views)
    rows = []
    for number, view in enumerate(views):
        high, wide = _extents(view.mask)
        for axis, extent in ((_right(view), wide), (_up(view), high)):
            row = np.zeros(3 + count)
            row[:3] = 4 * axis**2 / extent**2
            row[3 + number] = -1.0
            rows.append(row)
    system = np.array(rows)
    from scipy.optimize import nnls  # a part of scipy that no other run needs

    scales, _ = nnls(np.delete(system, 3, 1), -system[:, 3])
    squared = np.concatenate([[1.0], scales[3:]])
    if (squared <= 0).any():
        raise _contradiction(views)
    seen = np.sqrt(np.maximum(system[:, :3] @ scales[:3], 0) / np.repeat(squared, 2))
    if np.abs(seen - 1).max() > _CONTRADICTION:
        raise _contradiction(views)
    return np.asarray(np.sqrt(squared))


def _centre_of(image: Tensor) -> Tensor:
    """Return the centre of area (row, column) of an image (S, S), in pixels from its middle."""
    steps = torch.arange(len(image), device=image.device, dtype=image.dtype) + 0.5 - len(image) / 2
    total = image.sum().clamp_min(1e-6)
    return torch.stack([(image.sum(1) * steps).sum() / total, (image.sum(0) * steps).sum() / total])


def _contradiction(views: Sequence[SilhouetteView]) -> SilhouetteError:
    sizes = "; ".join(
        f"azimuth {view.azimuth_deg:g}, elevation {view.elevation_deg:g}: {high} high and {wide} wide"
        for view in views
        for high, wide in [_extents(view.mask)]
    )
    return SilhouetteError(
        f"The pictures cannot show one object from these directions, whatever their scales. In pixels: {sizes}.",
        advice="Correct the azimuths and elevations, or leave out the picture that does not fit.",
    )


def _cameras(view: SilhouetteView, radius: float) -> Cameras:
    return fixed_cameras(view.azimuth_deg, view.elevation_deg, view.fov_deg, views=1, fitting_radius=radius)


def _view_width(view: SilhouetteView, radius: float) -> float:
    """Return the width of a view in the plane through the origin."""
    return 2 * radius / math.cos(math.radians(view.fov_deg) / 2)


def _right(view: SilhouetteView) -> _Floats:
    azimuth = math.radians(view.azimuth_deg)
    return np.array([math.cos(azimuth), 0.0, -math.sin(azimuth)])


def _up(view: SilhouetteView) -> _Floats:
    azimuth, elevation = math.radians(view.azimuth_deg), math.radians(view.elevation_deg)
    sine = math.sin(elevation)
    return np.array([-sine * math.sin(azimuth), math.cos(elevation), -sine * math.cos(azimuth)])


def _extents(mask: NDArray[np.bool_]) -> tuple[int, int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1


def _centre(mask: NDArray[np.bool_]) -> _Floats:
    return np.asarray(np.argwhere(mask).mean(0) + 0.5)


def _spread(mask: NDArray[np.bool_]) -> float:
    """Return the root mean square distance of the covered pixels from their centre."""
    return float(np.sqrt(np.argwhere(mask).var(0).sum()))


def _half_diagonal(mask: NDArray[np.bool_]) -> float:
    """Return the greatest distance of a covered pixel from the centre of area."""
    return float(np.linalg.norm(np.argwhere(mask) + 0.5 - _centre(mask), axis=1).max())


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

    `guidance`: one that can grade orientations (`deformation.orientation.Grader`); `weight`: of the silhouettes,
    relative to the guidance.
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
        evaluated: tuple[list[Tensor], dict[str, float]] = self._guidance.losses(image, context)  # type: ignore[attr-defined]
        return evaluated

    def grades(self, image: Tensor, poses: Sequence[Cameras], fraction: float, generator: torch.Generator) -> Tensor:
        """Grade several azimuths of the same picture, as the guidance does."""
        graded: Tensor = self._guidance.grades(image, poses, fraction, generator)  # type: ignore[attr-defined]
        return graded
