"""Describe the kind `text_deform`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from meshdeform.assets.check import MAX_PARTS
from meshdeform.assets.inspect import surface_format
from meshdeform.errors import MeshdeformError, ParameterError
from meshdeform.priors.public_names import configured_name, hidden_folders
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.control import check_places
from meshdeform.requests.document import (
    DeformParams,
    JobKind,
    JobRequest,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.models import WEIGHTS_PART, is_sent
from meshdeform.requests.prompts import (
    goal_guidance,
    needs_prior,
    needs_target,
    prompt_words,
)
from meshdeform.requests.removed import without_removed
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS
from meshdeform.requests.sketches import SKETCH_PART
from meshdeform.requests.unbounded import read_unbounded
from meshdeform.runs.base import (
    FITTED_SOURCE,
    FORMATS_OF_RESULT,
    ArtifactKind,
    FilePart,
    InputFile,
    JobRun,
    Kind,
    RunInput,
    StartRun,
)
from meshdeform.runs.sent_weights import WEIGHTS_FILE, load_sent
from meshdeform.runs.text_deform_checks import check, check_words

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary
    from meshdeform.runs.fitted_source import FittedSource
    from meshdeform.settings import Settings

__all__ = ["TEXT_DEFORM", "read_source", "read_target"]

_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"
_TARGET = "target"
_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def _check(request: JobRequest, settings: Settings, files: frozenset[str]) -> ResolvedParams:
    models = settings.offered_models
    params = request.params
    if params.model is not None:
        params = params.model_copy(update={"model": configured_name(params.model, models)})
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
            has_sketch=SKETCH_PART in files,
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
    for number, prompt in enumerate(params.prompts):
        check_selections(("prompts", number, "regions"), prompt.regions, complete)
    check_places(params, {part: file.bounds for part, file in files.items()})


def _as_branch(job: JobRequest, branch: JobRequest) -> JobRequest:
    """Return the branch's request with what determines the mesh of its job, whose checkpoint fits no other."""
    for group, name in (("output", "subdivide"), ("params", "exclude"), ("params", "backdrop")):
        wanted, own = getattr(getattr(job, group), name), getattr(branch, group)
        if name in own.model_fields_set and getattr(own, name) != wanted:
            raise ParameterError.at(
                [group, name],
                f"A branch deforms the same mesh as its job, so it needs the same {group}.{name}.",
                f"Leave {group}.{name} out, or post a new job.",
                message="differs from that of the job",
            )
        if getattr(own, name) != wanted:
            branch = branch.model_copy(update={group: own.model_copy(update={name: wanted})})
    return branch


def _resolved(request: JobRequest, default_model: str, kept: Mapping[str, Any] | None) -> ResolvedParams:
    """Return the parameters stored when the request was accepted; resolve them if there are none."""
    if kept is not None:
        kept = without_removed({"params": kept})["params"]
        try:
            return read_unbounded(ResolvedParams, kept)
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
    params = request.params
    weights = [WEIGHTS_PART] if is_sent(params.model or "") else []
    return [
        "asset",
        *([_TARGET] if needs_target(params) else []),
        *([SKETCH_PART] if goal_guidance(params) is GuidanceKind.TARGET else []),
        *SILHOUETTE_PARTS[: len(params.silhouettes)],
        *weights,
    ]


def read_target(params: DeformParams, given: RunInput) -> tuple[InputFile | None, dict[str, Any] | None]:
    """Return the target mesh of a job, which may be that of its drawing, and what the report says about the drawing.

    Raises
    ------
    DrawingError, ModelError
        As for `sketched_target.guessed`.
    """
    drawing = given.files.get(SKETCH_PART)
    if drawing is None and params.sketch is None:
        return given.files.get(_TARGET), None
    from meshdeform.runs.sketched_target import sketched_target

    return sketched_target(None if drawing is None else drawing.data, params.sketch, given)


