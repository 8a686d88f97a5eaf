"""Samples of a machine, and the free energy that says how plausible a shape is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.solids import tube
from meshdeform.kinds.families.assembly import Assembler, sewn
from meshdeform.kinds.families.boundary import boundary_defects, without_strays
from meshdeform.kinds.families.cut import shortened
from meshdeform.kinds.families.embedded import Embedding, Pull
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.sampling import FreeEnergy, between, completed, sampled, to_machine


@pytest.fixture(scope="module")
def pairs():
    """Twelve members in two groups far apart, of two parts; members of the second group lack the last point."""
    random = np.random.default_rng(0)
    group = np.arange(12) >= 6
    places = random.uniform(-0.3, 0.3, (5, 3)) + 0.2 * group[:, None, None]
    exists = np.ones((12, 5), bool)
    exists[group, 4] = False
    return SimpleNamespace(
        names=list("abcdefghijkl"),
        parts=["seat", "leg"],
        labels=np.array([0, 0, 1, 1, 1]),
        points=places + random.normal(scale=0.01, size=(12, 5, 3)),
        exists=exists,
        segments=[np.array([0, 1], np.uint8)] * 12,
    )


def test_a_sample_lies_between_two_near_members_each_part_by_its_own_share(pairs):
    shares = []
    for seed in range(40):
        drawn = sampled(pairs, np.random.default_rng(seed))
        first, second = drawn.sources[0][:2]
        assert set(drawn.sources[0]) == set(range(12))
        group = {first // 6, second // 6}
        assert len(group) == 1  # of one group
        np.testing.assert_array_equal(drawn.exists, pairs.exists[first])
        for part in (0, 1):
            own = (pairs.labels == part) & drawn.exists
            one, other = (pairs.points[each, own] for each in sorted(drawn.sources[part][:2]))
            way = ((drawn.points[own] - one) * (other - one)).sum() / ((other - one) ** 2).sum()
            np.testing.assert_allclose(drawn.points[own], one + way * (other - one), atol=1e-9)
            nearer = min(drawn.sources[part][:2]) if way < 0.5 else max(drawn.sources[part][:2])
            assert drawn.sources[part][0] == nearer  # the part comes from the member that it is more like
            shares.append(way)
    assert -0.25 <= min(shares) < 0 < 1 < max(shares) <= 1.25
    whole = sampled(pairs, np.random.default_rng(0), mixed=False)
    assert whole.sources[0] == whole.sources[1]
    assert len(whole.sources[0]) == 1


def test_what_lies_between_two_shapes_begins_and_ends_with_them_and_completions_keep_what_is_known(pairs):
    for share, end in ((0.0, 0), (1.0, 7)):
        found = between(pairs, [0, 7], share)
        np.testing.assert_array_equal(found.points, pairs.points[end])
        np.testing.assert_array_equal(found.exists, pairs.exists[end])
        assert found.sources == {0: [end], 1: [end]}
    near = between(pairs, [0, 7], 0.4)
    np.testing.assert_allclose(near.points[:4], 0.6 * pairs.points[0, :4] + 0.4 * pairs.points[7, :4])
    np.testing.assert_array_equal(near.points[4], pairs.points[0, 4])  # the other one has no such point
    for seed in range(10):
        found = completed(pairs, 8, [1], np.random.default_rng(seed))
        np.testing.assert_array_equal(found.points[2:], pairs.points[8, 2:])
        assert found.exists.tolist() == [True] * 4 + [False]
        assert list(found.sources) == [0]
        assert found.sources[0][0] >= 6  # the seat is that of a member with such legs


def test_members_of_a_machine_have_less_free_energy_than_noise():
    random = torch.Generator().manual_seed(1)
    points = 0.5 + 0.02 * torch.randn(40, 6, 3, generator=random)
    machine = BetaMachine.start(points, torch.ones(40, 6), torch.zeros(6, dtype=torch.long), random)
    energy = FreeEnergy(machine, points, torch.ones(40, 6))
    noise = energy(torch.rand(40, 6, 3, generator=random) * 0.98 + 0.01, torch.ones(40, 6))
    assert energy.members.mean() < noise.mean() - 1
    assert energy.plausibility(float(noise.max())) == 0.0
    assert energy.plausibility(float(energy.members.min()) - 1) == 1.0
    scaling = torch.tensor([-0.4, -0.5, -0.3, 1.1])
    assert to_machine(torch.tensor([[-0.4, 0.6, 0.25]]), scaling).tolist() == [[0.25, 0.75, 0.5]]


# Boundaries of parts, their deformation, and how they meet.


@pytest.fixture(scope="module")
def limb():
    """A tube along y with 24 sections of 16 vertices, and the height of each triangle."""
    solid = tube([(0, 0, 0), (0, 1, 0)], [(0.1, 0.1)] * 2, sides=16, rows=25)
    return solid, solid.verts[solid.faces][:, :, 1].mean(1)


def test_a_cut_around_a_limb_is_clean_and_a_ragged_one_is_not(limb):
    solid, height = limb
    angle = np.arctan2(*solid.verts[solid.faces].mean(1)[:, [0, 2]].T)
    clean = (height > 0.5).astype(np.uint8)
    ragged = (height > 0.5 + 0.15 * np.sign(np.sin(4 * angle))).astype(np.uint8)
    of_clean, of_ragged = (boundary_defects(solid.verts, solid.faces, parts, 3) for parts in (clean, ragged))
    assert of_clean[:2].max() < 0.1
    assert of_ragged[:2].min() > 0.5
    assert np.isinf(of_clean[2])  # no such part
    assert boundary_defects(solid.verts, solid.faces, np.zeros_like(clean), 1) == [0.0]


def test_parts_cut_from_one_member_stay_together_along_the_cut(limb):
    solid, height = limb
    upper, lower = (solid.verts[np.unique(solid.faces[chosen])] for chosen in (height > 0.5, height < 0.5))

    def placed(number, verts, shift, member=0, embedding=True):
        part = SimpleNamespace(verts=verts, patches=None)
        return SimpleNamespace(
            number=number,
            member=member,
            part=part,
            embedding=embedding,
            moved=lambda verts, _: np.full_like(verts, shift),
        )

    for embedding, meet in ((True, 2.0), (None, 3.0)):  # halfway, or where the part is that may not move
        ways = sewn([placed(0, upper, 1.0), placed(1, lower, 3.0, embedding=embedding)])
        for verts, way, own in ((upper, ways[0], 1.0), (lower, ways[1], 3.0)):
            np.testing.assert_allclose(way, np.where(np.abs(verts[:, 1:2] - 0.5) < 1e-9, meet, own) * np.ones(3))
    assert sewn([placed(0, upper, 1.0), placed(1, lower, 3.0, member=1)])[1].min() == 3


def test_a_shape_of_one_member_has_its_parts_with_unclean_boundaries_too(pairs):
    assembler = Assembler(pairs, None, np.where(np.arange(12)[:, None] == 3, 0.5, np.zeros(2)), 0.25)
    drawn = sampled(pairs, np.random.default_rng(0))
    for sources, member in (([3], 3), ([3, 5], 5)):
        assert assembler.chosen(replace(drawn, sources={0: sources})) == {0: member}


def test_a_piece_of_the_mesh_is_of_the_part_that_has_most_of_it(limb):
    solid, height = limb
    verts = np.concatenate([solid.verts, solid.verts + 5])
    faces = np.concatenate([solid.faces, solid.faces + len(solid.verts)])
    spots = np.random.default_rng(0).random(len(height)) < 0.1
    assert not without_strays(verts, faces, np.concatenate([spots, spots]).astype(np.uint8)).any()
    # A limb of another part has a short boundary: a trunk that is welded to its crown stays a trunk.
    found = np.concatenate([(height > 0.7) | spots, height < 0.3])
    limbs = np.concatenate([height > 0.7, height < 0.3])
    np.testing.assert_array_equal(without_strays(verts, faces, found.astype(np.uint8)), limbs)
    even = np.concatenate([height > 0.5, np.ones(len(height), bool)]).astype(np.uint8)
    np.testing.assert_array_equal(without_strays(verts, faces, even), even)


def test_a_boundary_is_made_shorter_where_that_costs_less_area():
    row = np.repeat([0, 1], 4)  # eight fields in a row, the sixth of which has the other part
    row[5] = 0
    faces = np.stack([np.arange(7), np.arange(1, 8)], 1)
    areas = np.ones(8)
    for price, best in ((0.4, row), (0.6, np.repeat([0, 1], 4)), (5.0, np.zeros(8, int))):
        np.testing.assert_array_equal(shortened(row, areas, faces, np.full(7, price)), best)


def test_a_turn_is_followed_without_shear_and_other_pieces_stay():
    random = np.random.default_rng(1)
    nodes = random.random((60, 3))
    piece = (np.arange(60) >= 40).astype(np.int64)
    angle = 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    target = np.where(piece[:, None] == 0, nodes @ turn.T, nodes)
    graph = Embedding(nodes, piece)
    graph.solve([Pull(nodes, target, piece, 100.0)])
    inside = random.random((30, 3)) * 0.6 + 0.2
    moved = inside + graph.displacement(inside, np.zeros(30, np.int64))
    assert np.abs(moved - inside @ turn.T).max() < 0.05
    maps = graph.linear(inside, np.zeros(30, np.int64))
    assert np.abs(np.linalg.det(maps) - 1).max() < 0.05
    assert np.abs(graph.displacement(inside, np.ones(30, np.int64))).max() < 1e-6
