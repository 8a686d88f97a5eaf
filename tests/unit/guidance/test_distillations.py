"""The kinds of distillation and of negative prompts, with a prior whose answers are known."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import REFERENCE_ELEMENTS, ScoreDistillation
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.requests.document import Distillation, NegativePrompt
from tests.unit.guidance.pictures import PicturesPrior

SIDE = 16


def context(seed: int = 0) -> StepContext:
    return StepContext(0, 100, fixed_cameras(0.0, 15.0), torch.Generator().manual_seed(seed))


def picture(seed: int) -> Tensor:
    return torch.rand(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(seed))


def prior(**more: Tensor) -> PicturesPrior:
    return PicturesPrior({"": picture(1), "a dog": picture(2), **more})


def gradient(guide: PicturesPrior, **options: object) -> Tensor:
    """On z0, without the weighting: the residual."""
    image = torch.full((1, 3, SIDE, SIDE), 0.5, requires_grad=True)
    guidance = ScoreDistillation(guide, "a dog", guidance_scale=3.0, **options)
    loss, logs = guidance.loss(image, context())
    loss.backward()
    level = guide.alphas_cumprod[guide.timesteps[-1]]
    residual = image.grad / 2 / ((1 - level) * REFERENCE_ELEMENTS / image.numel())
    assert logs["sds_mse"] == pytest.approx(residual.square().mean().item(), rel=1e-3)
    return residual


def test_interval_matching_over_no_interval_and_without_inversion_is_classifier_score_distillation() -> None:
    """z_s is z_t, of the same noise: what is left is the direction of the prompt, to rounding."""
    ism = gradient(prior(), distillation=Distillation.ISM, ism_interval=0.0, ism_stride=1.0)
    csd = gradient(prior(), distillation=Distillation.CSD)
    torch.testing.assert_close(ism, csd, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("interval", [0.05, 0.2])
@pytest.mark.parametrize("stride", [0.1, 0.4])
def test_interval_matching_has_no_pull_but_the_prompts_where_the_path_is_straight(
    interval: float, stride: float
) -> None:
    """The ideal denoiser of nothing finds the same noise at both ends, so the interval adds nothing."""
    options = {"timestep_min": 0.6, "timestep_max": 0.9, "timestep_max_end": 0.9}
    ism = gradient(prior(), distillation=Distillation.ISM, ism_interval=interval, ism_stride=stride, **options)
    csd = gradient(prior(), distillation=Distillation.CSD, **options)
    torch.testing.assert_close(ism, csd, atol=2e-3, rtol=2e-3)


def test_interval_matching_asks_once_a_stride_once_at_the_begin_and_for_both_texts_at_the_end() -> None:
    guide = prior()
    gradient(guide, distillation=Distillation.ISM, timestep_min=0.85, timestep_max=0.9, timestep_max_end=0.9)
    assert [len(rows) for rows in guide.asked] == [1, 1, 1, 1, 1, 2]
    assert guide.timesteps[-1] - guide.timesteps[-2] == 50
    assert all(after - before == 200 for before, after in zip(guide.timesteps[:-2], guide.timesteps[1:-1], strict=True))


def test_interval_matching_is_drawn_reproducibly() -> None:
    first, second = (gradient(prior(), distillation=Distillation.ISM) for _ in range(2))
    assert torch.equal(first, second)


def test_noise_free_early_is_the_whole_unconditional_prediction_and_the_prompts_direction() -> None:
    guide = prior(ugly=picture(3))
    early = {"timestep_min": 0.05, "timestep_max": 0.15, "timestep_max_end": 0.15}
    got = gradient(guide, distillation=Distillation.NFSD, negative_prompt="ugly", **early)
    nothing, text = (guide.noise(name, guide.z_t, guide.timesteps[-1]) for name in ("", "a dog"))
    torch.testing.assert_close(got, nothing + 3 * (text - nothing), atol=1e-3, rtol=1e-3)
    assert [len(rows) for rows in guide.asked] == [2]


def test_noise_free_elsewhere_is_the_difference_to_bad_pictures_and_the_prompts_direction() -> None:
    guide = prior(ugly=picture(3))
    late = {"timestep_min": 0.2, "timestep_max": 0.98}
    got = gradient(guide, distillation=Distillation.NFSD, negative_prompt="ugly", **late)
    nothing, text, bad = (guide.noise(name, guide.z_t, guide.timesteps[-1]) for name in ("", "a dog", "ugly"))
    torch.testing.assert_close(got, nothing - bad + 3 * (text - nothing), atol=1e-3, rtol=1e-3)
    assert [len(rows) for rows in guide.asked] == [3]


def test_noise_free_without_bad_pictures_is_classifier_score_distillation() -> None:
    late = {"timestep_min": 0.3}
    nfsd = gradient(prior(), distillation=Distillation.NFSD, **late)
    assert torch.equal(nfsd, gradient(prior(), distillation=Distillation.CSD, **late))


@pytest.mark.parametrize("kind", [Distillation.SDS, Distillation.CSD, Distillation.ISM])
def test_a_negative_prompt_that_says_only_more_of_the_prompt_changes_nothing_in_perp_neg(kind: Distillation) -> None:
    """Parallel: the picture of "more" lies on the line from nothing through the prompt's."""
    more = picture(1) + 0.3 * (picture(2) - picture(1))
    plain = gradient(prior(), distillation=kind)
    perpendicular = gradient(
        prior(more=more), distillation=kind, negative_prompt="more", negative=NegativePrompt.PERPENDICULAR
    )
    torch.testing.assert_close(perpendicular, plain, atol=5e-3, rtol=5e-3)


