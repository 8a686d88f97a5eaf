"""Every parameter of the guidance, the whole way through an optimisation, with both kinds of prior."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.errors import ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors.base import Prior
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.runs.text_guidance import score_distillation

STEPS = 3

BOTH = [
    {},
    {"guidance_rescale": 0.7, "safeguard": "intersections"},
    {"distillation": "csd"},
    {"distillation": "nfsd"},
    {"distillation": "ism", "guidance_rescale": 0.5},
    {"distillation": "ism", "ism_interval": 0.1, "ism_stride": 0.5, "views": "orthogonal_batch"},
    {"noise_draws": 2, "timestep_min_end": 0.1, "timestep_max_end": 0.3},
]
STABLE_DIFFUSION = [
    *({**options, "negative_prompt": "blurry"} for options in BOTH),
    {"negative": "perpendicular", "negative_prompt": "blurry", "negative_weight": 2.0},
    {"negative": "perpendicular", "negative_prompt": "blurry", "distillation": "ism", "guidance_rescale": 0.7},
    {"view_prompts": True, "views": "orthogonal_batch", "negative_prompt": "ugly"},
    {"view_prompts": True, "views": "random_batch", "distillation": "nfsd"},
    {"view_prompts": True, "views": "random_single", "distillation": "csd", "elevation_max_deg": 80.0},
    {"view_prompts": True, "views": "orthogonal_batch", "negative": "perpendicular"},
    {"view_prompts": True, "views": "random_single", "negative": "perpendicular", "negative_prompt": "ugly"},
]
BUILTIN = [
    *BOTH,
    {"negative_prompt": "fat"},
    {"negative_prompt": "a chair", "negative": "perpendicular"},
    {"negative_prompt": "a chair", "negative": "perpendicular", "distillation": "ism"},
    {"negative_prompt": "a chair", "distillation": "nfsd", "views": "random_single"},
]


@pytest.fixture(scope="module")
def stable_diffusion(tiny_stable_diffusion: Path) -> StableDiffusionPrior:
    prior = StableDiffusionPrior(str(tiny_stable_diffusion))
    prior.unwanted = "ugly"  # the tiny tokenizer counts letters, and the published text has too many
    return prior


@pytest.fixture(scope="module")
def builtin() -> BuiltinPrior:
    return BuiltinPrior()


def resolved(model: str, options: dict[str, object]) -> ResolvedParams:
    return resolve(DeformParams.model_validate({"model": model, "steps": STEPS, **options}))


def deformed(prior: Prior, params: ResolvedParams) -> torch.Tensor:
    """A small sphere after a few steps; the last loss is checked on the way."""
    mesh = icosphere(2)
    deformation = Deformation(mesh, score_distillation(prior, "a vase", params), params)
    steps = list(deformation)
    assert len(steps) == STEPS
    assert all(np.isfinite(list(step.losses.values())).all() for step in steps)
    moved = deformation.verts()
    assert torch.isfinite(moved).all()
    assert (moved - mesh.verts).norm(dim=1).max() > 1e-4
    return moved


@pytest.mark.parametrize("options", STABLE_DIFFUSION, ids=str)
def test_stable_diffusion_runs_with_every_flag(
    stable_diffusion: StableDiffusionPrior, options: dict[str, object]
) -> None:
    deformed(stable_diffusion, resolved("some/checkpoint", options))


@pytest.mark.parametrize("options", BUILTIN, ids=str)
def test_the_builtin_prior_runs_with_every_flag(builtin: BuiltinPrior, options: dict[str, object]) -> None:
    deformed(builtin, resolved("builtin", options))


def test_a_flag_that_changes_what_is_asked_changes_the_shape(builtin: BuiltinPrior) -> None:
    """Each differs from the plain run, and noise-free score distillation without bad pictures is csd here."""
    plain = deformed(builtin, resolved("builtin", {}))
    shapes = {
        name: deformed(builtin, resolved("builtin", options))
        for name, options in {
            "csd": {"distillation": "csd"},
            "nfsd": {"distillation": "nfsd"},
            "ism": {"distillation": "ism"},
            "negative": {"negative_prompt": "fat"},
            "perpendicular": {"negative_prompt": "fat", "negative": "perpendicular"},
        }.items()
    }
    assert torch.equal(shapes.pop("nfsd"), shapes["csd"])
    for shape in (several := [plain, *shapes.values()]):
        assert sum(torch.equal(shape, other) for other in several) == 1


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        ("builtin", {"view_prompts": True, "views": "random_single"}, "for Stable Diffusion models"),
        ("some/checkpoint", {"view_prompts": True}, "pictures of one view each"),
        ("builtin", {"negative": "perpendicular"}, "nothing to keep away from"),
        ("some/checkpoint", {"negative": "perpendicular"}, "nothing to keep away from"),
        (
            "some/checkpoint",
            {"negative": "perpendicular", "negative_prompt": "x", "distillation": "nfsd"},
            "a use of its own",
        ),
    ],
)
def test_what_would_have_no_effect_is_refused_with_what_to_do(
    model: str, options: dict[str, object], said: str
) -> None:
    with pytest.raises(ParameterError, match=said) as caught:
        resolved(model, options)
    assert caught.value.advice_text


@pytest.mark.parametrize("negative", ["unconditional", "perpendicular"])
def test_a_negative_prompt_leads_the_shape_away_from_itself(builtin: BuiltinPrior, negative: str) -> None:
    """A vase that shall not be tall gets less high for its width than one that shall not be short."""
    mesh, heights = icosphere(2), {}
    for unwanted in ("tall", "short"):
        params = resolved("builtin", {"negative_prompt": unwanted, "negative": negative, "steps": 25})
        deformation = Deformation(mesh, score_distillation(builtin, "a vase", params), params)
        for _ in deformation:
            pass
        extent = deformation.verts().amax(0) - deformation.verts().amin(0)
        heights[unwanted] = float(extent[1] / extent[[0, 2]].mean())
    assert heights["tall"] < 0.95 * heights["short"]
