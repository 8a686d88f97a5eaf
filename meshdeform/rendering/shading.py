"""Shade the deformed mesh differentiably from several cameras, and combine the views into one image.

There are three kinds of shading: `normals` colours every face by its normal in the camera's frame, 0.5 + 0.5 n (as in
the builtin prior's training data); `lambert` lights neutral clay with smooth normals; and `textured` lights the asset's
own base colours in the same way. In a fixed scene, light comes from the camera's upper left, and a quarter of it is
ambient. In a varied scene (`Lighting`), light and background change with every view, and the clay is that of the
published code: albedo 0.5, light 5 / pi, no ambient light. All kinds of shading treat surfaces as two-sided.

`textured` computes in linear light and encodes the picture as sRGB. A quarter of its light is ambient in varied scenes
too, because a texture in black shade would not be seen, and white is 1. All materials are lit, even those that the file
declares unlit, so that the shape is seen. Colours move with the surface and cut-outs with their texture, and the
picture is differentiable in both (`base_colours.py`); what is seen through a hole or through glass is drawn behind it.

On the CPU, `normals` is compiled, with its gradient (`colour_by_normals`). Views are shared among threads. Sums are
added up in float64, of each view in the order of its pixels and faces and then of the views in their order, so the same
input gives the same bits with any number of threads.

Scenes
------
The paper renders with an arbitrary background colour (section 4.1); its code draws, for every view, one of three kinds
of background and a light from anywhere on the camera's side. The gradient then averages over surroundings, so the shape
has to match the prompt whatever the background and light.

A background is, with equal odds,

* noise: an independent colour at every pixel, blurred;
* a checkerboard of two colours, 2 to 8 squares a side, blurred;
* one colour.

The density of the light's direction is proportional to the cosine of its angle to the camera's: 45 degrees on average.

Sources: Xu et al. 2024, FusionDeformer, section 4.1 and its public code; Jain et al. 2022, Zero-shot text-guided object
generation with Dream Fields, section 4.2 (the three kinds of background).

Views
-----
Image models know single pictures, so four views a quarter turn apart share one.

Source: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable
from torch.nn import functional

from meshdeform.errors import ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.srgb import linear_from_srgb, srgb_from_linear
from meshdeform.geometry.tensors import area_vectors, through_normals
from meshdeform.rendering import rasterizer
from meshdeform.rendering.base_colours import OPAQUE_ENOUGH, BaseColours
from meshdeform.rendering.cameras import NUM_VIEWS, UNIT_SPHERE, CameraRange, Cameras, orthogonal_cameras
from meshdeform.rendering.clay import AMBIENT, LIGHT
from meshdeform.rendering.rasterizer import Fragments, SilhouetteEdges, antialias, interpolate, projected, rasterize
from meshdeform.rendering.visibility import EMPTY_DEPTH
from meshdeform.support.threads import in_ranges

SLIM_SHAPE = 1e-2
"""Below this area over longest edge squared, a face passes on a smaller share of its pixels' gradients.

The gradient of a pixel grows with the reciprocal of the face's height, but is only valid for motions shorter than that
height, and no optimiser step is that short. The gradient is therefore limited to that of a face of this shape.
"""

TRUST_FROM, TRUST_OVER = 0.7, 0.25
"""Cosine between smooth and flat normal from which, and over which, the smooth one's motion counts only partly."""

_SHORTEST = 1e-12
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_SQUARES = (2, 8)

_BLUR = (0.01, 0.06)
"""Standard deviation of the blur, as a share of the view's side."""

Shading = Literal["normals", "lambert", "textured", "mixed"]

_VARIED_GAIN = 0.5 * 5 / math.pi
"""Albedo times light of the published code."""

_TEXTURED_ODDS = 0.5
"""Share of the steps of a `mixed` style that are `textured`."""
_INFINITE = 9.0
_SEEN = 0.5
"""Opacity from which a surface, and not what is behind it, has silhouettes."""


class _Seen(NamedTuple):
    """What the views see: the cameras (B, 3) and their axes (B, 3, 3), and the face at each pixel (B, H, W), or -1."""

    eye: _Floats
    axes: _Floats
    face_ids: _Index


class _Facets(NamedTuple):
    """A mesh, the unit normals (F, 3) of its faces, their lengths before, shares (F,), and unit normals (V, 3)."""

    verts: _Floats
    faces: _Index
    normals: _Floats
    lengths: _Floats
    share: _Floats
    smooth: _Floats


