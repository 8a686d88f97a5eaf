"""Describe the kind `text_deform`: its files, its steps, its branches, and its artifacts. Torch-free."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    MeshdeformError,
    ParameterError,
)
from meshdeform.requests.choices import StartMode
from meshdeform.requests.default_kind import kind_like
from meshdeform.requests.document import (
    DeformParams,
    GuidanceKind,
    JobKind,
    JobRequest,
    ResolvedParams,
    read_unbounded,
    resolve,
)
from meshdeform.requests.parameters import (
    SILHOUETTE_FIELDS,
    TARGET_FIELDS,
    WORDS_FIELD,
    prompt_words,
)
from meshdeform.runs.base import FORMATS_OF_RESULT, ArtifactKind, FileField, JobFile, Kind, start_of
from meshdeform.runs.changes import asked_changes
from meshdeform.runs.exemplar_kind import steps_of
from meshdeform.runs.outlook import outlook_of
from meshdeform.runs.text_deform_check import check, is_plain_change
from meshdeform.runs.word_pins import pins_of

if TYPE_CHECKING:
    from meshdeform.settings import Settings

M = TypeVar("M", bound=BaseModel)

_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"

_TARGET = "target"

_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def _outlook(request: JobRequest, params: ResolvedParams, settings: Settings, asset: JobFile) -> dict[str, Any] | None:
    fitted = params.guidance is GuidanceKind.EXEMPLAR and (request.prompt or params.prompts)
    if asset.path is None or not fitted or is_plain_change(request, params) or request.output.subdivide:
        return None
    limits = Limits.from_settings(settings)
    return outlook_of(asset.path, asset.filename, request, params, limits, asset.readings)


def _as_branch(job: JobRequest, branch: JobRequest) -> JobRequest:
    """Return the branch's request with its kind and its job's mesh, without which a checkpoint is of no use."""
    branch = kind_like(job, branch)
    output = _with_same(("output",), job.output, branch.output, ("subdivide",))
    control = _with_same(("params", "control"), job.params.control, branch.params.control, ("exclude", "backdrop"))
    params = branch.params.model_copy(update={"control": control})
    if job.params.kind is GuidanceKind.EXEMPLAR and params.kind is not GuidanceKind.EXEMPLAR:
        raise ParameterError.at(
            ["params", "guidance"],
            "A branch of a job with `exemplar` guidance has that guidance: no optimiser can go on with its shape.",
            "Leave out what only the optimiser or a model has, or post a new job with the result.glb of this one as "
            "its asset.",
        )
    if _starts_at_exemplar(params) and not _starts_at_exemplar(job.params):
        raise ParameterError.at(
            ["params", "guidance", "start"],
            "A branch starts from the shape of its job, which has not started from an exemplar.",
            "Leave start out, or post a new job.",
        )
    if is_plain_change(branch, resolve(params)):
        raise ParameterError.at(
            ["prompt"],
            "A branch goes on with a prompt, and this is a change in plain words.",
            "Post a new job with the result.glb of this one as its asset.",
        )
    return branch.model_copy(update={"output": output, "params": params})


def _starts_at_exemplar(params: DeformParams) -> bool:
    return params.flat().get("start") is StartMode.EXEMPLAR


def _with_same(place: tuple[str, ...], job: M, branch: M, names: Sequence[str]) -> M:
    """Return a group of a branch's request with these members of its job; refuse other values."""
    for name in names:
        value, where = getattr(job, name), ".".join((*place, name))
        if name in branch.model_fields_set and getattr(branch, name) != value:
            raise ParameterError.at(
                [*place, name],
                f"A branch deforms the same mesh as its job, so it needs the same {where}.",
                f"Leave {where} out, or post a new job.",
                message="differs from that of the job",
            )
        if getattr(branch, name) != value:
            branch = branch.model_copy(update={name: value})
    return branch


