import math

import pytest
import torch

from meshdeform.priors.builtin.grammar import parse, tokenise
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork, camera_map, null_tokens
from meshdeform.priors.builtin.prior import (
    NUM_TIMESTEPS,
    add_noise,
    cosine_alphas_cumprod,
    loss_weight,
    noise_from_clean,
)
from tests.close import assert_close

SMALL = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)


@pytest.fixture
def network() -> PriorNetwork:
    torch.manual_seed(0)
    made = PriorNetwork(SMALL).eval()
    # Zero-initialised output layers hide everything behind them.
    for parameter in made.parameters():
        if not parameter.any():
            torch.nn.init.normal_(parameter, std=0.2)
    return made


def _tokens(*prompts: str) -> torch.Tensor:
    return torch.tensor([tokenise(parse(prompt)) for prompt in prompts])


def test_the_schedule_falls_from_signal_to_noise() -> None:
    levels = cosine_alphas_cumprod()
    assert levels.shape == (NUM_TIMESTEPS,)
    assert levels.dtype == torch.float32
    assert (levels.diff() < 0).all()
    assert levels[0] > 0.999
    assert 0 < levels[-1] < 1e-4
    assert levels[NUM_TIMESTEPS // 2] == pytest.approx(0.5, abs=0.02)


def test_the_noise_that_was_added_comes_back_from_the_clean_picture() -> None:
    generator = torch.Generator().manual_seed(0)
    clean, noise = torch.randn(2, 5, 3, 4, 4, generator=generator, dtype=torch.float64).unbind(0)
    levels = cosine_alphas_cumprod().double()
    at = torch.tensor([0, 20, 500, 980, 999])
    noisy = add_noise(clean, noise, at, levels)
    assert_close(noise_from_clean(clean, noisy, at, levels), noise)
    # Unit variance stays unit variance.
    assert (levels.sqrt()[at] ** 2 + (1 - levels[at])).allclose(torch.ones(5, dtype=torch.float64))


def test_the_loss_is_that_of_velocity_up_to_its_bound() -> None:
    levels = cosine_alphas_cumprod()
    weight = loss_weight(torch.arange(NUM_TIMESTEPS), levels).flatten()
    noisy_enough = levels < 0.8
    assert_close(weight[noisy_enough], levels[noisy_enough] / (1 - levels[noisy_enough]) + 1)
    assert (weight[~noisy_enough] == 5).all()


def test_a_prediction_has_the_picture_s_shape_and_starts_at_zero() -> None:
    made = PriorNetwork(SMALL)
    x = torch.randn(2, 3, 128, 128)
    out = made(x, torch.tensor([3, 900]), made.text(null_tokens(2)), torch.tensor([0.0, 90.0]))
    assert out.shape == x.shape
    assert (out - made.out.bias.reshape(3, 16).mean()).abs().max() < 1.0


def test_everything_it_is_told_changes_the_prediction(network: PriorNetwork) -> None:
    x = torch.randn(1, 3, 128, 128, generator=torch.Generator().manual_seed(1))

    @torch.no_grad()
    def predict(prompt: str = "a vase", timestep: int = 300, azimuth: float = 10.0) -> torch.Tensor:
        return network(x, torch.tensor([timestep]), network.text(_tokens(prompt)), torch.tensor([azimuth]))

    base = predict()
    assert_close(predict(), base)
    for other in (predict("a dog"), predict("a tall vase"), predict(timestep=600), predict(azimuth=190.0)):
        assert (other - base).abs().max() > 1e-4
    assert_close(predict(azimuth=370.0), base, atol=1e-4, rtol=1e-4)


def test_single_views_are_told_from_grids_picture_by_picture(network: PriorNetwork) -> None:
    x = torch.randn(1, 3, 128, 128, generator=torch.Generator().manual_seed(1)).expand(2, -1, -1, -1)
    at, azimuth = torch.tensor([300, 300]), torch.tensor([10.0, 10.0])
    with torch.no_grad():
        text = network.text(_tokens("a vase", "a vase"))
        grids = network(x, at, text, azimuth)
        mixed = network(x, at, text, azimuth, torch.tensor([False, True]))
    assert_close(mixed[0], grids[0])
    assert (mixed[1] - grids[1]).abs().max() > 1e-3


def test_padding_does_not_change_a_prompt_and_no_words_have_their_own_vector(network: PriorNetwork) -> None:
    with torch.no_grad():
        together = network.text(_tokens("a vase", "a tall thin vase"))
        assert_close(together[:1], network.text(_tokens("a vase")))
        network.text.word.weight[0] += 100.0  # the padding's own embedding
        assert_close(network.text(_tokens("a vase")), together[:1])
        assert_close(network.text(null_tokens(1))[0], network.text.nothing)


def test_a_batch_predicts_what_its_members_predict_alone(network: PriorNetwork) -> None:
    x = torch.randn(2, 3, 128, 128, generator=torch.Generator().manual_seed(2))
    at, azimuth = torch.tensor([100, 700]), torch.tensor([0.0, 45.0])
    with torch.no_grad():
        text = network.text(_tokens("a car", "a boat"))
        both = network(x, at, text, azimuth)
        alone = torch.cat([network(x[i : i + 1], at[i : i + 1], text[i : i + 1], azimuth[i : i + 1]) for i in (0, 1)])
    assert_close(both, alone, atol=1e-4, rtol=1e-4)


def test_the_camera_map_knows_each_pixels_place_and_azimuth() -> None:
    azimuth = torch.tensor([30.0, 30.0])
    grid, alone = camera_map(azimuth, torch.tensor([False, True]), 8)
    corners = [(0, 0, 30.0), (0, 7, 120.0), (7, 0, 210.0), (7, 7, 300.0)]
    for row, column, degrees in corners:
        angle = math.radians(degrees)
        assert_close(grid[:2, row, column], torch.tensor([math.sin(angle), math.cos(angle)]))
        assert_close(alone[:2, row, column], torch.tensor([0.5, math.sqrt(0.75)]))
    assert grid[2, 0].tolist() == [-0.75, -0.25, 0.25, 0.75] * 2
    assert alone[2, 0].tolist() == [(k + 0.5) / 4 - 1 for k in range(8)]
    assert torch.equal(grid[3], grid[2].T)
    assert torch.equal(alone[3], alone[2].T)
    products = [grid[place] * grid[turn] for place in (2, 3) for turn in (0, 1)]
    assert_close(grid[4:], torch.stack(products))
