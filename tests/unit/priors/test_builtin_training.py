from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from meshdeform.errors import ModelError
from meshdeform.priors.builtin import network as weights_network
from meshdeform.priors.builtin.grammar import VOCABULARY, parse, tokenise
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork
from meshdeform.priors.builtin.teaching.deformed import PictureSet, pictures, single_views
from meshdeform.priors.builtin.teaching.teacher import TrainConfig
from meshdeform.priors.builtin.vocabulary import NOUNS, OPPOSITES
from tests.close import assert_close
from training.prior import mix, sample, train, warm_start
from training.prior.dataset import PictureFolder, draw_prompt, draw_set
from training.prior.families import FAMILIES, member
from training.prior.held_out import held_out_pairs, is_held_out
from training.prior.train import PriorTrainer

pytestmark = pytest.mark.training

SMALL = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)


@pytest.fixture(scope="module")
def tiny() -> PictureSet:
    generator = torch.Generator().manual_seed(0)
    images, tokens, azimuth, single = [], [], [], []
    for noun in ("vase", "star"):
        shape = member(noun, (), np.random.default_rng(0))
        for count, draw in ((2, pictures), (1, single_views)):
            drawn, angles = draw(shape, count, generator)
            images.append(drawn)
            azimuth.append(angles)
            single += [draw is single_views] * count
        tokens += [tokenise(parse(noun))] * 3
    return PictureSet(torch.cat(images), torch.tensor(tokens), torch.cat(azimuth), torch.tensor(single))


@pytest.fixture
def small_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "PriorNetwork", lambda: PriorNetwork(SMALL))


def test_drawn_prompts_never_have_what_is_held_out_unless_asked() -> None:
    rng = np.random.default_rng(1)
    drawn = {(noun, a) for noun in NOUNS for _ in range(150) for a in draw_prompt(noun, rng).attributes}
    assert not drawn & set(held_out_pairs())
    drawn_all = (draw_prompt(noun, rng, held_out=True) for noun in ("pig", "bell") for _ in range(300))
    every = {(prompt.noun, attribute) for prompt in drawn_all for attribute in prompt.attributes}
    assert any(is_held_out(noun, attribute) for noun, attribute in every)


def test_drawn_prompts_are_mostly_plain_and_never_contradict_themselves() -> None:
    rng = np.random.default_rng(0)
    prompts = [draw_prompt(noun, rng) for noun in NOUNS for _ in range(60)]
    counts = np.bincount([len(prompt.attributes) for prompt in prompts], minlength=3) / len(prompts)
    np.testing.assert_allclose(counts, [0.45, 0.42, 0.13], atol=0.04)
    for prompt in prompts:
        assert parse(str(prompt)) == prompt
        assert not any(pair <= {a.degree for a in prompt.attributes if a.part == "whole"} for pair in OPPOSITES)


def test_a_drawn_noun_is_the_same_again_and_its_file_gives_it_back(tmp_path: Path) -> None:
    first = draw_set("heart", members=2, pictures_each=2, seed=3)
    assert first.single.tolist() == [False, False, True] * 2
    for _ in range(2):
        kept = PictureFolder.cached(tmp_path, ["heart"], 2, 2, 3).sets["heart"]
        for field in ("images", "tokens", "azimuth_deg", "single"):
            assert torch.equal(getattr(first, field), getattr(kept, field)), field
    other_seed = PictureFolder.cached(tmp_path, ["heart"], 2, 2, 4).sets["heart"]
    assert not torch.equal(first.images, other_seed.images)


def test_only_a_noun_whose_family_changed_is_drawn_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def written() -> list[int]:
        PictureFolder.cached(tmp_path, ["bowl", "heart"], 1, 1, 0)
        return [(tmp_path / f"{noun}.safetensors").stat().st_mtime_ns for noun in ("bowl", "heart")]

    first = written()
    assert written() == first
    monkeypatch.setitem(FAMILIES, "heart", FAMILIES["vase"])
    assert [again == before for again, before in zip(written(), first, strict=True)] == [True, False]


def test_a_batch_has_each_noun_as_often_as_its_odds_say(tiny: PictureSet) -> None:
    sets = {"vase": tiny.rows(torch.arange(3)), "star": tiny.rows(torch.arange(3, 6))}
    folder = PictureFolder(sets, {"star": 4.0})
    assert len(folder) == 6
    batch = folder.sample(1000, torch.Generator().manual_seed(0))
    stars = batch.tokens[:, 0] == tiny.tokens[3, 0]
    assert float(stars.double().mean()) == pytest.approx(0.8, abs=0.04)
    assert float(batch.single[stars].double().mean()) == pytest.approx(1 / 3, abs=0.05)
    assert torch.equal(batch.images[stars & batch.single][0], tiny.images[5])


@pytest.mark.usefixtures("small_network")
def test_training_lowers_the_loss(tiny: PictureSet) -> None:
    trainer = PriorTrainer(tiny, TrainConfig(batch=4), device="cpu", precision="fp32")
    trainer.total_steps = 60
    losses = [trainer.step() for _ in range(60)]
    assert np.mean(losses[-10:]) < 0.75 * np.mean(losses[:5])