@kernel
def _scaled(vectors: _Floats) -> _Floats:
    """Return the lengths (N,) of vectors (N, 3), which become unit vectors; those of no length are divided by 1e-12."""
    lengths = np.empty(len(vectors))
    for n in range(len(vectors)):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        lengths[n] = np.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / max(lengths[n], _SHORTEST)
        vectors[n, 0], vectors[n, 1], vectors[n, 2] = x * inverse, y * inverse, z * inverse
    return lengths


@kernel
def _facing(facets: _Facets, eye: _Floats, view: int, f: int) -> float:
    """Return 1 if a view sees a face from its front, else -1."""
    v, total = facets.faces[f, 0], 0.0
    for c in range(3):
        total += facets.normals[f, c] * (eye[view, c] - facets.verts[v, c])
    return -1.0 if total < 0 else 1.0


@kernel
def _draw(facets: _Facets, seen: _Seen, backdrop: _Floats, image: _Floats) -> None:
    """Fill in an image (B, H, W, 3): unit normals (F, 3), or a backdrop (B, H, W, 3) or (1, 1, 1, 3)."""
    alike, normals, axes, face_ids = backdrop.shape[1] == 1, facets.normals, seen.axes, seen.face_ids
    for view in range(face_ids.shape[0]):
        for row in range(face_ids.shape[1]):
            for column in range(face_ids.shape[2]):
                f = face_ids[view, row, column]
                if f < 0:
                    for c in range(3):
                        image[view, row, column, c] = backdrop[0, 0, 0, c] if alike else backdrop[view, row, column, c]
                    continue
                half = 0.5 * _facing(facets, seen.eye, view, f)
                for c in range(3):
                    image[view, row, column, c] = 0.5 + half * (
                        axes[view, c, 0] * normals[f, 0]
                        + axes[view, c, 1] * normals[f, 1]
                        + axes[view, c, 2] * normals[f, 2]
                    )


@kernel
def _shares(verts: _Floats, faces: _Index, lengths: _Floats) -> _Floats:
    """Return the share (F,) of its pixels' gradients that each face passes on; 0 if it has no area."""
    share = np.zeros(len(faces))
    for f in range(len(faces)):
        longest = 0.0
        for i in range(3):
            a, b, square = faces[f, i], faces[f, (i + 1) % 3], 0.0
            for c in range(3):
                square += (verts[b, c] - verts[a, c]) ** 2
            longest = max(longest, square)
        if lengths[f] > 2 * COLLAPSED_SHAPE * longest:
            share[f] = min(lengths[f] / (2 * longest) / SLIM_SHAPE, 1.0)
    return share


