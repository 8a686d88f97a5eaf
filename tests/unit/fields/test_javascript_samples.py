"""Spectrum and samples in JavaScript: eigenvalues of the sphere and of Python, and places that keep their distance."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from meshdeform.fields.intrinsic import delaunay
from meshdeform.fields.intrinsic_operators import mass, spectrum
from meshdeform.geometry.shapes import icosphere, join, torus

VIEWER = Path(__file__).parents[3] / "service" / "web" / "viewer"
SCRIPT = """
const [folder, file] = process.argv.slice(1);
const { readFileSync } = await import("node:fs");
const [{ delaunay }, { HeatGeodesics }, { spectrum }, { whiteNoise, blueNoise }] =
  await Promise.all(["intrinsic", "heat", "spectrum", "samples"].map((name) => import(`${folder}/${name}.js`)));
const given = JSON.parse(readFileSync(file));
const [positions, indices] = [Float32Array.from(given.positions), Uint32Array.from(given.indices)];
const { values, functions } = spectrum(new HeatGeodesics(delaunay(positions, indices)), given.count);
const white = whiteNoise(positions, indices, given.samples);
console.log(JSON.stringify({
  values, functions: functions.map((x) => Array.from(x)), area: white.area,
  white: Array.from(white.points), blue: Array.from(blueNoise(positions, indices, given.samples)),
}));
"""
SAMPLES = 400


@pytest.fixture(scope="module")
def sphere_and_torus(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Vertices and faces of a sphere beside a torus, and what JavaScript makes of them."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    mesh = join(icosphere(3), torus(n=40, m=16))
    verts = mesh.verts.numpy().copy()
    verts[len(icosphere(3).verts) :, 0] += 4
    faces = mesh.faces.numpy()
    file = tmp_path_factory.mktemp("samples") / "mesh.json"
    given = {"positions": verts.ravel().tolist(), "indices": faces.ravel().tolist(), "count": 10, "samples": SAMPLES}
    file.write_text(json.dumps(given))
    run = [node, "--input-type=module", "-e", SCRIPT, VIEWER.as_uri(), str(file)]
    found = json.loads(subprocess.run(run, capture_output=True, check=True, timeout=120).stdout)
    return verts, faces, found


def test_eigenvalues_and_functions_are_those_of_python(
    sphere_and_torus: tuple[np.ndarray, np.ndarray, dict[str, Any]],
) -> None:
    verts, faces, found = sphere_and_torus
    mesh = delaunay(verts, faces)
    values, _functions = spectrum(mesh, 12)
    assert values[:2] == pytest.approx([0, 0], abs=1e-6)  # one for each part, which JavaScript leaves out
    assert found["values"] == pytest.approx(values[2:], rel=1e-3)
    assert sum(1.9 < value < 2.1 for value in found["values"]) >= 3  # l (l + 1) of the sphere
    ours = np.array(found["functions"])
    assert ours @ (mass(mesh)[:, None] * ours.T) == pytest.approx(np.eye(10), abs=1e-3)
    # Functions of one eigenvalue span the same: each of ours lies in the span of Python's, and of a few more.
    _, more = spectrum(mesh, 20)
    shares = (more.T @ (mass(mesh)[:, None] * ours.T)) ** 2
    assert (shares.sum(0) > 0.999).all()


def test_white_noise_goes_by_area_and_blue_noise_keeps_its_distance(
    sphere_and_torus: tuple[np.ndarray, np.ndarray, dict[str, Any]],
) -> None:
    verts, faces, found = sphere_and_torus
    corners = verts[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert found["area"] == pytest.approx(area.sum(), rel=1e-4)
    white, blue = (np.array(found[name]).reshape(-1, 3) for name in ("white", "blue"))
    share = area[corners[:, :, 0].mean(1) < 2].sum() / area.sum()
    for points, slack in ((white, 4.0), (blue, 2.0)):  # in standard deviations of a binomial
        assert len(points) == SAMPLES
        sphere = points[points[:, 0] < 2]
        assert np.linalg.norm(sphere, axis=1) == pytest.approx(1, abs=0.02)
        assert abs(len(sphere) - SAMPLES * share) < slack * np.sqrt(SAMPLES * share * (1 - share))
    least = [cKDTree(points).query(points, k=2)[0][:, 1].min() for points in (white, blue)]
    densest = 2 * np.sqrt(area.sum() / (2 * np.sqrt(3) * SAMPLES))
    assert least[1] > 0.6 * densest  # 0.7 in the plane, by the paper
    assert least[0] < 0.3 * densest
