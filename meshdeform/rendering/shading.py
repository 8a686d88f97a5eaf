"""Shade the deformed mesh differentiably from several cameras, and combine the views into one image.

There are three kinds of shading: `normals` colours every face by its normal in the camera's frame, 0.5 + 0.5 n (as in
the builtin prior's training data); `lambert` lights neutral clay with smooth normals; and `textured` lights the asset's
own base colours in the same way. In a fixed scene, light comes from the camera's upper left, and a quarter of it is
ambient. In a varied scene (`scenes.py`), light and background change with every view, and the clay is that of the
published code: albedo 0.5, light 5 / pi, no ambient light. All kinds of shading treat surfaces as two-sided.

`textured` computes in linear light and encodes the picture as sRGB. A quarter of its light is ambient in varied scenes
too, because a texture in black shade would not be seen, and white is 1. All materials are lit, even those that the file
declares unlit, so that the shape is seen. Colours move with the surface and cut-outs with their texture, and the
picture is differentiable in both (`base_colours.py`); what is seen through a hole or through glass is drawn behind it.

Source of the combination of orthogonal views: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import ShapeError
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.rest_mesh import COLLAPSED_SHAPE
from meshdeform.rendering.base_colours import BaseColours, Layers, linear_from_srgb, srgb_from_linear
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.compiled_normals import SLIM_SHAPE, TRUST_FROM, TRUST_OVER, colour_by_normals, shrink
from meshdeform.rendering.rasterizer import SilhouetteEdges, antialias, backend, interpolate, rasterize
from meshdeform.rendering.scenes import Scene, sample_scene

__all__ = ["RenderStyle", "Renderer", "Shading", "combine_views"]


Shading = Literal["normals", "lambert", "textured", "mixed"]

_AMBIENT = 0.25
_LIGHT = (-0.4, 0.6, 0.7)  # in the camera's frame: from the upper left behind the viewer
_VARIED_GAIN = 0.5 * 5 / math.pi
"""Albedo times light of the published code."""
_TEXTURED_ODDS = 0.5
"""Share of the steps of a `mixed` style that are `textured`."""


@dataclass(frozen=True)
class RenderStyle:
    """Style of the views; each prior specifies its own.

    Attributes
    ----------
    view_size : int
        Side of one view in pixels; a combined image is twice as large.
    supersample : int
        Views are rendered at ``view_size * supersample`` pixels and averaged down.
    shading : "normals", "lambert", "textured" or "mixed"
        `mixed`: `textured` in some steps and `lambert` in the others.
    background : red, green and blue in [0, 1]
        Colour in a fixed scene.
    scene : "fixed" or "varied"
        Whether background and light are constant, or drawn for every view (`scenes.sample_scene`).
    """

    view_size: int = 64
    supersample: int = 2
    shading: Shading = "normals"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene: Literal["fixed", "varied"] = "fixed"


@dataclass(frozen=True)
class _Surface:
    """The deformed mesh as every view sees it.

    Attributes
    ----------
    clip : (B, V, 4)
    axes : (B, 3, 3)
        Rotations to the cameras' frames.
    normals : (B, V, 3)
        Unit normals of the vertices in the cameras' frames.
    cross : (F, 3)
        Normals of the faces in the world, as long as twice their area.
    facing : (B, F)
        1 for faces that are seen from their front, -1 for others.
    solid : (F,) bool
        Whether the face has an area.
    share : (F,)
        Share of its pixels' gradients that a face passes on.
    """

    clip: Tensor
    axes: Tensor
    normals: Tensor
    cross: Tensor
    facing: Tensor
    solid: Tensor
    share: Tensor


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
    n_verts : int
    style : RenderStyle
    device : str or torch.device
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
        edges = edges_of(faces.cpu())
        self.style = style
        self.n_verts = n_verts
        self.faces = faces.to(device)
        self.edges = SilhouetteEdges(edges.edges.to(device), edges.opposite.to(device))
        self._dtype = dtype
        self._background = torch.tensor(style.background, dtype=dtype, device=device)
        self._light = functional.normalize(torch.tensor(_LIGHT, dtype=dtype, device=device), dim=0)
        coloured = appearance is not None and style.shading in ("textured", "mixed")
        self._colours = BaseColours(appearance, device) if coloured and appearance is not None else None

    @property
    def shading(self) -> Shading:
        """Shading of the style, or `lambert` if that needs colours and there are none."""
        chosen = self.style.shading
        return "lambert" if chosen in ("textured", "mixed") and self._colours is None else chosen

    def sample_scene(self, views: int, generator: torch.Generator) -> Scene | None:
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
        self, verts: Tensor, cameras: Cameras, scene: Scene | None = None, shading: Shading | None = None
    ) -> Tensor:
        """Render the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame, where the views show the unit sphere.
        cameras : Cameras
            B cameras, on the mesh's device.
        scene : Scene, optional
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
        if shading == "normals" and backend.is_compiled(verts):
            return self._pooled(self._compiled_normals(verts, cameras, scene))
        surface = self._surface(verts, cameras)
        if self._colours is not None and shading in ("textured", "mixed"):
            return srgb_from_linear(self._pooled(self._textured(surface, self._colours, scene)))
        return self._pooled(self._plain(surface, scene, normals=shading == "normals"))

    def _pooled(self, image: Tensor) -> Tensor:
        if self.style.supersample == 1:
            return image
        if backend.is_compiled(image):
            return shrink(image, self.style.supersample)
        return functional.avg_pool2d(image.permute(0, 3, 1, 2), self.style.supersample).permute(0, 2, 3, 1)

    def _compiled_normals(self, verts: Tensor, cameras: Cameras, scene: Scene | None) -> Tensor:
        """Draw normals as `_plain` does, (B, side, side, 3)."""
        clip, side = _clip(verts, cameras), self.style.view_size * self.style.supersample
        fragments = rasterize(clip, self.faces, side, side)
        backdrop = self._backdrop(len(clip), side, scene)
        axes = cameras.view[:, :3, :3]
        image = colour_by_normals(verts, clip, self.faces, cameras.eye, axes, fragments.face_ids, backdrop)
        return antialias(image, clip, self.edges, fragments.depth)

    def _surface(self, verts: Tensor, cameras: Cameras) -> _Surface:
        clip, axes = _clip(verts, cameras), cameras.view.to(verts.dtype)
        corners = verts.index_select(0, self.faces.reshape(-1)).view(-1, 3, 3)
        cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with torch.no_grad():
            towards = cameras.eye[:, None] - corners[:, 0]
            facing = torch.where((cross * towards).sum(-1) < 0, -1.0, 1.0)
            # A pixel may fall on a face of almost no area. Its derivatives, of order 1 / area, would swamp all others,
            # and if the area rounds to zero, interpolation is undefined.
            longest_sq = (corners - corners.roll(1, 1)).square().sum(-1).amax(-1)
            double_area = cross.norm(dim=-1)
            solid = double_area > 2 * COLLAPSED_SHAPE * longest_sq
            shape = double_area / (2 * longest_sq).clamp_min(torch.finfo(longest_sq.dtype).tiny)
            share = (shape / SLIM_SHAPE).clamp_max(1.0)
        normals = torch.zeros_like(verts).index_add(0, self.faces.reshape(-1), cross.repeat_interleave(3, 0))
        normals = functional.normalize(normals, dim=-1, eps=1e-12) @ axes[:, :3, :3].mT
        return _Surface(clip, axes[:, :3, :3], normals, cross, facing, solid, share)

    def _pixels(self, face_ids: Tensor) -> _Pixels:
        height, width = face_ids.shape[1:]
        at = (face_ids.view(-1) >= 0).nonzero()[:, 0]
        face = face_ids.view(-1).index_select(0, at)
        view = torch.div(at, height * width, rounding_mode="floor")
        return _Pixels(at, view, face, view * self.faces.shape[0] + face)

    def _plain(self, surface: _Surface, scene: Scene | None, *, normals: bool) -> Tensor:
        """Draw normals or clay, (B, side, side, 3)."""
        views, side = len(surface.clip), self.style.view_size * self.style.supersample
        fragments = rasterize(surface.clip, self.faces, side, side)
        pixels = self._pixels(fragments.face_ids)
        colour = self._normal_colours(surface, pixels, side) if normals else self._clay(surface, pixels, side, scene)
        image = self._backdrop(views, side, scene).index_copy(0, pixels.at, colour)
        return antialias(image.view(views, side, side, 3), surface.clip, self.edges, fragments.depth)

    def _textured(self, surface: _Surface, colours: BaseColours, scene: Scene | None) -> Tensor:
        """Draw the base colours in linear light, (B, side, side, 3)."""
        views, side = len(surface.clip), self.style.view_size * self.style.supersample
        layers = Layers(views, side, surface.clip)
        clip = surface.clip[:, colours.rows]
        with torch.no_grad():
            level = colours.levels(clip, colours.faces, colours.paint, side).reshape(-1)
            strides = colours.strides(clip, side)
        values = colours.values.to(clip.dtype).expand(views, -1, -1)
        for _ in range(colours.layers):
            fragments = rasterize(surface.clip, self.faces, side, side, layers.behind)
            pixels = self._pixels(fragments.face_ids)
            paint, share = colours.paint[pixels.face], surface.share[pixels.face, None]
            at = _damped(_interpolated(clip, values, colours.faces, pixels, surface.solid, side), share)
            colour = colours.colours(paint, at, level[pixels.key])
            stride = None if strides is None else strides.view(-1, 2, 2)[pixels.key]
            alpha = colours.coverage(paint, at, level[pixels.key], colour, stride)
            light = _AMBIENT + (1 - _AMBIENT) * self._diffuse(surface, pixels, side, scene)
            if not layers.add(fragments, pixels.at, colour[:, :3] * light[:, None], alpha[:, None]):
                break
        image = layers.over(linear_from_srgb(self._backdrop(views, side, scene)))
        return antialias(image, surface.clip, self.edges, layers.depth, layers.removed)

    def _backdrop(self, views: int, side: int, scene: Scene | None) -> Tensor:
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

    def _clay(self, surface: _Surface, pixels: _Pixels, side: int, scene: Scene | None) -> Tensor:
        diffuse = self._diffuse(surface, pixels, side, scene)
        brightness = _AMBIENT + (1 - _AMBIENT) * diffuse if scene is None else _VARIED_GAIN * diffuse
        return brightness[:, None].expand(-1, 3)

    def _diffuse(self, surface: _Surface, pixels: _Pixels, side: int, scene: Scene | None) -> Tensor:
        """Return the cosine (P,) between the smooth normals and the light; 0 in shade."""
        facing, share = surface.facing.reshape(-1)[pixels.key, None], surface.share[pixels.face, None]
        smooth = _interpolated(surface.clip, surface.normals, self.faces, pixels, surface.solid, side)
        light = self._light if scene is None else scene.lights.index_select(0, pixels.view)
        return (functional.normalize(_damped(smooth, share), dim=-1, eps=1e-12) * facing * light).sum(-1).clamp_min(0)


