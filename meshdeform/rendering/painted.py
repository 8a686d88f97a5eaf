"""Draw an asset as its file describes it: base colours, its own normals, cut-outs and transparency.

Light comes with the camera (from the upper left, weaker from the right) and from sky and ground, so no side is black.
Surfaces are matt. The nearest surface is drawn first; where it is transparent, the next one behind it, and so on.

Differentiable in positions and normals: within surfaces through the interpolated attributes, at silhouettes through
`antialias`. Visibility, cut-outs and the choice of a texture's copy are constants.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.mesh import edges_of
from meshdeform.rendering.base_colours import BaseColours, Layers, linear_from_srgb, srgb_from_linear
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.rasterizer import SilhouetteEdges, antialias, interpolate, rasterize

__all__ = ["PaintedRenderer", "PaintedStyle"]

_KEY, _FILL = (-0.45, 0.65, 0.60), (0.75, 0.05, 0.65)  # in the camera's frame: x right, y up, z towards the viewer
_KEY_LIGHT, _FILL_LIGHT = 0.80, 0.16
_SKY, _GROUND = 0.32, 0.14


@dataclass(frozen=True)
class PaintedStyle:
    """Style of the views.

    Attributes
    ----------
    view_size : int
        Side of a view in pixels.
    supersample : int
        Views are rendered at ``view_size * supersample`` pixels and averaged down.
    background : red, green and blue in [0, 1]
        sRGB; used if `render` is given no other background.
    """

    view_size: int = 256
    supersample: int = 2
    background: tuple[float, float, float] = (0.93, 0.93, 0.93)


@dataclass(frozen=True)
class _View:
    """One camera's view of the surface: what its pixels are computed from.

    `values` (1, M, 10): normal, texture coordinates, vertex colour, and 1 where the file has a normal.
    """

    clip: Tensor
    values: Tensor
    faces: Tensor
    paint: Tensor
    flat: Tensor
    sign: Tensor
    level: Tensor
    axes: Tensor


class PaintedRenderer:
    """Renders deformed states of one asset.

    Parameters
    ----------
    appearance : Appearance
    style : PaintedStyle
    device : str or torch.device
    """

    def __init__(self, appearance: Appearance, style: PaintedStyle, device: torch.device | str = "cpu") -> None:
        self.style = style
        paints = appearance.paints
        self._colours = BaseColours(appearance, device)
        self._rows, self._faces, self._paint = self._colours.rows, self._colours.faces, self._colours.paint
        self._double_sided = torch.tensor([paint.double_sided for paint in paints], device=device)
        self._unlit = torch.tensor([paint.unlit for paint in paints], device=device)
        self._edges: SilhouetteEdges | None = None

    def render(self, positions: Tensor, normals: Tensor, cameras: Cameras, backdrop: Tensor | None = None) -> Tensor:
        """Render the asset from every camera.

        Parameters
        ----------
        positions : (N, 3) floating
            Positions of the surface's vertices in the cameras' frame.
        normals : (N, 3) floating
            Unit normals; NaN where there is none: faces there are flat.
        cameras : Cameras
            B cameras, on the asset's device.
        backdrop : (view_size, view_size, 3) float32 in [0, 1], optional
            sRGB picture behind the asset.

        Returns
        -------
        (B, view_size, view_size, 3) float32 in [0, 1], sRGB.
        """
        positions, normals = positions.float(), normals.float()
        views = [self._render(positions, normals, cameras, b, backdrop) for b in range(len(cameras.view_proj))]
        return torch.stack(views)

    def _render(self, positions: Tensor, normals: Tensor, cameras: Cameras, b: int, backdrop: Tensor | None) -> Tensor:
        side = self.style.view_size * self.style.supersample
        view = self._view(positions, normals, cameras, b, side)
        layers = Layers(1, side, positions)
        for _ in range(self._colours.layers):
            fragments = rasterize(view.clip, view.faces, side, side, layers.behind)
            pixels = (fragments.face_ids.view(-1) >= 0).nonzero()[:, 0]
            light, alpha = self._shade(view, pixels, fragments.face_ids.view(-1)[pixels], side)
            if not layers.add(fragments, pixels, light, alpha):
                break
        image = layers.over(self._backdrop(backdrop, positions))
        if image.requires_grad:
            clip = self._clip(positions, cameras, b)
            image = antialias(image, clip, self._silhouettes(positions), layers.depth, layers.removed)
        if self.style.supersample > 1:
            image = functional.avg_pool2d(image.permute(0, 3, 1, 2), self.style.supersample).permute(0, 2, 3, 1)
        return srgb_from_linear(image[0].clamp(0, 1))

    def _backdrop(self, backdrop: Tensor | None, like: Tensor) -> Tensor:
        size, factor = self.style.view_size, self.style.supersample
        if backdrop is None:
            return linear_from_srgb(torch.tensor(self.style.background, device=like.device)).expand(1, 3)
        linear = linear_from_srgb(backdrop.to(like.device))[:, None, :, None]
        return linear.expand(size, factor, size, factor, 3).reshape(-1, 3)

    @staticmethod
    def _clip(positions: Tensor, cameras: Cameras, b: int) -> Tensor:
        matrix = cameras.view_proj[b : b + 1]
        return positions @ matrix[:, :, :3].mT + matrix[:, None, :, 3]

    def _view(self, positions: Tensor, normals: Tensor, cameras: Cameras, b: int, side: int) -> _View:
        clip = self._clip(positions, cameras, b)[:, self._rows]
        corners = positions[self._rows[self._faces]]
        cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with torch.no_grad():
            front = (cross * (cameras.eye[b] - corners[:, 0])).sum(-1) >= 0
            kept = (front | self._double_sided[self._paint]).nonzero()[:, 0]
            level = self._colours.levels(clip, self._faces[kept], self._paint[kept], side)[0]
        given = normals.isfinite().all(-1, keepdim=True)
        values = torch.cat([torch.where(given, normals, 0.0), given.float()], 1)[self._rows]
        return _View(
            clip=clip,
            values=torch.cat([values, self._colours.values], 1)[None],
            faces=self._faces[kept],
            paint=self._paint[kept],
            flat=functional.normalize(cross[kept], dim=-1, eps=1e-20),
            sign=torch.where(front[kept], 1.0, -1.0)[:, None],
            level=level,
            axes=cameras.view[b, :3, :3],
        )

    def _shade(self, view: _View, pixels: Tensor, face: Tensor, side: int) -> tuple[Tensor, Tensor]:
        """Return linear light (P, 3) and alpha (P, 1) of the surface at pixels."""
        at = interpolate(view.clip, view.values, view.faces, pixels, face, side, side)
        paint = view.paint[face]
        colour = self._colours.colours(paint, at[:, 4:], view.level[face])
        alpha = self._colours.opacity(paint, colour)
        smooth = at[:, :3]
        usable = (at[:, 3:4] > 0.999) & (smooth.detach().norm(dim=-1, keepdim=True) > 1e-3)
        normal = functional.normalize(torch.where(usable, smooth, view.flat[face]), dim=-1, eps=1e-12)
        light = torch.where(self._unlit[paint][:, None], 1.0, _lit(normal * view.sign[face], view.axes))
        return colour[:, :3] * light, alpha[:, None]

    def _silhouettes(self, positions: Tensor) -> SilhouetteEdges:
        """Return the edges of the surface whose vertices at one place are one; positions of the first call decide."""
        if self._edges is None:
            faces = self._rows[self._faces].cpu()
            _, place = torch.unique(positions.detach().cpu(), dim=0, return_inverse=True)
            first = torch.full((int(place.max()) + 1,), len(place)).scatter_reduce_(
                0, place, torch.arange(len(place)), "amin"
            )
            edges = edges_of(first[place][faces])
            self._edges = SilhouetteEdges(edges.edges.to(positions.device), edges.opposite.to(positions.device))
        return self._edges


def _lit(normal: Tensor, axes: Tensor) -> Tensor:
    """Return the light (P, 1) on surfaces with unit normals (P, 3) in the world; `axes` rotates to the camera."""
    seen = normal @ axes.mT
    key, fill = (functional.normalize(normal.new_tensor(d), dim=0) for d in (_KEY, _FILL))
    sky = (1 + normal[:, 1:2]) / 2
    ambient = _GROUND + (_SKY - _GROUND) * sky
    return ambient + _KEY_LIGHT * (seen @ key).clamp_min(0)[:, None] + _FILL_LIGHT * (seen @ fill).clamp_min(0)[:, None]
