"""Flips and geodesic distances in JavaScript: those of the counterparts in Python, on a mesh that needs both."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from meshdeform.fields.intrinsic import delaunay
from meshdeform.fields.intrinsic_operators import HeatGeodesics
from meshdeform.geometry.shapes import grid, icosphere, join, torus

VIEWER = Path(__file__).parents[3] / "service" / "web" / "viewer"
SCRIPT = """
const [folder, file] = process.argv.slice(1);
const { readFileSync } = await import("node:fs");
const { delaunay } = await import(`${folder}/intrinsic.js`);
const { HeatGeodesics } = await import(`${folder}/heat.js`);
const { positions, indices, sources } = JSON.parse(readFileSync(file));
const mesh = delaunay(Float32Array.from(positions), Uint32Array.from(indices));
const solver = new HeatGeodesics(mesh);
const distances = sources.map((source) => Array.from(solver.distances(source), (d) => (Number.isFinite(d) ? d : null)));
console.log(JSON.stringify({ flips: mesh.flips, lengths: Array.from(mesh.lengths).sort((a, b) => a - b), distances }));
"""


def computed(folder: Path, verts: np.ndarray, faces: np.ndarray, sources: list[int]) -> dict[str, list[float]]:
    """What JavaScript makes of a mesh."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    file = folder / "mesh.json"
    given = {"positions": verts.ravel().tolist(), "indices": faces.ravel().tolist(), "sources": sources}
    file.write_text(json.dumps(given))
    run = [node, "--input-type=module", "-e", SCRIPT, VIEWER.as_uri(), str(file)]
    found: dict[str, list[float]] = json.loads(subprocess.run(run, capture_output=True, check=True, timeout=120).stdout)
    return found


def test_flips_and_distances_are_those_of_python(tmp_path: Path) -> None:
    # A long thin torus, a grid with a border, and a sphere: obtuse triangles, borders, parts without a source.
    mesh = join(torus(n=60, m=24), grid(6), icosphere(2))
    verts = mesh.verts.numpy().copy()
    verts[: 60 * 24, 0] *= 4
    verts = verts.astype(np.float32).astype(np.float64)
    faces = mesh.faces.numpy()
    sources = [0, 700, len(verts) - 1]
    found = computed(tmp_path, verts, faces, sources)
    wanted = delaunay(verts, faces)
    assert wanted.flips > 50
    assert wanted.certified
    # Where four points lie on a circle either diagonal will do; the lengths that occur are the same.
    assert found["flips"] == pytest.approx(wanted.flips, rel=0.1)
    assert np.abs(np.array(found["lengths"]) - np.sort(wanted.lengths.ravel())).max() < 1e-5
    solver = HeatGeodesics(wanted)
    for source, each in zip(sources, found["distances"], strict=True):
        ours = np.array([np.inf if d is None else d for d in each])
        exact = solver.distances([source])
        assert (np.isfinite(ours) == np.isfinite(exact)).all()
        reached = np.isfinite(exact)
        assert np.abs(ours[reached] - exact[reached]).max() < 2e-3 * exact[reached].max()


def test_distances_on_a_sphere_are_angles(tmp_path: Path) -> None:
    mesh = icosphere(4)
    verts = mesh.verts.numpy()
    found = computed(tmp_path, verts, mesh.faces.numpy(), [0])
    angles = np.arccos(np.clip(verts @ verts[0] / (verts**2).sum(1) ** 0.5 / np.linalg.norm(verts[0]), -1, 1))
    assert np.abs(np.array(found["distances"][0]) - angles * np.linalg.norm(verts[0])).mean() < 0.02
