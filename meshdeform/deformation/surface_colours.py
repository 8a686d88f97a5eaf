"""Give the mesh that a run draws the base colours of its asset.

Welding keeps every triangle, so a welded mesh has the asset's own texture coordinates, seams included. A stand-in has
other triangles, which cross seams and may be large where the asset is flat. Its colours are therefore baked: every face
gets a square tile of a texture of its own, with about as many texels as the face has pixels, and every texel the colour
of the nearest point on the whole mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.nearest_points import NearestPoints, tree_of
from meshdeform.geometry.srgb import srgb_from_linear
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.base_colours import BaseColours

_DETAIL = 1 / 200
"""Length of a texel as a share of the diagonal: about a pixel of a view."""
_SIDES = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Sides of tiles, in texels."""
_MOST_TEXELS = 300_000
_BLOCK = 50_000
"""Texels that are looked up at once."""
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def welded_appearance(appearance: Appearance, welded: WeldedMesh) -> Appearance | None:
    """Return the look of the welded mesh's faces, of which `rows` are welded vertices; None if it has no colour."""
    if not appearance.coloured:
        return None
    chosen = welded.face_source
    return Appearance(
        np.maximum(welded.vertex_map[appearance.rows], 0),  # those of degenerate faces only are not used
        appearance.triangles[chosen],
        appearance.texcoords,
        appearance.colors,
        appearance.paint_of_triangle[chosen],
        appearance.paints,
        appearance.left_out,
    )


def baked_appearance(
    appearance: Appearance,
    whole: RestMesh,
    simple: RestMesh,
    detail: float = _DETAIL,
    most: int = _MOST_TEXELS,
    curved: Callable[[_Index, _Floats], _Floats] | None = None,
) -> Appearance:
    """Return the look of a stand-in, baked from that of the whole mesh.

    `appearance`: of the whole mesh: `rows` are its vertices; `whole` and `simple`: the whole mesh and its stand-in, at
    rest; `detail`: length of a texel as a share of the diagonal. `most`: texels, if all tiles can be as small; tiles
    have two by two at least. `curved`: returns the points (P, 3) of faces (P,) at shares (P, 2) of the way from their
    first corner to the other two, where the stand-in stands for something that is not flat.
    """
    corners = simple.verts[simple.faces]
    sides = _tile_sides(corners, detail, most)
    starts, width, height = _packed(sides)
    pixels = np.zeros((height, width, 4), np.uint8)
    tree, colours = tree_of(whole, known=True), BaseColours(appearance)
    ends = np.cumsum(sides**2)
    for rows in np.split(np.arange(len(sides)), np.searchsorted(ends, np.arange(_BLOCK, ends[-1], _BLOCK))):
        within, column, row = _texels(sides[rows])
        face = rows[within]
        along = np.stack([column, row], 1) / (sides[face] - 1)[:, None]
        a, b, c = corners[face].transpose(1, 0, 2)
        points = a + along[:, :1] * (b - a) + along[:, 1:] * (c - a) if curved is None else curved(face, along)
        nearest = NearestPoints(whole, points, simple.normals[face], tree=tree)
        found = _looked_up(colours, whole, nearest, 2 * simple.areas[face] / (sides[face] - 1) ** 2)
        pixels[starts[face, 1] + row, starts[face, 0] + column] = found
    last = sides - 1
    corners = np.stack([starts, starts + np.stack([last, 0 * last], 1), starts + np.stack([0 * last, last], 1)], 1)
    count = 3 * len(corners)
    modes = {appearance.paints[at].alpha_mode for at in np.unique(appearance.paint_of_triangle)}
    mode = "BLEND" if "BLEND" in modes else "MASK" if "MASK" in modes else "OPAQUE"
    texture = Texture(pixels, ("clamp", "clamp"), reduced=False)
    return Appearance(
        simple.faces.reshape(-1),
        np.arange(count).reshape(-1, 3),
        ((corners.reshape(-1, 2) + 0.5) / [width, height]).astype(np.float32),
        np.ones((count, 4), np.float32),
        np.zeros(len(corners), np.int64),
        (Paint((1.0, 1.0, 1.0, 1.0), texture, mode),),
        appearance.left_out,
    )


def _tile_sides(corners: _Floats, detail: float, most: int) -> _Index:
    """Return the side (F,) of the tile of each face, in texels."""
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(1)
    texel = detail * float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    while True:
        index = np.searchsorted(_SIDES, longest / texel + 1).clip(max=len(_SIDES) - 1)
        sides: _Index = np.asarray(_SIDES)[index]
        if int((sides**2).sum()) <= max(most, _SIDES[0] ** 2 * len(sides)):
            return sides
        texel *= math.sqrt(2)


def _texels(sides: _Index) -> tuple[_Index, _Index, _Index]:
    """Return face, column and row of every texel of all tiles."""
    counts = sides**2
    face = np.repeat(np.arange(len(sides)), counts)
    within = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    return face, within % sides[face], within // sides[face]


def _packed(sides: _Index) -> tuple[_Index, int, int]:
    """Return column and row (F, 2) of the tiles' first texels in one picture, and its width and height."""
    width = max(int(math.sqrt(int((sides**2).sum()))), _SIDES[-1])
    starts, top = np.zeros((len(sides), 2), np.int64), 0
    for side in _SIDES:
        chosen = np.flatnonzero(sides == side)
        number, in_row = np.arange(len(chosen)), width // side
        starts[chosen, 0], starts[chosen, 1] = number % in_row * side, top + number // in_row * side
        top += -(-len(chosen) // in_row) * side
    return starts, width, top


def _looked_up(colours: BaseColours, whole: RestMesh, nearest: NearestPoints, sizes: _Floats) -> NDArray[np.uint8]:
    """Return sRGB and opacity (P, 4) of points on the whole mesh, for texels of areas (P,)."""
    values = (colours.values[:, colours.faces[nearest.faces]] * nearest.weights.astype(np.float32)).sum(-1)
    density = colours.texel_areas()[nearest.faces] / np.maximum(whole.areas[nearest.faces], 1e-300)
    level = 0.5 * np.log2(np.maximum(density * sizes, 1e-12))
    paint = colours.paint[nearest.faces]
    found = colours.colours(paint, values, level.astype(np.float32))
    rgba = np.stack([*srgb_from_linear(np.clip(found[:3], 0, 1)), colours.opacity(paint, found)], 1)
    return np.asarray(np.rint(rgba * 255), np.uint8)
