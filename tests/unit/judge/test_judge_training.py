"""How the judge is trained: disjoint members, true labels, a loss that goes down, weights that come back."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from meshdeform.judge.scoring import JudgeNetwork, encoded
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUNS
from training.judge.measure import prompts_of
from training.judge.members import (
    HELD_OUT,
    TRAINING,
    ViewSet,
    counts_of,
    draw_other,
    seeded,
)
from training.judge.train import TrainConfig, Trainer, _unknown, calibrate

pytestmark = pytest.mark.training

KIND = {noun: number for number, noun in enumerate(NOUNS)}


@pytest.fixture(scope="module")
def small() -> ViewSet:
    """A member of every family, one more of every noun by the judge's own code, and four that are nothing."""
    torch.set_num_threads(1)
    return ViewSet.of_all(TRAINING, counts_of(list(NOUNS), 1, 1, 4))


def test_every_noun_has_shapes_of_other_code_that_are_closed_and_face_outward() -> None:
    for noun in NOUNS:
        prompt, (verts, faces) = draw_other(noun, seeded(HELD_OUT, "other " + noun, 1))
        assert prompt.noun == noun
        assert all(attribute.part == "whole" for attribute in prompt.attributes)
        assert np.linalg.norm(verts, axis=1).max() == pytest.approx(1.0)
        a, b, c = verts[faces].transpose(1, 0, 2)
        assert (a * np.cross(b, c)).sum() > 0
        # The surface is closed: its faces' areas, as vectors, cancel out.
        areas = np.cross(b - a, c - a)
        assert np.linalg.norm(areas.sum(0)) < 0.05 * np.linalg.norm(areas, axis=1).sum()


def test_training_learns_a_handful_of_meshes_and_is_repeatable(small: ViewSet) -> None:
    few = small.rows(torch.arange(8))
    runs = []
    for _ in range(2):
        trainer = Trainer(few, TrainConfig(steps=14, batch=4))
        runs.append(torch.stack([trainer.step() for _ in range(14)]))
    assert torch.equal(runs[0], runs[1])
    assert bool((runs[0][-3:].mean(0) < 0.8 * runs[0][:2].mean(0)).all())


def test_calibration_softens_a_network_that_is_wrong(small: ViewSet) -> None:
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    torch.nn.init.normal_(network.noun_head.weight, std=10.0)
    # Twenty of nouns, and the four that are nothing.
    calibrate(network, small.rows(torch.tensor([*range(20), *range(len(small) - 4, len(small))])))
    assert float(network.noun_sharpness) < 0.3


def test_members_of_other_code_are_compared_with_other_nouns_alone(small: ViewSet) -> None:
    noun = KIND["rabbit"]
    rows = torch.tensor([noun, len(NOUNS) + noun, len(NOUNS), len(small) - 1])
    texts = ("a rabbit", "a tall rabbit", "a rabbit with big ears", "a cat with big ears")
    prompts = [parse(text) for text in texts]
    own = parse(str(prompts_of(small.rows(rows[1:2]))[0]))
    expected = [prompt.noun == "rabbit" and prompt != own for prompt in map(parse, texts)]
    hidden = _unknown(small, rows, encoded(prompts)) > 0
    assert hidden.tolist() == [[False] * 4, expected, [False] * 4, [False] * 4]
