"""Stable Diffusion behind the prior interface, on the real classes with random weights."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from meshdeform.errors import ModelError, PromptError, ShapeError
from meshdeform.priors import load_prior
from meshdeform.priors.model_files import find
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import fixed_cameras
from tests.cases import each_case
from tests.close import assert_close
from tests.unit.priors.combined import guided, text_rows

CAMERAS = fixed_cameras(0.0, 15.0)
SIZE = 128


@pytest.fixture(scope="session")
def prior(tiny_stable_diffusion: Path) -> StableDiffusionPrior:
    return StableDiffusionPrior(str(tiny_stable_diffusion))


@pytest.fixture
def copy(tiny_stable_diffusion: Path, tmp_path: Path) -> Path:
    """A checkpoint to break."""
    return shutil.copytree(tiny_stable_diffusion, tmp_path / "copy")


def change(path: Path, edit: Callable[[dict[str, object]], object]) -> None:
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))


def noise(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def picture(size: int = SIZE) -> Tensor:
    return torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(9))


def test_load_prior_gives_one_that_says_what_it_is(tiny_stable_diffusion: Path) -> None:
    prior = load_prior(str(tiny_stable_diffusion), device="cpu")
    assert prior.identity == {
        "id": str(tiny_stable_diffusion),
        "revision": "",
        "sha256": find(str(tiny_stable_diffusion)).sha256(),
    }
    assert (prior.device, prior.dtype) == (torch.device("cpu"), torch.float32)
    assert prior.num_timesteps == 1000
    assert (2 * prior.style.view_size, prior.style.shading) == (SIZE, "lambert")


def test_the_schedule_is_the_published_one(prior: StableDiffusionPrior) -> None:
    """Scaled linear betas from 0.00085 to 0.012, as every Stable Diffusion 1 and 2 has them."""
    betas = torch.linspace(0.00085**0.5, 0.012**0.5, 1000, dtype=torch.float64) ** 2
    expected = torch.cumprod(1 - betas, 0).float()
    assert_close(prior.alphas_cumprod, expected, rtol=1e-4, atol=1e-6)


def test_a_picture_becomes_latents_an_eighth_its_size_and_another_size_is_resized(prior: StableDiffusionPrior) -> None:
    latents = prior.encode_image(picture())
    assert latents.shape == (1, 4, SIZE // 8, SIZE // 8)
    assert torch.equal(latents, prior.encode_image(picture()))
    assert_close(latents, 0.18215 * prior._vae.encode(2 * picture() - 1).latent_dist.mean)
    small, large = (prior.encode_image(torch.full((1, 3, side, side), 0.4)) for side in (48, SIZE))
    assert_close(small, large, rtol=1e-3, atol=1e-4)
    with pytest.raises(ShapeError):
        prior.encode_image(torch.zeros(3, 48, 48))


@each_case("weight", [1e-7, 1.0, 1e6])
def test_in_half_precision_no_weight_overflows_or_underflows(tiny_stable_diffusion: Path, weight: float) -> None:
    """The gradient on z0 comes with the guidance's weight on it; float16 holds 6e-8 to 65,504."""
    half = StableDiffusionPrior(str(tiny_stable_diffusion), dtype="float16")
    full = StableDiffusionPrior(str(tiny_stable_diffusion), dtype="float32")
    gradients = []
    for one in (half, full):
        image = picture().requires_grad_()
        latents = one.encode_image(image)
        (weight * latents * noise(*latents.shape, seed=4)).sum().backward()
        assert image.grad is not None
        gradients.append(image.grad / weight)
    assert torch.isfinite(gradients[0]).all()
    assert float((gradients[0] - gradients[1]).norm()) < 0.02 * float(gradients[1].norm())


def test_the_text_embedding_holds_the_negative_prompt_and_the_prompt_uncut(prior: StableDiffusionPrior) -> None:
    both = text_rows(prior, "a mushroom", "blurry")
    assert both.shape == (2, 77, 32)
    assert torch.equal(text_rows(prior, "a mushroom", "")[1], both[1])
    assert_close(text_rows(prior, "blurry")[1], both[0])
    assert not torch.allclose(both[0], both[1])
    text_rows(prior, "x" * 75)
    with pytest.raises(PromptError, match="has 76 tokens; this model reads 75"):
        text_rows(prior, "x" * 76)
    with pytest.raises(PromptError, match=r"blurry xx.* has 213 tokens"):
        text_rows(prior, "", "blurry " + "xx " * 100 + "y" * 7)


