"""The Beta shape machine."""

from __future__ import annotations

import math

import torch

from meshdeform.kinds.families.learning import Learning
from meshdeform.kinds.families.machine import STRONGEST, BetaMachine


def planted(shapes=300, strength=200.0):
    """Shapes of two parts, each in one of two states: points (T, 6, 3), the states (T, 2), means of both (2, 6, 3)."""
    random = torch.Generator().manual_seed(0)
    labels = torch.tensor([0, 0, 0, 1, 1, 1])
    states = (torch.rand(shapes, 2, generator=random) < torch.tensor([0.5, 0.3])).float()
    low = torch.rand(6, 3, generator=random) * 0.2 + 0.3
    high = low + 0.15 * torch.sign(torch.randn(6, 3, generator=random))
    on = states[:, labels][:, :, None]
    mean = low * (1 - on) + high * on
    with torch.random.fork_rng():
        torch.manual_seed(0)
        points = torch.distributions.Beta(mean * strength, (1 - mean) * strength).sample()
    return points, states, torch.stack([low, high]), labels, random


def learned(points, exists, labels, random, epochs, sizes):
    machine = BetaMachine.start(points, exists, labels, random, sizes)
    learning = Learning.start(machine, points, exists, torch.zeros(len(labels), len(labels)), random)
    for _ in range(epochs):
        learning.step(epochs)
    return learning


def test_samples_of_a_planted_machine_recover_its_parameters():
    points, states, means, labels, random = planted()
    exists = torch.ones(points.shape[:2])
    learning = learned(points, exists, labels, random, 240, (4, 2, 2))
    machine = learning.finished()
    h1 = machine.infer(points, exists).h1
    for unit in range(4):
        part = unit // 2
        sign = torch.corrcoef(torch.stack([h1[:, unit], states[:, part]]))[0, 1]
        assert abs(float(sign)) > 0.99
    # The two modes of each part, and so a/(a+b) and c/(c+d) with the biases, are those that were planted.
    for state in (0, 1):
        same = (states == state).all(1)
        assert float((machine.expected(h1[same]) - means[state]).abs().mean()) < 0.04
    variance = points[(states == 0).all(1)].var(0).mean()
    alpha, beta = machine.exponents(h1[(states == 0).all(1)])
    expected = (alpha * beta / ((alpha + beta).square() * (alpha + beta + 1))).mean()
    assert 0.5 < float(expected / variance) < 2
    assert all((machine.weights[name] >= 0).all() for name in ("a0", "b0", "a", "b", "c", "d"))
    assert math.isfinite(learning.best_error)


def test_a_coordinate_that_never_varies_gets_no_endless_exponents_and_a_blow_up_goes_back_to_the_best_weights() -> None:
    points, _, _, labels, random = planted(40)
    points[:, 0, 0] = 0.5
    learning = learned(points, torch.ones(40, 6), labels, random, 300, (4, 2, 2))
    alpha, beta = learning.machine.exponents(torch.full((1, 4), 0.5))
    assert 1000 < float((alpha + beta)[0, 0]) < 1.5 * STRONGEST
    best = {name: value.clone() for name, value in learning.best.items()}
    for value in learning.machine.weights.values():
        value.fill_(float("nan"))
    rate = learning.rate
    learning.step(301)
    assert learning.rate == rate / 2
    assert all(torch.equal(learning.machine.weights[name], value) for name, value in best.items())


def test_an_absent_point_does_not_matter():
    points, _, _, labels, random = planted(20)
    exists = torch.ones(20, 6)
    exists[:, 5] = 0
    machine = BetaMachine.start(points, exists, labels, random)
    changed = points.clone()
    changed[:, 5] = 0.7
    assert torch.equal(machine.infer(points, exists).h1, machine.infer(changed, exists).h1)
    assert torch.equal(machine.log_likelihood(points, exists), machine.log_likelihood(changed, exists))


def test_the_structure_part_learns_which_points_exist_together():
    random = torch.Generator().manual_seed(1)
    kind = (torch.rand(200, generator=random) < 0.5).float()
    exists = torch.stack([kind, kind, 1 - kind, torch.ones(200)], 1)
    points = torch.full((200, 4, 3), 0.5) + 0.05 * torch.rand(200, 4, 3, generator=random)
    start = BetaMachine.start(points, exists, torch.zeros(4, dtype=torch.long), random, (2, 2, 2)).weights
    inputs = start["g0"] + exists @ start["eg"]  # at unit variance, or below where nothing varies enough
    torch.testing.assert_close(inputs.mean(0), torch.zeros(2), atol=1e-5, rtol=0)
    assert (inputs.std(0, correction=0) <= 1 + 1e-5).all()
    assert (inputs.std(0) > 0.3).all()
    learning = learned(points, exists, torch.zeros(4, dtype=torch.long), random, 200, (2, 2, 2))
    machine = learning.machine
    before = learning.machine.existence(torch.full((1, 2), 0.5))[0]
    made = machine.existence(machine.structure(exists))
    assert float((made - exists).abs().mean()) < float((before - exists).abs().mean())
