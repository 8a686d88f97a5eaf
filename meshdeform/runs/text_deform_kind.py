"""Describe the kind `text_deform`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from meshdeform.assets.check import MAX_PARTS
from meshdeform.errors import MeshdeformError, ParameterError
from meshdeform.priors.public_names import configured_name, hidden_folders
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import (
    DeformParams,
    JobKind,
    JobRequest,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.models import WEIGHTS_PART, is_sent
from meshdeform.requests.parameters import CONSTANTS, SILHOUETTE_PARTS
from meshdeform.requests.prompts import prompt_words
from meshdeform.requests.removed import without_removed
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.requests.unbounded import read_unbounded
from meshdeform.runs.base import (
    FORMATS_OF_RESULT,
    ArtifactKind,
    FilePart,
    InputFile,
    Kind,
    RunInput,
    start_of,
)
from meshdeform.runs.sent_weights import WEIGHTS_FILE
from meshdeform.runs.text_deform_checks import check, check_places, check_words

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary
    from meshdeform.settings import Settings

__all__ = ["TEXT_DEFORM", "read_target", "resolved_params", "with_constants"]

M = TypeVar("M", bound=BaseModel)
_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"
_TARGET = "target"
_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def _check(request: JobRequest, settings: Settings, files: frozenset[str]) -> ResolvedParams:
    models = settings.offered_models
    params = request.params
    if params.model is not None:
        params = params.with_model(configured_name(params.model, models))
        request = request.model_copy(update={"params": params})
    with hidden_folders(models):
        return check(
            request,
            default_model=settings.model,
            allowed_models=settings.further_models,
            revision=settings.model_revision,
            has_target=_TARGET in files,
            pictures=files.intersection(SILHOUETTE_PARTS),
            has_weights=WEIGHTS_PART in files,
        )


def _check_files(params: ResolvedParams, files: Mapping[str, AssetSummary]) -> None:
    found = files["asset"]
    lists = {name: getattr(found, name) for name in ("nodes", "mesh_names", "materials", "joints")}
    # A list of that length may be incomplete; the run then refuses what selects nothing.
    complete = {name: parts for name, parts in lists.items() if len(parts) < MAX_PARTS}
    if "nodes" in complete:
        find_excluded(params.exclude, found.nodes)
    check_selections(("control", "rigid"), params.rigid, complete)
    check_selections(("control", "regions"), params.regions, complete)
    for number, prompt in enumerate(params.prompts):
        check_selections(("guidance", "prompts", number, "regions"), prompt.regions, complete)
    check_places(params, {part: file.bounds for part, file in files.items()})


def _as_branch(job: JobRequest, branch: JobRequest) -> JobRequest:
    """Return the branch's request with what determines the mesh of its job, whose checkpoint fits no other."""
    output = _with_same(("output",), job.output, branch.output, ("subdivide",))
    control = _with_same(("params", "control"), job.params.control, branch.params.control, ("exclude", "backdrop"))
    params = branch.params.model_copy(update={"control": control})
    return branch.model_copy(update={"output": output, "params": params})


def _with_same(place: tuple[str, ...], job: M, branch: M, names: Sequence[str]) -> M:
    """Return a group of a branch's request with these members of its job; refuse other values."""
    for name in names:
        wanted, where = getattr(job, name), ".".join((*place, name))
        if name in branch.model_fields_set and getattr(branch, name) != wanted:
            raise ParameterError.at(
                [*place, name],
                f"A branch deforms the same mesh as its job, so it needs the same {where}.",
                f"Leave {where} out, or post a new job.",
                message="differs from that of the job",
            )
        if getattr(branch, name) != wanted:
            branch = branch.model_copy(update={name: wanted})
    return branch