def test_perp_neg_leads_from_nothing_to_the_prompt_and_away_from_what_is_orthogonal() -> None:
    step = torch.zeros(1, 3, SIDE, SIDE)
    step[:, 1] = 0.2 * picture(5)[:, 1]
    wanted = picture(1).clone()
    wanted[:, 0] += 0.1
    guide = PicturesPrior({"": picture(1), "a dog": wanted, "green": picture(1) + step})
    got = gradient(
        guide,
        distillation=Distillation.CSD,
        negative_prompt="green",
        negative=NegativePrompt.PERPENDICULAR,
        negative_weight=2.0,
    )
    nothing, text, green = (guide.noise(name, guide.z_t, guide.timesteps[-1]) for name in ("", "a dog", "green"))
    torch.testing.assert_close(got, 3 * (text - nothing - 2 * (green - nothing)), atol=1e-3, rtol=1e-3)


def test_an_unconditional_negative_prompt_is_led_away_from_whole() -> None:
    guide = prior(green=picture(4))
    got = gradient(guide, distillation=Distillation.CSD, negative_prompt="green")
    text, green = (guide.noise(name, guide.z_t, guide.timesteps[-1]) for name in ("a dog", "green"))
    torch.testing.assert_close(got, 3 * (text - green), atol=1e-3, rtol=1e-3)


def test_view_prompts_pull_each_picture_to_its_own_view() -> None:
    views = {f"a dog, {view} view": picture(10 + k) for k, view in enumerate(("front", "side", "back", "overhead"))}
    guide = prior(**views)
    images = torch.full((4, 3, SIDE, SIDE), 0.5, requires_grad=True)
    guidance = ScoreDistillation(
        guide, "a dog", guidance_scale=1.0, distillation=Distillation.CSD, view_prompts=True, timestep_min=0.5
    )
    guidance.loss(images, context())[0].backward()
    for k, view in enumerate(("front", "side", "back", "side")):
        pull = picture(1) - views[f"a dog, {view} view"]
        cosine = torch.cosine_similarity(images.grad[k].flatten(), pull.flatten(), dim=0)
        assert cosine == pytest.approx(1.0, abs=1e-3)
