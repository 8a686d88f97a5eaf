"""Refuse requests of the kind `text_deform` that could not run: its model, prompts, targets, pictures and places.

Torch-free.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from meshdeform.assets.check import MAX_LISTED
from meshdeform.assets.inspect import AssetSummary
from meshdeform.assets.limits import Limits
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
from meshdeform.requests.document import BUILTIN_MODEL, GuidanceKind, JobRequest, ResolvedParams, resolve
from meshdeform.requests.groups import GROUPS
from meshdeform.requests.parameters import SILHOUETTE_FIELDS, TARGET_FIELDS, ViewParams, active_prompts
from meshdeform.requests.selection import check_selections, find_excluded
from meshdeform.runs.base import JobFile
from meshdeform.runs.changes import asked_changes, check_change, check_parts, is_change, refuse_unread_change
from meshdeform.runs.exemplar_kind import check_exemplar

if TYPE_CHECKING:
    from meshdeform.settings import Settings
    from meshdeform.vocabulary.lookup import Words

__all__ = ["check", "check_points", "check_vertex", "is_plain_change"]

_LocatedPrompt = tuple[list[str | int], str]
"""A prompt after its path in the document."""

_MAX_REACH = 1_000_000
"""How far from an asset a point may be, in lengths of its bounding box."""

_LocatedPoint = tuple[str, int, str, Sequence[float]]

_SAME_DEG = 1.0
"""Directions of pictures that differ by less are the same."""

_TARGET = TARGET_FIELDS[0]


def check(request: JobRequest, settings: Settings, files: Mapping[str, JobFile]) -> ResolvedParams:
    """Refuse a request that could not run in a deployment; return the values of all its parameters.

    As far as its files are here, it is also checked that they have what the request names.
    """
    models = settings.offered_models
    if request.params.model is not None:
        params = request.params.with_model(configured_name(request.params.model, models))
        request = request.model_copy(update={"params": params})
    with hidden_folders(models):
        resolved = _checked_params(request, settings, files)
    asset = files.get("asset")
    if asset is not None and isinstance(asset.summary, AssetSummary):
        summaries = {name: file.summary for name, file in files.items() if isinstance(file.summary, AssetSummary)}
        _check_contents(request, resolved, summaries)
    if asset is not None and asset.path is not None:
        limits = Limits.from_settings(settings)
        check_parts(asset.path, asset.filename, request.prompt, resolved, limits, asset.readings)
    return resolved


def _checked_params(request: JobRequest, settings: Settings, files: Collection[str]) -> ResolvedParams:
    default_model, allowed = settings.model, settings.allowed_models
    targets = [name for name in TARGET_FIELDS if name in files]
    resolved = resolve(request.params, default_model=default_model)
    _check_pictures(resolved, request.prompt, [name for name in SILHOUETTE_FIELDS if name in files])
    _check_targets(resolved, targets)
    if resolved.guidance is GuidanceKind.SDS:
        model = resolved.model
        if is_plain_change(request, resolved):  # no model is asked
            check_change(resolved)
            _check_given(resolved)
            return resolved
        if model not in (BUILTIN_MODEL, default_model, *allowed):
            raise _not_allowed(model, list(public_names([BUILTIN_MODEL, default_model, *allowed]).values()))
        check_model(model, settings.model_revision if model == default_model else "")
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
    from meshdeform.vocabulary.lookup import current_words

    check_exemplar(request, params, targets)
    if targets:
        _check_given(params)
        return
    if is_plain_change(request, params):
        check_change(params)
        _check_given(params)
        return
    try:
        _check_vocabulary(_filled(_prompts(request)), params, current_words())
    except VocabularyError as error:
        refuse_unread_change(request.prompt, error)
        raise


def _check_start(request: JobRequest, params: ResolvedParams) -> None:
    """Refuse a start at the exemplars of prompts whose noun has none, and pictures beside it."""
    if params.start is not StartMode.EXEMPLAR:
        return
    from meshdeform.vocabulary.grammar import parse

    path = ["params", "guidance", "start"]
    if params.silhouettes:
        detail = "The fit from which the run would start takes no pictures beside `sds`."
        raise ParameterError.at(
            path, detail, "Leave start or the pictures out, or set params.guidance.kind to exemplar."
        )
    _check_given(params)
    for _, prompt in _filled(_prompts(request)):
        try:
            parse(prompt)
        except (PromptError, VocabularyError) as error:
            near = "".join(f", such as {text!r}" for text in error.extra.get("suggestions", [])[:1])
            raise ParameterError.at(
                path,
                f"The run would start from the exemplar of {prompt!r}, and there is none: {error}",
                f"Leave start out, or use only words that `meshdeform models builtin` lists{near}.",
            ) from error


def is_plain_change(request: JobRequest, params: ResolvedParams) -> bool:
    """Return whether the prompt is a change in plain words, whatever the asset is."""
    sentence = asked_changes(request.prompt, params)
    return sentence is not None and is_change(sentence)


def _check_targets(params: ResolvedParams, targets: Collection[str]) -> None:
    """Refuse `target` guidance without its mesh, and target meshes that the guidance does not use."""
    if params.guidance is GuidanceKind.TARGET and _TARGET not in targets:
        raise ParameterError.at(
            ["params", "guidance"], "`target` guidance needs a second mesh.", "Send it as the field `target`."
        )
    if params.guidance is GuidanceKind.EXEMPLAR:
        return
    if _TARGET in targets and params.guidance is not GuidanceKind.TARGET:
        raise ParameterError.at(
            ["params", "guidance"],
            f"A target was sent, but the guidance is `{params.guidance}`, which does not use it.",
            "Leave params.guidance.kind out, or omit the field `target`.",
        )
    for name in sorted(set(targets) - {_TARGET}):
        raise ParameterError.at(
            ["params", "guidance"],
            f"`{name}` was sent, but only `exemplar` guidance takes the nearest of several targets.",
            f"Leave params.guidance.kind out, or omit the field `{name}`.",
        )


def _prompts(request: JobRequest) -> list[_LocatedPrompt]:
    """Return the prompts of a request, each with its path in the document."""
    params = request.params
    if not params.prompts:
        return [(["prompt"], request.prompt)]
    if not active_prompts(request.prompt, params.prompts):
        advice = "Give one of them a weight, or set prompt."
        raise ParameterError.at(["params", "guidance", "prompts"], "All prompts have the weight 0.", advice)
    prompts: list[_LocatedPrompt] = [(["prompt"], request.prompt)] if request.prompt else []
    for number, each in enumerate(params.prompts):
        prompts.append((["params", "guidance", "prompts", number, "prompt"], each.prompt))
    return prompts


def _check_prompts(prompts: Sequence[_LocatedPrompt], params: ResolvedParams) -> None:
    """Refuse prompts that are empty, or that the builtin model cannot read."""
    _filled(prompts)
    if is_builtin(params.model) and prompts:
        from meshdeform.priors.builtin.vocabulary import BUILTIN_WORDS

        _check_vocabulary(prompts, params, BUILTIN_WORDS)


def _filled(prompts: Sequence[_LocatedPrompt]) -> Sequence[_LocatedPrompt]:
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
                "Send it as the field `silhouette_1`, with its azimuth in params.guidance.silhouettes.",
            )
        if prompt:
            detail = "There is a prompt, and `silhouettes` guidance does not use it."
            advice = "Leave params.guidance.kind out to use both, or leave the prompt out."
            raise ParameterError.at(["params", "guidance"], detail, advice)
    parts = SILHOUETTE_FIELDS[: len(views)]
    for number, name in enumerate(parts):
        if name not in present:
            detail = f"params.guidance.silhouettes has {len(views)} entries, and the field `{name}` is missing."
            raise ParameterError.at(
                ["params", "guidance", "silhouettes", number], detail, f"Send the picture as the field `{name}`."
            )
    for name in sorted(set(present) - set(parts)):
        detail = f"The field `{name}` was sent, and params.guidance.silhouettes has {len(views)} entries."
        advice = "Give each picture an entry with its azimuth, in the order of the parts."
        raise ParameterError.at(["params", "guidance", "silhouettes"], detail, advice)
    for number, view in enumerate(views):
        for other in range(number):
            if _same_direction(view, views[other]):
                detail = f"`{parts[other]}` and `{parts[number]}` have the same azimuth and elevation."
                raise ParameterError.at(
                    ["params", "guidance", "silhouettes", number],
                    detail,
                    "Correct one of the azimuths, or leave one of the pictures out.",
                )


def _same_direction(one: ViewParams, other: ViewParams) -> bool:
    apart = abs((one.azimuth - other.azimuth + 180.0) % 360.0 - 180.0)
    return apart < _SAME_DEG and abs(one.elevation - other.elevation) < _SAME_DEG


def _check_vocabulary(prompts: Sequence[_LocatedPrompt], params: ResolvedParams, known: Words) -> None:
    """Refuse prompts that cannot be read with these words."""
    from meshdeform.vocabulary.grammar import parse_negative

    for path, prompt in prompts:
        _check_known(prompt, known, path if len(prompts) > 1 else None)  # of several, say which
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
    from meshdeform.vocabulary.lookup import WORDS, current_words

    known = current_words() if params.guidance is GuidanceKind.EXEMPLAR else WORDS
    if params.source_noun is not None:
        _check_known(f"a {params.source_noun}", known, ["params", "guidance", "source_noun"])


def _check_known(text: str, known: Words, path: Sequence[str | int] | None) -> None:
    """Refuse a text that cannot be read with these words, at its path in the request."""
    from meshdeform.vocabulary.grammar import parse

    try:
        parse(text, known)
    except (PromptError, VocabularyError) as error:
        raise (error if path is None else error.located(path)) from None


def check_points(params: ResolvedParams, bounds: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """Refuse points of handles and landmarks that are absurdly far from the file in whose world they are.

    `bounds`: the least and the greatest coordinates (2, 3) of the `asset` and the `target`, as far as they are known.
    """
    for file, points in (("asset", _points_on_asset(params)), ("target", _points_on_target(params))):
        if not bounds.get(file):
            continue
        low, high = bounds[file]
        size = max(end - begin for begin, end in zip(low, high, strict=True))
        for name, number, member, point in points:
            away = max(max(a - x, x - b) for a, x, b in zip(low, point, high, strict=True))
            if away > _MAX_REACH * size:
                path = f"{GROUPS[name][0]}.{name}"
                detail = f"params.{path}: the point is {away / size:.1g} times as far from the {file} as that is long."
                advice = f"Give a point within {_MAX_REACH:,} lengths of the {file}."
                raise ParameterError.at(["params", *path.split("."), number, member], detail, advice)


def _points_on_asset(params: ResolvedParams) -> Iterator[_LocatedPoint]:
    for number, handle in enumerate(params.handles):
        if handle.position is not None:
            yield "handles", number, "position", handle.position
        yield "handles", number, "to", handle.to
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.source, int):
            yield "landmarks", number, "source", pair.source


def _points_on_target(params: ResolvedParams) -> Iterator[_LocatedPoint]:
    for number, pair in enumerate(params.landmarks):
        if not isinstance(pair.target, int):
            yield "landmarks", number, "target", pair.target


def _check_contents(request: JobRequest, params: ResolvedParams, files: Mapping[str, AssetSummary]) -> None:
    """Refuse parameters that do not fit the contents of the files."""
    asset = files["asset"]
    # Subdivision numbers anew. Exclusions only make them fewer.
    triangles = None if request.output.subdivide else asset.triangles
    lists = {name: getattr(asset, name) for name in ("nodes", "mesh_names", "materials", "joints")}
    # A list of that length may be incomplete; the run then refuses what selects nothing.
    complete = {name: parts for name, parts in lists.items() if len(parts) < MAX_LISTED}
    if "nodes" in complete:
        find_excluded(params.exclude, asset.nodes)
    check_selections(("control", "rigid"), params.rigid, complete, triangles)
    check_selections(("control", "regions"), params.regions, complete, triangles)
    check_selections(("control", "parts"), params.parts, complete, triangles)
    for number, prompt in enumerate(params.prompts):
        check_selections(("guidance", "prompts", number, "regions"), prompt.regions, complete, triangles)
    check_points(params, {part: file.bounds for part, file in files.items()})
    if not request.output.subdivide:
        for number, handle in enumerate(params.handles):
            check_vertex(("control", "handles", number, "vertex"), handle.vertex, asset.vertices)
    for number, pair in enumerate(params.landmarks):
        for name, vertex, file in (("source", pair.source, "asset"), ("target", pair.target, _TARGET)):
            if isinstance(vertex, int) and file in files and not (name == "source" and request.output.subdivide):
                check_vertex(("guidance", "landmarks", number, name), vertex, files[file].vertices)


def check_vertex(path: Sequence[str | int], vertex: int | None, count: int) -> None:
    """Refuse the number of a vertex that a mesh of `count` vertices does not have, at a path within `params`."""
    if vertex is not None and vertex >= count:
        detail = f"params.{'.'.join(map(str, path))}: the mesh has {count} vertices, and none with the index {vertex}."
        advice = "Indices begin at 0; or give a position [x, y, z]."
        raise ParameterError.at(["params", *path], detail, advice)
