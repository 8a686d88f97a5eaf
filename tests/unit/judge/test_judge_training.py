"""How the judge is trained: true labels, a loss that goes down, weights that come back, and a fitted sharpness."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from meshdeform.judge.network import JudgeConfig
from meshdeform.vocabulary.nouns import NOUNS
from training.judge.assets import OTHERS, TUNED, listed
from training.judge.measure import calibration_error, line
from training.judge.members import HELD_OUT, NOTHING, TRAINING, ViewSet, counts_of, draw_shape, seeded
from training.judge.network import JudgeNetwork
from training.judge.train import TrainConfig, Trainer, calibrate, targets

pytestmark = pytest.mark.training


@pytest.fixture(scope="module")
def small() -> ViewSet:
    """A shape of eight nouns by other code, and two that are nothing."""
    torch.set_num_threads(1)
    counts = counts_of(list(NOUNS)[:8], 1, 0, 2)
    return ViewSet.joined([ViewSet.drawn(TRAINING, kind, count) for kind, count in counts.items()])


def test_every_noun_has_shapes_of_other_code_that_are_closed_and_face_outward() -> None:
    for noun in NOUNS:
        part = draw_shape(f"other {noun}", seeded(HELD_OUT, f"other {noun}", 1))
        verts, faces = part.verts, part.faces
        assert np.linalg.norm(verts, axis=1).max() == pytest.approx(1.0)
        a, b, c = verts[faces].transpose(1, 0, 2)
        assert (a * np.cross(b, c)).sum() > 0
        # The surface is closed: its faces' areas, as vectors, cancel out.
        areas = np.cross(b - a, c - a)
        assert np.linalg.norm(areas.sum(0)) < 0.05 * np.linalg.norm(areas, axis=1).sum()


def test_no_family_is_drawn_for_training(small: ViewSet) -> None:
    counts = counts_of(["chair", "vase"], 3, 5, 2)
    assert counts == {"other chair": 3, "other vase": 3, NOTHING: 2}
    assert small.noun.tolist() == [*range(8), -1, -1]


def test_training_learns_a_handful_of_meshes_and_is_repeatable(small: ViewSet) -> None:
    few = small.rows(torch.arange(8))
    runs = []
    for _ in range(2):
        trainer = Trainer(few, TrainConfig(steps=14, batch=4))
        runs.append(torch.stack([trainer.step() for _ in range(14)]))
    assert torch.equal(runs[0], runs[1])
    assert bool((runs[0][-3:].mean(0) < 0.8 * runs[0][:2].mean(0)).all())


def test_what_is_no_noun_should_get_what_is_known_without_seeing_it() -> None:
    offered = torch.softmax(torch.arange(float(len(NOUNS))), 0)
    wanted = targets(torch.tensor([2, -1]), offered)
    assert wanted[0].nonzero().tolist() == [[2]]
    assert torch.equal(wanted[1], offered)


def test_calibration_softens_a_network_that_is_wrong(small: ViewSet) -> None:
    torch.manual_seed(0)
    network = JudgeNetwork(JudgeConfig(tuple(NOUNS))).eval()
    torch.nn.init.normal_(network.noun_head.weight, std=10.0)
    calibrate(network, small.rows(torch.arange(8)))
    assert float(network.sharpness) < 0.3


def test_the_calibration_error_is_the_mean_gap_between_confidence_and_share() -> None:
    sure = torch.tensor([[0.9, 0.1], [0.9, 0.1], [0.4, 0.6], [0.0, 1.0]])
    noun = torch.tensor([0, 1, 1, 1])
    # Of two at 0.9 one is right, that at 0.6 is, and so is that at 1.
    assert calibration_error(sure, noun) == pytest.approx((0.8 + 0.4) / 4)


def test_assets_are_measured_in_one_set_each_and_stand_upright() -> None:
    sets = listed()
    assert sets.keys() == {TUNED, "bench/keep, last", OTHERS, "bench/nouns, packs", "bench/nouns, authors"}
    every = [each for assets in sets.values() for each in assets]
    assert len({each.sha256 for each in every}) == len(every)
    assert {each.up for each in every} == {"+Y", "+Z"}


def test_weights_are_compared_by_the_nouns_that_both_know(small: ViewSet) -> None:
    torch.manual_seed(0)
    known = list(NOUNS)[:4]
    network = JudgeNetwork(JudgeConfig(tuple(known))).eval()
    torch.nn.init.zeros_(network.noun_head.weight)
    network.noun_head.bias.data = torch.tensor([0.0, 1.0, 2.0, 3.0])
    eight = small.rows(torch.arange(8))
    # It takes everything for the fourth noun, and for the third where it may not say that.
    assert line("all", network, eight, NOUNS).startswith("| all | 4 | 0.250 | 0.250 | 0.750 | ")
    assert line("three", network, eight, known[:3]).startswith("| three | 3 | 0.333 | 0.333 | 1.000 | ")
