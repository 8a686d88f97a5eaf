"""Shade the deformed mesh differentiably from several cameras.

There are three kinds of shading: `normals` colours every face by its normal in the camera's frame, 0.5 + 0.5 n (as in
the builtin prior's training data); `lambert` lights neutral clay with smooth normals; and `textured` lights the asset's
own base colours in the same way. In a fixed scene, light comes from the camera's upper left, and a quarter of it is
ambient. In a varied scene (`Lighting`), light and background change with every view, and the clay is that of the
published code: albedo 0.5, light 5 / pi, no ambient light. All kinds of shading treat surfaces as two-sided.

`textured` computes in linear light and encodes the picture as sRGB. A quarter of its light is ambient in varied scenes
too, because a texture in black shade would not be seen, and white is 1. All materials are lit, even those that the file
declares unlit, so that the shape is seen. Colours move with the surface and cut-outs with their texture, and the
picture is differentiable in both (`base_colours.py`); what is seen through a hole or through glass is drawn behind it.

On the CPU, `normals` is compiled, with its gradient (`normal_colours.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.srgb import linear_from_srgb, srgb_from_linear
from meshdeform.rendering import rasterizer
from meshdeform.rendering.antialiasing import SilhouetteEdges, antialias
from meshdeform.rendering.base_colours import BaseColours
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.clay import AMBIENT, LIGHT
from meshdeform.rendering.interpolation import interpolate
from meshdeform.rendering.layers import Layers
from meshdeform.rendering.normal_colours import SLIM_SHAPE, TRUST_FROM, TRUST_OVER, colour_by_normals
from meshdeform.rendering.rasterizer import projected, rasterize
from meshdeform.rendering.scenes import Lighting, sample_scene
from meshdeform.rendering.shrinking import shrink

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


Shading = Literal["normals", "lambert", "textured", "mixed"]

_VARIED_GAIN = 0.5 * 5 / math.pi
"""Albedo times light of the published code."""

_TEXTURED_ODDS = 0.5
"""Share of the steps of a `mixed` style that are `textured`."""


@dataclass(frozen=True)
class RenderStyle:
    """Style of the views; each prior specifies its own."""

    view_size: int = 64  # side of one view in pixels; a combined image is twice as large
    supersample: int = 2  # views are rendered at ``view_size * supersample`` pixels and averaged down
    shading: Shading = "normals"  # `mixed`: `textured` in some steps and `lambert` in the others
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # colour in a fixed scene
    scene: Literal["fixed", "varied"] = "fixed"
    """Whether background and light are constant, or drawn for every view (`sample_scene`)."""


@dataclass(frozen=True)
class _Surface:
    """The deformed mesh as every view sees it."""

    clip: Tensor  # (B, V, 4)
    axes: Tensor  # (B, 3, 3): rotations to the cameras' frames
    normals: Tensor  # (B, V, 3): unit normals of the vertices in the cameras' frames
    cross: Tensor  # (F, 3): normals of the faces in the world, as long as twice their area
    facing: Tensor  # (B, F): 1 for faces that are seen from their front, -1 for others
    solid: Tensor  # (F,) bool: whether the face has an area
    share: Tensor  # (F,): share of its pixels' gradients that a face passes on


@dataclass(frozen=True)
class _Pixels:
    """Pixels that show the surface: `at` (P,) indices into all views, their `view`, `face` and `key` in (B, F)."""

    at: Tensor
    view: Tensor
    face: Tensor
    key: Tensor


class Renderer:
    """Renders the deformed states of one mesh.

    Parameters
    ----------
    faces : (F, 3) int64
        The fixed topology.
    appearance : Appearance, optional
        Base colours of the faces, of which `rows` are vertices of this mesh. Without, `textured` and `mixed` draw clay.
    dtype : torch.dtype
        Precision of the picture.
    """

    def __init__(
        self,
        faces: Tensor,
        n_verts: int,
        style: RenderStyle,
        device: torch.device | str = "cpu",
        *,
        appearance: Appearance | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise ShapeError(f"expected faces (F, 3), got {tuple(faces.shape)}")
        edges = edges_of(faces.cpu().numpy())
        self.style = style
        self.n_verts = n_verts
        self.faces = faces.to(device)
        self.edges = SilhouetteEdges(*(torch.from_numpy(each).to(device) for each in (edges.edges, edges.opposite)))
        self._dtype = dtype
        self._background = torch.tensor(style.background, dtype=dtype, device=device)
        self._light = functional.normalize(torch.tensor(LIGHT, dtype=dtype, device=device), dim=0)
        coloured = appearance is not None and style.shading in ("textured", "mixed")
        self._colours = None
        if coloured and appearance is not None:
            self._colours = BaseColours(appearance, torch, lambda array: torch.from_numpy(array).to(device))

    @property
    def shading(self) -> Shading:
        """Shading of the style, or `lambert` if that needs colours and there are none."""
        chosen = self.style.shading
        return "lambert" if chosen in ("textured", "mixed") and self._colours is None else chosen

    def sample_scene(self, views: int, generator: torch.Generator) -> Lighting | None:
        """Draw the background and light of `views` views, or return None if the style's scene is fixed."""
        if self.style.scene == "fixed":
            return None
        return sample_scene(views, self.style.view_size * self.style.supersample, generator, self.faces.device)

    def sample_shading(self, generator: torch.Generator) -> Shading:
        """Draw the shading of all views of a step if the style is `mixed`: `textured` or `lambert`, with equal odds."""
        if self.shading != "mixed":
            return self.shading
        return "textured" if float(torch.rand(1, generator=generator)) < _TEXTURED_ODDS else "lambert"

    def render(
        self, verts: Tensor, cameras: Cameras, scene: Lighting | None = None, shading: Shading | None = None
    ) -> Tensor:
        """Render the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame, where the views show the unit sphere.
        cameras : Cameras
            B cameras.
        scene : Lighting, optional
            Background and light of the B views; by default the style's fixed ones.
        shading : Shading, optional
            As from `sample_shading`; by default that of the style, or `textured` for `mixed`.

        Returns
        -------
        (B, view_size, view_size, 3) float32 in [0, 1], differentiable in `verts`.

        Raises
        ------
        ShapeError
            `verts` is not (n_verts, 3).
        """
        if verts.shape != (self.n_verts, 3):
            raise ShapeError(f"expected verts ({self.n_verts}, 3), got {tuple(verts.shape)}")
        shading, verts = shading or self.shading, verts.to(self._dtype)
        if shading == "normals" and rasterizer.is_compiled(verts):
            return self._pooled(self._compiled_normals(verts, cameras, scene))
        surface = self._surface(verts, cameras)
        if self._colours is not None and shading in ("textured", "mixed"):
            light = self._pooled(self._textured(surface, self._colours, scene))
            encoded: Tensor = srgb_from_linear(light, torch)
            return encoded
        return self._pooled(self._plain(surface, scene, normals=shading == "normals"))

    def _pooled(self, image: Tensor) -> Tensor:
        if self.style.supersample == 1:
            return image
        if rasterizer.is_compiled(image):
            return shrink(image, self.style.supersample)
        return functional.avg_pool2d(image.permute(0, 3, 1, 2), self.style.supersample).permute(0, 2, 3, 1)

    def _compiled_normals(self, verts: Tensor, cameras: Cameras, scene: Lighting | None) -> Tensor:
        """Draw normals as `_plain` does, (B, side, side, 3)."""
        clip, side = projected(verts, cameras), self.style.view_size * self.style.supersample
        fragments = rasterize(clip, self.faces, side, side)
        backdrop = self._backdrop(len(clip), side, scene)
        eye, axes = torch.from_numpy(cameras.eye), torch.from_numpy(cameras.view[:, :3, :3])
        image = colour_by_normals(verts, clip, self.faces, eye, axes, fragments.face_ids, backdrop)
        return antialias(image, clip, self.edges, fragments.depth)

    def _surface(self, verts: Tensor, cameras: Cameras) -> _Surface:
        clip, axes = projected(verts, cameras), torch.from_numpy(cameras.view[:, :3, :3]).to(verts)
        corners = verts.index_select(0, self.faces.reshape(-1)).view(-1, 3, 3)
        cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with torch.no_grad():
            towards = torch.from_numpy(cameras.eye).to(verts)[:, None] - corners[:, 0]
            facing = torch.where((cross * towards).sum(-1) < 0, -1.0, 1.0)
            # A pixel may fall on a face of almost no area. Its derivatives, of order 1 / area, would swamp all others,
            # and if the area rounds to zero, interpolation is undefined.
            longest_sq = (corners - corners.roll(1, 1)).square().sum(-1).amax(-1)
            double_area = cross.norm(dim=-1)
            solid = double_area > 2 * COLLAPSED_SHAPE * longest_sq
            shape = double_area / (2 * longest_sq).clamp_min(torch.finfo(longest_sq.dtype).tiny)
            share = (shape / SLIM_SHAPE).clamp_max(1.0)
        normals = torch.zeros_like(verts).index_add(0, self.faces.reshape(-1), cross.repeat_interleave(3, 0))
        normals = functional.normalize(normals, dim=-1, eps=1e-12) @ axes.mT
        return _Surface(clip, axes, normals, cross, facing, solid, share)

    def _pixels(self, face_ids: Tensor) -> _Pixels:
        height, width = face_ids.shape[1:]
        at = (face_ids.view(-1) >= 0).nonzero()[:, 0]
        face = face_ids.view(-1).index_select(0, at)
        view = torch.div(at, height * width, rounding_mode="floor")
        return _Pixels(at, view, face, view * self.faces.shape[0] + face)

    def _plain(self, surface: _Surface, scene: Lighting | None, *, normals: bool) -> Tensor:
        """Draw normals or clay, (B, side, side, 3)."""
        views, side = len(surface.clip), self.style.view_size * self.style.supersample
        fragments = rasterize(surface.clip, self.faces, side, side)
        pixels = self._pixels(fragments.face_ids)
        colour = self._normal_colours(surface, pixels, side) if normals else self._clay(surface, pixels, side, scene)
        image = self._backdrop(views, side, scene).index_copy(0, pixels.at, colour)
        return antialias(image.view(views, side, side, 3), surface.clip, self.edges, fragments.depth)

    def _textured(self, surface: _Surface, colours: BaseColours, scene: Lighting | None) -> Tensor:
        """Draw the base colours in linear light, (B, side, side, 3)."""
        views, side = len(surface.clip), self.style.view_size * self.style.supersample
        layers = Layers(views, side, surface.clip)
        clip = surface.clip[:, colours.rows]
        with torch.no_grad():
            level = colours.levels(clip, colours.faces, colours.paint, side).reshape(-1)
            strides = colours.strides(clip, side)
        values = colours.values.T.to(clip.dtype).expand(views, -1, -1)
        for _ in range(colours.layers):
            fragments = rasterize(surface.clip, self.faces, side, side, layers.behind)
            pixels = self._pixels(fragments.face_ids)
            paint, share = colours.paint[pixels.face], surface.share[pixels.face, None]
            at = _damped(_interpolated(clip, values, colours.faces, pixels, surface.solid, side), share).T
            colour = colours.colours(paint, at, level[pixels.key])
            with torch.no_grad():
                stride = None if strides is None else strides.view(-1, 2, 2)[pixels.key]
                width = colours.edge_widths(paint, at, level[pixels.key], stride)
            alpha = colours.coverage(paint, colour, width)
            light = AMBIENT + (1 - AMBIENT) * self._diffuse(surface, pixels, side, scene)
            if not layers.add(fragments, pixels.at, (colour[:3] * light).T, alpha[:, None]):
                break
        image = layers.over(linear_from_srgb(self._backdrop(views, side, scene), torch))
        return antialias(image, surface.clip, self.edges, layers.depth, layers.removed)

    def _backdrop(self, views: int, side: int, scene: Lighting | None) -> Tensor:
        if scene is None:
            return self._background.expand(views * side * side, 3)
        return scene.backgrounds.reshape(-1, 3).to(self._dtype)

    def _normal_colours(self, surface: _Surface, pixels: _Pixels, side: int) -> Tensor:
        facing, share = surface.facing.reshape(-1)[pixels.key, None], surface.share[pixels.face, None]
        normal = functional.normalize(surface.cross, dim=-1, eps=1e-12) @ surface.axes.mT
        flat = normal.reshape(-1, 3).index_select(0, pixels.key)
        flat = torch.where(surface.solid[pixels.face, None], _damped(flat, share), flat.detach())
        smooth = _interpolated(surface.clip, surface.normals.detach(), self.faces, pixels, surface.solid, side)
        return 0.5 + 0.5 * facing * (flat + _motion_only(_damped(smooth, share), flat))

    def _clay(self, surface: _Surface, pixels: _Pixels, side: int, scene: Lighting | None) -> Tensor:
        diffuse = self._diffuse(surface, pixels, side, scene)
        brightness = AMBIENT + (1 - AMBIENT) * diffuse if scene is None else _VARIED_GAIN * diffuse
        return brightness[:, None].expand(-1, 3)

    def _diffuse(self, surface: _Surface, pixels: _Pixels, side: int, scene: Lighting | None) -> Tensor:
        """Return the cosine (P,) between the smooth normals and the light; 0 in shade."""
        facing, share = surface.facing.reshape(-1)[pixels.key, None], surface.share[pixels.face, None]
        smooth = _interpolated(surface.clip, surface.normals, self.faces, pixels, surface.solid, side)
        light = self._light if scene is None else scene.lights.index_select(0, pixels.view)
        return (functional.normalize(_damped(smooth, share), dim=-1, eps=1e-12) * facing * light).sum(-1).clamp_min(0)


