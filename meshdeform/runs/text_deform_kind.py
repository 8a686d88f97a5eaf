"""Describe the kind `text_deform`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from meshdeform.assets.check import MAX_PARTS
from meshdeform.errors import MeshdeformError, ModelError, ParameterError, PromptError, VocabularyError
from meshdeform.priors.public_names import configured_name, hidden_folders, public_names
from meshdeform.requests.document import (
    BUILTIN_MODEL,
    DeformParams,
    GuidanceKind,
    JobKind,
    JobRequest,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS
from meshdeform.runs.base import ArtifactKind, FilePart, JobRun, Kind, RunInput, StartRun
from meshdeform.runs.picture_parts import check_pictures

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary
    from meshdeform.settings import Settings

__all__ = ["TEXT_DEFORM", "check"]

_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"
_PICTURES = ("image/png", "image/jpeg", "image/webp")
_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def check(
    request: JobRequest,
    *,
    default_model: str,
    allowed_models: Sequence[str] = (),
    revision: str = "",
    has_target: bool = False,
    pictures: Collection[str] = (),
) -> ResolvedParams:
    """Refuse a request that could not run; return the values of all its parameters.

    Parameters
    ----------
    request : JobRequest
    default_model : str
        The model used if the request names none; always allowed, like `builtin`.
    allowed_models : sequence of str
        Further models that a request may name.
    revision : str
        Revision of the default model.
    has_target : bool
        Whether the second mesh for `target` guidance is present.
    pictures : collection of str
        The names of the parts with pictures that are present.

    Raises
    ------
    ParameterError
        `target` guidance without a target, a target without `target` guidance, pictures without a direction or the
        reverse, or parameters that contradict the preset or each other.
    PromptError, VocabularyError
        The prompt is empty, or it or the negative prompt has words outside the builtin prior's vocabulary.
    ModelError
        The model is not allowed, or not on this machine.
    """
    params = request.params
    resolved = resolve(params, default_model=default_model)
    check_pictures(request, pictures)
    if params.guidance is GuidanceKind.TARGET:
        if not has_target:
            raise _refusal("guidance", "`target` guidance needs a second mesh.", "Send it as the part `target`.")
        return resolved
    if has_target:
        raise _refusal(
            "guidance",
            f"A target was sent, but the guidance is `{params.guidance}`, which does not use it.",
            "Set params.guidance to `target`, or omit the part `target`.",
        )
    if params.guidance is GuidanceKind.SILHOUETTES:
        return resolved
    if not request.prompt:
        raise PromptError("The prompt is empty.")
    model = params.model or default_model
    if model == BUILTIN_MODEL:
        from meshdeform.priors.builtin.grammar import parse, parse_negative

        parse(request.prompt)
        if params.negative_prompt.strip():
            try:
                parse_negative(params.negative_prompt, request.prompt)
            except (PromptError, VocabularyError) as error:
                # Add which of the two texts the error is about.
                error.extra |= _at("negative_prompt", error.detail)
                raise
        return resolved
    if model != default_model and model not in allowed_models:
        known = list(public_names([BUILTIN_MODEL, default_model, *allowed_models]).values())
        raise ModelError(
            f"This server does not run the model {model!r}.",
            advice=f"Use one of: {', '.join(known)}. The server's operator can add it to MESHDEFORM_ALLOWED_MODELS.",
            models=known,
        )
    from meshdeform.priors import check_model

    check_model(model, revision if model == default_model else "")
    return resolved


def _refusal(name: str, detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, **_at(name, detail))


def _at(name: str, detail: str) -> dict[str, Any]:
    """Return the member of a problem document that names the parameter."""
    return {"errors": [{"loc": ["params", name], "msg": detail, "type": "value_error"}]}


def _check(request: JobRequest, settings: Settings, files: frozenset[str]) -> ResolvedParams:
    if request.output.usd and not settings.writes_usd:
        detail = "The request asks for result.usdz, and this deployment does not write USDZ."
        raise ParameterError(
            detail,
            advice="Omit output.usd. The service's operator can install the extra `usd` and set MESHDEFORM_USD.",
            errors=[{"loc": ["output", "usd"], "msg": detail, "type": "value_error"}],
        )
    models = settings.offered_models
    named = request.params.model
    if named is not None:
        params = request.params.model_copy(update={"model": configured_name(named, models)})
        request = request.model_copy(update={"params": params})
    with hidden_folders(models):
        return check(
            request,
            default_model=settings.model,
            allowed_models=settings.allowed_models,
            revision=settings.model_revision,
            has_target="target" in files,
            pictures=files.intersection(SILHOUETTE_PARTS),
        )


def _check_files(params: ResolvedParams, files: Mapping[str, AssetSummary]) -> None:
    found = files["asset"]
    lists = {name: getattr(found, name) for name in ("nodes", "mesh_names", "materials", "joints")}
    # A list of that length may be incomplete; the run then refuses what selects nothing.
    complete = {name: parts for name, parts in lists.items() if len(parts) < MAX_PARTS}
    if "nodes" in complete:
        find_excluded(params.exclude, found.nodes)
    check_selections("rigid", params.rigid, complete)
    check_selections("regions", params.regions, complete)


def _as_branch(job: JobRequest, branch: JobRequest) -> JobRequest:
    """Return the branch's request with what determines the mesh of its job, whose checkpoint fits no other."""
    for group, name in (("output", "subdivide"), ("params", "exclude"), ("params", "backdrop")):
        wanted, own = getattr(getattr(job, group), name), getattr(branch, group)
        if name in own.model_fields_set and getattr(own, name) != wanted:
            raise ParameterError(
                f"A branch deforms the same mesh as its job, so it needs the same {group}.{name}.",
                advice=f"Leave {group}.{name} out, or post a new job.",
                errors=[{"loc": [group, name], "msg": "differs from that of the job", "type": "value_error"}],
            )
        if getattr(own, name) != wanted:
            branch = branch.model_copy(update={group: own.model_copy(update={name: wanted})})
    return branch


