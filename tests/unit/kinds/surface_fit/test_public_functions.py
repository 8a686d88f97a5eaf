"""The package's own functions: fit arrays, unfold the file, and sample its surface."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.surface_fit import fit, sample, unfold


def test_a_ball_is_fitted_unfolded_and_sampled() -> None:
    ball = icosphere(3)
    data = fit((ball.verts.numpy(), ball.faces.numpy()), base_faces=100, steps=150, batch_faces=24)
    verts, faces = unfold(data, 2)
    assert len(faces) >= 16 * 100
    assert np.abs(np.linalg.norm(verts, axis=1) - 1).mean() < 0.01
    points, normals = sample(data, 500, seed=3)
    assert points.shape == normals.shape == (500, 3)
    assert np.abs(np.linalg.norm(points, axis=1) - 1).mean() < 0.01
    assert (points * normals).sum(1).mean() > 0.97
    # Evenly: every octant has its eighth.
    octants = np.bincount((points > 0) @ [1, 2, 4], minlength=8)
    assert abs(octants - 500 / 8).max() < 15
    np.testing.assert_array_equal(points, sample(data, 500, seed=3)[0])
    with pytest.raises(ValueError, match="not a"):
        unfold(data[4:], 1)