@kernel
def _normals(verts: _Floats, faces: _Index) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Return what `_Facets` has besides the mesh."""
    normals = area_vectors(verts, faces)
    smooth = np.zeros((len(verts), 3))
    for f in range(len(faces)):
        for i in range(3):
            for c in range(3):
                smooth[faces[f, i], c] += normals[f, c]
    _scaled(smooth)
    lengths = _scaled(normals)
    return normals, lengths, _shares(verts, faces, lengths), smooth


@kernel
def _backward(
    facets: _Facets, seen: _Seen, clip: _Floats, gradient: _Floats, d_normals: _Floats, d_clip: _Floats
) -> None:
    """Add to the gradients of each view's unit normals (B, F, 3) and of the vertices in its clip space (B, V, 4)."""
    faces, normals, share, smooth = facets.faces, facets.normals, facets.share, facets.smooth
    axes, face_ids = seen.axes, seen.face_ids
    height, width = face_ids.shape[1], face_ids.shape[2]
    x, y, g, d = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for view in range(face_ids.shape[0]):
        for row in range(height):
            for column in range(width):
                f = face_ids[view, row, column]
                if f < 0 or share[f] == 0.0:
                    continue
                # The gradient on the normal, in the world: the pixel's, turned back.
                half = 0.5 * share[f] * _facing(facets, seen.eye, view, f)
                r, s, t = gradient[view, row, column, 0], gradient[view, row, column, 1], gradient[view, row, column, 2]
                for c in range(3):
                    d[c] = half * (axes[view, 0, c] * r + axes[view, 1, c] * s + axes[view, 2, c] * t)
                    d_normals[view, f, c] += d[c]
                # Of the smooth normals only the motion counts, as `_motion_only` says.
                px, py = (column + 0.5) * (2.0 / width) - 1.0, 1.0 - (row + 0.5) * (2.0 / height)
                for i in range(3):
                    v = faces[f, i]
                    x[i] = clip[view, v, 0] - px * clip[view, v, 3]
                    y[i] = clip[view, v, 1] - py * clip[view, v, 3]
                a, b = x[1] * y[2] - y[1] * x[2], x[2] * y[0] - y[2] * x[0]
                total = a + b + x[0] * y[1] - y[0] * x[1]
                if total == 0.0:
                    continue
                a, b = a / total, b / total
                cosine = 0.0
                for i in range(3):
                    v, weight = faces[f, i], (a if i == 0 else b if i == 1 else 1.0 - a - b)
                    g[i] = d[0] * smooth[v, 0] + d[1] * smooth[v, 1] + d[2] * smooth[v, 2]
                    cosine += weight * (
                        normals[f, 0] * smooth[v, 0] + normals[f, 1] * smooth[v, 1] + normals[f, 2] * smooth[v, 2]
                    )
                trust = min(max((cosine - TRUST_FROM) / TRUST_OVER, 0.0), 1.0)
                if trust == 0.0:
                    continue
                mean = a * g[0] + b * g[1] + (1.0 - a - b) * g[2]
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    # The area opposite to corner i is x_j y_k - y_j x_k.
                    d_area = trust * (g[i] - mean) / total
                    v, dx, dy = faces[f, j], d_area * y[k], -d_area * x[k]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy
                    v, dx, dy = faces[f, k], -d_area * y[j], d_area * x[j]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy


@kernel
def _shrink(image: _Floats, factor: int, out: _Floats) -> None:
    """Fill in the means (H, W, C) of squares of an image (factor H, factor W C)."""
    height, width, channels = out.shape
    share = out.dtype.type(1.0 / (factor * factor))
    sums = np.empty(image.shape[1], out.dtype)
    for row in range(height):
        sums[:] = image[row * factor]
        for i in range(1, factor):
            sums += image[row * factor + i]
        for column in range(width):
            begin = column * factor * channels
            for c in range(channels):
                total = sums[begin + c]
                for j in range(1, factor):
                    total += sums[begin + j * channels + c]
                out[row, column, c] = total * share


@kernel
def _spread(gradient: _Floats, factor: int, out: _Floats) -> None:
    """Fill in the gradient (factor H, factor W C) of `_shrink`."""
    height, width, channels = gradient.shape
    share = out.dtype.type(1.0 / (factor * factor))
    for row in range(height):
        first = out[row * factor]
        for column in range(width):
            begin = column * factor * channels
            for j in range(factor):
                for c in range(channels):
                    first[begin + j * channels + c] = gradient[row, column, c] * share
        for i in range(1, factor):
            out[row * factor + i] = first


