"""Samples of a machine, and the free energy that says how plausible a shape is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.solids import tube
from meshdeform.kinds.families.assembly import sewn
from meshdeform.kinds.families.boundary import without_strays
from meshdeform.kinds.families.cut import shortened
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.placing import PartJoint, Placing, axis_fit
from meshdeform.kinds.families.sampling import FreeEnergy, between, completed, like_parts, sampled, to_machine


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


def test_members_take_turns_and_each_gives_proportions_while_others_give_parts(pairs):
    drawn = [sampled(pairs, number, 5) for number in range(24)]
    bases = [each.sources[0][-1] for each in drawn]
    assert sorted(bases[:12]) == list(range(12)) == sorted(bases[12:])
    for each, base in zip(drawn, bases, strict=True):
        givers = [each.sources[part][0] for part in (0, 1)]
        assert len({*givers, base}) == 3  # no part comes from the member of the proportions, and no two from one
        np.testing.assert_array_equal(each.exists, pairs.exists[base])
        assert np.abs(each.points - pairs.points[base])[pairs.labels == 0].max() < 0.2
    again = sampled(pairs, 3, 5)
    np.testing.assert_array_equal(again.points, drawn[3].points)
    assert again.sources == drawn[3].sources


def test_parts_are_alike_that_differ_in_place_alone_and_those_with_too_few_points_are_none(pairs):
    apart = pairs.points.copy()
    apart[4] = apart[3] + [0.3, 0.1, 0.0]
    family = SimpleNamespace(**{**vars(pairs), "points": apart})
    assert set(like_parts(family, 3, 1)[:2]) == {3, 4}
    gone = pairs.exists.copy()
    gone[4, 2:4] = False
    family.exists = gone
    assert 4 not in like_parts(family, 3, 1)


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
        assert found.sources[0][-1] >= 6  # the proportions are those of a member with such legs


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


def test_parts_cut_from_one_member_stay_together_along_the_cut(limb):
    solid, height = limb
    upper, lower = (solid.verts[np.unique(solid.faces[chosen])] for chosen in (height > 0.5, height < 0.5))

    def placed(number, verts, shift, member=0, still=False):
        part = SimpleNamespace(verts=verts, patches=None)
        return SimpleNamespace(
            number=number,
            member=member,
            part=part,
            still=still,
            moved=lambda verts, _: np.full_like(verts, shift),
        )

    for still, meet in ((False, 2.0), (True, 3.0)):  # halfway, or where the part is that may not move
        ways = sewn([placed(0, upper, 1.0), placed(1, lower, 3.0, still=still)])
        for verts, way, own in ((upper, ways[0], 1.0), (lower, ways[1], 3.0)):
            np.testing.assert_allclose(way, np.where(np.abs(verts[:, 1:2] - 0.5) < 1e-9, meet, own) * np.ones(3))
    assert sewn([placed(0, upper, 1.0), placed(1, lower, 3.0, member=1)])[1].min() == 3


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


def test_a_large_piece_of_the_mesh_keeps_two_parts_and_a_small_one_does_not():
    solid = tube([(0, 0, 0), (0, 1, 0)], [(0.4, 0.4)] * 2, sides=16, rows=25)  # too wide for limbs
    height = solid.verts[solid.faces][:, :, 1].mean(1)
    sizes = (1.0, 1.0, 0.3)
    verts = np.concatenate([size * solid.verts + 3 * n for n, size in enumerate(sizes)])
    faces = np.concatenate([solid.faces + n * len(solid.verts) for n in range(len(sizes))])
    cabins = np.tile(height > 0.7, 3)
    kept = np.concatenate([height > 0.7, height > 0.7, np.zeros(len(height), bool)])
    np.testing.assert_array_equal(without_strays(verts, faces, cabins.astype(np.uint8)), kept)


def test_a_boundary_is_made_shorter_where_that_costs_less_area():
    row = np.repeat([0, 1], 4)  # eight fields in a row, the sixth of which has the other part
    row[5] = 0
    faces = np.stack([np.arange(7), np.arange(1, 8)], 1)
    areas = np.ones(8)
    for price, best in ((0.4, row), (0.6, np.repeat([0, 1], 4)), (5.0, np.zeros(8, int))):
        np.testing.assert_array_equal(shortened(row, areas, faces, np.full(7, price)), best)


def test_what_is_at_a_joint_goes_with_it_and_the_rest_follows_smoothly():
    source = np.random.default_rng(1).random((30, 3))
    scale, shift = axis_fit(source, source)
    assert (scale == 1).all()
    assert not shift.any()
    joints = [PartJoint(np.zeros(3), 0.1, 0, np.array([0.2, 0, 0])), PartJoint(np.array([0, 1.0, 0]), 0.1, 0)]
    placing = Placing(np.ones(3), np.zeros(3), joints)
    line = np.array([[0, 0.05, 0], [0, 0.25, 0], [0, 0.5, 0], [0, 0.75, 0], [0, 0.95, 0]])
    ways = placing.moved(line, np.zeros(5, np.int64))
    assert ways[0, 0] == pytest.approx(0.2, abs=1e-3)
    assert ways[2, 0] == pytest.approx(0.1)
    assert ways[4, 0] == pytest.approx(0.0, abs=1e-3)
    assert (np.diff(ways[:, 0]) < 0).all()
    other = placing.moved(np.array([[0, 0.05, 0]]), np.ones(1, np.int64))  # a patch without a joint follows all
    assert 0 < other[0, 0] <= 0.2
    maps = Placing(np.array([2.0, 1, 1]), np.zeros(3)).linear(line, np.zeros(5, np.int64))
    np.testing.assert_allclose(maps, np.tile(np.diag([2.0, 1, 1]), (5, 1, 1)), atol=1e-9)