def _clip(verts: Tensor, cameras: Cameras) -> Tensor:
    """Return the places (B, V, 4) of positions (V, 3) in the views' clip space."""
    matrices = cameras.view_proj.to(verts.dtype)
    return verts @ matrices[:, :, :3].mT + matrices[:, None, :, 3]


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
    """Return zero with the gradient of a pattern that moves with the surface.

    Flat colours are constant on each face, so their gradient does not include the motion of the faces: shifting a
    sphere would have an effect at its silhouette only. The smoothly interpolated normals provide this gradient. It is
    faded out at creases, where smooth and flat normals differ.
    """
    with torch.no_grad():
        trust = (((smooth * flat).sum(-1, keepdim=True) - TRUST_FROM) / TRUST_OVER).clamp(0, 1)
    return trust * (smooth - smooth.detach())


def combine_views(images: Tensor) -> Tensor:
    """Combine the four views into one image: 0 and 1 above, 2 and 3 below.

    Parameters
    ----------
    images : (4, H, W, 3) floating

    Returns
    -------
    (1, 3, 2H, 2W), the layout that image models take.
    """
    if images.ndim != 4 or images.shape[0] != 4:
        raise ShapeError(f"expected four views (4, H, W, C), got {tuple(images.shape)}")
    rows = torch.cat([torch.cat([images[0], images[1]], 1), torch.cat([images[2], images[3]], 1)], 0)
    return rows.permute(2, 0, 1)[None]
