"""Rasterise: find the nearest triangle at each pixel, and antialias silhouettes differentiably.

There is one backend per kind of device: a compiled loop on the CPU, plain torch elsewhere. Both use the same exact
integer arithmetic and therefore agree on every pixel except for ties in depth.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.rendering.rasterizer import backend
from meshdeform.rendering.rasterizer.antialias import SilhouetteEdges, antialias
from meshdeform.rendering.rasterizer.interpolate import interpolate
from meshdeform.rendering.rasterizer.spans import EMPTY_DEPTH

__all__ = ["EMPTY_DEPTH", "Fragments", "SilhouetteEdges", "antialias", "interpolate", "rasterize"]


@dataclass(frozen=True)
class Fragments:
    """The nearest triangle at each pixel centre.

    Attributes
    ----------
    face_ids : (B, H, W) int64
        Index of the face, -1 where there is none. Row 0 is the top of the image.
    depth : (B, H, W) float32
        Normalised device depth: -1 at the near plane, 1 at the far one, above 1 beyond it; `EMPTY_DEPTH` where there
        is no face.
    """

    face_ids: Tensor
    depth: Tensor


def rasterize(clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None) -> Fragments:
    """Find the nearest triangle at each pixel centre; triangles are two-sided.

    Triangles with a vertex at or behind the camera plane are dropped. The result is not differentiable: gradients come
    from shading on the visible surface and from `antialias` at silhouettes.

    Parameters
    ----------
    clip : (B, V, 4) floating
        Vertex positions in clip space (x right, y up).
    faces : (F, 3) int64
    height, width : int
        Pixels.
    behind : (B, H, W) float32, optional
        Depth of each pixel up to which triangles are ignored, to find the next layer of a transparent surface.

    Raises
    ------
    ShapeError
        `clip` is not (B, V, 4) or `faces` not (F, 3).
    """
    if clip.ndim != 3 or clip.shape[2] != 4 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ShapeError(f"expected clip (B, V, 4) and faces (F, 3), got {tuple(clip.shape)} and {tuple(faces.shape)}")
    if backend.is_compiled(clip):
        from meshdeform.rendering.rasterizer.compiled import rasterize_compiled

        return Fragments(*rasterize_compiled(clip.detach(), faces, height, width, behind))
    from meshdeform.rendering.rasterizer.spans import rasterize_spans

    return Fragments(*rasterize_spans(clip.detach(), faces, height, width, behind))