class _Shrink(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, image: Tensor, factor: int) -> Tensor:
        views, height, width, channels = image.shape
        ctx.factor = factor  # type: ignore[attr-defined]
        out = torch.empty((views, height // factor, width // factor, channels), dtype=image.dtype)
        rows = image.detach().contiguous().view(views * height, width * channels)
        _shrink(rows.numpy(), factor, out.flatten(0, 1).numpy())
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor, None]:
        factor: int = ctx.factor  # type: ignore[attr-defined]
        views, height, width, channels = gradient.shape
        out = torch.empty((views, height * factor, width * factor, channels), dtype=gradient.dtype)
        rows = out.view(views * height * factor, width * factor * channels)
        _spread(gradient.contiguous().flatten(0, 1).numpy(), factor, rows.numpy())
        return out, None


def shrink(image: Tensor, factor: int) -> Tensor:
    """Return the means (B, H, W, C) of squares of pixels of an image (B, factor H, factor W, C) on the CPU."""
    result: Tensor = _Shrink.apply(image, factor)  # type: ignore[no-untyped-call]
    return result


def colour_by_normals(
    verts: Tensor, clip: Tensor, faces: Tensor, eye: Tensor, axes: Tensor, face_ids: Tensor, backdrop: Tensor
) -> Tensor:
    """Colour every pixel by the normal of the face that it shows.

    `verts`, (V, 3) floating: positions in the world; `clip`, (B, V, 4) floating: the same positions in the views' clip
    space; `faces` is (F, 3) int64; `eye`, (B, 3) floating: positions of the cameras; `axes`, (B, 3, 3) floating:
    rotations to the cameras' frames; `face_ids`, (B, H, W) int64: the visible face at each pixel, -1 where there is
    none; `backdrop`, (B * H * W, 3) floating: colours where there is no face. Returns (B, H, W, 3) of the backdrop's
    type, differentiable once in `verts` (colours) and `clip` (their motion).
    """
    result: Tensor = _Colour.apply(verts, clip, faces, eye, axes, face_ids, backdrop)  # type: ignore[no-untyped-call]
    return result


class _Colour(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: FunctionCtx,
        verts: Tensor,
        clip: Tensor,
        faces: Tensor,
        eye: Tensor,
        axes: Tensor,
        face_ids: Tensor,
        backdrop: Tensor,
    ) -> Tensor:
        points, positions, corners, eyes, turns, ids = (
            t.detach().contiguous().numpy() for t in (verts, clip, faces, eye, axes, face_ids)
        )
        # One colour stays one: to repeat three numbers for each pixel takes longer than to draw.
        alike = backdrop.stride(0) == 0
        behind = (backdrop[:1].view(1, 1, 1, 3) if alike else backdrop.view(*face_ids.shape, 3)).contiguous().numpy()
        image = torch.empty((*face_ids.shape, 3), dtype=backdrop.dtype)
        pixels = image.numpy()
        facets = _Facets(points, corners, *_normals(points, corners))

        def draw(begin: int, end: int) -> None:
            at = slice(begin, end)
            _draw(facets, _Seen(eyes[at], turns[at], ids[at]), behind if alike else behind[at], pixels[at])

        in_ranges(draw, len(ids))
        ctx.saved = (facets, positions, eyes, turns, ids)  # type: ignore[attr-defined]
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        facets, clip, eye, axes, face_ids = ctx.saved  # type: ignore[attr-defined]
        verts, faces, lengths = facets.verts, facets.faces, facets.lengths
        incoming = gradient.contiguous().numpy()
        d_verts, d_clip, d_normals = np.zeros(verts.shape), np.zeros(clip.shape), np.zeros((len(clip), *faces.shape))

        def through_views(begin: int, end: int) -> None:
            at = slice(begin, end)
            seen = _Seen(eye[at], axes[at], face_ids[at])
            _backward(facets, seen, clip[at], incoming[at], d_normals[at], d_clip[at])

        in_ranges(through_views, len(clip))
        inverse = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > _SHORTEST)
        through_normals(verts, faces, facets.normals, inverse, d_normals.sum(0), d_verts)
        return (torch.from_numpy(d_verts.astype(verts.dtype)), torch.from_numpy(d_clip.astype(clip.dtype)), *[None] * 5)


@dataclass(frozen=True)
class Lighting:
    """Background and light of B views."""

    backgrounds: Tensor  # (B, S, S, 3) float32 in [0, 1]
    lights: Tensor
    """(B, 3) float32: unit vectors towards the light, in each camera's frame (x right, y up, z towards the viewer)."""


def sample_scene(views: int, side: int, generator: torch.Generator, device: torch.device | str = "cpu") -> Lighting:
    """Draw the backgrounds and lights of one step.

    `views`: number of views, B; `side`: side of a view, S, in pixels; `generator`: the job's only source of randomness.
    """
    backgrounds = torch.stack([_background(side, generator) for _ in range(views)])
    u = torch.rand(views, 2, generator=generator, dtype=torch.float64)
    sine, turn = u[:, 0].sqrt(), 2 * math.pi * u[:, 1]
    lights = torch.stack([sine * turn.cos(), sine * turn.sin(), (1 - u[:, 0]).sqrt()], 1).float()
    return Lighting(backgrounds.to(device), lights.to(device))