def _interpolated(clip: Tensor, values: Tensor, faces: Tensor, pixels: _Pixels, solid: Tensor, side: int) -> Tensor:
    """Return values of vertices (B, V, C) at pixels (P, C): interpolated, or the mean of corners if not `solid`."""
    has_area = solid.index_select(0, pixels.face)
    inside, thin = has_area.nonzero()[:, 0], (~has_area).nonzero()[:, 0]
    inside_pixels, inside_face = pixels.at.index_select(0, inside), pixels.face.index_select(0, inside)
    smooth = interpolate(clip, values, faces, inside_pixels, inside_face, side, side)
    view, face = pixels.view.index_select(0, thin), pixels.face.index_select(0, thin)
    mean = values.detach()[view[:, None], faces.index_select(0, face)].mean(1)
    result = smooth.new_empty(len(pixels.at), values.shape[2]).index_copy(0, inside, smooth)
    return result.index_copy(0, thin, mean)


def _damped(value: Tensor, share: Tensor) -> Tensor:
    """Return bit-identical values with a share of their gradient."""
    return value.detach() + share * (value - value.detach())


def _motion_only(smooth: Tensor, flat: Tensor) -> Tensor:
    """Return zero with the gradient of a pattern that moves with the surface."""
    # Flat colours are constant on each face, so their gradient does not include the motion of the faces: shifting a
    # sphere would have an effect at its silhouette only. The smoothly interpolated normals provide this gradient. It is
    # faded out at creases, where smooth and flat normals differ.
    with torch.no_grad():
        trust = (((smooth * flat).sum(-1, keepdim=True) - TRUST_FROM) / TRUST_OVER).clamp(0, 1)
    return trust * (smooth - smooth.detach())
