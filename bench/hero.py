"""Make the animated picture at the top of the README: a painted animal becomes a camel and goes back.

    python -m bench.hero

The animal is the quadruped of the benchmark in 9,680 triangles, painted by formula with vertex colours, which a
deformation keeps. It is fitted to a camel by shape, with seed 2.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from meshdeform.assets import build_glb
from training.evaluation.sources import quadruped

PROMPT = "a camel"
COAT, PATCH, MUZZLE, HOOF = (0.80, 0.52, 0.22), (0.30, 0.10, 0.03), (0.86, 0.66, 0.42), (0.07, 0.04, 0.03)
"""Linear colours."""


def painted_animal(cells: int = 22) -> bytes:
    """Return the GLB of a quadruped with patches, hooves and a muzzle, of 20 * cells^2 triangles."""
    mesh = quadruped(cells)
    verts, faces = mesh.verts, mesh.faces
    normals = trimesh.Trimesh(verts, faces, process=False).vertex_normals
    return build_glb(verts, faces, normals=normals, colors=coat(verts))


def coat(verts: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return linear colours (V, 3) float32 of patches, hooves and a muzzle."""
    centres = np.random.default_rng(3).uniform(verts.min(0), verts.max(0), (420, 3))
    nearest = np.sort(np.linalg.norm(verts[:, None] - centres, axis=2), axis=1)[:, :2]
    # Between two cells the coat shows; the wider the gap, the nearer both centres are.
    patch = np.clip((nearest[:, 1] - nearest[:, 0] - 0.016) / 0.012, 0, 1)[:, None]
    colors = (1 - patch) * np.array(COAT) + patch * np.array(PATCH)
    low, high = verts[:, 1].min(), verts[:, 1].max()
    height = ((verts[:, 1] - low) / (high - low))[:, None]
    colors = np.where(height < 0.09, np.array(HOOF), colors)
    front = verts[:, 2].max()
    muzzle = np.clip((verts[:, 2] - front + 0.14) / 0.05, 0, 1)[:, None]
    colors = (1 - muzzle) * colors + muzzle * np.array(MUZZLE)
    colors = np.where((verts[:, 2] > front - 0.012)[:, None], np.array(HOOF), colors)
    return colors.astype(np.float32)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        asset, result = Path(folder) / "animal.glb", Path(folder) / "result.glb"
        asset.write_bytes(painted_animal())
        meshdeform = [sys.executable, "-m", "meshdeform"]
        subprocess.run([*meshdeform, "run", str(asset), PROMPT, "-o", str(result), "--seed", "2"], check=True)
        subprocess.run(
            [*meshdeform, "animate", str(asset), str(result), "--force", "-o", "docs/pictures/hero.webp"], check=True
        )


if __name__ == "__main__":
    main()
