"""Photograph an asset for people: cameras that frame it closely, a light background, a soft shadow on the ground.

`preview.png` shows the asset before (upper row) and after (lower row), from four sides.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor
from torch.nn import functional

from meshdeform.assets import Limits, load_asset
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.torch_threads import one_torch_thread
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.painted import PaintedRenderer, PaintedStyle
from meshdeform.rendering.rasterizer import rasterize

__all__ = ["Pose", "Studio", "comparison_png", "preview_png"]


_FOV_DEG = 28.0
_MARGIN = 0.9
"""Share of the view that the asset may fill."""
_UPPER, _LOWER = (0.965, 0.968, 0.972), (0.885, 0.89, 0.90)
_PLAIN = (0.94, 0.945, 0.95)
_SHADOW = 0.42
_SHADOW_SIZE = 96
_SHADOW_REACH = 1.3


@dataclass(frozen=True)
class Pose:
    """One state of the surface: positions and normals (N, 3) float64; NaN where a vertex has no normal."""

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]


class Studio:
    """Draws states of one asset at one scale.

    Parameters
    ----------
    appearance : Appearance
    poses : sequence of Pose
        The states that must fit the views.
    size : int
        Side of a view in pixels.
    azimuths_deg : sequence of float
        Views that every pose must fit.
    elevation_deg : float
    supersample : int
    plain : bool
        Whether the background is one colour without a shadow, for formats of few colours.
    """

    def __init__(
        self,
        appearance: Appearance,
        poses: Sequence[Pose],
        *,
        size: int,
        azimuths_deg: Sequence[float],
        elevation_deg: float = 15.0,
        supersample: int = 2,
        plain: bool = False,
    ) -> None:
        self._renderer = PaintedRenderer(appearance, PaintedStyle(size, supersample))
        self._elevation, self._size, self._plain = elevation_deg, size, plain
        self._used = torch.from_numpy(np.unique(appearance.rows))
        self._faces = torch.from_numpy(appearance.rows[appearance.triangles])
        shown = torch.cat([torch.from_numpy(pose.positions)[self._used] for pose in poses])
        self._centre = (shown.amin(0) + shown.amax(0)) / 2
        self._scale = 1 / (shown - self._centre).norm(dim=1).max().clamp_min(1e-300)
        self._framing = _framing(self._cameras(azimuths_deg), ((shown - self._centre) * self._scale).float())

    @torch.no_grad()
    @one_torch_thread()
    def photograph(self, pose: Pose, azimuths_deg: Sequence[float]) -> NDArray[np.uint8]:
        """Draw a state from several sides.

        Returns
        -------
        (B, size, size, 3) uint8
        """
        positions = ((torch.from_numpy(pose.positions) - self._centre) * self._scale).float()
        cameras = self._cameras(azimuths_deg)
        cameras = replace(cameras, view_proj=self._framing @ cameras.view_proj)
        shadow, ground = self._shadow(positions), float(positions[self._used, 1].min())
        normals = torch.from_numpy(pose.normals)
        views = []
        for b in range(len(azimuths_deg)):
            one = _one(cameras, b)
            views.append(self._renderer.render(positions, normals, one, self._backdrop(one, shadow, ground))[0])
        pixels: NDArray[np.uint8] = (torch.stack(views) * 255).round().to(torch.uint8).numpy()
        return pixels

    def _cameras(self, azimuths_deg: Sequence[float]) -> Cameras:
        return fixed_cameras(tuple(float(a) for a in azimuths_deg), self._elevation, _FOV_DEG)

    def _shadow(self, positions: Tensor) -> Tensor:
        """Return the darkness (1, 1, H, W) of the ground: dark under what is near it."""
        shown = positions[self._used]
        ground = shown[:, 1].min()
        height = positions[:, 1] - ground
        flat = positions[:, [0, 2]] / _SHADOW_REACH
        # From below, orthographic: the nearest surface is the lowest one.
        clip = torch.stack([flat[:, 0], -flat[:, 1], height / 2 - 0.5, torch.ones_like(height)], 1)[None]
        depth = rasterize(clip, self._faces, _SHADOW_SIZE, _SHADOW_SIZE).depth
        dark = torch.where(depth <= 1, torch.exp(-2.5 * (2 * depth + 1).clamp_min(0)), 0.0)[:, None]
        for width in (5, 9, 9):
            dark = functional.avg_pool2d(dark, width, 1, width // 2)
        return dark

    def _backdrop(self, camera: Cameras, shadow: Tensor, ground: float) -> Tensor:
        """Return the background (size, size, 3) of one view."""
        size = self._size
        if self._plain:
            return torch.tensor(_PLAIN).expand(size, size, 3)
        at = (torch.arange(size) + 0.5) * 2 / size - 1
        x, y = at.expand(size, size), -at[:, None].expand(size, size)
        share = ((1 - y) / 2)[..., None]
        base = torch.tensor(_UPPER) * (1 - share) + torch.tensor(_LOWER) * share
        back = torch.linalg.inv(camera.view_proj[0].double()).float()
        near, far = (
            (torch.stack([x, y, torch.full_like(x, z), torch.ones_like(x)], -1) @ back.mT) for z in (-1.0, 1.0)
        )
        near, far = near[..., :3] / near[..., 3:], far[..., :3] / far[..., 3:]
        along = (ground - near[..., 1]) / (far - near)[..., 1]
        place = near + along[..., None] * (far - near)
        grid = torch.stack([place[..., 0], place[..., 2]], -1)[None] / _SHADOW_REACH
        dark = functional.grid_sample(shadow, grid.nan_to_num(9.0, 9.0, 9.0), align_corners=False)[0, 0]
        return base * (1 - _SHADOW * torch.where(along > 0, dark, 0.0)[..., None])


def _one(cameras: Cameras, b: int) -> Cameras:
    only = slice(b, b + 1)
    return replace(
        cameras,
        view_proj=cameras.view_proj[only],
        view=cameras.view[only],
        eye=cameras.eye[only],
        azimuths_deg=cameras.azimuths_deg[only],
        elevation_deg=cameras.elevation_deg[only],
    )


def _framing(cameras: Cameras, points: Tensor) -> Tensor:
    """Return the change (4, 4) of clip space that makes points (P, 3) fill all views; the horizontal centre stays."""
    low, high, wide = math.inf, -math.inf, 1e-6
    for matrix in cameras.view_proj:
        clip = points @ matrix[:, :3].mT + matrix[:, 3]
        x, y = clip[:, 0] / clip[:, 3], clip[:, 1] / clip[:, 3]
        low, high, wide = min(low, float(y.min())), max(high, float(y.max())), max(wide, float(x.abs().max()))
    zoom = _MARGIN / max(wide, (high - low) / 2)
    change = torch.diag(torch.tensor([zoom, zoom, 1.0, 1.0]))
    change[1, 3] = -zoom * (low + high) / 2
    return change


_SIZE = 256
_AZIMUTHS_DEG = (30.0, 120.0, 210.0, 300.0)


def preview_png(appearance: Appearance, source: Pose, result: Pose) -> bytes:
    """Draw both states with the asset's colours and normals, at the same scale, so that growth is visible.

    Returns
    -------
    A PNG of 1024 x 512 pixels: front, left, back and right of the source above and of the result below.
    """
    studio = Studio(appearance, (source, result), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
    rows = [np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1) for pose in (source, result)]
    return _labelled(rows, ("source", "result"))


def comparison_png(glbs: Mapping[str, bytes]) -> bytes:
    """Draw assets that need not have the same triangles, one in each row under its name, from four sides."""
    rows = []
    for data in glbs.values():
        asset = load_asset(data, limits=Limits.unlimited())
        pose = Pose(asset.surface.positions, asset.surface.normals)
        studio = Studio(asset.appearance(), (pose,), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
        rows.append(np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1))
    return _labelled(rows, list(glbs))


def _labelled(rows: Sequence[NDArray[np.uint8]], labels: Sequence[str]) -> bytes:
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(rows)), "RGB")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for row, label in enumerate(labels):
        # At the end of the row: the web page shows its beginning as a thumbnail.
        draw.text((image.width - 9, row * _SIZE + 6), label, fill=(110, 112, 118), font=font, anchor="ra")
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()
