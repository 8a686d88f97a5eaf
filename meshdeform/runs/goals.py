"""Create what guides a run: a prompt with a prior, or a target mesh placed on the asset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.errors import ParameterError, PromptError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.guidance.base import Guidance
from meshdeform.guidance.sds import ScoreDistillation, WeightedPrompt
from meshdeform.priors.base import Prior
from meshdeform.rendering.shading import Shading
from meshdeform.requests.choices import AppearanceMode, GuidanceKind
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.models import is_builtin
from meshdeform.runs.base import InputFile
from meshdeform.runs.prompts import Prompts
from meshdeform.runs.report import sha256_hex
from meshdeform.runs.silhouette_fit import SilhouetteFit
from meshdeform.runs.target_fit import TargetFit

__all__ = ["Goal", "GoalSource", "read_goal", "score_distillation"]


_SHADINGS: dict[AppearanceMode, Shading] = {
    AppearanceMode.NORMALS: "normals",
    AppearanceMode.CLAY: "lambert",
    AppearanceMode.TEXTURED: "textured",
    AppearanceMode.MIXED: "mixed",
}


def score_distillation(
    prior: Prior, prompt: str | Sequence[WeightedPrompt], params: ResolvedParams
) -> ScoreDistillation:
    """Return the guidance `sds` of a job with these parameters.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use this prompt.
    """
    return ScoreDistillation(
        prior,
        prompt,
        negative_prompt=params.negative_prompt,
        guidance_scale=params.guidance_scale,
        guidance_rescale=params.guidance_rescale,
        timestep_min=params.timestep_min,
        timestep_max=params.timestep_max,
        timestep_max_end=params.timestep_max_end,
        # Parameters resolved by an earlier edition have no appearance, and this model takes only its own.
        shading=None if is_builtin(params.model) else _SHADINGS[params.appearance],
    )


@dataclass(frozen=True)
class Goal:
    """What a run aims at.

    Attributes
    ----------
    prompt : str
        With which the result is compared; empty for a target, and if each prompt has a region.
    guidance : Guidance
    fit : TargetFit, optional
        The target, placed on the asset.
    shares : sequence of (F,) float64
        The faces that each loss of the guidance reaches (`Deformation`).
    """

    prompt: str
    guidance: Guidance
    fit: TargetFit | None = None
    shares: Sequence[NDArray[np.float64]] = ()


@dataclass(frozen=True)
class GoalSource:
    """What a goal is made of.

    Attributes
    ----------
    asset : Asset
    world : TriangleMesh
        The asset's welded mesh in its world.
    rest : RestMesh
        The same in the cameras' frame.
    prior : Prior, optional
        For a prompt.
    prompts : Prompts, optional
        Those of a job with `params.guidance.prompts`.
    target : InputFile, optional
        The target mesh.
    silhouettes : SilhouetteFit, optional
        Pictures as targets, alone or beside the prompt.
    limits : Limits, optional
    device : str
    """

    asset: Asset
    world: TriangleMesh
    rest: RestMesh
    prior: Prior | None
    target: InputFile | None
    silhouettes: SilhouetteFit | None
    limits: Limits | None
    device: str
    prompts: Prompts | None = None


def read_goal(request: JobRequest, params: ResolvedParams, given: GoalSource) -> Goal:
    """Return the goal of a job.

    Raises
    ------
    ParameterError
        The target or the prior is missing, or a landmark is a vertex that does not exist.
    PromptError
        The prompt is empty, or the prior cannot use it.
    AlignmentError
        The target is too far from the asset.
    AssetError
        The target cannot be read.
    """
    if params.guidance is GuidanceKind.TARGET:
        return _fitted(params, given)
    if given.prompts is not None:
        pulled = _pictured(given.prompts.texts, params, given)
        return Goal(given.prompts.main, pulled, shares=given.prompts.shares)
    return Goal(request.prompt, _pictured(request.prompt, params, given))


def _fitted(params: ResolvedParams, given: GoalSource) -> Goal:
    file = given.target
    if file is None:
        raise ParameterError(
            "params.guidance is `target`, but there is no target mesh.", advice="Send one as the part `target`."
        )
    fit = TargetFit.of(params, given.asset, given.world, load_asset(file.data, file.filename, given.limits))
    return Goal("", fit.guidance(given.rest, params, given.device, sha256_hex(file.data)), fit)


def _pictured(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, given: GoalSource) -> Guidance:
    """Return the guidance of prompts, of pictures, or of both."""
    pictures = given.silhouettes
    if params.guidance is GuidanceKind.SILHOUETTES and pictures is not None:
        return pictures.guidance(given.device)
    guidance = _prompted(prompt, params, given.prior)
    return guidance if pictures is None else pictures.beside(guidance, given.device)


def _prompted(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, prior: Prior | None) -> Guidance:
    if not prompt:
        raise PromptError("The prompt is empty.")
    if prior is None:
        raise ParameterError("params.guidance is `sds`, which needs a prior.")
    return score_distillation(prior, prompt, params)
