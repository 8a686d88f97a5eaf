"""The package's own functions: fit arrays, unfold the file, and sample its surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.surface_fit import fit, sample, unfold
from meshdeform.kinds.surface_fit.gluing import glue, topology
from meshdeform.kinds.surface_fit.reader import read_field


def test_a_ball_is_fitted_unfolded_and_sampled() -> None:
    ball = icosphere(3)
    data = fit((ball.verts, ball.faces), base_faces=100, steps=150)
    verts, faces = unfold(data, 2)
    assert len(faces) >= 16 * 100
    assert np.abs(np.linalg.norm(verts, axis=1) - 1).mean() < 0.01
    points, normals = sample(data, 500, seed=3)
    assert points.shape == normals.shape == (500, 3)
    assert np.abs(np.linalg.norm(points, axis=1) - 1).mean() < 0.01
    assert (points * normals).sum(1).mean() > 0.97
    # By area: every octant has its eighth; of white noise within three standard deviations, of blue within a few.
    even = sample(data, 500, seed=3, noise="blue")[0]
    for found, off in ((points, 22), (even, 10)):
        octants = np.bincount((found > 0) @ [1, 2, 4], minlength=8)
        assert abs(octants - 500 / 8).max() < off
    # The densest packing of 500 points on a unit sphere is some 0.17 apart.
    nearest = [cKDTree(each).query(each, k=2)[0][:, 1].min() for each in (points, even)]
    assert nearest[0] < 0.02
    assert nearest[1] > 0.65 * 0.17
    assert len(np.unique(even, axis=0)) == 500
    np.testing.assert_array_equal(points, sample(data, 500, seed=3)[0])
    with pytest.raises(ValueError, match="not a"):
        unfold(data[4:], 1)


def test_the_field_unfolds_to_a_torus_of_64_000_triangles(repository: Path) -> None:
    file = repository / "examples" / "bumpy_torus.ndf"
    verts, faces = read_field(file).unfold(3)
    assert len(faces) == 64_000
    assert file.stat().st_size < 7000
    assert topology(faces, glue(verts, faces)).genus == 1
    assert np.ptp(verts, axis=0) == pytest.approx([1.97, 0.57, 1.97], abs=0.05)
