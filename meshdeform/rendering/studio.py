"""Photograph an asset for people: cameras that frame it closely, a light background, a soft shadow on the ground.

`preview.png` shows the asset before (upper row) and after (lower row), from four sides.

The asset is drawn as its file describes it: base colours, its own normals, cut-outs and transparency. Light comes with
the camera (from the upper left, weaker from the right) and from sky and ground, so no side is black. Surfaces are matt.
The nearest surface is drawn first; where it is transparent, the next one behind it, and so on.

Differentiable in positions and normals: within surfaces through the interpolated attributes, at silhouettes through
`antialias`. Visibility, cut-outs and the choice of a texture's copy are constants.
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
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.torch_threads import one_torch_thread
from meshdeform.rendering.base_colours import BaseColours, Layers, linear_from_srgb, srgb_from_linear
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.rasterizer import SilhouetteEdges, antialias, interpolate, rasterize

_KEY, _FILL = (-0.45, 0.65, 0.60), (0.75, 0.05, 0.65)  # in the camera's frame: x right, y up, z towards the viewer
_KEY_LIGHT, _FILL_LIGHT = 0.80, 0.16
_SKY, _GROUND = 0.32, 0.14
_FOV_DEG = 28.0
_ELEVATION_DEG = 15.0

_MARGIN = 0.9
"""Share of the view that the asset may fill."""

_UPPER, _LOWER = (0.965, 0.968, 0.972), (0.885, 0.89, 0.90)
_PLAIN = (0.94, 0.945, 0.95)
_SHADOW = 0.42
_SHADOW_SIZE = 96
_SHADOW_REACH = 1.3


@dataclass(frozen=True)
class PaintedStyle:
    """Style of the views."""

    view_size: int = 256  # side of a view in pixels
    supersample: int = 2  # views are rendered at ``view_size * supersample`` pixels and averaged down
    background: tuple[float, float, float] = (0.93, 0.93, 0.93)  # sRGB; used if `render` is given no other background


@dataclass(frozen=True)
class _View:
    """One camera's view of the surface: what its pixels are computed from."""

    # `values` (1, M, 10): normal, texture coordinates, vertex colour, and 1 where the file has a normal.

    clip: Tensor
    values: Tensor
    faces: Tensor
    paint: Tensor
    flat: Tensor
    sign: Tensor
    level: Tensor
    axes: Tensor


class PaintedRenderer:
    """Renders deformed states of one asset."""

    def __init__(self, appearance: Appearance, style: PaintedStyle) -> None:
        self.style = style
        paints = appearance.paints
        self._colours = BaseColours(appearance)
        self._rows, self._faces, self._paint = self._colours.rows, self._colours.faces, self._colours.paint
        self._double_sided = torch.tensor([paint.double_sided for paint in paints])
        self._unlit = torch.tensor([paint.unlit for paint in paints])
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
            B cameras.
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
        defined = normals.isfinite().all(-1, keepdim=True)
        values = torch.cat([torch.where(defined, normals, 0.0), defined.float()], 1)[self._rows]
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
            edges = edges_of(first[place][faces].numpy())
            self._edges = SilhouetteEdges(
                *(torch.from_numpy(each).to(positions.device) for each in (edges.edges, edges.opposite))
            )
        return self._edges


def _lit(normal: Tensor, axes: Tensor) -> Tensor:
    """Return the light (P, 1) on surfaces with unit normals (P, 3) in the world; `axes` rotates to the camera."""
    seen = normal @ axes.mT
    key, fill = (functional.normalize(normal.new_tensor(d), dim=0) for d in (_KEY, _FILL))
    sky = (1 + normal[:, 1:2]) / 2
    ambient = _GROUND + (_SKY - _GROUND) * sky
    return ambient + _KEY_LIGHT * (seen @ key).clamp_min(0)[:, None] + _FILL_LIGHT * (seen @ fill).clamp_min(0)[:, None]


@dataclass(frozen=True)
class Pose:
    """One state of the surface: positions and normals (N, 3) float64; NaN where a vertex has no normal."""

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]


