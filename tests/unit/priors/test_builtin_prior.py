import math
from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.errors import ModelError, ShapeError
from meshdeform.nouns.families import member
from meshdeform.priors.builtin import weights_file
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork, camera_map, null_tokens, write_weights
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, STYLE, BuiltinPrior, cosine_alphas_cumprod, noise_from_clean
from meshdeform.priors.builtin.vocabulary import VOCABULARY, tokenise
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer
from meshdeform.rendering.views import combine_views
from meshdeform.support.files import file_sha256
from meshdeform.vocabulary.grammar import parse
from tests.cases import each_case
from tests.close import assert_close
from tests.unit.priors.combined import guided, text_rows
from training.prior.pictures import SINGLE_STYLE
from training.prior.trainer import add_noise, loss_weight


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Random weights of a small network, written as the trainer writes them."""
    torch.manual_seed(0)
    config = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)
    state = {
        name: torch.randn_like(tensor) * 0.2 if not tensor.any() else tensor
        for name, tensor in PriorNetwork(config).state_dict().items()
    }
    path = tmp_path / "prior.safetensors"
    write_weights(path, state, config, {"steps": "7", "seed": "3"})
    return path


def test_single_views_are_predicted_each_with_its_own_camera(weights: Path) -> None:
    prior = BuiltinPrior(weights=weights)
    embedding = text_rows(prior, "a tall vase")
    z_t = torch.randn(3, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    at, azimuths = torch.tensor([400, 100, 700]), (20.0, -75.0, 160.0)
    together = guided(*prior.predict_noise(z_t, at, embedding, fixed_cameras(azimuths, 10.0)), 3.0)
    assert together.shape == z_t.shape
    for k, azimuth in enumerate(azimuths):
        alone = guided(
            *prior.predict_noise(z_t[k : k + 1], at[k : k + 1], embedding, fixed_cameras((azimuth,), 10.0)), 3.0
        )
        assert_close(together[k : k + 1], alone, atol=1e-3, rtol=1e-3)
    turned = guided(*prior.predict_noise(z_t, at, embedding, fixed_cameras((20.0, -75.0, 0.0), 10.0)), 3.0)
    assert_close(turned[:2], together[:2], atol=1e-3, rtol=1e-3)
    assert (turned[2] - together[2]).abs().max() > 1e-3
    four = fixed_cameras(20.0, 10.0)
    grid = guided(*prior.predict_noise(z_t[:1], at[:1], embedding, four), 3.0)
    assert (grid - together[:1]).abs().max() > 1e-3
    with pytest.raises(ShapeError, match="3 pictures and 4 cameras"):
        guided(*prior.predict_noise(z_t, at, embedding, four), 3.0)
    assert 2 * prior.style.view_size == SINGLE_STYLE.view_size == 128


def test_it_says_who_it_is_and_pictures_are_their_own_latents(weights: Path) -> None:
    prior = BuiltinPrior(weights=weights)
    assert prior.identity == {"id": str(weights), "revision": "7 steps, seed 3", "sha256": file_sha256(weights)}
    assert BuiltinPrior().identity["id"] == "builtin"
    assert prior.alphas_cumprod.shape == (prior.num_timesteps,)
    assert (prior.style, prior.dtype) == (STYLE, torch.float32)
    image = torch.rand(1, 3, 128, 128, requires_grad=True)
    z0 = prior.encode_image(image)
    assert_close(z0, image * 2 - 1)
    z0.sum().backward()
    assert_close(image.grad, torch.full_like(image, 2.0))
    predicted = prior.predict_noise(z0, torch.tensor([5]), text_rows(prior, "a hat"), fixed_cameras(0.0, 0.0))
    assert not any(each.requires_grad for each in predicted)


def test_a_negative_prompt_stands_in_for_nothing(weights: Path) -> None:
    """Its row is that of the prompt it is; attributes alone are those of the prompt's noun."""
    prior = BuiltinPrior(weights=weights)
    negative, prompt = text_rows(prior, "a vase", "fat")
    assert_close(prompt, text_rows(prior, "a vase")[1])
    assert_close(negative, text_rows(prior, "a fat vase")[1])
    assert not torch.allclose(negative, text_rows(prior, "a vase", "")[0])
    rows = prior.encode_texts("a vase", "", "a chair", "fat")
    assert rows.shape == (4, 16)
    assert_close(rows[2], text_rows(prior, "a chair")[1])


