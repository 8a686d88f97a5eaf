"""What the report of a fit says of a surface, against known answers and the report of every run."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.faults import Faults
from meshdeform.exemplar.measures import kept_share, vertex_areas
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere


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
    rest, faces = mesh.verts, mesh.faces
    verts = rest + 0.06 * np.random.default_rng(seed).normal(size=rest.shape)
    found, report = Faults(rest, faces).find(verts), measure(rest, faces, verts)
    assert (found.folded.sum(), found.cutting.sum()) == (report.flipped_faces, report.self_intersections_added)
    assert found.folded.sum() > 10
    assert found.cutting.sum() > 10
