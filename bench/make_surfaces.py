"""Write surfaces for `meshdeform surface-fit`: a bumpy torus, a noisy cloud of it, and an analytic implicit of genus 3.

python bench/make_surfaces.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from meshdeform.assets import build_glb
from meshdeform.geometry.mesh import TriangleMesh
from training.shapes import torus


def bumpy_torus(n: int = 240, m: int = 100) -> tuple[np.ndarray, np.ndarray]:
    """Return a torus of 2 n m triangles whose tube swells and shrinks in eight by three bumps."""
    mesh: TriangleMesh = torus(0.7, 0.25, n, m)
    verts = mesh.verts.numpy().copy()
    around = np.arctan2(verts[:, 0], verts[:, 2])
    ring = 0.7 * np.stack([np.sin(around), 0 * around, np.cos(around)], 1)
    tube = verts - ring
    turn = np.arctan2(tube[:, 1], (tube * ring).sum(1) / 0.7)
    swell = 1 + 0.15 * np.sin(8 * around) * np.cos(3 * turn)
    return ring + tube * swell[:, None], mesh.faces.numpy()


def noisy_cloud(count: int = 20_000) -> np.ndarray:
    """Return points with normals (count, 6) of the bumpy torus, off by 0.2 % of its diagonal along the normal."""
    verts, faces = bumpy_torus()
    random = np.random.default_rng(0)
    corners = verts[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = random.choice(len(faces), count, p=area / area.sum())
    weights = random.dirichlet([1, 1, 1], count)
    normals = cross[face] / area[face, None]
    diagonal = np.linalg.norm(np.ptp(verts, axis=0))
    points = np.einsum("pk,pkc->pc", weights, corners[face])
    return np.concatenate([points + 0.002 * diagonal * random.normal(size=(count, 1)) * normals, normals], 1)


def genus_3(cells: int = 96) -> tuple[np.ndarray, np.ndarray, float]:
    """Return values, origin and spacing of a thickened plane curve with three holes: f(x, y)^2 + z^2 - 0.005 scaled."""
    low, high = np.array([-1.4, -1.4, -0.4]), np.array([1.4, 1.4, 0.4])
    spacing = float((high - low).max()) / cells
    axes = [np.arange(low[i], high[i] + spacing / 2, spacing) for i in range(3)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    disc = x**2 + y**2 - 1
    flat = disc
    for k in range(3):
        a = 2 * np.pi * k / 3
        flat = flat * ((x - 0.55 * np.cos(a)) ** 2 + (y - 0.55 * np.sin(a)) ** 2 - 0.0625)
    value = flat**2 + z**2 * 0.2 - 0.005
    slope = np.sqrt(sum(g**2 for g in np.gradient(value, spacing)))
    return value / np.maximum(slope, 0.05), low, spacing


def main() -> None:
    """Write the files."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bumpy_torus.glb").write_bytes(build_glb(*bumpy_torus()))
    np.savetxt(folder / "noisy_cloud.xyz", noisy_cloud(), fmt="%.6f")
    (folder / "noisy_cloud.truth.glb").write_bytes(build_glb(*bumpy_torus()))
    values, origin, spacing = genus_3()
    np.savez(folder / "genus_3.npz", sdf=values.astype(np.float32), origin=origin, spacing=spacing)


if __name__ == "__main__":
    main()
