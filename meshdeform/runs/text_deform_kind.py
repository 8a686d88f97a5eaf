"""Describe the kind `text_deform`: its files, the check of its requests, and its artifacts. Torch-free.

The check says whether a request could run: its model, prompts, targets and pictures.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from meshdeform.assets.check import MAX_PARTS
from meshdeform.errors import (
    KindRetiredError,
    MeshdeformError,
    ModelError,
    ParameterError,
    PromptError,
    VocabularyError,
)
from meshdeform.priors import check_model, configured_name, hidden_folders, public_names
from meshdeform.requests.choices import StartMode, is_builtin, is_weights_file
from meshdeform.requests.default_kind import kind_like
from meshdeform.requests.document import (
    BUILTIN_MODEL,
    DeformParams,
    GuidanceKind,
    JobKind,
    JobRequest,
    ResolvedParams,
    read_unbounded,
    resolve,
)
from meshdeform.requests.groups import PLACES
from meshdeform.requests.parameters import (
    SILHOUETTE_PARTS,
    TARGET_PARTS,
    WORDS_PART,
    Silhouette,
    active_prompts,
    prompt_words,
)
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.runs.base import (
    FORMATS_OF_RESULT,
    ArtifactKind,
    FilePart,
    Kind,
    start_of,
)
from meshdeform.runs.changes import asked_changes, check_change, check_parts, is_change, refuse_unread_change
from meshdeform.runs.exemplar_kind import check_exemplar, steps_of
from meshdeform.runs.outlook import outlook_of
from meshdeform.runs.word_pins import pins_of

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary, Limits
    from meshdeform.runs.kept_readings import Readings
    from meshdeform.settings import Settings
    from meshdeform.vocabulary.grammar import Words

_PlacedPrompt = tuple[list[str | int], str]
"""A prompt after its place in the document."""

_MAX_REACH = 1_000_000
"""How far from an asset a point may be, in lengths of its bounding box."""

_Place = tuple[str, int, str, Sequence[float]]

_SAME_DEG = 1.0
"""Directions of pictures that differ by less are the same."""


M = TypeVar("M", bound=BaseModel)

_log = logging.getLogger(__name__)

_GLB = "model/gltf-binary"

_TARGET = "target"

_MESHES = (_GLB, "model/obj", "model/ply", "model/stl", "application/zip")


def check(
    request: JobRequest,
    *,
    default_model: str,
    allowed_models: Sequence[str] = (),
    revision: str = "",
    targets: Collection[str] = (),
    pictures: Collection[str] = (),
) -> ResolvedParams:
    """Refuse a request that could not run; return the values of all its parameters.

    `default_model`: the model used if the request names none; always allowed, like `builtin`; `allowed_models`: further
    models that a request may name; `revision`: revision of the default model; `targets` and `pictures`: the names of
    the parts with target meshes and with pictures that are present.
    """
    resolved = resolve(request.params, default_model=default_model)
    _check_pictures(resolved, request.prompt, pictures)
    _check_targets(resolved, targets)
    known = list(public_names([BUILTIN_MODEL, default_model, *allowed_models]).values())
    if resolved.guidance is GuidanceKind.SDS:
        model = resolved.model
        offered = model in (BUILTIN_MODEL, default_model, *allowed_models)
        if _is_change(request, resolved):  # no model is asked
            check_change(resolved)
            _check_given(resolved)
            return resolved
        if not offered:
            raise _not_allowed(model, known)
        check_model(model, revision if model == default_model else "")
        try:
            _check_prompts(_prompts(request), resolved)
        except VocabularyError as error:
            refuse_unread_change(request.prompt, error)
            raise
        _check_start(request, resolved)
    if resolved.guidance is GuidanceKind.EXEMPLAR:
        _check_exemplar(request, resolved, targets)
    return resolved


def _check_exemplar(request: JobRequest, params: ResolvedParams, targets: Collection[str]) -> None:
    """Refuse what `exemplar` guidance does not have, and prompts whose noun it has no members of."""
    from meshdeform.vocabulary.grammar import known_here

    check_exemplar(request, params, targets)
    if targets:
        _check_given(params)
        return
    if _is_change(request, params):
        check_change(params)
        _check_given(params)
        return
    try:
        _check_vocabulary(_filled(_prompts(request)), params, known_here())
    except VocabularyError as error:
        refuse_unread_change(request.prompt, error)
        raise


def _check_start(request: JobRequest, params: ResolvedParams) -> None:
    """Refuse a start at the exemplars of prompts whose noun has none, and pictures beside it."""
    if params.start is not StartMode.EXEMPLAR:
        return
    from meshdeform.vocabulary.grammar import parse

    place = ["params", "guidance", "start"]
    if params.silhouettes:
        detail = "The fit from which the run would start takes no pictures beside `sds`."
        raise ParameterError.at(
            place, detail, "Leave start or the pictures out, or set params.guidance.kind to exemplar."
        )
    _check_given(params)
    for _, prompt in _filled(_prompts(request)):
        try:
            parse(prompt)
        except (PromptError, VocabularyError) as error:
            near = "".join(f", such as {text!r}" for text in error.extra.get("suggestions", [])[:1])
            raise ParameterError.at(
                place,
                f"The run would start from the exemplar of {prompt!r}, and there is none: {error}",
                f"Leave start out, or use only words that `meshdeform models builtin` lists{near}.",
            ) from error


def _is_change(request: JobRequest, params: ResolvedParams) -> bool:
    """Return whether the prompt is a change in plain words, whatever the asset is."""
    sentence = asked_changes(request.prompt, params)
    return sentence is not None and is_change(sentence)


def _check_targets(params: ResolvedParams, targets: Collection[str]) -> None:
    """Refuse `target` guidance without its mesh, and target meshes that the guidance does not use."""
    if params.guidance is GuidanceKind.TARGET and _TARGET not in targets:
        raise ParameterError.at(
            ["params", "guidance"], "`target` guidance needs a second mesh.", "Send it as the part `target`."
        )
    if params.guidance is GuidanceKind.EXEMPLAR:
        return
    if _TARGET in targets and params.guidance is not GuidanceKind.TARGET:
        raise ParameterError.at(
            ["params", "guidance"],
            f"A target was sent, but the guidance is `{params.guidance}`, which does not use it.",
            "Leave params.guidance.kind out, or omit the part `target`.",
        )
    for name in sorted(set(targets) - {_TARGET}):
        raise ParameterError.at(
            ["params", "guidance"],
            f"`{name}` was sent, but only `exemplar` guidance takes the nearest of several targets.",
            f"Leave params.guidance.kind out, or omit the part `{name}`.",
        )


def _prompts(request: JobRequest) -> list[_PlacedPrompt]:
    """Return the prompts of a request, each with its place in the document."""
    params = request.params
    if not params.prompts:
        return [(["prompt"], request.prompt)]
    if not active_prompts(request.prompt, params.prompts):
        advice = "Give one of them a weight, or set prompt."
        raise ParameterError.at(["params", "guidance", "prompts"], "All prompts have the weight 0.", advice)
    prompts: list[_PlacedPrompt] = [(["prompt"], request.prompt)] if request.prompt else []
    for number, each in enumerate(params.prompts):
        prompts.append((["params", "guidance", "prompts", number, "prompt"], each.prompt))
    return prompts


def _check_prompts(prompts: Sequence[_PlacedPrompt], params: ResolvedParams) -> None:
    """Refuse prompts that are empty, or that the builtin model cannot read."""
    _filled(prompts)
    if is_builtin(params.model) and prompts:
        from meshdeform.priors.builtin.vocabulary import BUILTIN_WORDS

        _check_vocabulary(prompts, params, BUILTIN_WORDS)


def _filled(prompts: Sequence[_PlacedPrompt]) -> Sequence[_PlacedPrompt]:
    """Return the prompts; refuse empty ones."""
    if not all(prompt for _, prompt in prompts):
        raise PromptError("The prompt is empty.")
    return prompts


def _not_allowed(model: str, known: Sequence[str]) -> MeshdeformError:
    detail = f"This server does not run the model {model!r}."
    if is_weights_file(model):  # those that people had of their own were taught
        return KindRetiredError(f"{detail} Weights whose words were taught are no longer used.")
    return ModelError(
        detail,
        advice=f"Use one of: {', '.join(known)}. The server's operator can add it to MESHDEFORM_ALLOWED_MODELS.",
        models=list(known),
    )


def _check_pictures(params: ResolvedParams, prompt: str, present: Collection[str]) -> None:
    """Refuse pictures without a direction, directions without a picture, and directions that are the same."""
    # `present` has the names of the parts with pictures.
    views = params.silhouettes
    if params.guidance is GuidanceKind.TARGET and present:
        detail = "Pictures cannot guide beside a second mesh, which has all its silhouettes."
        raise ParameterError.at(["params", "guidance"], detail, "Leave the pictures out, or use another guidance.")
    if params.guidance is GuidanceKind.SILHOUETTES:
        if not views:
            detail = "`silhouettes` guidance needs at least one picture."
            raise ParameterError.at(
                ["params", "guidance", "silhouettes"],
                detail,
                "Send it as the part `silhouette_1`, with its azimuth in params.guidance.silhouettes.",
            )
        if prompt:
            detail = "There is a prompt, and `silhouettes` guidance does not use it."
            advice = "Leave params.guidance.kind out to use both, or leave the prompt out."
            raise ParameterError.at(["params", "guidance"], detail, advice)
    parts = SILHOUETTE_PARTS[: len(views)]
    for number, name in enumerate(parts):
        if name not in present:
            detail = f"params.guidance.silhouettes has {len(views)} entries, and the part `{name}` is missing."
            raise ParameterError.at(
                ["params", "guidance", "silhouettes", number], detail, f"Send the picture as the part `{name}`."
            )
    for name in sorted(set(present) - set(parts)):
        detail = f"The part `{name}` was sent, and params.guidance.silhouettes has {len(views)} entries."
        advice = "Give each picture an entry with its azimuth, in the order of the parts."
        raise ParameterError.at(["params", "guidance", "silhouettes"], detail, advice)
    for number, view in enumerate(views):
        for other in range(number):
            if _same(view, views[other]):
                detail = f"`{parts[other]}` and `{parts[number]}` have the same azimuth and elevation."
                raise ParameterError.at(
                    ["params", "guidance", "silhouettes", number],
                    detail,
                    "Correct one of the azimuths, or leave one of the pictures out.",
                )


def _same(one: Silhouette, other: Silhouette) -> bool:
    apart = abs((one.azimuth - other.azimuth + 180.0) % 360.0 - 180.0)
    return apart < _SAME_DEG and abs(one.elevation - other.elevation) < _SAME_DEG


def _check_vocabulary(prompts: Sequence[_PlacedPrompt], params: ResolvedParams, known: Words) -> None:
    """Refuse prompts that cannot be read with these words."""
    from meshdeform.vocabulary.grammar import parse_negative

    for place, prompt in prompts:
        _check_known(prompt, known, place if len(prompts) > 1 else None)  # of several, say which
        if params.negative_prompt.strip():
            try:
                parse_negative(params.negative_prompt, prompt, known)
            except (PromptError, VocabularyError) as error:
                # Add which of the two texts the error is about.
                error.located(["params", "guidance", "negative_prompt"])
                raise
    _check_given(params)


def _check_given(params: ResolvedParams) -> None:
    """Refuse a noun of the source that has no shapes."""
    from meshdeform.vocabulary.grammar import WORDS, known_here

    known = known_here() if params.guidance is GuidanceKind.EXEMPLAR else WORDS
    if params.source_noun is not None:
        _check_known(f"a {params.source_noun}", known, ["params", "guidance", "source_noun"])


def _check_known(text: str, known: Words, place: Sequence[str | int] | None) -> None:
    """Refuse a text that cannot be read with these words, at its place in the request."""
    from meshdeform.vocabulary.grammar import parse

    try:
        parse(text, known)
    except (PromptError, VocabularyError) as error:
        raise (error if place is None else error.located(place)) from None


def check_places(params: ResolvedParams, bounds: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """Refuse points of handles and landmarks that are absurdly far from the file in whose world they are.

    `bounds`: the least and the greatest coordinates (2, 3) of the `asset` and the `target`, as far as they are known.
    """
    for part, places in (("asset", _places_on_asset(params)), ("target", _places_on_target(params))):
        if not bounds.get(part):
            continue
        low, high = bounds[part]
        size = max(end - begin for begin, end in zip(low, high, strict=True))
        for name, number, member, point in places:
            away = max(max(a - x, x - b) for a, x, b in zip(low, point, high, strict=True))
            if away > _MAX_REACH * size:
                path = f"{PLACES[name][0]}.{name}"
                detail = f"params.{path}: the point is {away / size:.1g} times as far from the {part} as that is long."
                advice = f"Give a point within {_MAX_REACH:,} lengths of the {part}."
                raise ParameterError.at(["params", *path.split("."), number, member], detail, advice)


def _places_on_asset(params: ResolvedParams) -> Iterator[_Place]:
    for number, handle in enumerate(params.handles):
        if handle.position is not None:
            yield "handles", number, "position", handle.position
        yield "handles", number, "to", handle.to
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.source, int):
            yield "landmarks", number, "source", pair.source


def _places_on_target(params: ResolvedParams) -> Iterator[_Place]:
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.target, int):
            yield "landmarks", number, "target", pair.target


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
            allowed_models=settings.allowed_models,
            revision=settings.model_revision,
            targets=files.intersection(TARGET_PARTS),
            pictures=files.intersection(SILHOUETTE_PARTS),
        )


def _check_files(request: JobRequest, params: ResolvedParams, files: Mapping[str, AssetSummary]) -> None:
    asset = files["asset"]
    # Subdivision numbers anew. Exclusions only make them fewer.
    triangles = None if request.output.subdivide else asset.triangles
    lists = {name: getattr(asset, name) for name in ("nodes", "mesh_names", "materials", "joints")}
    # A list of that length may be incomplete; the run then refuses what selects nothing.
    complete = {name: parts for name, parts in lists.items() if len(parts) < MAX_PARTS}
    if "nodes" in complete:
        find_excluded(params.exclude, asset.nodes)
    check_selections(("control", "rigid"), params.rigid, complete, triangles)
    check_selections(("control", "regions"), params.regions, complete, triangles)
    check_selections(("control", "parts"), params.parts, complete, triangles)
    for number, prompt in enumerate(params.prompts):
        check_selections(("guidance", "prompts", number, "regions"), prompt.regions, complete, triangles)
    check_places(params, {part: file.bounds for part, file in files.items()})
    if not request.output.subdivide:
        for number, handle in enumerate(params.handles):
            check_vertex(("control", "handles", number, "vertex"), handle.vertex, asset.vertices)
    for number, pair in enumerate(params.landmarks):
        for name, place, part in (("source", pair.source, "asset"), ("target", pair.target, _TARGET)):
            if isinstance(place, int) and part in files and not (name == "source" and request.output.subdivide):
                check_vertex(("guidance", "landmarks", number, name), place, files[part].vertices)


def check_vertex(path: Sequence[str | int], vertex: int | None, count: int) -> None:
    """Refuse the number of a vertex that a mesh of `count` vertices does not have, at a path within `params`."""
    if vertex is not None and vertex >= count:
        detail = f"params.{'.'.join(map(str, path))}: the mesh has {count} vertices, and none with the index {vertex}."
        advice = "Indices begin at 0; or give a position [x, y, z]."
        raise ParameterError.at(["params", *path], detail, advice)


def _check_asset(
    request: JobRequest, params: ResolvedParams, asset: Path, filename: str, limits: Limits, readings: Readings
) -> None:
    check_parts(asset, filename, request.prompt, params, limits, readings)


def _outlook(
    request: JobRequest, params: ResolvedParams, asset: Path, filename: str, limits: Limits, readings: Readings
) -> dict[str, Any] | None:
    fitted = params.guidance is GuidanceKind.EXEMPLAR and (request.prompt or params.prompts)
    if not fitted or _is_change(request, params) or request.output.subdivide:
        return None
    return outlook_of(asset, filename, request, params, limits, readings)


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
    if _is_change(branch, resolve(params)):
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
        if _is_change(request, params):
            return 0
        return steps_of(request, params) if params.guidance is GuidanceKind.EXEMPLAR else params.steps
    except MeshdeformError:
        # A default has changed since the job was accepted; its worker will report the error.
        return request.params.steps if "steps" in request.params.model_fields_set else 0


def _uses(request: JobRequest) -> list[str]:
    params = request.params
    prompted = request.prompt or params.prompts
    targets = {GuidanceKind.TARGET: [_TARGET], GuidanceKind.EXEMPLAR: [] if prompted else TARGET_PARTS}
    return [
        "asset",
        *targets.get(params.kind, ()),
        *SILHOUETTE_PARTS[: len(params.silhouettes)],
        *([WORDS_PART] if pins_of(request) else []),
    ]


def _goal(request: JobRequest, filenames: Mapping[str, str]) -> str:
    """Return the prompt, or what the result is to look like; `filenames` are those of the files, by part."""
    like = filenames.get(_TARGET) or filenames.get(SILHOUETTE_PARTS[0])
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
        FilePart(
            "asset",
            "The file to deform: GLB, OBJ, PLY, STL or ZIP.",
            required=True,
            media_types=_MESHES,
        ),
        FilePart(
            _TARGET,
            "The second mesh of `target` guidance; of `exemplar`, the first target.",
            required=False,
            media_types=_MESHES,
        ),
        *(
            FilePart(
                name,
                f"Target {number} of `exemplar` guidance, of which the nearest is taken.",
                required=False,
                media_types=_MESHES,
            )
            for number, name in enumerate(TARGET_PARTS[1:], 2)
        ),
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
        FilePart(
            WORDS_PART,
            "The words of your own that `words` pins, as `meshdeform words export` writes them; the service adds them.",
            required=False,
            media_types=("application/octet-stream",),
            content="words",
        ),
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
    check_files=_check_files,
    check_asset=_check_asset,
    outlook=_outlook,
    as_branch=_as_branch,
    goal=_goal,
)
