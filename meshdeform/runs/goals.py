"""Create what guides each stage of a run: a prompt with a prior, or a target mesh placed on the asset."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.deformation.stand_in import chosen_carrier
from meshdeform.errors import AlignmentError, ParameterError, PromptError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.guidance.base import Guidance
from meshdeform.guidance.sds import ScoreDistillation, WeightedPrompt
from meshdeform.priors.base import Prior
from meshdeform.priors.public_names import public_name
from meshdeform.rendering.shading import Shading
from meshdeform.requests.choices import AppearanceMode, GuidanceKind
from meshdeform.requests.document import BUILTIN_MODEL, JobRequest, ResolvedParams, resolve
from meshdeform.requests.models import is_builtin
from meshdeform.requests.stages import Stage, of_stage, prompt_words
from meshdeform.runs.base import InputFile
from meshdeform.runs.movement import HoldCounter, measure_movement
from meshdeform.runs.prompts import Prompts
from meshdeform.runs.report import sha256_hex
from meshdeform.runs.silhouette_fit import SilhouetteFit
from meshdeform.runs.target_fit import TargetFit

__all__ = ["Goal", "GoalSource", "read_goals", "score_distillation", "stage_reports", "unique_names"]


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
    """What one stage of a run aims at.

    Attributes
    ----------
    name : str
    prompt : str
        With which the result is compared; empty for a target, and if each prompt has a region.
    params : ResolvedParams
        Those of this stage.
    guidance : Guidance
    fit : TargetFit, optional
        The target of the stage, placed on the asset.
    shares : sequence of (F,) float64
        The faces that each loss of the guidance reaches (`Deformation`).
    """

    name: str
    prompt: str
    params: ResolvedParams
    guidance: Guidance
    fit: TargetFit | None = None
    shares: Sequence[NDArray[np.float64]] = ()


@dataclass(frozen=True)
class GoalSource:
    """What goals are made of.

    Attributes
    ----------
    asset : Asset
    world : TriangleMesh
        The asset's welded mesh in its world.
    rest : RestMesh
        The same in the cameras' frame.
    prior : Prior, optional
        For prompts.
    prompts : Prompts, optional
        Those of a job with `params.prompts`.
    targets : mapping of str to InputFile
        Target meshes by part.
    silhouettes : SilhouetteFit, optional
        Pictures as targets, alone or beside the prompt.
    limits : Limits, optional
    device : str
    """

    asset: Asset
    world: TriangleMesh
    rest: RestMesh
    prior: Prior | None
    targets: Mapping[str, InputFile]
    silhouettes: SilhouetteFit | None
    limits: Limits | None
    device: str
    prompts: Prompts | None = None


def read_goals(request: JobRequest, params: ResolvedParams, given: GoalSource) -> list[Goal]:
    """Return the goals of a job in order: one for each stage, or a single one.

    Raises
    ------
    ParameterError
        A target or the prior is missing, or a landmark is a vertex that does not exist.
    PromptError
        A prompt is empty, or the prior cannot use it.
    AlignmentError
        A target is too far from the asset.
    AssetError
        A target cannot be read.
    """
    if not params.stages:
        target = "target" if params.guidance is GuidanceKind.TARGET else None
        if given.prompts is not None and target is None:
            return [_several(given.prompts, request, params, given)]
        return [_goal("", request.prompt, target, params, given)]
    # All stages share their variables, and a target needs more freedom than a prompt.
    carrier = chosen_carrier(params.carrier, given.rest, rigid=bool(params.rigid))
    params = params.model_copy(update={"carrier": carrier})
    return [
        _goal(stage.name, stage.prompt, stage.target, _of_stage(request, params, stage), given, number)
        for number, stage in enumerate(params.stages, 1)
    ]


def _of_stage(request: JobRequest, params: ResolvedParams, stage: Stage) -> ResolvedParams:
    """Return the values of all parameters in a stage; presets differ between prompts and targets."""
    if stage.guidance is params.guidance:
        return params.model_copy(update={"stages": ()})
    written = request.params.model_copy(update={"model": params.model})
    found = resolve(of_stage(written, stage), default_model=params.model)
    # The stages share the variables and, for the progress, the number of steps.
    shared = {"carrier": params.carrier, "steps": params.steps}
    return found.model_copy(update=shared)


def _goal(
    name: str,
    prompt: str,
    target: str | None,
    params: ResolvedParams,
    given: GoalSource,
    number: int | None = None,
) -> Goal:
    if target is None:
        return Goal(name or prompt, prompt, params, _pictured(prompt, params, given))
    file = given.targets.get(target)
    if file is None:
        raise ParameterError(
            "params.guidance is `target`, but there is no target mesh.", advice=f"Send one as the part `{target}`."
        )
    try:
        fit = TargetFit.of(params, given.asset, given.world, load_asset(file.data, file.filename, given.limits))
    except AlignmentError as error:
        if number is not None:
            error.detail = f"Stage {number}: {error.detail}"
            error.args = (error.detail,)
        raise
    guidance = fit.guidance(given.rest, params, given.device, sha256_hex(file.data))
    return Goal(name or PurePath(file.filename).stem, "", params, guidance, fit)


def _several(prompts: Prompts, request: JobRequest, params: ResolvedParams, given: GoalSource) -> Goal:
    name = prompt_words(request.prompt, params)
    return Goal(name, prompts.main, params, _pictured(prompts.texts, params, given), shares=prompts.shares)


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


def unique_names(goals: Sequence[Goal]) -> list[str]:
    """Return the names of the goals, numbered where they repeat."""
    found: list[str] = []
    for goal in goals:
        name, number = goal.name, 1
        while name in found:
            number += 1
            name = f"{goal.name} {number}"
        found.append(name)
    return found


def stage_reports(
    goals: Sequence[Goal],
    rest: TriangleMesh,
    shapes: Sequence[Tensor],
    *,
    fitted: Callable[[TargetFit, Tensor], dict[str, Any]],
    likeness: Callable[[str, Tensor], dict[str, Any] | None],
) -> list[dict[str, Any]]:
    """Return the report's `stages`: what each aimed at, how far it went, and what came of it.

    Parameters
    ----------
    goals : sequence of Goal
    rest : TriangleMesh
        The welded source in its world.
    shapes : sequence of (V, 3) float64
        The ends of the stages, there.
    fitted, likeness : callable
        Measure a shape against a target, and against a prompt of the builtin prior.
    """
    reports = []
    before = rest.verts
    for name, goal, verts in zip(unique_names(goals), goals, shapes, strict=True):
        way = measure_movement(RestMesh.of(TriangleMesh(before, rest.faces)), verts, HoldCounter())
        report: dict[str, Any] = {
            "name": name,
            "guidance": goal.guidance.identity | {"id": public_name(goal.guidance.identity["id"])},
            "steps": goal.params.steps,
            "moved": way.rms,
            "quality": measure(rest.verts.numpy(), rest.faces.numpy(), verts.numpy()).to_dict(),
        }
        if goal.fit is not None:
            report["fit"] = fitted(goal.fit, verts)
        else:
            report["prompt"] = goal.prompt
            if goal.guidance.identity["id"] == BUILTIN_MODEL:
                report["likeness"] = likeness(goal.prompt, verts)
        reports.append(report)
        before = verts
    return reports
