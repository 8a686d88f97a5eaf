"""Samples of a machine, and the free energy that says how plausible a shape is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch

from meshdeform.kinds.families.boundary import boundary_defects, without_strays
from meshdeform.kinds.families.embedded import Embedding, Pull, axis_fit
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.sampling import (
    FreeEnergy,
    State,
    Unexplained,
    between,
    completed,
    gibbs,
    sampled,
    to_frame,
    to_machine,
)
from meshdeform.kinds.sketch.solids import tube


def planted(points=2, strong=1.0):
    """A machine of two units in each layer, whose parameters are random but known."""
    random = torch.Generator().manual_seed(3)

    def draw(*shape):
        return (torch.rand(*shape, generator=random) - 0.5) * 2 * strong

    visible = 3 * points
    weights = {
        **{name: 1 + draw(visible).abs() for name in ("a0", "b0")},
        **{name: draw(visible, 2).abs() for name in "abcd"},
        **{name: draw(visible) - 1 for name in ("m0", "m1")},
        "w1": draw(2),
        "w2": draw(2),
        "w3": draw(2),
        "w12": draw(2, 2) * 2,
        "w23": draw(2, 2) * 2,
        "e0": draw(points),
        "g0": draw(2),
        "eg": draw(points, 2),
    }
    return BetaMachine(weights, torch.ones(visible, 2))


def exact(machine):
    """The probability of each state of the first layer, with coordinates and the other layers summed out."""
    w, states = machine.weights, [torch.tensor(s, dtype=torch.float32) for s in itertools.product((0, 1), repeat=2)]
    weight = []
    for h1 in states:
        alpha, beta = (each[0] for each in machine.exponents(h1[None]))
        area = torch.lgamma(alpha) + torch.lgamma(beta) - torch.lgamma(alpha + beta)
        shift = (w["m0"] @ (w["a"] - w["c"]) + w["m1"] @ (w["b"] - w["d"])) @ h1
        above = [
            h1 @ w["w12"] @ h2 + w["w2"] @ h2 + h2 @ w["w23"] @ h3 + w["w3"] @ h3 for h2 in states for h3 in states
        ]
        weight.append(area.sum() - shift + w["w1"] @ h1 + torch.stack(above).logsumexp(0))
    return torch.stack(weight).softmax(0).numpy()


def test_gibbs_samples_of_a_planted_machine_have_its_distribution():
    machine, chains = planted(), 6000
    zero = torch.zeros(chains, 2)
    state = gibbs(machine, State(zero, zero, zero), torch.ones(chains, 2), 30, np.random.default_rng(0))
    seen = np.bincount((state.h1 @ torch.tensor([2.0, 1.0])).long().numpy(), minlength=4) / chains
    wanted = exact(machine)
    assert wanted.max() - wanted.min() > 0.1  # the machine has something to be recovered
    np.testing.assert_allclose(seen, wanted, atol=4 * 0.5 / chains**0.5)


def test_samples_vary_by_what_is_unexplained_in_the_members_each_part_by_itself():
    machine, random = planted(points=3), torch.Generator().manual_seed(2)
    points = torch.rand(8, 3, 3, generator=random) * 0.5 + 0.25
    exists = torch.ones(8, 3)
    exists[2:, 1] = 0.0  # two members alone have the second point
    labels = torch.tensor([0, 0, 1])
    rest = Unexplained.of(machine, points, exists, labels)
    apart = points - machine.expected(machine.infer(points, exists).h1)
    known = apart[:2].reshape(2, -1)
    random = np.random.default_rng(0)
    drawn = torch.stack([rest.draw(random) for _ in range(20_000)]).reshape(-1, 9)
    found = drawn.T @ drawn / len(drawn)
    every = apart.reshape(8, -1)
    torch.testing.assert_close(found[:3, :3], every.T[:3] @ every[:, :3] / 8, atol=2e-3, rtol=0)
    torch.testing.assert_close(found[3:6, 3:6], known.T[3:6] @ known[:, 3:6] / 2, atol=2e-3, rtol=0)
    assert found[:6, 6:].abs().max() < 2e-3
    assert found[:3, 3:6].abs().max() > 2e-3  # within a part, points move together
    # Coordinates stay inside, and without anything unexplained a sample is the expectation of its hidden units.
    none = Unexplained(torch.zeros(8, 9), labels)
    far = Unexplained(torch.full((8, 9), 50.0), labels)
    for seed in range(3):
        each = [sampled(machine, points, exists, by, 4, np.random.default_rng(seed)) for by in (none, rest, far)]
        assert torch.equal(each[0].exists, each[1].exists)
        assert (each[0].points - each[1].points).abs().max() > 1e-3
        assert all(0 < float(made.points.min()) <= float(made.points.max()) < 1 for made in each)


def test_what_lies_between_two_shapes_begins_and_ends_with_them_and_completions_keep_what_is_known():
    machine = planted(points=3)
    points, exists = torch.rand(2, 3, 3) * 0.5 + 0.25, torch.tensor([[1.0, 1, 0], [1, 0, 1]])
    for share, end in ((0.0, 0), (1.0, 1)):
        found = between(machine, points, exists, share)
        assert torch.equal(found.points, points[end])
        assert torch.equal(found.exists, exists[end])
    near = between(machine, points, exists, 1e-4)
    assert (near.points[:2] - points[0, :2]).abs().max() < 1e-3
    scaling = torch.tensor([-0.4, -0.5, -0.3, 1.1])
    assert torch.allclose(to_machine(to_frame(points, scaling), scaling), points, atol=1e-6)

    # And a completed shape has the known points.
    points, exists = torch.rand(3, 3) * 0.5 + 0.25, torch.tensor([1.0, 0, 1])
    for seed in range(5):
        rest = Unexplained(torch.full((4, 9), 0.01), torch.tensor([0, 0, 1]))
        found = completed(machine, points, exists, torch.tensor([1.0, 1, 0]), rest, 3, np.random.default_rng(seed))
        assert torch.equal(found.points[0], points[0])
        assert found.exists[:2].tolist() == [1, 0]


def test_shapes_of_the_machine_have_less_free_energy_than_noise():
    machine = planted(points=6, strong=8.0)
    zero = torch.zeros(40, 2)
    state = gibbs(machine, State(zero, zero, zero), torch.ones(40, 6), 10, np.random.default_rng(1))
    alpha, beta = machine.exponents(state.h1)
    drawn = np.random.default_rng(2).beta(alpha.numpy(), beta.numpy())
    points = torch.from_numpy(drawn).float().clamp(1e-3, 1 - 1e-3).reshape(40, 6, 3)
    energy = FreeEnergy(machine, points, torch.ones(40, 6))
    noise = energy(torch.rand(40, 6, 3, generator=torch.Generator().manual_seed(0)) * 0.98 + 0.01, torch.ones(40, 6))
    assert energy.members.mean() < noise.mean() - 1
    assert energy.plausibility(float(noise.max())) == 0.0
    assert energy.plausibility(float(energy.members.min()) - 1) == 1.0


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


def test_stray_patches_go_to_the_part_around_them_and_limbs_stay(limb):
    solid, height = limb
    parts = (height > 0.5).astype(np.uint8)
    spotted = parts.copy()
    spotted[np.flatnonzero(height < 0.3)[:6]] = 1
    np.testing.assert_array_equal(without_strays(solid.verts, solid.faces, spotted), parts)
    # Separate solids of one part are no strays, however small they are.
    verts = np.concatenate([solid.verts, 0.1 * solid.verts + 5])
    faces = np.concatenate([solid.faces, solid.faces + len(solid.verts)])
    both = np.concatenate([parts, np.ones_like(parts)])
    np.testing.assert_array_equal(without_strays(verts, faces, both), both)


def test_pulls_to_where_points_are_move_nothing():
    points = np.random.default_rng(0).random((40, 3))
    scale, shift = axis_fit(points, points.copy())
    assert scale.tolist() == [1, 1, 1]
    assert shift.tolist() == [0, 0, 0]
    piece = np.zeros(40, np.int64)
    graph = Embedding(points, piece)
    graph.solve([Pull(points, points.copy(), piece, 1.0)])
    assert not graph.displacement(points + 0.01, piece).any()
    np.testing.assert_array_equal(graph.linear(points, piece), np.tile(np.eye(3), (40, 1, 1)))


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
