"""Distances that are stored in a band around a surface, and a constant beyond it."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets.surface_files import DistanceGrid
from meshdeform.fields.surface_sources import surface_of

CENTRE = [1.83, 1.7, 2.0]


def test_distances_in_a_band_become_their_ball_beyond_it_too() -> None:
    spacing = np.full(3, 0.25)
    cells = np.moveaxis(np.indices((18, 18, 18)), 0, -1) * spacing
    distances = np.linalg.norm(cells - CENTRE, axis=-1) - 1
    surface = surface_of(DistanceGrid(np.clip(distances, -0.75, 0.75), np.zeros(3), spacing))
    assert surface.reference.topology.characteristics == (2,)
    directions = np.concatenate([np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)])
    for radius in (0.15, 0.6, 1.0, 1.45):  # 0.15 and 1.45 at the corner are beyond the band
        place, normal = surface.project(CENTRE + radius * directions, np.zeros_like(directions))
        assert np.linalg.norm(place - CENTRE, axis=1) == pytest.approx(1, abs=0.02)
        assert np.linalg.norm(place - CENTRE - directions, axis=1).max() < 0.1
        assert (normal * directions).sum(1).min() > 0.99
