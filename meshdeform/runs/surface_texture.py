"""Bake the colours of the asset that was fitted into a texture of its finest level."""

from __future__ import annotations

import io

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from meshdeform.assets import Asset
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.deformation.surface_colours import baked_appearance, welded_appearance
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.quality import texel_corners
from meshdeform.geometry.weld import weld
from meshdeform.kinds.surface_fit.base_places import within_base
from meshdeform.kinds.surface_fit.level_files import smooth_normals
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import NeuralField

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST_TEXELS = 1_500_000


def coloured_level(asset: Asset, field: NeuralField, level: int) -> bytes | None:
    """Return a GLB of a level with the colours of an asset; None if the asset has one colour.

    Each face of the base has a tile, so that reduced copies of the picture mix what is near on the surface.
    """
    welded = weld(asset.surface.positions, asset.surface.triangles)
    look = welded_appearance(asset.appearance(), welded)
    if look is None:
        return None
    divided = level_of(field.faces, len(field.verts), level)
    verts, faces = field.evaluate(divided.corners, divided.weights), divided.faces
    base = RestMesh.of(TriangleMesh(torch.from_numpy(verts[: len(field.verts)]), torch.from_numpy(field.faces)))
    texels = texel_corners(look)
    ab, ac = (texels[:, k] - texels[:, 0] for k in (1, 2))
    count = float(np.nansum(np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])) / 2) or 4.0 * len(texels)
    detail = float(np.sqrt(welded.mesh.areas.sum() / count) / np.linalg.norm(np.ptp(verts, axis=0)))

    def curved(face: _Index, along: _Floats) -> _Floats:
        inside = along - np.maximum(along.sum(1, keepdims=True) - 1, 0) / 2  # beyond the third side: on it
        return field.evaluate(field.faces[face], np.column_stack([1 - inside.sum(1), inside]))

    baked = baked_appearance(look, welded.mesh, base, detail, _MOST_TEXELS, curved)
    texture, out = baked.paints[0].texture, io.BytesIO()
    assert texture is not None
    Image.fromarray(texture.pixels).convert("RGB").save(out, "PNG")
    found = np.repeat(np.arange(len(faces)), 3)
    _, weights = within_base(field.faces, divided, found, np.tile(np.eye(3), (len(faces), 1)))
    tiles = baked.texcoords.reshape(-1, 3, 2)[found // 4**level]
    primitive = Primitive(
        verts[faces].reshape(-1, 3),
        np.arange(3 * len(faces)).reshape(-1, 3),
        smooth_normals(verts, faces)[faces].reshape(-1, 3),
        np.einsum("pk,pkc->pc", weights, tiles),
        material="surface",
        texture=out.getvalue(),
    )
    return build_glb([primitive])