def test_missing_torn_and_foreign_weights_are_model_errors(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ModelError, match="missing"):
        BuiltinPrior(weights=tmp_path / "nothing.safetensors")
    torn = tmp_path / "torn.safetensors"
    torn.write_bytes(weights.read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        BuiltinPrior(weights=torn)
    monkeypatch.setattr(weights_file, "VOCABULARY", VOCABULARY[:-1])
    with pytest.raises(ModelError, match="another vocabulary"):
        BuiltinPrior(weights=weights)


@pytest.fixture(scope="module")
def shipped() -> BuiltinPrior:
    return BuiltinPrior()


def test_the_shipped_prior_tells_shapes_apart_and_sides_from_each_other(shipped: BuiltinPrior) -> None:
    """The noise is explained best by the prompt and the azimuth that are true."""
    nouns = ["vase", "mushroom", "chair", "giraffe", "airplane", "snowman"]
    confused = 0
    for number, noun in enumerate(nouns):
        shape = member(noun, (), np.random.default_rng(900 + number))
        renderer = Renderer(torch.from_numpy(shape.faces), len(shape.verts), STYLE)
        cameras, turned = fixed_cameras(35.0, 15.0), fixed_cameras(215.0, 15.0)
        z0 = shipped.encode_image(combine_views(renderer.render(torch.from_numpy(shape.verts), cameras)))
        generator = torch.Generator().manual_seed(number)
        at = torch.tensor([600])
        noise = torch.randn(z0.shape, generator=generator)
        noisy = add_noise(z0, noise, at, shipped.alphas_cumprod)

        def error(prompt: str, seen=cameras, noisy=noisy, noise=noise, at=at) -> float:
            predicted = guided(*shipped.predict_noise(noisy, at, text_rows(shipped, prompt), seen), 1.0)
            return float((predicted - noise).square().mean())

        errors = {other: error(other) for other in nouns}
        confused += min(errors, key=errors.__getitem__) != noun
        if noun in ("chair", "giraffe", "airplane"):
            assert error(noun) < error(noun, turned)
    assert confused == 0


@each_case(
    ("dtype", "expected"), [("bfloat16", torch.bfloat16), ("float16", torch.float32), ("float32", torch.float32)]
)
def test_it_predicts_nearly_the_same_in_bfloat16(shipped: BuiltinPrior, dtype: str, expected: torch.dtype) -> None:
    """To 0.01 of the noise, whose standard deviation is 1; the same bits every time, and text vectors in float32."""
    prior = BuiltinPrior(dtype=dtype)
    assert prior.dtype is expected
    noisy, at = torch.randn(1, 3, 128, 128, generator=torch.Generator().manual_seed(0)), torch.tensor([500])
    rows, cameras = text_rows(shipped, "a tall vase"), fixed_cameras(20.0, 15.0)
    assert torch.equal(text_rows(prior, "a tall vase"), rows)
    exact, found = (torch.cat(p.predict_noise(noisy, at, rows, cameras)) for p in (shipped, prior))
    assert found.dtype is torch.float32
    assert torch.equal(found, torch.cat(prior.predict_noise(noisy, at, rows, cameras)))
    assert (float((found - exact).square().mean().sqrt()) > 0) == (expected is torch.bfloat16)
    assert_close(found, exact, atol=0.1, rtol=0)
    assert float((found - exact).square().mean().sqrt()) < 0.01


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


def test_padding_does_not_change_a_prompt_and_no_words_have_their_own_vector(network: PriorNetwork) -> None:
    with torch.no_grad():
        together = network.text(_tokens("a vase", "a tall thin vase"))
        assert_close(together[:1], network.text(_tokens("a vase")))
        network.text.word.weight[0] += 100.0  # the padding's own embedding
        assert_close(network.text(_tokens("a vase")), together[:1])
        assert_close(network.text(null_tokens(1))[0], network.text.nothing)


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
