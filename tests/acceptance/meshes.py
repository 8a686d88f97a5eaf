"""Small assets that the tests make themselves."""

from __future__ import annotations

from pathlib import Path

from meshdeform.geometry.shapes import icosphere


def write_ellipsoid(path: Path, height: float) -> Path:
    """Write a sphere of 162 vertices, stretched along Y, as an OBJ."""
    mesh = icosphere(2)
    lines = [f"v {x} {y * height} {z}" for x, y, z in mesh.verts.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines))
    return path
