"""Differentiable shading of the deformed mesh from several cameras, and the combination of the views in one image.

Two kinds of shading: `normals` colours every face by its normal in the camera's frame, 0.5 + 0.5 n (what the builtin
prior learned), `lambert` lights a neutral clay with smooth normals. A fixed scene lights it from the camera's upper
left, and a quarter of the light comes from everywhere; in a varied one (`scenes.py`) light and background change with
every view, and the clay is the published one: half of white, lit by 5 / pi, black where no light falls. Both kinds of
shading treat surfaces as two-sided.

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
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.operators import COLLAPSED_SHAPE
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.rasterizer import Fragments, SilhouetteEdges, antialias, interpolate, rasterize
from meshdeform.rendering.scenes import Scene, sample_scene

__all__ = ["RenderStyle", "Renderer", "combine_views"]

_SLIM_SHAPE = 1e-2
"""A face of a smaller area, over its longest edge squared, passes on a smaller share of its pixels' gradients.

What is seen on a face turns and moves by the reciprocal of its height, which holds for motions shorter than that height
only: no step of an optimiser is that short. So its gradients are those of a face as high as this shape is.
"""
_AMBIENT = 0.25
_LIGHT = (-0.4, 0.6, 0.7)  # in the camera's frame: from the upper left, behind the viewer
_VARIED_GAIN = 0.5 * 5 / math.pi
"""Albedo times light of the published code."""


@dataclass(frozen=True)
class RenderStyle:
    """How the views look; a prior names the style it was trained on.

    Attributes
    ----------
    view_size : int
        Side of one view in pixels; the combined image has twice that.
    supersample : int
        Views are drawn at ``view_size * supersample`` and averaged down.
    shading : "normals" or "lambert"
    background : red, green and blue in [0, 1]
        Of a fixed scene.
    scene : "fixed" or "varied"
        Whether background and light are always the same, or drawn for every view (`scenes.sample_scene`).
    """

    view_size: int = 64
    supersample: int = 2
    shading: Literal["normals", "lambert"] = "normals"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene: Literal["fixed", "varied"] = "fixed"


class Renderer:
    """Draws one mesh's deformed states.

    Parameters
    ----------
    faces : (F, 3) int64
        The topology, which stays.
    n_verts : int
    style : RenderStyle
    device : str or torch.device
    """

    def __init__(self, faces: Tensor, n_verts: int, style: RenderStyle, device: torch.device | str = "cpu") -> None:
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise ShapeError(f"expected faces (F, 3), got {tuple(faces.shape)}")
        edges = edges_of(faces.cpu())
        self.style = style
        self.n_verts = n_verts
        self.faces = faces.to(device)
        self.edges = SilhouetteEdges(edges.edges.to(device), edges.opposite.to(device))
        self._background = torch.tensor(style.background, dtype=torch.float32, device=device)
        self._light = functional.normalize(torch.tensor(_LIGHT, dtype=torch.float32, device=device), dim=0)

    def sample_scene(self, views: int, generator: torch.Generator) -> Scene | None:
        """Draw the surroundings of so many views, or return None where the style's scene is fixed."""
        if self.style.scene == "fixed":
            return None
        return sample_scene(views, self.style.view_size * self.style.supersample, generator, self.faces.device)

    def render(self, verts: Tensor, cameras: Cameras, scene: Scene | None = None) -> Tensor:
        """Draw the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the frame where the views show the unit sphere.
        cameras : Cameras
            B of them, on the mesh's device.
        scene : Scene, optional
            The surroundings of the B views; the style's fixed background and light unless given.

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
        verts = verts.float()
        views = cameras.view_proj.shape[0]
        clip = verts @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]
        side = self.style.view_size * self.style.supersample
        fragments = rasterize(clip, self.faces, side, side)
        pixels = (fragments.face_ids.view(-1) >= 0).nonzero()[:, 0]
        face = fragments.face_ids.view(-1).index_select(0, pixels)
        colour = self._colours(verts, clip, cameras, fragments, pixels, face, scene)
        behind = self._background.expand(views * side * side, 3) if scene is None else scene.backgrounds.reshape(-1, 3)
        image = behind.index_copy(0, pixels, colour)
        image = antialias(image.view(views, side, side, 3), clip, self.edges, fragments.depth)
        if self.style.supersample > 1:
            image = functional.avg_pool2d(image.permute(0, 3, 1, 2), self.style.supersample).permute(0, 2, 3, 1)
        return image

    def _colours(
        self,
        verts: Tensor,
        clip: Tensor,
        cameras: Cameras,
        fragments: Fragments,
        pixels: Tensor,
        face: Tensor,
        scene: Scene | None,
    ) -> Tensor:
        height, width = fragments.face_ids.shape[1:]
        view = torch.div(pixels, height * width, rounding_mode="floor")
        corners = verts.index_select(0, self.faces.reshape(-1)).view(-1, 3, 3)
        cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with torch.no_grad():
            towards = cameras.eye[:, None] - corners[:, 0]
            facing = torch.where((cross * towards).sum(-1) < 0, -1.0, 1.0)
            # A pixel may fall on a face of nearly no area. Its derivatives, of order 1 / area, would drown all others,
            # and where the area rounds to zero there is nothing to interpolate by.
            longest_sq = (corners - corners.roll(1, 1)).square().sum(-1).amax(-1)
            double_area = cross.norm(dim=-1)
            solid = (double_area > 2 * COLLAPSED_SHAPE * longest_sq).index_select(0, face)
            shape = double_area / (2 * longest_sq).clamp_min(torch.finfo(longest_sq.dtype).tiny)
            share = (shape / _SLIM_SHAPE).clamp_max(1.0).index_select(0, face)[:, None]
        key = view * self.faces.shape[0] + face
        facing = facing.reshape(-1).index_select(0, key)[:, None]
        vertex_normal = torch.zeros_like(verts).index_add(0, self.faces.reshape(-1), cross.repeat_interleave(3, 0))
        vertex_normal = functional.normalize(vertex_normal, dim=-1, eps=1e-12) @ cameras.view[:, :3, :3].mT
        if self.style.shading == "normals":
            normal = functional.normalize(cross, dim=-1, eps=1e-12) @ cameras.view[:, :3, :3].mT
            flat = normal.reshape(-1, 3).index_select(0, key)
            flat = torch.where(solid[:, None], _damped(flat, share), flat.detach())
            smooth = self._smooth(clip, vertex_normal.detach(), pixels, face, solid, (height, width))
            smooth = _damped(smooth, share)
            return 0.5 + 0.5 * facing * (flat + _motion_only(smooth, flat))
        smooth = _damped(self._smooth(clip, vertex_normal, pixels, face, solid, (height, width)), share)
        light = self._light if scene is None else scene.lights.index_select(0, view)
        diffuse = (functional.normalize(smooth, dim=-1, eps=1e-12) * facing * light).sum(-1).clamp_min(0)
        brightness = _AMBIENT + (1 - _AMBIENT) * diffuse if scene is None else _VARIED_GAIN * diffuse
        return brightness[:, None].expand(-1, 3)

    def _smooth(
        self, clip: Tensor, vertex_normal: Tensor, pixels: Tensor, face: Tensor, solid: Tensor, size: tuple[int, int]
    ) -> Tensor:
        """Vertex normals (B, V, 3) at the pixels (P, 3): interpolated, or the corners' mean where `solid` is false."""
        inside, thin = solid.nonzero()[:, 0], (~solid).nonzero()[:, 0]
        some, its_face = pixels.index_select(0, inside), face.index_select(0, inside)
        smooth = interpolate(clip, vertex_normal, self.faces, some, its_face, *size)
        view = torch.div(pixels.index_select(0, thin), size[0] * size[1], rounding_mode="floor")
        mean = vertex_normal.detach()[view[:, None], self.faces.index_select(0, face.index_select(0, thin))].mean(1)
        result = smooth.new_empty(len(pixels), 3).index_copy(0, inside, smooth)
        return result.index_copy(0, thin, mean)


def _damped(value: Tensor, share: Tensor) -> Tensor:
    """The same value, bit for bit, with a share of its gradient."""
    return value.detach() + share * (value - value.detach())


def _motion_only(smooth: Tensor, flat: Tensor) -> Tensor:
    """Zero, with the gradient of a pattern that moves with the surface.

    Flat colours are constant on each face, so on their own they do not feel that the faces move: a sphere that is
    shifted would change at its silhouette only. The smoothly interpolated normals carry that motion. At
    creases, where they say something else than the flat ones, they are faded out.
    """
    with torch.no_grad():
        trust = (((smooth * flat).sum(-1, keepdim=True) - 0.7) / 0.25).clamp(0, 1)
    return trust * (smooth - smooth.detach())


def combine_views(images: Tensor) -> Tensor:
    """Put the four views into one image: 0 and 1 above, 2 and 3 below.

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
