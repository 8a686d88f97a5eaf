from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from meshdeform.nouns.families import member
from meshdeform.priors.builtin import network as weights_network
from meshdeform.priors.builtin.grammar import VOCABULARY, parse, tokenise
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork
from meshdeform.priors.builtin.vocabulary import NOUNS
from tests.close import assert_close
from training.prior import train, warm_start
from training.prior.dataset import draw_prompt
from training.prior.held_out import held_out_pairs
from training.prior.pictures import PictureSet, pictures, single_views
from training.prior.train import PriorTrainer
from training.prior.trainer import TrainConfig

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


def test_drawn_prompts_never_have_what_is_held_out() -> None:
    rng = np.random.default_rng(1)
    drawn = {(noun, a) for noun in NOUNS for _ in range(150) for a in draw_prompt(noun, rng).attributes}
    assert not drawn & set(held_out_pairs())


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
