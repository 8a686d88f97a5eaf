"""Shade the deformed mesh differentiably from several cameras, and combine the views into one image.

There are two kinds of shading: `normals` colours every face by its normal in the camera's frame, 0.5 + 0.5 n (as in the
builtin prior's training data), and `lambert` lights neutral clay with smooth normals. In a fixed scene, light comes
from the camera's upper left, and a quarter of it is ambient. In a varied scene (`scenes.py`), light and background
change with every view, and the clay is that of the published code: albedo 0.5, light 5 / pi, no ambient light. Both
kinds of shading treat surfaces as two-sided.

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
"""Below this area over longest edge squared, a face passes on a smaller share of its pixels' gradients.

The gradient of a pixel grows with the reciprocal of the face's height, but is only valid for motions shorter than that
height, and no optimiser step is that short. The gradient is therefore limited to that of a face of this shape.
"""
_AMBIENT = 0.25
_LIGHT = (-0.4, 0.6, 0.7)  # in the camera's frame: from the upper left behind the viewer
_VARIED_GAIN = 0.5 * 5 / math.pi
"""Albedo times light of the published code."""


@dataclass(frozen=True)
class RenderStyle:
    """Style of the views; each prior specifies its own.

    Attributes
    ----------
    view_size : int
        Side of one view in pixels; the combined image is twice as large.
    supersample : int
        Views are rendered at ``view_size * supersample`` pixels and averaged down.
    shading : "normals" or "lambert"
    background : red, green and blue in [0, 1]
        Colour in a fixed scene.
    scene : "fixed" or "varied"
        Whether background and light are constant, or drawn for every view (`scenes.sample_scene`).
    """

    view_size: int = 64
    supersample: int = 2
    shading: Literal["normals", "lambert"] = "normals"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene: Literal["fixed", "varied"] = "fixed"


class Renderer:
    """Renders the deformed states of one mesh.

    Parameters
    ----------
    faces : (F, 3) int64
        The fixed topology.
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
        """Draw the background and light of `views` views, or return None if the style's scene is fixed."""
        if self.style.scene == "fixed":
            return None
        return sample_scene(views, self.style.view_size * self.style.supersample, generator, self.faces.device)

    def render(self, verts: Tensor, cameras: Cameras, scene: Scene | None = None) -> Tensor:
        """Render the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame, where the views show the unit sphere.
        cameras : Cameras
            B cameras, on the mesh's device.
        scene : Scene, optional
            Background and light of the B views; by default the style's fixed ones.

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
        background = (
            self._background.expand(views * side * side, 3) if scene is None else scene.backgrounds.reshape(-1, 3)
        )
        image = background.index_copy(0, pixels, colour)
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
            # A pixel may fall on a face of almost no area. Its derivatives, of order 1 / area, would swamp all others,
            # and if the area rounds to zero, interpolation is undefined.
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
        """Return vertex normals (B, V, 3) at pixels (P, 3): interpolated, or the mean of corners if not `solid`."""
        inside, thin = solid.nonzero()[:, 0], (~solid).nonzero()[:, 0]
        inside_pixels, inside_face = pixels.index_select(0, inside), face.index_select(0, inside)
        smooth = interpolate(clip, vertex_normal, self.faces, inside_pixels, inside_face, *size)
        view = torch.div(pixels.index_select(0, thin), size[0] * size[1], rounding_mode="floor")
        mean = vertex_normal.detach()[view[:, None], self.faces.index_select(0, face.index_select(0, thin))].mean(1)
        result = smooth.new_empty(len(pixels), 3).index_copy(0, inside, smooth)
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
        trust = (((smooth * flat).sum(-1, keepdim=True) - 0.7) / 0.25).clamp(0, 1)
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
