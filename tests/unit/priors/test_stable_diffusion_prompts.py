"""Several prompts with Stable Diffusion, on the real classes with random weights: one prediction for all, exact sums,
and whole jobs in which a prompt has a region."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from torch import Tensor

from meshdeform.assets import build_glb
from meshdeform.errors import PromptError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation, WeightedPrompt
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.text_deform_kind import check
from tests.cases import each_case
from tests.close import assert_close

CAMERAS = fixed_cameras(0.0, 15.0)
BALL = icosphere(1)
ABOVE = {"box": {"min": [-2, 0, -2], "max": [2, 2, 2]}}
IN_BOX = (BALL.verts[BALL.faces][:, :, 1] >= 0).all(1)
BARE = dict.fromkeys(("jacobian_reg_weight", "laplacian_weight", "normal_weight", "dirichlet_weight"), 0.0)
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


def start(model: str, prior: StableDiffusionPrior, prompt: str, *prompts: dict[str, Any], **more: Any) -> Any:
    """A job of two steps whose regularisers have no weight, so that its gradients are those of the prompts."""
    params = {
        "preset": "preview",
        "carrier": "surface",
        "steps": 2,
        "safeguard": "none",
        "guidance": {"model": model, "appearance": "clay"},
        "control": {"falloff": 0.0},
    }
    request = JobRequest.model_validate({"prompt": prompt, "params": grouped({**params, **BARE, "prompts": prompts})})
    check(request, default_model=model)
    asset = build_glb(BALL.verts.numpy(), BALL.faces.numpy())
    return text_deform.start(job_input(asset=asset, filename="a.glb", request=request, prior=prior, **more))


def first_gradient(run: Any) -> Tensor:
    """The gradient on the Jacobians at the first step: ten times Adam's first moment."""
    next(iter(run))
    return 10 * safetensors.torch.load(run.checkpoint())["jacobians.exp_avg"]


def test_a_job_with_a_prompt_for_a_region_reaches_its_faces_alone_and_resumes_bit_for_bit(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior
) -> None:
    model = str(tiny_stable_diffusion)
    pear, vase = (first_gradient(start(model, prior, text)) for text in ("a pear", "a vase"))
    local = {"prompt": "a vase", "weight": 3, "regions": [ABOVE]}
    run = start(model, prior, "a pear", local)
    found = first_gradient(run)
    # What rounding in the encoder leaves is relative to the largest entry.
    limit = 1e-3 * float(pear.abs().max())
    assert_close(found[~IN_BOX], pear[~IN_BOX], atol=limit)
    assert_close(found[IN_BOX], (0.25 * pear + 0.75 * vase)[IN_BOX], atol=limit)
    assert not first_gradient(start(model, prior, "", local))[~IN_BOX].any()

    resumed = start(model, prior, "a pear", local, checkpoint=run.checkpoint())
    results = []
    for each in (run, resumed):
        assert len(list(each)) == 1
        results.append(each.finish())
    assert results[0]["result.glb"].data == results[1]["result.glb"].data
    report = json.loads(results[0]["report.json"].data)
    assert report["guidance"]["id"] == tiny_stable_diffusion.name
    whole, part = report["prompts"]
    assert (whole["prompt"], whole["faces"]) == ("a pear", len(BALL.faces))
    assert (part["prompt"], part["faces"], part["weight"]) == ("a vase", int(IN_BOX.sum()), 3)
    assert part["moved"]["inside"] > 0
    assert "likeness" not in part, "there is no judge of what this model was asked for"


def test_a_further_prompt_that_would_be_cut_is_refused(
    tiny_stable_diffusion: Path, prior: StableDiffusionPrior
) -> None:
    with pytest.raises(PromptError, match="has 90 tokens; this model reads 75"):
        start(str(tiny_stable_diffusion), prior, "a pear", {"prompt": "y" * 90})


# Our presets for Stable Diffusion on the real classes, random weights: few controls, the paper's penalties, resume.


PAIR = join(BALL, TriangleMesh(0.4 * BALL.verts + torch.tensor([0.0, 1.3, 0.3], dtype=torch.float64), BALL.faces))


def begin(prior: StableDiffusionPrior, mesh: TriangleMesh, **given: Any) -> text_deform.TextDeformRun:
    params = {"preset": "preview", "steps": 4, "guidance": {"model": "tiny-sd", "appearance": "clay"}}
    request = JobRequest.model_validate({"prompt": "a pear", "params": grouped(params)})
    asset = build_glb(mesh.verts.numpy(), mesh.faces.numpy())
    return text_deform.start(job_input(asset=asset, filename="a.glb", request=request, prior=prior, **given))


@each_case("mesh, kind, elements", [(BALL, "surface", "face"), (PAIR, "lattice", "cell")])
def test_a_preset_moves_few_controls_and_resumes_to_the_bit(
    prior: StableDiffusionPrior, mesh: TriangleMesh, kind: str, elements: str
) -> None:
    whole = begin(prior, mesh)
    steps = iter(whole)
    next(steps)
    saved = whole.checkpoint()
    state = whole._deformation.checkpoint().tensors
    assert state[f"{elements}_level_0"].abs().max() > 0
    assert (state[f"{elements}_level_2"] == 0).all(), "it is unlocked later"
    list(steps)
    resumed = begin(prior, mesh, checkpoint=saved)
    list(resumed)
    assert (whole.positions() == resumed.positions()).all()
    report = json.loads(whole.finish()["report.json"].data)
    assert (report["carrier"]["kind"], report["carrier"]["mirror"]) == (kind, "x")


@each_case("preset", ["preview", "balanced"])
def test_the_weights_are_the_papers(preset: str) -> None:
    ours, paper = (
        resolve(DeformParams.model_validate({"preset": name, "guidance": {"model": "tiny-sd"}}))
        for name in (preset, "paper")
    )
    for name in ("guidance_weight", "jacobian_reg_weight", "laplacian_weight", "normal_weight", "dirichlet_weight"):
        assert getattr(ours, name) == getattr(paper, name), name
