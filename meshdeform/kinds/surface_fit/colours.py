"""Carry the colours of an asset to a fitted field: as a texture of a level, and as scalars of the file."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from meshdeform.assets import Asset
from meshdeform.assets.build import Picture, Primitive, build_glb
from meshdeform.deformation.surface_colours import baked_appearance, welded_appearance
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.texture_stretch import texel_corners
from meshdeform.geometry.weld import weld
from meshdeform.kinds.surface_fit.base_places import within_base
from meshdeform.kinds.surface_fit.level_files import smooth_normals
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import NeuralField
from meshdeform.kinds.surface_fit.scalar_fields import ScalarField, learn_scalars
from meshdeform.kinds.surface_fit.scalar_sections import COLOUR

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST_TEXELS = 1_500_000
_SAMPLES, _KEPT_BACK = 60_000, 6_000


@dataclass(frozen=True)
class FieldColours:
    """The colours of an asset on a field: a texture with a tile for each face of the base.

    So reduced copies of the picture mix what is near on the surface.
    """

    field: NeuralField
    pixels: NDArray[np.uint8]  # (H, W, 4)
    tiles: _Floats  # (F, 3, 2): texture coordinates of the corners of the base's faces

    @classmethod
    def of(cls, asset: Asset, field: NeuralField) -> FieldColours | None:
        """Return the colours of an asset, baked; None if it has one colour."""
        welded = weld(asset.surface.positions, asset.surface.triangles)
        look = welded_appearance(asset.appearance(), welded)
        if look is None:
            return None
        corners = np.arange(len(field.verts))[:, None].repeat(3, 1)
        verts = field.evaluate(corners, np.eye(3)[:1].repeat(len(corners), 0))
        texels = texel_corners(look)
        ab, ac = (texels[:, k] - texels[:, 0] for k in (1, 2))
        count = float(np.nansum(np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])) / 2) or 4.0 * len(texels)
        detail = float(np.sqrt(welded.mesh.areas.sum() / count) / np.linalg.norm(np.ptp(verts, axis=0)))

        def curved(face: _Index, along: _Floats) -> _Floats:
            inside = along - np.maximum(along.sum(1, keepdims=True) - 1, 0) / 2  # beyond the third side: on it
            return field.evaluate(field.faces[face], np.column_stack([1 - inside.sum(1), inside]))

        base = RestMesh.of(TriangleMesh(verts, field.faces))
        baked = baked_appearance(look, welded.mesh, base, detail, _MOST_TEXELS, curved)
        texture = baked.paints[0].texture
        assert texture is not None
        return cls(field, texture.pixels, baked.texcoords.reshape(-1, 3, 2).astype(np.float64))

    def learned(self, seed: int, on_step: Callable[[], None]) -> tuple[ScalarField, float]:
        """Return the colours as scalars, sRGB in 0 to 1, and how far off they are on average where not learned."""
        random, field = np.random.default_rng(seed), self.field
        corners = field.verts[field.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        face = random.choice(len(area), _SAMPLES, p=area / area.sum())
        weights = random.dirichlet([1, 1, 1], _SAMPLES)
        at = np.einsum("pk,pkc->pc", weights, self.tiles[face]) * self.pixels.shape[1::-1]
        column, row = at.astype(np.int64).T
        values = self.pixels[row, column, :3] / 255.0
        learned, other = slice(_KEPT_BACK, None), slice(_KEPT_BACK)
        places = field.faces[face]
        found = learn_scalars(
            field.verts, places[learned], weights[learned], values[learned], name=COLOUR, seed=seed, on_step=on_step
        )
        off = np.abs(np.clip(found.values(places[other], weights[other]), 0, 1) - values[other])
        return found, float(off.mean())

    def glb(self, level: int) -> bytes:
        """Return a GLB of a level with the texture."""
        field, out = self.field, io.BytesIO()
        divided = level_of(field.faces, len(field.verts), level)
        verts, faces = field.evaluate(divided.corners, divided.weights), divided.faces
        Image.fromarray(self.pixels).convert("RGB").save(out, "PNG")
        corners = np.repeat(np.arange(len(faces)), 3)
        _, weights = within_base(field.faces, divided, corners, np.tile(np.eye(3), (len(faces), 1)))
        primitive = Primitive(
            verts[faces].reshape(-1, 3),
            np.arange(3 * len(faces)).reshape(-1, 3),
            smooth_normals(verts, faces)[faces].reshape(-1, 3),
            np.einsum("pk,pkc->pc", weights, self.tiles[corners // 4**level]),
            material="surface",
            texture=Picture(out.getvalue()),
        )
        return build_glb([primitive])
