"""The small encoder of Stable Diffusion in place of the large one, on the real classes with random weights."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from torch import Tensor

from meshdeform.assets import build_glb
from meshdeform.errors import ModelError, ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import check_model
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.requests.choices import Encoder
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.runs import text_deform
from meshdeform.runs.goals import score_distillation
from meshdeform.runs.text_deform_checks import check
from meshdeform.testing import FakePrior
from tests.close import assert_close

BALL = icosphere(1)


@pytest.fixture(scope="module")
def prior(tiny_stable_diffusion: Path) -> StableDiffusionPrior:
    return StableDiffusionPrior(str(tiny_stable_diffusion))


@pytest.fixture
def copy(tiny_stable_diffusion: Path, tmp_path: Path) -> Path:
    """A checkpoint to break."""
    return shutil.copytree(tiny_stable_diffusion, tmp_path / "copy")


def picture() -> Tensor:
    return torch.rand(1, 3, 128, 128, generator=torch.Generator().manual_seed(9))


def direction(*shape: int, seed: int = 4) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def gradient(prior: StableDiffusionPrior, weight: float = 1.0) -> Tensor:
    """The gradient on a picture of one and the same linear function of the latents."""
    image = picture().requires_grad_()
    latents = prior.encode_image(image)
    (weight * latents * direction(*latents.shape)).sum().backward()
    assert image.grad is not None
    return image.grad


def test_the_latents_are_those_of_the_small_network_for_pixels_from_0_to_1(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior, capfd: pytest.CaptureFixture[str]
) -> None:
    from diffusers import AutoencoderTiny

    alone = AutoencoderTiny.from_pretrained(tiny_stable_diffusion / "vae_tiny", local_files_only=True)
    capfd.readouterr()
    small = StableDiffusionPrior(str(tiny_stable_diffusion)).with_encoder(Encoder.TINY)
    assert capfd.readouterr() == ("", ""), "nothing about a configuration that is as it should be"
    with torch.no_grad():
        expected = alone.encoder.layers(picture())
    assert_close(small.encode_image(picture()), expected, rtol=1e-4, atol=1e-5)
    assert small.encode_image(picture()).shape == prior.encode_image(picture()).shape == (1, 4, 16, 16)


@pytest.mark.parametrize("encoder", Encoder)
def test_the_gradient_of_each_encoder_is_its_slope(prior: StableDiffusionPrior, encoder: Encoder) -> None:
    """Along the gradient, and along a random direction, against differences of the latents."""
    chosen = prior.with_encoder(encoder)
    found = gradient(chosen)
    assert found.shape == (1, 3, 128, 128)
    assert torch.isfinite(found).all()
    assert (found != 0).float().mean() > 0.99
    weights = direction(1, 4, 16, 16).double()
    for towards in (found, direction(*found.shape, seed=5)):
        step = 0.02 * towards / towards.norm()
        ahead, behind = (chosen.encode_image(picture() + sign * step).detach().double() for sign in (1, -1))
        slope = ((ahead - behind) * weights).sum() / 2
        assert_close(slope, (found.double() * step).sum(), rtol=0.05, atol=1e-3 * float(found.norm() * step.norm()))


def test_the_two_encoders_differ_and_share_the_other_networks(prior: StableDiffusionPrior) -> None:
    before = gradient(prior)
    small = prior.with_encoder(Encoder.TINY)
    assert not torch.allclose(gradient(small), before)
    assert torch.equal(gradient(prior), before)
    assert torch.equal(gradient(small.with_encoder(Encoder.VAE)), before)
    assert (small._unet, small._text_encoder) == (prior._unet, prior._text_encoder)
    assert small.with_encoder(Encoder.TINY) is small
    assert prior.with_encoder(Encoder.TINY)._tiny[0] is small._tiny[0], "read once"


@pytest.mark.parametrize("weight", [1e-7, 1e6])
def test_in_half_precision_no_weight_overflows_or_underflows(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior, weight: float
) -> None:
    half = StableDiffusionPrior(str(tiny_stable_diffusion), dtype="float16").with_encoder(Encoder.TINY)
    found, expected = gradient(half, weight) / weight, gradient(prior.with_encoder(Encoder.TINY))
    assert torch.isfinite(found).all()
    assert float((found - expected).norm()) < 0.02 * float(expected.norm())


def start(model: Path, prior: StableDiffusionPrior, **params: Any) -> Any:
    settings = {"model": str(model), "preset": "preview", "steps": 1, "appearance": "clay", "safeguard": "none"}
    request = JobRequest.model_validate({"prompt": "a pear", "params": {**settings, **params}})
    check(request, default_model=str(model))
    asset = build_glb(BALL.verts.numpy(), BALL.faces.numpy())
    return text_deform.start(asset=asset, filename="a.glb", request=request, prior=prior)


def test_a_job_uses_the_encoder_that_it_names_and_its_report_says_so(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports, moments = {}, {}
    for encoder in Encoder:
        with monkeypatch.context() as patch:
            other = prior._vae if encoder is Encoder.TINY else prior.with_encoder(Encoder.TINY)._tiny[0]
            patch.setattr(other, "encode", lambda *_: pytest.fail("the other encoder was asked"))
            run = start(tiny_stable_diffusion, prior, encoder=encoder)
            assert len(list(run)) == 1
        moments[encoder] = safetensors.torch.load(run.checkpoint())["jacobians.exp_avg"]
        reports[encoder] = json.loads(run.finish()["report.json"].data)
    large, small = reports[Encoder.VAE], reports[Encoder.TINY]
    assert (large["params"]["encoder"], small["params"]["encoder"]) == ("vae", "tiny")
    assert small["guidance"]["encoder"] == "tiny"
    assert len(small["guidance"].pop("encoder_sha256")) == 64
    small["guidance"].pop("encoder")
    assert small["guidance"] == large["guidance"]
    assert moments[Encoder.TINY].norm() > 0
    assert not torch.allclose(moments[Encoder.TINY], moments[Encoder.VAE])


def test_a_folder_without_a_small_encoder_is_refused_with_what_to_do(copy: Path) -> None:
    shutil.rmtree(copy / "vae_tiny")
    check_model(str(copy))
    loaded = StableDiffusionPrior(str(copy))
    for refused in (
        lambda: check_model(str(copy), encoder=Encoder.TINY),
        lambda: loaded.with_encoder(Encoder.TINY),
        lambda: start(copy, loaded, encoder="tiny"),
    ):
        with pytest.raises(ModelError, match="no folder vae_tiny") as caught:
            refused()
        assert "hf download madebyollin/taesd" in caught.value.advice_text


def test_another_autoencoder_in_that_folder_is_refused(copy: Path) -> None:
    shutil.rmtree(copy / "vae_tiny")
    shutil.copytree(copy / "vae", copy / "vae_tiny")
    with pytest.raises(ModelError, match="has AutoencoderKL, not AutoencoderTiny"):
        check_model(str(copy), encoder=Encoder.TINY)


@pytest.mark.parametrize(
    ("damage", "message"), [("cut", "cannot be read"), ("lack", "lack 1 tensors"), ("channels", "16 channels at 1/8")]
)
def test_a_small_encoder_that_cannot_be_used_is_one_clear_error(copy: Path, damage: str, message: str) -> None:
    path = copy / "vae_tiny" / "diffusion_pytorch_model.safetensors"
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:2000])
    elif damage == "lack":
        tensors = safetensors.torch.load_file(path)
        tensors.pop(min(tensors))
        safetensors.torch.save_file(tensors, path, {"format": "pt"})
    else:
        from diffusers import AutoencoderTiny

        sizes = {"encoder_block_out_channels": (8,) * 4, "decoder_block_out_channels": (8,) * 4}
        AutoencoderTiny(latent_channels=16, **sizes).save_pretrained(copy / "vae_tiny")
    with pytest.raises(ModelError, match=message):
        StableDiffusionPrior(str(copy)).with_encoder(Encoder.TINY)


def test_only_stable_diffusion_has_an_encoder_to_choose() -> None:
    tiny = DeformParams.model_validate({"encoder": "tiny"})
    with pytest.raises(ParameterError, match="has no encoder") as caught:
        resolve(tiny)
    assert caught.value.extra["errors"][0]["loc"] == ["params", "encoder"]
    chosen = resolve(tiny, default_model="owner/model")
    assert chosen.encoder is Encoder.TINY
    assert resolve(DeformParams()).encoder is Encoder.VAE
    with pytest.raises(ModelError, match="no encoder"):
        score_distillation(FakePrior(), "a pear", chosen)


def test_jobs_with_another_encoder_take_another_time() -> None:
    workloads = {
        JobRequest.model_validate({"prompt": "a pear", "params": {"model": "a/b", **params}}).workload
        for params in ({}, {"encoder": "vae"}, {"encoder": "tiny"})
    }
    assert len(workloads) == 2
