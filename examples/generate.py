"""Generate the assets in this folder (run by scripts/examples): closed surfaces with normals, UVs and a material.

The vertices are split at UV seams and at hard edges, as exporters do, so deforming the examples exercises the welding.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.build import build_glb
from meshdeform.geometry.shapes import icosphere

FOLDER = Path(__file__).parent
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Example:
    """An asset in memory: per-vertex arrays, triangles, and the colour of its material."""

    positions: Floats
    normals: Floats
    uvs: Floats
    triangles: Integers
    colour: tuple[float, float, float, float]


def glb(name: str) -> bytes:
    """Build the GLB file of one example and return its bytes."""
    example = EXAMPLES[name]()
    return build_glb(
        example.positions,
        example.triangles,
        normals=example.normals,
        uvs=example.uvs,
        name=name,
        material="clay",
        base_color=example.colour,
    )


def sphere() -> Example:
    """Return an icosphere of radius 0.5 with 5,120 triangles, with longitude and latitude as UVs."""
    mesh = icosphere(4)
    points, triangles = mesh.verts, mesh.faces
    u = np.arctan2(points[:, 0], points[:, 2]) / (2 * np.pi) + 0.5
    v = np.arccos(np.clip(points[:, 1], -1, 1)) / np.pi
    corner_u, corner_v = u[triangles], v[triangles]
    # For a triangle across the seam, u continues beyond 1; a pole takes the longitude of its triangle.
    crossing = corner_u.max(1) - corner_u.min(1) > 0.5
    corner_u = np.where(crossing[:, None] & (corner_u < 0.5), corner_u + 1, corner_u)
    pole = np.abs(points[triangles][:, :, 1]) > 1 - 1e-9
    others = np.where(pole, 0, corner_u).sum(1) / np.maximum((~pole).sum(1), 1)
    corner_u = np.where(pole, others[:, None], corner_u)
    keys = np.stack([triangles.ravel(), np.round(corner_u.ravel() * 1e9), np.round(corner_v.ravel() * 1e9)], 1)
    _, first, inverse = np.unique(keys.astype(np.int64), axis=0, return_index=True, return_inverse=True)
    source = triangles.ravel()[first]
    uvs = np.stack([corner_u.ravel()[first], corner_v.ravel()[first]], 1)
    return Example(0.5 * points[source], points[source], uvs, inverse.reshape(-1, 3), (0.62, 0.66, 0.72, 1.0))


def cube(cells: int = 20) -> Example:
    """Return a cube with sides of 0.8 and hard edges: six grids of `cells` squared, by default 4,800 triangles."""
    line = np.linspace(-1, 1, cells + 1)
    s, t = (axis.ravel() for axis in np.meshgrid(line, line, indexing="ij"))
    positions, normals, uvs, triangles = [], [], [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.zeros((len(s), 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, s * sign, t
            triangles.append(_grid_triangles(cells + 1, cells + 1)[:, ::-1] + len(s) * len(positions))
            positions.append(0.4 * side)
            normals.append(np.tile(np.eye(3)[axis] * sign, (len(s), 1)))
            uvs.append(np.stack([s, -t], 1) / 2 + 0.5)
    return Example(*map(np.concatenate, (positions, normals, uvs, triangles)), (0.80, 0.52, 0.36, 1.0))  # type: ignore[arg-type]


def capsule() -> Example:
    """Return an upright cylinder of radius 0.3 with round ends, 1.2 high."""
    angle = np.linspace(np.pi, 0, 25)
    arc = np.stack([0.3 * np.sin(angle), 0.3 * np.cos(angle)], 1)
    lower, upper = arc[:13] - [0, 0.3], arc[12:] + [0, 0.3]
    side = np.stack([np.full(15, 0.3), np.linspace(-0.3, 0.3, 15)], 1)[1:-1]
    return revolved(np.concatenate([lower, side, upper]), 64, (0.45, 0.68, 0.50, 1.0))


def vase() -> Example:
    """Return a solid vase, 1.2 high, with a foot, a belly, a neck and a lip."""
    height = np.linspace(0, 1, 41)
    radius = np.interp(height, [0, 0.04, 0.15, 0.38, 0.6, 0.8, 0.9, 1], [0.2, 0.21, 0.29, 0.38, 0.3, 0.15, 0.15, 0.22])
    smooth = np.convolve(np.pad(radius, 2, mode="edge"), [0.1, 0.2, 0.4, 0.2, 0.1], mode="valid")
    wall = np.stack([smooth, 1.2 * height - 0.6], 1)
    lid = np.linspace(0, 1, 7)[:-1, None] * [1, 0]
    bottom, top = lid * wall[0] + [0, wall[0, 1]], lid[::-1] * wall[-1] + [0, wall[-1, 1]]
    return revolved(np.concatenate([bottom, wall, top]), 48, (0.36, 0.50, 0.72, 1.0))


def revolved(profile: Floats, segments: int, colour: tuple[float, float, float, float]) -> Example:
    """Revolve a profile of (radius, height), from the lower pole to the upper, about the Y axis."""
    rings = len(profile)
    turn = 2 * np.pi * np.arange(segments + 1) / segments
    turn[-1] = 0.0  # the seam's two columns coincide exactly
    around = np.stack([np.sin(turn), np.zeros(segments + 1), np.cos(turn)], 1)
    positions = profile[:, None, :1] * around + profile[:, None, 1:] * [0, 1, 0]
    along = np.gradient(profile, axis=0)
    outward = np.stack([along[:, 1], -along[:, 0]], 1)
    outward[0], outward[-1] = [0, -1], [0, 1]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals = outward[:, None, :1] * around + outward[:, None, 1:] * [0, 1, 0]
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    u, v = np.meshgrid(np.arange(segments + 1) / segments, 1 - length / length[-1])
    triangles = _grid_triangles(rings, segments + 1)
    corners = positions.reshape(-1, 3)[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    # At a pole one triangle of each square has no area, and the last column's vertex is unused.
    used, faces = np.unique(triangles[area > 1e-12], return_inverse=True)
    uvs = np.stack([u.ravel(), v.ravel()], 1)
    return Example(
        positions.reshape(-1, 3)[used], normals.reshape(-1, 3)[used], uvs[used], faces.reshape(-1, 3), colour
    )


def _grid_triangles(rows: int, columns: int) -> Integers:
    """Return the triangles of a row-major grid of vertices, facing opposite to row x column."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns + 1, corner + columns
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


EXAMPLES = {"sphere": sphere, "cube": cube, "capsule": capsule, "vase": vase}


def main() -> None:
    """Write every example beside this file."""
    for name in EXAMPLES:
        data = glb(name)
        (FOLDER / f"{name}.glb").write_bytes(data)
        print(f"{name}.glb: {len(EXAMPLES[name]().triangles)} triangles, {len(data):,} bytes")


if __name__ == "__main__":
    main()
