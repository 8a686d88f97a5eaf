"""Cells keep areas; smoothing keeps what is constant; segments vote and islands go; fits find known maps."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.families.parts import box, ellipsoid, join
from meshdeform.nouns.labels import labelled_member
from meshdeform.reading import cells as cells_module
from meshdeform.reading.articulated import AssetSamples, fit_candidate
from meshdeform.reading.banks import candidate_member
from meshdeform.reading.cells import cells_of
from meshdeform.reading.choice import AssetMesh, Candidate, FrontFrame, candidates
from meshdeform.reading.groups import groups_of
from meshdeform.reading.samples import hidden, spread
from meshdeform.reading.smoothing import settled, smoothed


def test_many_faces_are_grouped_and_keep_their_area(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=40)
    each = cells_of(ball.verts, ball.faces)
    assert len(each) == len(ball.faces)
    monkeypatch.setattr(cells_module, "MOST_CELLS", 300)
    few = cells_of(ball.verts, ball.faces)
    assert 50 < len(few) <= 300
    np.testing.assert_allclose(few.areas.sum(), each.areas.sum(), rtol=1e-9)
    assert few.links.max() < len(few)
    assert (few.links[:, 0] < few.links[:, 1]).all()
    np.testing.assert_allclose(np.linalg.norm(few.normals, axis=1), 1)
    assert (few.centres * few.normals).sum(1).min() > 0


def test_smoothing_keeps_constants_and_area_weighted_means() -> None:
    shape = join([ellipsoid([0, 0, 0], 0.2), box([0.6, 0, 0], [0.3, 0.2, 0.2])])
    cells = cells_of(shape.verts, shape.faces)
    even = np.tile([0.3, 0.7], (len(cells), 1))
    np.testing.assert_allclose(smoothed(even, cells), even, atol=1e-9)
    noise = np.random.default_rng(0).random((len(cells), 2))
    soft = smoothed(noise, cells)
    np.testing.assert_allclose(cells.areas @ soft, cells.areas @ noise, rtol=1e-6)
    assert soft.std() < 0.5 * noise.std()


def test_segments_vote_islands_go_and_single_parts_are_one_piece() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=20)
    cells = cells_of(ball.verts, ball.faces)
    high, low = cells.centres[:, 1] > 0.2, cells.centres[:, 1] < -0.2
    soft = np.stack([~(high | low), high | low, np.zeros(len(cells), bool)], 1).astype(float)
    speck = int(np.argmin(np.abs(cells.centres[:, 1])))
    soft[speck] = [0, 0, 1]
    soft[int(np.argmax(cells.centres[:, 0]))] = [0.4, 0.6, 0]
    codes = np.zeros(len(cells), np.int64)
    none = np.zeros(3, bool)
    kept = settled(soft, cells, codes, none)
    assert (kept[high] == 1).all()
    assert (kept[low] == 1).all()
    assert kept[int(np.argmax(cells.centres[:, 0]))] == 0
    single = settled(soft, cells, codes, np.array([False, True, False]))
    assert {bool((single[high] == 1).all()), bool((single[low] == 1).all())} == {True, False}
    two = join([ball, ellipsoid([2, 0, 0], 0.3, rings=20)])
    cells = cells_of(two.verts, two.faces)
    right = cells.centres[:, 0] > 1
    soft = np.where((right & (cells.centres[:, 1] > -0.2))[:, None], [0.1, 0.9], [0.9, 0.1])
    assert (settled(soft, cells, np.zeros(len(cells), np.int64), np.zeros(2, bool))[right] == 1).all()


def test_what_is_inside_another_solid_is_hidden() -> None:
    shape = join([ellipsoid([0, 0, 0], 0.5), ellipsoid([0.1, 0, 0], 0.2), ellipsoid([2, 0, 0], 0.2)])
    samples = spread(shape.verts, shape.faces, 1500, 0)
    solid = (samples.positions[:, 0] > 1.5).astype(np.int64) * 2
    solid[np.linalg.norm(samples.positions - [0.1, 0, 0], axis=1) < 0.21] = 1
    inside = hidden(samples, solid)
    assert inside[solid == 1].all()
    assert not inside[solid != 1].any()


def test_groups_join_what_moves_together_and_tie_what_touches() -> None:
    member = labelled_member("dog", (), np.random.default_rng(0))
    groups = groups_of(member)
    assert groups.of_vert.shape == (len(member.verts),)
    legs = {int(groups.of_vert[member.solids == k][0]) for k in member.solids_named("leg")}
    assert len(legs) == 4
    body = int(groups.of_vert[member.solids == member.solids_named("body")[0]][0])
    tied = {frozenset((i, j)) for i, j, _ in groups.ties}
    assert all(frozenset((body, leg)) in tied for leg in legs)
    assert sum(leg in pair for leg in legs for pair in groups.mirrored if pair[0] != pair[1]) == 4


def test_a_fit_undoes_the_bending_of_a_limb() -> None:
    member = candidate_member("elephant", 2)
    frame = FrontFrame(AssetMesh(member.verts, member.faces), np.eye(3))
    asset = AssetSamples(frame)
    assert fit_candidate(asset, frame, Candidate("elephant", 2, 0.0)).residual < 0.02
    verts = member.verts.copy()
    trunk = member.carried("trunk")
    verts[trunk, 2] += 0.4 * (verts[trunk, 1].max() - verts[trunk, 1])
    bent = FrontFrame(AssetMesh(verts, member.faces), np.eye(3))
    fit = fit_candidate(AssetSamples(bent), bent, Candidate("elephant", 2, 0.0))
    apart = np.linalg.norm(fit.member.verts - bent.verts, axis=1)
    assert np.median(apart[trunk]) < 0.05 < 0.4 * np.ptp(member.verts[trunk, 1]) / 2
    assert np.median(apart[~trunk]) < 0.03


def test_the_nearest_member_of_its_own_draw_is_itself() -> None:
    member = candidate_member("chair", 7)
    frame = FrontFrame(AssetMesh(member.verts, member.faces), np.eye(3))
    best = candidates(frame, "chair", 3)
    assert 7 in [one.number for one in best]
    assert best[0].grade <= best[1].grade <= best[2].grade
