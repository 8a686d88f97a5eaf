"""Describe the kind `text_deform`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from meshdeform.assets.check import MAX_PARTS
from meshdeform.errors import MeshdeformError, ModelError, ParameterError, PromptError
from meshdeform.priors.public_names import configured_name, hidden_folders, public_names
from meshdeform.requests.document import (
    BUILTIN_MODEL,
    DeformParams,
    JobKind,
    JobRequest,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.models import WEIGHTS_PART, is_builtin, is_sent, is_taught
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS
from meshdeform.requests.sketches import SKETCH_PART
from meshdeform.requests.stages import (
    TARGET_PARTS,
    active_prompts,
    generated_targets,
    named_targets,
    needs_prior,
    with_target_models,
)
from meshdeform.runs.base import (
    FITTED_SOURCE,
    FORMATS_OF_RESULT,
    ArtifactKind,
    FilePart,
    JobRun,
    Kind,
    RunInput,
    StartRun,
)
from meshdeform.runs.goal_words import goal_of
from meshdeform.runs.picture_parts import PICTURE_FILES, check_pictures
from meshdeform.runs.sent_weights import WEIGHTS_FILE, check_weights_part, load_sent
from meshdeform.runs.sketch_part import SKETCH_FILE, check_sketch, drawn_parts
from meshdeform.runs.vocabulary import PlacedPrompt, at_parameter, check_vocabulary

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary
    from meshdeform.priors.builtin.words import Words
    from meshdeform.settings import Settings

__all__ = ["TEXT_DEFORM", "check"]

_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"
_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def check(
    request: JobRequest,
    *,
    default_model: str,
    allowed_models: Sequence[str] = (),
    revision: str = "",
    has_target: bool = False,
    targets: Collection[str] = (),
    pictures: Collection[str] = (),
    has_weights: bool = False,
    has_sketch: bool = False,
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
    targets : collection of str
        The parts that are target meshes, for stages.
    pictures : collection of str
        The names of the parts with pictures that are present.
    has_weights : bool
        Whether taught weights are among the files.
    has_sketch : bool
        Whether a drawing is among them.

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
    given = {*targets, *(["target"] if has_target else [])}
    if not check_sketch(resolved, given | ({SKETCH_PART} if has_sketch else set())):
        _check_targets(resolved, given)
    known = list(public_names([BUILTIN_MODEL, default_model, *allowed_models]).values())
    for generated in generated_targets(resolved):
        if generated.model != default_model and generated.model not in allowed_models:
            raise _not_allowed(generated.model, known)
        from meshdeform.priors.text_to_3d import check_generator

        check_generator(generated.model)
    if resolved.stages and request.prompt:
        raise _refusal("stages", "There are a prompt and stages.", "Leave the prompt out: each stage has its own.")
    if needs_prior(resolved):
        model = params.model or default_model
        check_weights_part(model, [WEIGHTS_PART] if has_weights else [])
        if is_sent(model):  # its words are those of a file, which is checked later
            return resolved
        offered = model in (BUILTIN_MODEL, default_model, *allowed_models)
        if is_taught(model) and not offered:  # before its words are read
            raise _not_allowed(model, known)
        _check_prompts(_prompts(request), params, model)
        if not offered:
            raise _not_allowed(model, known)
        from meshdeform.priors import check_model

        check_model(model, revision if model == default_model else "", params.encoder)
    elif has_weights:
        check_weights_part(params.model, [WEIGHTS_PART])
    return resolved


def _check_targets(params: ResolvedParams, given: Collection[str]) -> None:
    """Refuse a request whose target meshes are not those that were sent."""
    needed = named_targets(params)
    for part in needed:
        if part not in given:
            detail = "`target` guidance needs a second mesh." if not params.stages else f"A stage needs `{part}`."
            raise _refusal("stages" if params.stages else "guidance", detail, f"Send it as the part `{part}`.")
    for part in sorted(set(given) - set(needed)):
        if params.stages or params.target is not None:
            whose = "no stage" if params.stages else "params.target, which is generated, not"
            detail = f"`{part}` was sent, but {whose} uses it."
            raise _refusal("stages" if params.stages else "target", detail, f"Omit the part `{part}`.")
        raise _refusal(
            "guidance",
            f"A target was sent, but the guidance is `{params.guidance}`, which does not use it.",
            f"Set params.guidance to `target`, or omit the part `{part}`.",
        )


def _prompts(request: JobRequest) -> list[PlacedPrompt]:
    """Return the prompts of a request, each with its place in the document.

    Raises
    ------
    ParameterError
        There are several, and none pulls at anything.
    """
    params = request.params
    if params.stages:
        staged = enumerate(params.stages)
        return [(["params", "stages", number, "prompt"], stage.prompt) for number, stage in staged if stage.prompt]
    if not params.prompts:
        return [(["prompt"], request.prompt)]
    if not active_prompts(request.prompt, params.prompts):
        raise _refusal("prompts", "All prompts have the weight 0.", "Give one of them a weight, or set prompt.")
    found: list[PlacedPrompt] = [(["prompt"], request.prompt)] if request.prompt else []
    for number, each in enumerate(params.prompts):
        found.append((["params", "prompts", number, "prompt"], each.prompt))
    return found


def _check_prompts(prompts: Sequence[PlacedPrompt], params: DeformParams, model: str) -> None:
    """Refuse prompts that are empty, or that the builtin model cannot read."""
    _filled(prompts)
    if is_builtin(model) and prompts:
        from meshdeform.priors.builtin.taught import known_words

        check_vocabulary(prompts, params, known_words(model))


def _filled(prompts: Sequence[PlacedPrompt]) -> Sequence[PlacedPrompt]:
    """Return the prompts; refuse empty ones."""
    if not all(prompt for _, prompt in prompts):
        raise PromptError("The prompt is empty.")
    return prompts


def _not_allowed(model: str, known: Sequence[str]) -> ModelError:
    return ModelError(
        f"This server does not run the model {model!r}.",
        advice=f"Use one of: {', '.join(known)}. The server's operator can add it to MESHDEFORM_ALLOWED_MODELS.",
        models=list(known),
    )


def _refusal(name: str, detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, **at_parameter(name, detail))


def _check(request: JobRequest, settings: Settings, files: frozenset[str]) -> ResolvedParams:
    if request.output.usd and not settings.writes_usd:
        detail = "The request asks for result.usdz, and this deployment does not write USDZ."
        raise ParameterError(
            detail,
            advice="Omit output.usd. The service's operator can install the extra `usd` and set MESHDEFORM_USD.",
            errors=[{"loc": ["output", "usd"], "msg": detail, "type": "value_error"}],
        )
    models = settings.offered_models
    params = with_target_models(request.params, lambda name: configured_name(name, models))
    if params.model is not None:
        params = params.model_copy(update={"model": configured_name(params.model, models)})
    request = request.model_copy(update={"params": params})
    with hidden_folders(models):
        return check(
            request,
            default_model=settings.model,
            allowed_models=settings.further_models,
            revision=settings.model_revision,
            targets=files & set(TARGET_PARTS),
            pictures=files.intersection(SILHOUETTE_PARTS),
            has_weights=WEIGHTS_PART in files,
            has_sketch=SKETCH_PART in files,
        )


def _check_words(request: JobRequest, known: Words, _files: Mapping[str, AssetSummary]) -> None:
    if needs_prior(resolve(request.params)):
        check_vocabulary(_filled(_prompts(request)), request.params, known)


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
        params = _resolved(request, default_model, kept)
        return params.steps * max(len(params.stages), 1)
    except MeshdeformError:
        # A default has changed since the job was accepted; its worker will report the error.
        written = request.params.steps if "steps" in request.params.model_fields_set else 0
        return written * max(len(request.params.stages), 1)


def _uses(request: JobRequest) -> list[str]:
    weights = [WEIGHTS_PART] if is_sent(request.params.model or "") else []
    return [
        "asset",
        *named_targets(request.params),
        *drawn_parts(request.params),
        *SILHOUETTE_PARTS[: len(request.params.silhouettes)],
        *weights,
    ]


def _load() -> StartRun:
    from meshdeform.runs import text_deform
    from meshdeform.runs.fitted_source import fitted_source
    from meshdeform.runs.generated_target import generated_target
    from meshdeform.runs.sketched_target import read_targets

    def start(given: RunInput) -> JobRun:
        asset = given.files["asset"]
        params = _resolved(given.request, given.default_model, given.resolved)
        prior = load_sent(params.model, given) if needs_prior(params) else None
        source = fitted_source(given)
        targets, sketch = read_targets(params, given)
        return text_deform.start(
            asset=asset.data,
            filename=asset.filename,
            request=given.request,
            prior=prior,
            targets=targets,
            sketch=sketch,
            generate=lambda wanted, name: generated_target(wanted, name, params.seed, given),
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
        FilePart("target", "The second mesh of `target` guidance.", required=False, media_types=_MESHES),
        *(
            FilePart(part, "A target mesh of `params.stages`.", required=False, media_types=_MESHES)
            for part in TARGET_PARTS[1:]
        ),
        *PICTURE_FILES,
        SKETCH_FILE,
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
            "Parameters, seed, versions, hashes, losses, times, what was skipped, and the quality of the mesh before "
            "and after.",
        ),
        ArtifactKind("preview.png", "image/png", "Before and after, from four sides."),
        FITTED_SOURCE,
        ArtifactKind(
            "morph.glb",
            _GLB,
            "The source with the way to the result as morph targets and an animation, if `output.morph` is set or "
            "there are `params.stages`.",
            afterwards=True,
        ),
        ArtifactKind(
            "target.glb",
            _GLB,
            "The target that a text-to-3D model made for `params.target`, or that was made of a drawing; there before "
            "the fit begins. Those of stages are named `target-1.glb` and so on.",
        ),
        ArtifactKind(
            "result.usdz",
            "model/vnd.usdz+zip",
            "The result as USDZ, if `output.usd` is set ([Assets: USDZ](assets.md#usdz)).",
            afterwards=True,
        ),
        *FORMATS_OF_RESULT,
    ),
    uses=_uses,
    alternatives=("target", SKETCH_PART),
    check_files=_check_files,
    check_words=_check_words,
    as_branch=_as_branch,
    goal=goal_of,
)