def _background(side: int, generator: torch.Generator) -> Tensor:
    """Draw one background (S, S, 3)."""
    kind, width, count = torch.rand(3, generator=generator).tolist()
    colours = torch.rand(2, 3, generator=generator)
    if kind >= 2 / 3:
        return colours[0].expand(side, side, 3)
    sigma = (_BLUR[0] + (_BLUR[1] - _BLUR[0]) * width) * side
    if kind < 1 / 3:
        return _blurred(torch.rand(side, side, 3, generator=generator), sigma)
    squares = _SQUARES[0] + int(count * (_SQUARES[1] - _SQUARES[0] + 1))
    cell = torch.div(torch.arange(side) * squares, side, rounding_mode="floor")
    odd = ((cell[:, None] + cell[None, :]) % 2).bool()
    return _blurred(torch.where(odd[..., None], colours[0], colours[1]), sigma)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blur an image (S, S, 3) with a Gaussian of standard deviation `sigma`, in pixels."""
    reach = min(max(math.ceil(2.5 * sigma), 1), image.shape[0] - 1)
    kernel = torch.exp(-torch.arange(-reach, reach + 1).float().square() / (2 * max(sigma, 1e-3) ** 2))
    kernel = (kernel / kernel.sum()).view(1, 1, 1, -1)
    planes = functional.pad(image.permute(2, 0, 1)[:, None], (reach,) * 4, mode="reflect")
    planes = functional.conv2d(functional.conv2d(planes, kernel), kernel.mT)
    return planes[:, 0].permute(1, 2, 0)


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


class _Layers:
    """Surfaces behind each other in B views of `side` pixels, composed from front to back in linear light.

    `like`: of the dtype and device of the picture; `behind`, (B, side, side) float32 or None: depth up to which
    triangles belong to earlier layers, for `rasterize`; `depth` and `removed`, (B, side, side) float32: for
    `antialias`: depth of the surface that is seen, and of the farthest one in front of it that is cut out.
    """

    def __init__(self, views: int, side: int, like: Tensor) -> None:
        self._shape = (views, side, side)
        self._light = like.new_zeros(views * side * side, 3)
        self._through = like.new_ones(views * side * side, 1)
        self.behind: Tensor | None = None
        self.depth = torch.full(self._shape, EMPTY_DEPTH, dtype=torch.float32, device=like.device)
        self.removed = torch.full_like(self.depth, -torch.inf)
        self._hidden = torch.zeros_like(self.depth, dtype=torch.bool)

    def add(self, fragments: Fragments, pixels: Tensor, light: Tensor, alpha: Tensor) -> bool:
        """Add the next layer behind the others; return whether what is behind it shows.

        Parameters
        ----------
        fragments : Fragments
            Found with `behind`.
        pixels : (P,) int64
            The covered pixels.
        light : (P, 3)
        alpha : (P, 1)
        """
        before = self._through[pixels]
        share = before * alpha
        self._light = self._light.index_add(0, pixels, share * light)
        self._through = self._through.index_copy(0, pixels, before - share)
        with torch.no_grad():
            # Where an earlier layer is seen, this one is too, if at all, behind it.
            left = self._through.view(self._shape)
            new = (fragments.face_ids >= 0) & ~self._hidden
            seen = new & (left < _SEEN)
            self.depth = torch.where(seen, fragments.depth, self.depth)
            self.removed = torch.where(new & ~seen, fragments.depth, self.removed)
            self._hidden |= seen
            open_ = (left > 1 - OPAQUE_ENOUGH) & (fragments.face_ids >= 0)
            self.behind = torch.where(open_, fragments.depth, _INFINITE)
            return bool(open_.any())

    def over(self, background: Tensor) -> Tensor:
        """Return the picture (B, side, side, 3) in front of a linear background (B * side * side, 3), or (1, 3)."""
        return (self._light + self._through * background).view(*self._shape, 3)


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
        layers = _Layers(views, side, surface.clip)
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


def sample_orthogonal_cameras(
    bounds: CameraRange, generator: torch.Generator, fitting_radius: float = UNIT_SPHERE, turn_deg: float = 0.0
) -> Cameras:
    """Draw the four cameras of one step: azimuth a + {0, 90, 180, 270} with a ~ U(-180, 180).

    Each elevation and the shared field of view are uniform in `bounds`. `generator`: the job's only source of
    randomness; `fitting_radius` and `turn_deg`: as in `orthogonal_cameras`.
    """
    shares = torch.rand(2 + NUM_VIEWS, generator=generator, dtype=torch.float64).tolist()
    return orthogonal_cameras(bounds, shares, fitting_radius, turn_deg)