def resolved_params(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> ResolvedParams:
    """Return the parameters stored when the request was accepted; resolve them if there are none."""
    if kept is None:
        return resolve(request.params, default_model=default_model)
    try:
        return read_unbounded(ResolvedParams, kept)
    except ValidationError as error:
        # Another version with other parameters wrote them; the request is still valid.
        _log.info("the resolved parameters cannot be read and are resolved again: %s", error)
    if isinstance(kept.get("model"), str):  # the request may name a folder by its id
        request = request.model_copy(update={"params": request.params.with_model(kept["model"])})
    return resolve(request.params, default_model=default_model)


def _steps(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> int:
    try:
        params = resolved_params(request, default_model, kept)
        if is_plain_change(request, params):
            return 0
        return steps_of(request, params) if params.guidance is GuidanceKind.EXEMPLAR else params.steps
    except MeshdeformError:
        # A default has changed since the job was accepted; its worker will report the error.
        return request.params.steps if "steps" in request.params.model_fields_set else 0


def _uses(request: JobRequest) -> list[str]:
    params = request.params
    prompted = request.prompt or params.prompts
    targets = {GuidanceKind.TARGET: [_TARGET], GuidanceKind.EXEMPLAR: [] if prompted else TARGET_FIELDS}
    return [
        "asset",
        *targets.get(params.kind, ()),
        *SILHOUETTE_FIELDS[: len(params.silhouettes)],
        *([WORDS_FIELD] if pins_of(request) else []),
    ]


def _goal(request: JobRequest, filenames: Mapping[str, str]) -> str:
    """Return the prompt, or what the result is to look like; `filenames` are those of the files, by part."""
    like = filenames.get(_TARGET) or filenames.get(SILHOUETTE_FIELDS[0])
    return prompt_words(request.prompt, request.params) or (f"like {PurePath(like).stem}" if like else "")


def _needs_torch(request: JobRequest, params: ResolvedParams) -> bool:
    """Return whether an optimiser guides: neither a fit nor, as far as the prompt tells, a change in plain words."""
    return params.guidance is not GuidanceKind.EXEMPLAR and asked_changes(request.prompt, params) is None


TEXT_DEFORM = Kind(
    needs_torch=_needs_torch,
    name=JobKind.TEXT_DEFORM,
    takes_output=True,
    summary="Deforms an asset until it looks like a prompt, a second mesh, or pictures of it from given sides; or "
    "changes it in plain words, such as longer legs ([Changes in plain words](plain.md)).",
    reads=(
        FileField(
            "asset",
            "The file to deform: GLB, OBJ, PLY, STL or ZIP.",
            required=True,
            media_types=_MESHES,
        ),
        FileField(
            _TARGET,
            "The second mesh of `target` guidance; of `exemplar`, the first target.",
            required=False,
            media_types=_MESHES,
        ),
        *(
            FileField(
                name,
                f"Target {number} of `exemplar` guidance, of which the nearest is taken.",
                required=False,
                media_types=_MESHES,
            )
            for number, name in enumerate(TARGET_FIELDS[1:], 2)
        ),
        *(
            FileField(
                name,
                f"Picture {number} of `silhouettes`: a mask, or an object in front of a plain background.",
                required=False,
                media_types=("image/png", "image/jpeg", "image/webp"),
                content="silhouette",
            )
            for number, name in enumerate(SILHOUETTE_FIELDS, 1)
        ),
        FileField(
            WORDS_FIELD,
            "The words of your own that `words` pins, as `meshdeform words export` writes them; the service adds them.",
            required=False,
            media_types=("application/octet-stream",),
            content="words",
        ),
    ),
    params=DeformParams,
    check=check,
    steps=_steps,
    load=start_of("meshdeform.runs.text_deform"),
    artifacts=(
        ArtifactKind("result.glb", _GLB, "The asset with its new shape.", strengths=True),
        ArtifactKind(
            "report.json",
            "application/json",
            "Parameters, seed, versions, hashes, losses, times, what was skipped, the quality of the mesh before and "
            "after, what the result is worth, and of a prompt its likeness "
            "([Quality](quality.md#in-the-report-of-a-job)).",
        ),
        ArtifactKind("preview.png", "image/png", "Before and after, from four sides."),
        ArtifactKind(
            "morph.glb",
            _GLB,
            "The source with the way to the result as morph targets and an animation, if `output.morph` is set.",
            afterwards=True,
        ),
        ArtifactKind(
            "map.safetensors",
            "application/octet-stream",
            "Map of the edit, for other files ([Control](control.md#one-edit-many-files)), made "
            "[afterwards](http.md#post-v1jobsidartifactsname) only.",
            afterwards=True,
        ),
        *FORMATS_OF_RESULT,
    ),
    uses=_uses,
    outlook=_outlook,
    as_branch=_as_branch,
    goal=_goal,
)