def read_source(given: RunInput) -> FittedSource | None:
    """Return the mesh that stands for an asset without triangles (`fitted_source`); None if the asset is a mesh."""
    asset = given.files["asset"]
    if surface_format(asset.data[:65_536], asset.filename) is None:
        return None
    from meshdeform.runs.fitted_source import fitted_source

    return fitted_source(given)


def _load() -> StartRun:
    from meshdeform.runs import text_deform

    def start(given: RunInput) -> JobRun:
        asset = given.files["asset"]
        params = _resolved(given.request, given.default_model, given.resolved)
        prior = load_sent(params.model, given) if needs_prior(params) else None
        source = read_source(given)
        target, sketch = read_target(params, given)
        return text_deform.start(
            asset=asset.data,
            filename=asset.filename,
            request=given.request,
            prior=prior,
            target=None if target is None else target.data,
            target_filename="" if target is None else target.filename,
            sketch=sketch,
            pictures=[given.files[name].data for name in SILHOUETTE_PARTS[: len(params.silhouettes)]],
            checkpoint=given.checkpoint,
            initial=given.initial,
            default_model=given.default_model,
            limits=given.limits,
            device=given.device,
            asset_sha256=asset.sha256,
            resolved=params,
            source=source,
        )

    return start


def _goal(request: JobRequest, filenames: Mapping[str, str]) -> str:
    """Return the prompt, or what the result is to look like; `filenames` are those of the files, by part."""
    like = filenames.get(_TARGET) or filenames.get(SKETCH_PART) or filenames.get(SILHOUETTE_PARTS[0])
    drawn = f"like a {request.params.sketch.family}" if request.params.sketch else ""
    prompts = prompt_words(request.prompt, request.params)
    return prompts or drawn or (f"like {PurePath(like).stem}" if like else "")


TEXT_DEFORM = Kind(
    name=JobKind.TEXT_DEFORM,
    summary="Deforms an asset until it looks like a prompt, a second mesh, or pictures of it from given sides.",
    reads=(
        FilePart(
            "asset",
            "The file to deform: GLB, OBJ, PLY, STL or ZIP; or a surface without triangles, to which a mesh is fitted "
            "first: oriented points (PLY, XYZ), a signed distance grid (NPZ) or a network (safetensors).",
            required=True,
            media_types=(*_MESHES, "application/octet-stream"),
            content="surface",
        ),
        FilePart(_TARGET, "The second mesh of `target` guidance.", required=False, media_types=_MESHES),
        *(
            FilePart(
                name,
                f"Picture {number} of `params.silhouettes`: a mask, or an object in front of a plain background.",
                required=False,
                media_types=("image/png", "image/jpeg", "image/webp"),
                content="silhouette",
            )
            for number, name in enumerate(SILHOUETTE_PARTS, 1)
        ),
        FilePart(
            SKETCH_PART,
            "A line drawing that becomes the target mesh of `target` guidance.",
            required=False,
            media_types=("image/png", "image/jpeg", "image/webp"),
            content="sketch",
        ),
        WEIGHTS_FILE,
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
            "Parameters, seed, versions, hashes, losses, times, what was skipped, the quality of the mesh before and "
            "after, and of a prompt the [likeness and a verdict](quality.md#in-the-report-of-a-job).",
        ),
        ArtifactKind("preview.png", "image/png", "Before and after, from four sides."),
        FITTED_SOURCE,
        ArtifactKind(
            "morph.glb",
            _GLB,
            "The source with the way to the result as morph targets and an animation, if `output.morph` is set.",
            afterwards=True,
        ),
        ArtifactKind(
            "target.glb",
            _GLB,
            "The target that was made of a drawing or of `params.sketch`; there before the fit begins.",
        ),
        *FORMATS_OF_RESULT,
    ),
    uses=_uses,
    alternatives=(_TARGET, SKETCH_PART),
    check_files=_check_files,
    check_words=check_words,
    as_branch=_as_branch,
    goal=_goal,
)
