"""What the report of a fit says of a surface, against known answers and the report of every run."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.measures import kept_share, measures, surface_stretch, vertex_areas
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere


def test_a_similarity_stretches_nothing_and_one_axis_by_its_logarithm() -> None:
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 0, 1]])
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert surface_stretch(rest, 3 * rest @ turn + 1, faces) == pytest.approx(0, abs=1e-12)
    assert surface_stretch(rest, rest * [4.0, 1, 1], faces) == pytest.approx(np.log(2))
    assert np.isfinite(surface_stretch(rest, 0 * rest, faces))
    assert surface_stretch(rest, rest, faces[2:]) == 0


def test_areas_and_the_share_of_a_way() -> None:
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    faces = np.array([[0, 1, 2]])
    assert vertex_areas(rest, faces)[:3] == pytest.approx(1 / 6)
    assert 0 < vertex_areas(rest, faces)[3] < 1e-8
    goal = rest + [0.0, 0, 2]
    assert kept_share(rest, goal, rest + [0, 0, 1.5], faces) == pytest.approx(0.75)
    assert kept_share(rest, rest, rest, faces) == 1


@pytest.mark.parametrize("seed", [0, 1])
def test_faults_are_counted_as_in_the_report_of_a_run(seed: int) -> None:
    mesh = icosphere(3)
    rest, faces = mesh.verts.numpy(), mesh.faces.numpy()
    verts = rest + 0.06 * np.random.default_rng(seed).normal(size=rest.shape)
    found, report = measures(rest, verts, faces), measure(rest, faces, verts)
    assert (found.flipped, found.cut) == (report.flipped_faces, report.self_intersections_added)
    assert found.flipped > 10
    assert found.cut > 10