def _resolved(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> ResolvedParams:
    """Return the parameters stored when the request was accepted; resolve them if there are none."""
    if kept is not None:
        try:
            return ResolvedParams.model_validate(kept)
        except ValidationError as error:
            # Another version with other parameters wrote them; the request is still valid.
            _log.info("the resolved parameters cannot be read and are resolved again: %s", error)
        if isinstance(kept.get("model"), str):  # the request may name a folder by its id
            request = request.model_copy(update={"params": request.params.model_copy(update={"model": kept["model"]})})
    return resolve(request.params, default_model=default_model)


def _steps(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> int:
    try:
        return _resolved(request, default_model, kept).steps
    except MeshdeformError:
        # A default has changed since the job was accepted; its worker will report the error.
        return request.params.steps if "steps" in request.params.model_fields_set else 0


def _uses(request: JobRequest) -> list[str]:
    target = ["target"] if request.params.guidance is GuidanceKind.TARGET else []
    return ["asset", *target, *SILHOUETTE_PARTS[: len(request.params.silhouettes)]]


def _goal(request: JobRequest, filenames: Mapping[str, str]) -> str:
    like = filenames.get("target") or filenames.get(SILHOUETTE_PARTS[0])
    return request.prompt or (f"like {PurePath(like).stem}" if like else "")


def _load() -> StartRun:
    from meshdeform.runs import text_deform

    def start(given: RunInput) -> JobRun:
        asset, target = given.files["asset"], given.files.get("target")
        params = _resolved(given.request, given.default_model, given.resolved)
        prior = None
        if params.guidance is GuidanceKind.SDS:
            with hidden_folders([params.model]):
                prior = given.load_prior(params.model)
        return text_deform.start(
            asset=asset.data,
            filename=asset.filename,
            request=given.request,
            prior=prior,
            target=target.data if target else None,
            target_filename=target.filename if target else "",
            pictures=[given.files[name].data for name in SILHOUETTE_PARTS[: len(params.silhouettes)]],
            checkpoint=given.checkpoint,
            initial=given.initial,
            default_model=given.default_model,
            limits=given.limits,
            device=given.device,
            asset_sha256=asset.sha256,
            resolved=params,
        )

    return start


TEXT_DEFORM = Kind(
    name=JobKind.TEXT_DEFORM,
    summary="Deforms an asset until it looks like a prompt, a second mesh, or pictures of it from given sides.",
    reads=(
        FilePart("asset", "The file to deform: GLB, OBJ, PLY, STL or ZIP.", required=True, media_types=_MESHES),
        FilePart("target", "The second mesh of `target` guidance.", required=False, media_types=_MESHES),
        *(
            FilePart(
                name,
                f"Picture {number} of `params.silhouettes`: a mask, or an object in front of a plain background.",
                required=False,
                media_types=_PICTURES,
                content="silhouette",
            )
            for number, name in enumerate(SILHOUETTE_PARTS, 1)
        ),
    ),
    params=DeformParams,
    check=_check,
    steps=_steps,
    load=_load,
    artifacts=(
        ArtifactKind("result.glb", _GLB, "The asset with its new shape.", strengths=True),
        ArtifactKind(
            "report.json",
            "application/json",
            "Parameters, seed, versions, hashes, losses, times, what was skipped, and the quality of the mesh before "
            "and after.",
        ),
        ArtifactKind("preview.png", "image/png", "Before and after, from four sides."),
        ArtifactKind(
            "morph.glb",
            _GLB,
            "The source with the way to the result as morph targets and an animation, if `output.morph` is set.",
            afterwards=True,
        ),
        ArtifactKind(
            "result.usdz",
            "model/vnd.usdz+zip",
            "The result as USDZ, if `output.usd` is set ([Assets: USDZ](assets.md#usdz)).",
            afterwards=True,
        ),
    ),
    uses=_uses,
    check_files=_check_files,
    as_branch=_as_branch,
    goal=_goal,
)
