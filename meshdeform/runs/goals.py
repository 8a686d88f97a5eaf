"""Create the guidance: a prompt with a prior, a target mesh placed on the asset, or pictures of its outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.deformation.stand_in import stand_in_of
from meshdeform.errors import ParameterError, PromptError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.guidance.base import Guidance
from meshdeform.guidance.sds import ScoreDistillation, Timesteps
from meshdeform.guidance.silhouettes import BesideSilhouettes, SilhouetteGuide, SilhouetteTerm
from meshdeform.guidance.target import Shift, TargetGuide
from meshdeform.guidance.weighted import WeightedPrompt
from meshdeform.priors.base import Prior
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.rendering.shading import Shading
from meshdeform.requests.choices import AlignMode, AppearanceMode, GuidanceKind, is_builtin
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs.base import InputFile, sha256_hex
from meshdeform.runs.fits import SilhouetteFit, TargetFit
from meshdeform.runs.prompts import Prompts

_SHADINGS: dict[AppearanceMode, Shading] = {
    AppearanceMode.NORMALS: "normals",
    AppearanceMode.CLAY: "lambert",
    AppearanceMode.TEXTURED: "textured",
    AppearanceMode.MIXED: "mixed",
}


def score_distillation(
    prior: Prior, prompt: str | Sequence[WeightedPrompt], params: ResolvedParams
) -> ScoreDistillation:
    """Return the guidance `sds` of a job with these parameters."""
    return ScoreDistillation(
        prior,
        prompt,
        negative_prompt=params.negative_prompt,
        guidance_scale=params.guidance_scale,
        guidance_rescale=params.guidance_rescale,
        timesteps=Timesteps(params.timestep_min, params.timestep_max, params.timestep_max_end),
        shading=None if is_builtin(params.model) else _SHADINGS[params.appearance],
    )


@dataclass(frozen=True)
class Goal:
    """What an optimised run works towards: a guidance, and what its result is compared with."""

    prompt: str  # with which the result is compared; empty for a target, and if each prompt has a region
    guidance: Guidance
    fit: TargetFit | None = None  # the target, placed on the asset
    shares: Sequence[NDArray[np.float64]] = ()
    """sequence of (F,) float64: the faces that each loss of the guidance reaches (`Deformation`)."""


@dataclass(frozen=True)
class GoalSource:
    """What a goal is made of: the asset, its mesh and the request."""

    asset: Asset
    world: TriangleMesh  # the asset's welded mesh in its world
    rest: RestMesh  # the mesh from which the run starts, in the cameras' frame
    frame: CameraFrame  # the cameras' frame
    prior: Prior | None  # for a prompt
    target: InputFile | None  # the target mesh
    silhouettes: SilhouetteFit | None  # pictures as targets, alone or beside the prompt
    limits: Limits | None
    device: str
    prompts: Prompts | None = None  # those of a job with `params.guidance.prompts`


def read_goal(request: JobRequest, params: ResolvedParams, job_input: GoalSource) -> Goal:
    """Return the goal of a job."""
    if params.guidance is GuidanceKind.TARGET:
        return _fitted(params, job_input)
    if job_input.prompts is not None:
        pulled = _pictured(job_input.prompts.texts, params, job_input)
        return Goal(job_input.prompts.main, pulled, shares=job_input.prompts.shares)
    return Goal(request.prompt, _pictured(request.prompt, params, job_input))


def _fitted(params: ResolvedParams, job_input: GoalSource) -> Goal:
    file = job_input.target
    if file is None:
        raise ParameterError(
            "params.guidance is `target`, but there is no target mesh.", advice="Send one as the field `target`."
        )
    target = load_asset(file.data, file.filename, job_input.limits)
    fit = TargetFit.of(params, job_input.asset, job_input.world, target, job_input.frame)
    return Goal("", target_guidance(fit, job_input.rest, params, job_input.device, sha256_hex(file.data)), fit)


def _pictured(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, job_input: GoalSource) -> Guidance:
    """Return the guidance of prompts, of pictures, or of both."""
    pictures = job_input.silhouettes
    if params.guidance is GuidanceKind.SILHOUETTES and pictures is not None:
        return _by_pictures_alone(pictures, job_input.device)
    guidance = _prompted(prompt, params, job_input.prior)
    return guidance if pictures is None else _with_pictures(guidance, pictures, job_input.device)


def _prompted(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, prior: Prior | None) -> Guidance:
    if not prompt:
        raise PromptError("The prompt is empty.")
    if prior is None:
        raise ParameterError("params.guidance is `sds`, which needs a prior.")
    return score_distillation(prior, prompt, params)


def _with_pictures(guidance: Guidance, pictures: SilhouetteFit, device: str) -> Guidance:
    """Return a guidance by pictures beside another one."""
    identity = {**guidance.identity, "silhouettes_sha256": pictures.sha256}
    term = SilhouetteTerm(pictures.views, device=device)
    return BesideSilhouettes(guidance, term, pictures.params.silhouette_weight, identity)


def _by_pictures_alone(pictures: SilhouetteFit, device: str) -> Guidance:
    """Return the guidance by pictures alone."""
    identity = {"id": "silhouettes", "revision": "", "sha256": pictures.sha256}
    term = SilhouetteTerm(pictures.views, device=device)
    return SilhouetteGuide(term, pictures.params.silhouette_weight, identity)


def target_guidance(
    fit: TargetFit, rest: TriangleMesh, params: ResolvedParams, device: str, sha256: str
) -> TargetGuide:
    """Return the guidance towards the target for a mesh at rest in the cameras' frame."""
    offset = torch.zeros(3, dtype=torch.float64)
    # Vertices placed by a region or a handle must not be moved afterwards.
    shifts = not (params.regions or params.handles)
    if params.align is not AlignMode.AUTO and shifts:
        # The solve keeps the centre of mass of the asset, so the difference is a translation.
        apart = RestMesh.of(fit.target).centre_of_mass() - RestMesh.of(rest).centre_of_mass()
        offset = torch.from_numpy(apart)
    return TargetGuide(
        stand_in_of(fit.target),
        device=device,
        identity={"id": "target", "revision": "", "sha256": sha256},
        point_weight=params.point_weight,
        seed=params.seed,
        landmarks=fit.landmarks,
        shift=Shift(offset, free=shifts),
    )