def resolved_params(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> ResolvedParams:
    """Return the parameters stored when the request was accepted; resolve them if there are none."""
    if kept is None:
        return resolve(request.params, default_model=default_model)
    constants = {name: kept[name] for name in CONSTANTS & kept.keys()}  # earlier editions took them in requests
    kept = without_removed({"params": kept})["params"] | constants
    try:
        return read_unbounded(ResolvedParams, kept)
    except ValidationError as error:
        # Another version with other parameters wrote them; the request is still valid.
        _log.info("the resolved parameters cannot be read and are resolved again: %s", error)
    if isinstance(kept.get("model"), str):  # the request may name a folder by its id
        request = request.model_copy(update={"params": request.params.with_model(kept["model"])})
    return with_constants(resolve(request.params, default_model=default_model), constants)


def with_constants(params: ResolvedParams, kept: Mapping[str, Any]) -> ResolvedParams:
    """Return parameters with the constants that a job was accepted with: earlier editions took them in requests."""
    values = {**params.model_dump(), **{name: kept[name] for name in CONSTANTS & kept.keys()}}
    return read_unbounded(ResolvedParams, values)


def _steps(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> int:
    try:
        return resolved_params(request, default_model, kept).steps
    except MeshdeformError:
        # A default has changed since the job was accepted; its worker will report the error.
        return request.params.steps if "steps" in request.params.model_fields_set else 0


def _uses(request: JobRequest) -> list[str]:
    params = request.params
    weights = [WEIGHTS_PART] if is_sent(params.model or "") else []
    return [
        "asset",
        *([_TARGET] if params.kind is GuidanceKind.TARGET else []),
        *SILHOUETTE_PARTS[: len(params.silhouettes)],
        *weights,
    ]


def read_target(params: ResolvedParams, given: RunInput) -> InputFile | None:
    """Return the target mesh of a job; refuse a job whose target an earlier edition would have made of a drawing."""
    target = given.files.get(_TARGET)
    if target is None and params.guidance is GuidanceKind.TARGET:
        raise ParameterError(
            "The target of this job was to be made of a drawing, which jobs no longer do.",
            advice="Make a mesh of the drawing (docs/sketch.md), and post a new job with it as the part `target`.",
        )
    return target


def _goal(request: JobRequest, filenames: Mapping[str, str]) -> str:
    """Return the prompt, or what the result is to look like; `filenames` are those of the files, by part."""
    like = filenames.get(_TARGET) or filenames.get(SILHOUETTE_PARTS[0])
    return prompt_words(request.prompt, request.params) or (f"like {PurePath(like).stem}" if like else "")


TEXT_DEFORM = Kind(
    name=JobKind.TEXT_DEFORM,
    summary="Deforms an asset until it looks like a prompt, a second mesh, or pictures of it from given sides.",
    reads=(
        FilePart(
            "asset",
            "The file to deform: GLB, OBJ, PLY, STL or ZIP.",
            required=True,
            media_types=_MESHES,
        ),
        FilePart(_TARGET, "The second mesh of `target` guidance.", required=False, media_types=_MESHES),
        *(
            FilePart(
                name,
                f"Picture {number} of `silhouettes`: a mask, or an object in front of a plain background.",
                required=False,
                media_types=("image/png", "image/jpeg", "image/webp"),
                content="silhouette",
            )
            for number, name in enumerate(SILHOUETTE_PARTS, 1)
        ),
        WEIGHTS_FILE,
    ),
    params=DeformParams,
    check=_check,
    steps=_steps,
    load=start_of("meshdeform.runs.text_deform"),
    artifacts=(
        ArtifactKind("result.glb", _GLB, "The asset with its new shape.", strengths=True),
        ArtifactKind(
            "report.json",
            "application/json",
            "Parameters, seed, versions, hashes, losses, times, what was skipped, the quality of the mesh before and "
            "after, and of a prompt the [likeness and a verdict](quality.md#in-the-report-of-a-job).",
        ),
        ArtifactKind("preview.png", "image/png", "Before and after, from four sides."),
        ArtifactKind(
            "morph.glb",
            _GLB,
            "The source with the way to the result as morph targets and an animation, if `output.morph` is set.",
            afterwards=True,
        ),
        *FORMATS_OF_RESULT,
    ),
    uses=_uses,
    check_files=_check_files,
    check_words=check_words,
    as_branch=_as_branch,
    goal=_goal,
)