class Studio:
    """Draws states of one asset at one scale.

    Parameters
    ----------
    poses : sequence of Pose
        The states that must fit the views.
    size : int
        Side of a view in pixels.
    azimuths_deg : sequence of float
        Views that every pose must fit.
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
        plain: bool = False,
    ) -> None:
        self._renderer = PaintedRenderer(appearance, PaintedStyle(size))
        self._size, self._plain = size, plain
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
        return fixed_cameras(tuple(float(a) for a in azimuths_deg), _ELEVATION_DEG, _FOV_DEG)

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


FORMATS = {".webp": "WEBP", ".gif": "GIF"}
"""Formats by file suffix."""

_SIZES = {"WEBP": 320, "GIF": 256}
_FRAME_MS, _PAUSE_MS = 60, 800
_FROM_DEG, _FRONT_DEG, _TO_DEG = 5.0, 30.0, 55.0


def morph_animation(
    appearance: Appearance, source: Pose, result: Pose, *, kind: str, size: int | None = None, frames: int = 24
) -> bytes:
    """Draw the way from the source to the result and back, with a pause at each end, while the camera swings.

    Parameters
    ----------
    size : int, optional
        Side in pixels; by default 320, and 256 for the less compact GIF.
    frames : int
        From one end to the other.
    """
    ways = [(1 - math.cos(math.pi * k / (frames - 1))) / 2 for k in range(frames)]
    azimuths = [_FROM_DEG + (_TO_DEG - _FROM_DEG) * way for way in ways]
    studio = Studio(
        appearance,
        (source, result),
        size=size or _SIZES[kind],
        azimuths_deg=azimuths[:: max(1, frames // 4)],
        plain=kind == "GIF",
    )
    there = [
        studio.photograph(_between(source, result, way), (azimuth,))[0]
        for way, azimuth in zip(ways, azimuths, strict=True)
    ]
    times = [_PAUSE_MS, *[_FRAME_MS] * (frames - 2), _PAUSE_MS]
    return _written([*there, *there[-2:0:-1]], [*times, *times[-2:0:-1]], kind)


def turntable_animation(
    appearance: Appearance, pose: Pose, *, kind: str, size: int | None = None, frames: int = 48
) -> bytes:
    """Draw one turn about the vertical axis; the parameters are those of `morph_animation`."""
    azimuths = [_FRONT_DEG + 360 * k / frames for k in range(frames)]
    studio = Studio(
        appearance,
        (pose,),
        size=size or _SIZES[kind],
        azimuths_deg=azimuths[:: max(1, frames // 12)],
        plain=kind == "GIF",
    )
    return _written([studio.photograph(pose, (azimuth,))[0] for azimuth in azimuths], [_FRAME_MS] * frames, kind)


def _between(source: Pose, result: Pose, way: float) -> Pose:
    """Return the state at a share of the way from the source to the result."""
    normals = (1 - way) * source.normals + way * result.normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Pose(
        (1 - way) * source.positions + way * result.positions,
        np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 1e-9),
    )


def _written(frames: Sequence[NDArray[np.uint8]], times: list[int], kind: str) -> bytes:
    images = [Image.fromarray(frame, "RGB") for frame in frames]
    options: dict[str, object] = {"quality": 80, "method": 2}
    if kind == "GIF":
        # One palette for all frames and no dithering: what does not change costs nothing.
        palette = _strip(images).quantize(255, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
        options = {"optimize": False, "disposal": 1}
    out = io.BytesIO()
    images[0].save(out, kind, save_all=True, append_images=images[1:], duration=times, loop=0, **options)
    return out.getvalue()


def _strip(images: Sequence[Image.Image]) -> Image.Image:
    """Return up to six of the frames side by side."""
    some = images[:: max(1, len(images) // 6)]
    strip = Image.new("RGB", (sum(image.width for image in some), some[0].height))
    for k, image in enumerate(some):
        strip.paste(image, (k * image.width, 0))
    return strip
