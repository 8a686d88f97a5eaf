from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.cameras import fixed_cameras
from meshdeform.priors.builtin import dataset, sample, train, weights_file
from meshdeform.priors.builtin.dataset import PictureSet, draw_prompt, pictures
from meshdeform.priors.builtin.families import member
from meshdeform.priors.builtin.grammar import NOUNS, OPPOSITES, parse, tokenise
from meshdeform.priors.builtin.model import ModelConfig, PriorNetwork
from meshdeform.priors.builtin.style import STYLE
from meshdeform.priors.builtin.train import TrainConfig, Trainer
from meshdeform.shading import Renderer, combine_views

SMALL = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)


@pytest.fixture(scope="module")
def tiny() -> PictureSet:
    generator = torch.Generator().manual_seed(0)
    images, tokens, azimuth = [], [], []
    for noun in ("vase", "star"):
        shape = member(noun, (), np.random.default_rng(0))
        drawn, angles = pictures(shape, 3, generator)
        images.append(drawn)
        azimuth.append(angles)
        tokens += [tokenise(parse(noun))] * 3
    return PictureSet(torch.cat(images), torch.tensor(tokens), torch.cat(azimuth))


@pytest.fixture
def small_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "PriorNetwork", lambda: PriorNetwork(SMALL))


def test_a_picture_is_what_the_deformer_renders() -> None:
    shape = member("mushroom", (), np.random.default_rng(0))
    images, azimuth = pictures(shape, 2, torch.Generator().manual_seed(5))
    assert images.shape == (2, 3, 128, 128)
    assert images.dtype == torch.uint8
    assert (azimuth.abs() <= 180).all()
    # The fixed cameras are not those of the draw, but they show the same thing in the same colours.
    renderer = Renderer(torch.from_numpy(shape.faces), len(shape.verts), STYLE)
    views = renderer.render(torch.from_numpy(shape.verts), fixed_cameras(float(azimuth[0]), 15.0))
    fixed = combine_views(views)[0]
    covered = (fixed.sum(0) > 0).float().mean()
    assert (images[0].sum(0) > 0).float().mean() == pytest.approx(float(covered), rel=0.3)
    assert abs(images[0].float().div(255).mean() - fixed.mean()) < 0.05


def test_drawn_prompts_are_mostly_plain_and_never_contradict_themselves() -> None:
    rng = np.random.default_rng(0)
    prompts = [draw_prompt(noun, rng) for noun in NOUNS for _ in range(60)]
    counts = np.bincount([len(prompt.attributes) for prompt in prompts], minlength=3) / len(prompts)
    np.testing.assert_allclose(counts, [0.55, 0.35, 0.10], atol=0.04)
    for prompt in prompts:
        assert parse(str(prompt)) == prompt
        assert not any(pair <= {a.degree for a in prompt.attributes if a.part == "whole"} for pair in OPPOSITES)


def test_a_drawn_set_is_the_same_again_and_its_cache_gives_it_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "NOUNS", {noun: NOUNS[noun] for noun in ("bowl", "heart")})
    first = PictureSet.drawn(members=1, pictures_each=2, seed=3)
    kept = PictureSet.cached(tmp_path / "pictures.safetensors", 1, 2, 3)
    read = PictureSet.cached(tmp_path / "pictures.safetensors", 1, 2, 3)
    assert len(first) == 4
    for other in (kept, read):
        assert torch.equal(first.images, other.images)
        assert torch.equal(first.tokens, other.tokens)
        assert torch.equal(first.azimuth_deg, other.azimuth_deg)
    assert not torch.equal(first.images, PictureSet.drawn(members=1, pictures_each=2, seed=4).images)


@pytest.mark.usefixtures("small_network")
def test_training_lowers_the_loss(tiny: PictureSet) -> None:
    trainer = Trainer(tiny, TrainConfig(batch=4), device="cpu", precision="fp32")
    trainer.total_steps = 60
    losses = [trainer.step() for _ in range(60)]
    assert np.mean(losses[-10:]) < 0.75 * np.mean(losses[:5])


@pytest.mark.usefixtures("small_network")
def test_a_resumed_run_equals_an_uninterrupted_one(tiny: PictureSet, tmp_path: Path) -> None:
    state, weights = tmp_path / "state.pt", tmp_path / "prior.safetensors"

    def trainer() -> Trainer:
        made = Trainer(tiny, TrainConfig(batch=2), device="cpu", precision="fp32")
        made.total_steps = 6
        return made

    whole = trainer()
    expected = [whole.step() for _ in range(6)]
    first = trainer()
    losses = [first.step() for _ in range(3)]
    first.save(state, weights)
    second = trainer()
    second.restore(state)
    losses += [second.step() for _ in range(3)]
    assert losses == expected
    for name, tensor in whole.average.items():
        assert torch.equal(tensor, second.average[name]), name


@pytest.mark.usefixtures("small_network")
def test_the_learning_rate_rises_then_falls_to_zero(tiny: PictureSet) -> None:
    trainer = Trainer(tiny, TrainConfig(learning_rate=1.0), device="cpu", precision="fp32")
    assert trainer.learning_rate() == pytest.approx(0.02)  # while the first steps are timed
    trainer.total_steps = 1000
    rates = []
    for trainer.step_number in range(1000):
        rates.append(trainer.learning_rate())
    assert max(rates) == pytest.approx(1.0)
    assert np.argmax(rates) == 50
    assert rates[-1] < 1e-4
    assert (np.diff(rates[50:]) <= 0).all()


@pytest.mark.usefixtures("small_network")
def test_weights_come_back_in_half_precision(tiny: PictureSet, tmp_path: Path) -> None:
    trainer = Trainer(tiny, TrainConfig(batch=2), device="cpu", precision="fp32")
    trainer.total_steps = 1
    trainer.step()
    trainer.save(tmp_path / "state.pt", tmp_path / "prior.safetensors")
    network, metadata = weights_file.read_network(tmp_path / "prior.safetensors")
    assert metadata["steps"] == "1"
    assert network.config == SMALL
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(tensor, trainer.average[name], atol=1e-3, rtol=1e-3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["prior.safetensors", "state.pt"]


def test_samples_are_pictures_and_the_same_for_the_same_seed() -> None:
    torch.manual_seed(0)
    network = PriorNetwork(SMALL).eval()
    angles = torch.tensor([0.0, 90.0])
    first, again = (sample.sample(network, ["a vase", "a dog"], angles, steps=3, seed=1) for _ in range(2))
    assert first.shape == (2, 3, 128, 128)
    assert torch.equal(first, again)
    assert 0 <= float(first.min()) <= float(first.max()) <= 1
    sheet = sample.contact_sheet([first, first], ["one", "two"])
    assert sheet.size == (2 * 128 + 6, 2 * (128 + 18))
