"""How the judge is trained: disjoint members, true labels, a loss that goes down, weights that come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.judge.network import JudgeNetwork, encoded
from meshdeform.judge.training.augment import augmented
from meshdeform.judge.training.measure import prompts_of, variants
from meshdeform.judge.training.members import (
    CALIBRATION,
    HELD_OUT,
    TRAINING,
    ViewSet,
    draw_member,
    draw_nothing,
    roughened,
    seeded,
)
from meshdeform.judge.training.train import TrainConfig, Trainer, calibrate
from meshdeform.judge.weights_file import read_judge, write_judge
from meshdeform.priors.builtin.grammar import NOUNS, Attribute, ParsedPrompt, parse

pytestmark = pytest.mark.training


@pytest.fixture(scope="module")
def small() -> ViewSet:
    torch.set_num_threads(1)
    return ViewSet.drawn(TRAINING, 1, 4)


def test_the_ranges_of_seeds_share_no_member_with_each_other_or_the_prior() -> None:
    streams = [seeded(split, 3, 5).random(4) for split in (TRAINING, CALIBRATION, HELD_OUT)]
    streams.append(np.random.default_rng([0, 3, 5]).random(4))
    assert len({tuple(stream) for stream in streams}) == 4


def test_every_prompt_that_is_drawn_is_one_of_the_grammar() -> None:
    for kind, noun in enumerate(NOUNS):
        for number in range(2):
            prompt, _ = draw_member(noun, seeded(HELD_OUT, kind, number))
            assert parse(str(prompt)) == prompt


def test_a_set_says_what_it_shows(small: ViewSet) -> None:
    assert len(small) == len(NOUNS) + 4
    assert small.images.shape[1:] == (4, 64, 64)
    assert small.noun.tolist() == [*range(len(NOUNS)), -1, -1, -1, -1]
    named = ViewSet(small.images[: len(NOUNS)], small.noun[: len(NOUNS)], small.attributes[: len(NOUNS)])
    drawn = [draw_member(noun, seeded(TRAINING, kind, 0))[0] for kind, noun in enumerate(NOUNS)]
    assert prompts_of(named) == drawn


def test_a_set_comes_back_from_its_cache_and_another_one_is_drawn_anew(tmp_path: Path, small: ViewSet) -> None:
    path = tmp_path / "views.safetensors"
    drawn = ViewSet.cached(path, TRAINING, 0, 4)
    assert torch.equal(drawn.images, small.images[-4:])
    written = path.stat().st_mtime_ns
    assert torch.equal(ViewSet.cached(path, TRAINING, 0, 4).images, drawn.images)
    assert path.stat().st_mtime_ns == written
    assert len(ViewSet.cached(path, TRAINING, 0, 2)) == 2


def test_roughening_keeps_the_shape() -> None:
    for number in range(5):
        _, shape = draw_member("vase", seeded(HELD_OUT, 0, number))
        rough = roughened(shape, seeded(HELD_OUT, 1, number))
        assert np.array_equal(rough.faces, shape.faces)
        moved = np.linalg.norm(rough.verts - shape.verts, axis=1)
        assert 0.0 < moved.mean() < 0.15


def test_nothing_is_drawn_within_the_unit_sphere() -> None:
    for number in range(10):
        verts = draw_nothing(seeded(HELD_OUT, -1, number)).verts
        assert np.linalg.norm(verts, axis=1).max() == pytest.approx(1.0)


def test_augmentation_is_seeded_and_leaves_the_background_white() -> None:
    blank = torch.ones(16, 1, 64, 64)
    changed = augmented(blank, torch.Generator().manual_seed(1))
    assert float((changed - 1.0).abs().max()) < 0.15
    drawn = torch.rand(16, 1, 64, 64, generator=torch.Generator().manual_seed(2))
    one, two = (augmented(drawn, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(one, two)


def test_training_learns_a_handful_of_meshes_and_is_repeatable(small: ViewSet) -> None:
    few = ViewSet(small.images[:8], small.noun[:8], small.attributes[:8])
    runs = []
    for _ in range(2):
        trainer = Trainer(few, TrainConfig(steps=14, batch=4))
        runs.append(torch.stack([trainer.step() for _ in range(14)]))
    assert torch.equal(runs[0], runs[1])
    assert bool((runs[0][-3:].mean(0) < 0.8 * runs[0][:2].mean(0)).all())


def test_scores_are_the_nouns_logit_and_the_match_of_the_attributes() -> None:
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    prompts = [ParsedPrompt("vase"), ParsedPrompt("vase", (Attribute("whole", "tall"),)), ParsedPrompt("dog")]
    with torch.no_grad():
        noun_logits, features = network.encode_views(torch.rand(3, 1, 64, 64))
        scores = network.scores(noun_logits, features, encoded(prompts))
        one = network.scores(noun_logits[1:2], features[1:2], encoded(prompts[1:2]))
    assert scores.shape == (3, 3)
    assert float(one) == pytest.approx(float(scores[1, 1]), abs=1e-5)
    assert not torch.allclose(scores[:, 0], scores[:, 1])


def test_calibration_softens_a_network_that_is_wrong(small: ViewSet) -> None:
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    torch.nn.init.normal_(network.noun_head.weight, std=10.0)
    # Twenty of nouns, and the four that are nothing.
    rows = torch.tensor([*range(20), *range(len(NOUNS), len(NOUNS) + 4)])
    calibrate(network, ViewSet(small.images[rows], small.noun[rows], small.attributes[rows]))
    assert float(network.noun_sharpness) < 0.3


def test_weights_come_back(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    network.prompt_sharpness.fill_(2.5)
    write_judge(tmp_path / "judge", network, {"steps": "7"})
    again, metadata = read_judge(tmp_path / "judge")
    images = torch.rand(2, 1, 64, 64)
    with torch.no_grad():
        assert torch.allclose(again.encode_views(images)[0], network.encode_views(images)[0], atol=1e-2)
    assert float(again.prompt_sharpness) == 2.5
    assert metadata["steps"] == "7"


def test_the_variants_of_a_noun_are_its_own() -> None:
    assert ParsedPrompt("rabbit", (Attribute("ears", "big"),)) in variants("rabbit")
    assert len({str(prompt) for prompt in variants("rabbit")}) == len(variants("rabbit"))
    assert all(parse(str(prompt)) == prompt for noun in NOUNS for prompt in variants(noun))
