"""Score distillation: the gradient of the paper, drawn reproducibly, downhill to a known optimum."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from meshdeform.errors import NumericalError, ParameterError
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import REFERENCE_ELEMENTS, ScoreDistillation, Timesteps, rescaled
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from tests.cases import each_case
from tests.close import assert_close
from tests.fakes import FakePrior
from tests.unit.guidance.pictures import PicturesPrior

CAMERAS = fixed_cameras(0.0, 15.0)


def context(step: int = 0, total_steps: int = 100, seed: int = 0) -> StepContext:
    return StepContext(step, total_steps, CAMERAS, torch.Generator().manual_seed(seed))


class LinearPrior(FakePrior):
    """Predicts half of z_t, whatever it is; keeps z0 and z_t so that a test can work the gradient out by hand."""

    def encode_image(self, image: Tensor) -> Tensor:
        self.z0 = super().encode_image(image)
        if self.z0.requires_grad:
            self.z0.retain_grad()
        return self.z0

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: None, cameras: Cameras) -> tuple[Tensor, Tensor]:
        assert not z_t.requires_grad
        self.timesteps += timestep.tolist()
        self.z_t = z_t
        return 0.5 * z_t, 0.5 * z_t


@each_case("side", [64, 128])
def test_the_gradient_on_z0_is_exactly_the_papers_times_the_size_factor(side: int) -> None:
    prior = LinearPrior(torch.zeros(1, 3, side, side))
    image = torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(1)).requires_grad_()
    guidance = ScoreDistillation(prior, "", guidance_scale=1.0)
    loss, logs = guidance.loss(image, context())
    loss.backward()

    level = prior.alphas_cumprod[prior.timesteps[0]]
    noise = (prior.z_t - level.sqrt() * prior.z0.detach()) / (1 - level).sqrt()
    expected = (1 - level) * (0.5 * prior.z_t - noise) * REFERENCE_ELEMENTS / (3 * side * side)
    assert_close(prior.z0.grad, expected, rtol=1e-4, atol=1e-5)
    assert_close(image.grad, 2 * prior.z0.grad)
    assert logs["sds_gradient_norm"] == pytest.approx(expected.norm().item(), rel=1e-4)


def test_the_noise_and_the_scale_are_bit_exact_for_stable_diffusions_latents() -> None:
    """4 x 64 x 64 latents: the factor is 1, so the gradient is (1 - abar)(eps_hat - eps) and nothing else."""
    latents = torch.rand(1, 4, 64, 64, generator=torch.Generator().manual_seed(1)).requires_grad_()
    prior = LinearPrior(torch.zeros(1, 3, 64, 64))
    loss, _ = ScoreDistillation(prior, "", guidance_scale=1.0).loss(latents, context(seed=5))
    loss.backward()

    generator = torch.Generator().manual_seed(5)
    timestep = torch.randint(20, 981, (1,), generator=generator)
    noise = torch.randn(1, 4, 64, 64, generator=generator)
    assert timestep.item() == prior.timesteps[0]
    assert torch.equal(prior.z0.grad, (1 - prior.alphas_cumprod[timestep]) * (0.5 * prior.z_t - noise))


def test_descent_reaches_the_only_picture_that_the_prior_knows() -> None:
    optimum = torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(3))
    guidance = ScoreDistillation(FakePrior(optimum), "a picture", guidance_scale=100.0)
    image = torch.full_like(optimum, 0.5, requires_grad=True)
    optimizer = torch.optim.Adam([image], lr=0.05)
    generator = torch.Generator().manual_seed(0)
    errors = []
    for step in range(100):
        loss, _ = guidance.loss(image, StepContext(step, 100, CAMERAS, generator))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append((image.detach() - optimum).abs().max().item())
    assert errors[-1] < 0.02 < errors[0]


def test_the_prompt_is_encoded_once_a_job() -> None:
    prior = FakePrior()
    guidance = ScoreDistillation(prior, "a vase", negative_prompt="blurry", guidance_scale=7.5)
    for step in range(3):
        guidance.loss(torch.zeros(1, 3, 48, 48), context(step))
    assert prior.prompts == [("a vase", "blurry")]
    assert guidance.identity == prior.identity
    assert guidance.style == prior.style


def bounded(prior: FakePrior, low: float, high: float, end: float) -> ScoreDistillation:
    return ScoreDistillation(prior, "", guidance_scale=1.0, timesteps=Timesteps(low, high, end))


def test_timesteps_fill_their_range_and_never_leave_it_and_its_upper_bound_moves_linearly() -> None:
    guidance = bounded(FakePrior(), 0.02, 0.98, 0.5)
    bounds = [guidance.timestep_bounds(context(step, 101)) for step in (0, 50, 100)]
    assert bounds == [(20, 980), (20, 740), (20, 500)]
    assert guidance.timestep_bounds(context(0, 1)) == (20, 980)
    prior = FakePrior(torch.zeros(1, 3, 4, 4))
    guidance, generator = bounded(prior, 0.9, 1.0, 1.0), torch.Generator().manual_seed(0)
    for step in range(400):
        guidance.loss(torch.zeros(1, 3, 4, 4), StepContext(step, 400, CAMERAS, generator))
    assert min(prior.timesteps) in range(900, 905)
    assert max(prior.timesteps) in range(995, 1000)
    for crossed in ((0.5, 0.4, 0.98), (0.5, 0.98, 0.4), (-0.1, 0.5, 0.5), (0.0, 1.1, 0.5)):
        with pytest.raises(ParameterError, match="timestep_min"):
            bounded(FakePrior(), *crossed)


class StumblingPrior(FakePrior):
    """Predicts what is not finite a number of times."""

    def __init__(self, times: int, bad: float) -> None:
        super().__init__()
        self.times, self.bad, self.asked = times, bad, 0

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: None, cameras: Cameras) -> tuple[Tensor, ...]:
        self.asked += 1
        if self.asked <= self.times:
            return torch.full_like(z_t, self.bad), torch.full_like(z_t, self.bad)
        return super().predict_noise(z_t, timestep, embedding, cameras)


@each_case("bad", [float("nan"), float("inf")])
def test_one_prediction_that_is_not_finite_is_drawn_again_and_always_one_stops_the_run(bad: float) -> None:
    prior = StumblingPrior(1, bad)
    loss, _ = ScoreDistillation(prior, "", guidance_scale=1.0).loss(torch.zeros(1, 3, 48, 48), context())
    assert torch.isfinite(loss)
    assert prior.asked == 2
    with pytest.raises(NumericalError, match="not finite"):
        ScoreDistillation(StumblingPrior(99, bad), "", guidance_scale=1.0).loss(torch.zeros(1, 3, 48, 48), context())


def test_full_rescaling_gives_the_picture_the_spread_of_the_prompted_one() -> None:
    uncond, text, noisy = torch.rand(3, 1, 3, 16, 16, generator=torch.Generator().manual_seed(2))
    level = torch.full((1, 1, 1, 1), 0.3)
    to_noise = lambda x: (noisy - level.sqrt() * (2 * x - 1)) / (1 - level).sqrt()  # noqa: E731
    to_clean = lambda e: (noisy - (1 - level).sqrt() * e) / level.sqrt()  # noqa: E731
    strong = to_noise(uncond) + 20 * (to_noise(text) - to_noise(uncond))
    wanted = to_clean(to_noise(text)).std()
    assert to_clean(strong).std() > 5 * wanted
    none, half, full = (rescaled(strong, to_noise(text), noisy, level, share) for share in (0.0, 0.5, 1.0))
    assert_close(to_clean(full).std(), wanted, rtol=1e-4, atol=0.0)
    assert_close(none, strong, rtol=1e-4, atol=1e-4)
    assert_close(to_clean(half), (to_clean(full) + to_clean(strong)) / 2, rtol=1e-3, atol=1e-3)


def test_pictures_of_their_own_have_timesteps_of_their_own_and_share_the_weight() -> None:
    prior = FakePrior(torch.full((1, 3, 16, 16), 0.75))
    images = torch.full((4, 3, 16, 16), 0.25, requires_grad=True)
    loss, _ = ScoreDistillation(prior, "", guidance_scale=1.0).loss(images, context())
    loss.backward()
    assert len(set(prior.timesteps)) == 4
    for k, timestep in enumerate(prior.timesteps):
        level = prior.alphas_cumprod[timestep]
        pull = 2 * (1 - level) * (level / (1 - level)).sqrt() * -1.0 * REFERENCE_ELEMENTS / images.numel()
        assert_close(images.grad[k], pull.expand(3, 16, 16), rtol=1e-3, atol=1e-4)


def test_a_negative_prompt_takes_the_place_of_nothing() -> None:
    generator = torch.Generator().manual_seed(4)
    pictures = {text: torch.rand(1, 3, 8, 8, generator=generator) for text in ("a dog", "", "a cat")}
    for negative in ("", "a cat"):
        prior = PicturesPrior(pictures)
        guidance = ScoreDistillation(prior, "a dog", negative_prompt=negative, guidance_scale=3.0)
        image = torch.full((1, 3, 8, 8), 0.5, requires_grad=True)
        guidance.loss(image, context())[0].backward()
        level = prior.alphas_cumprod[prior.timesteps[0]]
        # Each text's picture x pulls along sqrt(abar / (1 - abar)) (z0 - x), whatever noise was drawn.
        wanted = pictures[negative] + 3.0 * (pictures["a dog"] - pictures[negative])
        pull = 2 * (1 - level) * (level / (1 - level)).sqrt() * 2 * (0.5 - wanted) * REFERENCE_ELEMENTS / image.numel()
        assert_close(image.grad, pull, rtol=1e-3, atol=1e-2)
