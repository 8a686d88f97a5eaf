"""How the judge is trained: disjoint members, true labels, a loss that goes down, weights that come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.judge.scoring import JudgeNetwork, encoded
from meshdeform.priors.builtin.grammar import Attribute, ParsedPrompt, parse
from meshdeform.priors.builtin.vocabulary import NOUNS
from training.judge.augment import augmented
from training.judge.measure import prompts_of, variants
from training.judge.members import (
    CALIBRATION,
    HELD_OUT,
    NOTHING,
    TRAINING,
    ViewSet,
    counts_of,
    draw_member,
    draw_other,
    seeded,
)
from training.judge.shapes.solids import ball, block, carved, drum, rod, surfaced
from training.judge.train import TrainConfig, Trainer, _unknown, calibrate
from training.prior.families import Part

pytestmark = pytest.mark.training

KIND = {noun: number for number, noun in enumerate(NOUNS)}


@pytest.fixture(scope="module")
def small() -> ViewSet:
    """A member of every family, one more of every noun by the judge's own code, and four that are nothing."""
    torch.set_num_threads(1)
    return ViewSet.of_all(TRAINING, counts_of(list(NOUNS), 1, 1, 4))


def test_the_ranges_of_seeds_share_no_member_with_each_other_or_the_prior() -> None:
    streams = [seeded(split, "dog", 5).random(4) for split in (TRAINING, CALIBRATION, HELD_OUT)]
    streams += [seeded(TRAINING, "other dog", 5).random(4), np.random.default_rng([0, 3, 5]).random(4)]
    assert len({tuple(stream) for stream in streams}) == 5


def test_every_prompt_that_is_drawn_is_one_of_the_grammar() -> None:
    for noun in NOUNS:
        prompt, _ = draw_member(noun, seeded(HELD_OUT, noun, 0))
        assert parse(str(prompt)) == prompt


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


def _volume(part: Part) -> float:
    a, b, c = part.verts[part.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def test_solids_have_the_volumes_that_geometry_gives_them() -> None:
    shapes = {
        4 / 3 * np.pi * 0.5 * 0.4 * 0.3: [ball((0.1, 0, 0), (0.5, 0.4, 0.3), (30, 20, 10))],
        1.0 * 0.8 * 0.6: [block((0, 0.2, 0), (1.0, 0.8, 0.6), 0.0)],
        np.pi * 0.25 * 1.2: [drum((0, 0, 0), (0, 0, 1.2), 0.5)],
        np.pi * 0.09 * (1 + 4 / 3 * 0.3): [rod((0, 0, 0), (1, 0, 0), 0.3)],
        1.0 - 0.4**3: [block((0, 0, 0), (1, 1, 1), 0.0), carved(block((0, 0, 0), (0.4, 0.4, 0.4), 0.0))],
    }
    for volume, solids in shapes.items():
        assert _volume(surfaced(solids, 40, 0.0)) == pytest.approx(volume, rel=0.03)
        assert _volume(surfaced(solids, 40, 0.0, voxels=True)) == pytest.approx(volume, rel=0.06)


def test_a_blend_fills_the_gap_between_solids_and_a_crease_does_not() -> None:
    solids = [ball((0, 0, 0), 0.5), ball((0.8, 0, 0), 0.5)]
    assert _volume(surfaced(solids, 40, 0.1)) > 1.01 * _volume(surfaced(solids, 40, 0.0))


def test_a_set_says_what_it_shows(small: ViewSet) -> None:
    count = len(NOUNS)
    assert len(small) == 2 * count + 4
    assert small.images.shape[1:] == (4, 64, 64)
    assert small.noun.tolist() == [*range(count), *range(count), -1, -1, -1, -1]
    assert small.other.tolist() == [False] * count + [True] * count + [False] * 4
    named = small.rows(torch.arange(2 * count))
    drawn = [draw_member(noun, seeded(TRAINING, noun, 0))[0] for noun in NOUNS]
    drawn += [draw_other(noun, seeded(TRAINING, "other " + noun, 0))[0] for noun in NOUNS]
    assert prompts_of(named) == drawn


def test_a_set_comes_back_from_its_cache_and_only_what_is_missing_is_drawn(tmp_path: Path) -> None:
    drawn = ViewSet.cached(tmp_path, counts_of(["vase"], 2, 1, 3))
    assert torch.equal(drawn.images[-3:], ViewSet.drawn(TRAINING, NOTHING, 3).images)
    written = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert set(written) == {"vase.safetensors", "other.vase.safetensors", "nothing.safetensors"}
    more = ViewSet.cached(tmp_path, counts_of(["vase", "pear"], 2, 1, 4))
    assert torch.equal(more.images[:2], drawn.images[:2])
    assert more.noun.tolist() == [KIND[noun] for noun in ("vase", "vase", "pear", "pear", "vase", "pear")] + [-1] * 4
    assert torch.equal(more.images[-4:-1], drawn.images[-3:])
    again = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert again["vase.safetensors"] == written["vase.safetensors"]
    assert again["nothing.safetensors"] != written["nothing.safetensors"]


def test_augmentation_is_seeded_and_leaves_the_background_white() -> None:
    blank = torch.ones(16, 1, 64, 64)
    changed = augmented(blank, torch.Generator().manual_seed(1))
    assert float((changed - 1.0).abs().max()) < 0.15
    drawn = torch.rand(16, 1, 64, 64, generator=torch.Generator().manual_seed(2))
    one, two = (augmented(drawn, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(one, two)


def test_training_learns_a_handful_of_meshes_and_is_repeatable(small: ViewSet) -> None:
    few = small.rows(torch.arange(8))
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


def test_the_variants_of_a_noun_are_its_own() -> None:
    assert ParsedPrompt("rabbit", (Attribute("ears", "big"),)) in variants("rabbit")
    assert len({str(prompt) for prompt in variants("rabbit")}) == len(variants("rabbit"))
    assert all(parse(str(prompt)) == prompt for noun in NOUNS for prompt in variants(noun))
