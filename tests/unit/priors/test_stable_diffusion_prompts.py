"""Several prompts with Stable Diffusion, on the real classes with random weights: one prediction for all, exact sums,
and whole jobs in which a prompt has a region."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation, WeightedPrompt
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.requests.document import DeformParams, resolve
from tests.cases import each_case
from tests.close import assert_close

CAMERAS = fixed_cameras(0.0, 15.0)
PEAR, VASE = WeightedPrompt("a pear", 0.25), WeightedPrompt("a vase", 0.5, group=1)


@pytest.fixture(scope="module")
def prior(tiny_stable_diffusion: Path) -> StableDiffusionPrior:
    return StableDiffusionPrior(str(tiny_stable_diffusion))


def gradients(prior: StableDiffusionPrior, *prompts: WeightedPrompt) -> list[Tensor]:
    """The gradient of every group's loss on the picture, which is the same at every call."""
    guidance = ScoreDistillation(prior, prompts, guidance_scale=100.0, guidance_rescale=0.7)
    image = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(9)).requires_grad_()
    losses, _ = guidance.losses(image, StepContext(0, 10, CAMERAS, torch.Generator().manual_seed(4)))
    return [torch.autograd.grad(loss, image, retain_graph=True)[0] for loss in losses]


def test_all_prompts_are_one_batch_of_the_network_and_the_picture_is_encoded_once(
    prior: StableDiffusionPrior, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: list[int] = []
    encoded: list[int] = []
    predict, encode = prior._unet.forward, prior._vae.encode

    def counted(sample: Tensor, *given: Any, **more: Any) -> Any:
        rows.append(len(sample))
        return predict(sample, *given, **more)

    def counted_pictures(image: Tensor) -> Any:
        encoded.append(len(image))
        return encode(image)

    monkeypatch.setattr(prior._unet, "forward", counted)
    monkeypatch.setattr(prior._vae, "encode", counted_pictures)
    gradients(prior, PEAR, VASE, WeightedPrompt("a chair", 0.25, group=1))
    assert rows == [4], "nothing, and the three prompts"
    assert encoded == [1]


def test_each_group_has_the_gradient_that_its_prompts_have_alone(prior: StableDiffusionPrior) -> None:
    pear, vase, chair = (gradients(prior, WeightedPrompt(text))[0] for text in ("a pear", "a vase", "a chair"))
    assert not torch.allclose(pear, vase, rtol=0.01, atol=0)
    first, second = gradients(prior, PEAR, VASE, WeightedPrompt("a chair", 0.25, group=1))
    limit = 1e-4 * float(pear.abs().max())
    assert_close(first, 0.25 * pear, atol=limit)
    assert_close(second, 0.5 * vase + 0.25 * chair, atol=limit)


def test_in_half_precision_every_group_comes_back_through_the_encoder(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior
) -> None:
    """Weights a million apart: in float16, one scale for both would overflow or underflow within the encoder."""
    half = StableDiffusionPrior(str(tiny_stable_diffusion), dtype="float16")
    given = WeightedPrompt("a pear", 1e-5), WeightedPrompt("a vase", 10.0, group=1)
    for found, expected in zip(gradients(half, *given), gradients(prior, *given), strict=True):
        assert torch.isfinite(found).all()
        assert float((found - expected).norm()) < 0.1 * float(expected.norm())


@each_case("preset", ["preview", "balanced"])
def test_the_weights_are_the_papers(preset: str) -> None:
    ours, paper = (
        resolve(DeformParams.model_validate({"preset": name, "guidance": {"model": "tiny-sd"}}))
        for name in (preset, "paper")
    )
    for name in ("guidance_weight", "jacobian_reg_weight", "laplacian_weight", "normal_weight", "dirichlet_weight"):
        assert getattr(ours, name) == getattr(paper, name), name
