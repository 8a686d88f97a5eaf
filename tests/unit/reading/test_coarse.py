"""A large mesh is read by a coarser one, whose labels come back to all of its faces."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.families.parts import Part, ellipsoid, join
from meshdeform.reading import NO_PART
from meshdeform.reading.coarse import coarse
from meshdeform.reading.evidence import Evidence


@pytest.fixture
def two_balls() -> Part:
    return join([ellipsoid([0, 0, 0], 1.0, rings=40), ellipsoid([5, 0, 0], 1.0, rings=40)])


def test_it_has_fewer_faces_in_the_same_place(two_balls: Part) -> None:
    less = coarse(two_balls, 1000)
    assert 300 < len(less.body.faces) <= 1000
    np.testing.assert_allclose(np.ptp(less.body.verts, axis=0), np.ptp(two_balls.verts, axis=0), rtol=0.1)
    apart = np.linalg.norm(less.body.verts[less.of_vert] - two_balls.verts, axis=1)
    assert apart.max() < 0.5
    kept = less.of_face >= 0
    assert kept.sum() == len(less.body.faces)
    assert np.array_equal(less.of_vert[two_balls.faces[kept]], less.body.faces[less.of_face[kept]])


def test_labels_and_evidence_go_there_and_back(two_balls: Part) -> None:
    less = coarse(two_balls, 1000)
    right = two_balls.verts[:, 0] > 2
    told = less.evidence(Evidence(joints={"head": right.astype(float)}, names={"ball": right}))
    away = less.body.verts[:, 0] > 2
    assert np.array_equal(told.joints["head"], away.astype(float))
    assert np.array_equal(told.names["ball"], away)
    labels = away[less.body.faces[:, 0]].astype(np.int64)
    assert np.array_equal(less.labels(labels, two_balls.faces), right[two_balls.faces[:, 0]].astype(np.int64))


def test_what_all_but_vanishes_is_of_no_part(two_balls: Part) -> None:
    speck = ellipsoid([2.5, 0, 0], 1e-4)
    less = coarse(join([two_balls, speck]), 1000)
    faces = join([two_balls, speck]).faces
    labels = less.labels(np.zeros(len(less.body.faces), np.int64), faces)
    assert (labels[len(two_balls.faces) :] == NO_PART).all()
    assert (labels[: len(two_balls.faces)] == 0).all()