def test_classifier_free_guidance_is_uncond_plus_s_times_the_difference(prior: StableDiffusionPrior) -> None:
    embedding, z_t, at = text_rows(prior, "a vase", "blurry"), noise(1, 4, 16, 16), torch.tensor([300])
    uncond, text = (
        prior._unet(z_t, at, encoder_hidden_states=embedding[row : row + 1]).sample.detach() for row in (0, 1)
    )
    for scale in (0.0, 1.0, 7.5, 100.0):
        predicted = guided(*prior.predict_noise(z_t, at, embedding, CAMERAS), scale)
        assert_close(predicted, uncond + scale * (text - uncond), rtol=1e-4, atol=1e-3)
    assert not predicted.requires_grad


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_v_prediction_equals_the_noise_that_its_velocity_stands_for(
    prior: StableDiffusionPrior, copy: Path, monkeypatch: pytest.MonkeyPatch, scale: float
) -> None:
    """Two U-Nets that know the same clean picture, one telling eps and one v, give the same noise."""
    change(copy / "scheduler" / "scheduler_config.json", lambda config: config.update(prediction_type="v_prediction"))
    other = StableDiffusionPrior(str(copy))
    clean, at = noise(2, 4, 16, 16, seed=1), torch.tensor([400])
    signal, sigma = prior.alphas_cumprod[at].sqrt(), (1 - prior.alphas_cumprod[at]).sqrt()

    class Output:
        def __init__(self, sample: Tensor) -> None:
            self.sample = sample

    def tells_noise(z_t: Tensor, *_: object, **__: object) -> Output:
        return Output((z_t - signal * clean) / sigma)

    def tells_velocity(z_t: Tensor, *_: object, **__: object) -> Output:
        eps = (z_t - signal * clean) / sigma
        return Output(signal * eps - sigma * clean)

    embedding, z_t = text_rows(prior, "a vase"), noise(1, 4, 16, 16)
    monkeypatch.setattr(prior._unet, "forward", tells_noise)
    monkeypatch.setattr(other._unet, "forward", tells_velocity)
    assert_close(
        guided(*other.predict_noise(z_t, at, embedding, CAMERAS), scale),
        guided(*prior.predict_noise(z_t, at, embedding, CAMERAS), scale),
        rtol=1e-4,
        atol=1e-4,
    )


@each_case(
    ("file", "edit", "words"),
    [
        ("scheduler/scheduler_config.json", lambda config: config.update(prediction_type="sample"), "predicts sample"),
        # Diffusers would put in 1e-4 .. 0.02, linearly, and say nothing.
        ("scheduler/scheduler_config.json", lambda config: config.pop("beta_end"), "no betas"),
        ("unet/config.json", lambda config: config.update(sample_size=[16, 24]), "sample_size"),
        ("unet/config.json", lambda config: config.update(sample_size=None), "sample_size"),
    ],
    ids=["prediction", "betas", "size", "no size"],
)
def test_a_model_that_cannot_be_asked_is_refused(
    copy: Path, file: str, edit: Callable[[dict[str, object]], object], words: str
) -> None:
    before = (copy / file).read_text()
    change(copy / file, edit)
    with pytest.raises(ModelError, match=words):
        StableDiffusionPrior(str(copy))
    (copy / file).write_text(before)


def test_damaged_weights_are_one_clear_error(copy: Path) -> None:
    weights = copy / "unet" / "diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        StableDiffusionPrior(str(copy))


@pytest.mark.parametrize(("part", "name"), [("vae", "diffusion_pytorch_model"), ("text_encoder", "model")])
def test_tensors_that_are_missing_are_not_made_up(copy: Path, part: str, name: str) -> None:
    from safetensors.torch import load_file, save_file

    path = copy / part / f"{name}.safetensors"
    tensors = load_file(path)
    dropped = min(tensors)
    del tensors[dropped]
    save_file(tensors, path, {"format": "pt"})
    with pytest.raises(ModelError, match=f"in {part}/ .* lack 1 tensors"):
        StableDiffusionPrior(str(copy))