@pytest.mark.usefixtures("small_network")
def test_a_resumed_run_equals_an_uninterrupted_one(tiny: PictureSet, tmp_path: Path) -> None:
    state, weights = tmp_path / "state.pt", tmp_path / "prior.safetensors"

    def trainer() -> PriorTrainer:
        made = PriorTrainer(tiny, TrainConfig(batch=2), device="cpu", precision="fp32")
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
    trainer = PriorTrainer(tiny, TrainConfig(learning_rate=1.0), device="cpu", precision="fp32")
    assert trainer.learning_rate() == pytest.approx(0.02)  # while the first steps are timed
    trainer.total_steps = 1000
    rates = []
    for trainer.step_number in range(1000):
        rates.append(trainer.learning_rate())
    assert max(rates) == pytest.approx(1.0)
    assert np.argmax(rates) == 50
    assert rates[-1] < 1e-4
    assert (np.diff(rates[50:]) <= 0).all()


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


NEW = (
    *("single", "single_place"),
    *("camera_fine.weight", "camera_fine.bias", "camera_coarse.weight", "camera_coarse.bias"),
)


@pytest.fixture
def older(tmp_path: Path) -> Path:
    """Weights of a network with fewer words, in another order, without single views and without the map of cameras."""
    torch.manual_seed(3)
    state = PriorNetwork(SMALL).state_dict()
    state = {name: torch.randn_like(tensor) * 0.2 if not tensor.any() else tensor for name, tensor in state.items()}
    words = [word for word in reversed(VOCABULARY) if word not in ("pig", "pinched")]
    for name in NEW:
        del state[name]
    state["text.word.weight"] = torch.randn(len(words), SMALL.text_width).half().float()
    path = tmp_path / "older.safetensors"
    save_file({name: tensor.half() for name, tensor in state.items()}, path, {"words": " ".join(words)})
    return path


def test_a_warm_start_maps_words_by_name_and_keeps_the_rest(older: Path) -> None:
    network = PriorNetwork(SMALL)
    assert warm_start.warm_start(network, older, torch.Generator()) == NEW
    held, metadata = weights_network.read_tensors(older)
    words = metadata["words"].split()
    rows = network.text.word.weight.detach()
    for number, word in enumerate(VOCABULARY):
        if word in words:
            assert torch.equal(rows[number], held["text.word.weight"][words.index(word)]), word
    nouns = torch.stack([rows[VOCABULARY.index(noun)] for noun in NOUNS if noun != "pig"])
    away = rows[VOCABULARY.index("pig")] - nouns.mean(0)
    assert 0 < float(away.abs().mean()) < 0.5 * float(nouns.std(0).mean())
    for name, tensor in network.state_dict().items():
        if name in held and name != "text.word.weight":
            assert torch.equal(tensor, held[name]), name
    # What a single view adds is zero until it is trained.
    x, at, azimuth = torch.randn(1, 3, 128, 128), torch.tensor([300]), torch.tensor([20.0])
    text = network.text(torch.tensor([tokenise(parse("a tall vase"))]))
    assert_close(network(x, at, text, azimuth), network(x, at, text, azimuth, torch.tensor([True])))


def test_a_run_starts_from_older_weights_and_says_so(
    tiny: PictureSet, older: Path, tmp_path: Path, small_network: None
) -> None:
    trainer = PriorTrainer(tiny, TrainConfig(batch=3), device="cpu", precision="fp32", initial=older)
    held, _ = weights_network.read_tensors(older)
    assert torch.equal(trainer.network.out.weight, held["out.weight"])
    assert torch.equal(trainer.average["out.weight"], held["out.weight"])
    trainer.total_steps = 2
    trainer.step()
    trainer.step()
    assert trainer.network.single.abs().max() > 0
    trainer.save(tmp_path / "state.pt", tmp_path / "prior.safetensors")
    _, metadata = weights_network.read_network(tmp_path / "prior.safetensors")
    assert metadata["initial"] == weights_network.file_sha256(older)
    assert metadata["words"].split() == list(VOCABULARY)


def test_a_file_without_its_words_or_of_another_size_is_refused(older: Path, tmp_path: Path) -> None:
    held, _ = weights_network.read_tensors(older)
    path = tmp_path / "nameless.safetensors"
    save_file(held, path, {"vocabulary": "0"})
    with pytest.raises(ModelError, match="vocabulary"):
        warm_start.warm_start(PriorNetwork(SMALL), path, torch.Generator())
    with pytest.raises(ModelError, match="another size"):
        warm_start.warm_start(PriorNetwork(), older, torch.Generator())


@pytest.mark.usefixtures("small_network")
def test_a_mix_lies_between_two_editions_but_for_new_words(
    older: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mix, "PriorNetwork", lambda: PriorNetwork(SMALL))
    network, new, mixed = PriorNetwork(SMALL), tmp_path / "new.safetensors", tmp_path / "mixed.safetensors"
    weights_network.write_weights(new, network.state_dict(), SMALL, {})
    mix.mix(older, new, 0.25, mixed)
    old, fresh, made = (weights_network.read_tensors(path)[0] for path in (older, new, mixed))
    name = next(each for each in old if "word" not in each)
    assert_close(made[name], 0.25 * old[name] + 0.75 * fresh[name], atol=2e-3, rtol=0.0)
    row = VOCABULARY.index("pig")
    assert_close(made["text.word.weight"][row], fresh["text.word.weight"][row], atol=0.0, rtol=0.0)


def test_most_timesteps_are_those_that_score_distillation_asks(tiny: PictureSet) -> None:
    trainer = PriorTrainer(tiny, TrainConfig(batch=20), device="cpu", precision="fp32")
    timesteps = torch.cat([trainer.batch()[1] for _ in range(50)])
    assert int(timesteps.min()) < 20
    assert int(timesteps.max()) > 980
    assert float((timesteps >= 700).double().mean()) == pytest.approx(0.75, abs=0.01)
