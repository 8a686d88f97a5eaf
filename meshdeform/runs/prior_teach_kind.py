"""Describe the kind `prior_teach`: its files, the check of its requests, and its artifacts. Torch-free.

The folders of a packed lesson name attributes of the meshes in them; those of a kit name nouns.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from meshdeform.assets import Limits
from meshdeform.assets.lesson_archive import MAX_MESHES, open_lesson
from meshdeform.errors import ModelError, ParameterError
from meshdeform.priors import configured_name, hidden_folders, public_names
from meshdeform.priors.builtin.grammar import Attribute, Words
from meshdeform.priors.builtin.taught import known_words
from meshdeform.priors.builtin.teaching.lesson import (
    NewNoun,
    attributes_of_folder,
    new_noun,
    new_nouns,
    nouns_of_kit,
)
from meshdeform.requests.choices import WEIGHTS_PART, JobKind, is_sent, is_taught
from meshdeform.requests.document import BUILTIN_MODEL, JobRequest
from meshdeform.requests.teaching import TeachParams
from meshdeform.runs.base import (
    TAUGHT_WEIGHTS,
    WEIGHTS_ARTIFACT,
    WEIGHTS_FILE,
    ArtifactKind,
    FilePart,
    Kind,
    check_weights_part,
    params_of,
    start_of,
)

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary
    from meshdeform.settings import Settings

MESHES_PART = "meshes"


def lesson_of(params: TeachParams, known: Words, names: Sequence[str]) -> dict[str, MeshLabel]:
    """Return the label of each mesh, by its name in the ZIP.

    `known`: those of the weights to start from. `names`: of the meshes; none if they are not known yet.
    """
    try:
        if params.noun is None:
            return _kit(params, known, names)
        new = new_noun(params.noun, known, synonyms=params.synonyms, replace_known=params.replace)
    except ParameterError as error:
        advice = error.advice_text.replace("--replace", "params.replace")
        place = ["params", "noun"] if params.noun else ["parts", MESHES_PART]
        raise ParameterError.at(place, error.detail, advice) from error
    return {name: MeshLabel(params.noun, attributes) for name, attributes in labelled(names, new).items()}


def _kit(params: TeachParams, known: Words, names: Sequence[str]) -> dict[str, MeshLabel]:
    """Return the label of each mesh of a kit."""
    if params.synonyms:
        raise ParameterError("A kit has no synonyms.", advice="Leave params.synonyms out, or name one noun.")
    kit = nouns_of_kit(names)
    nouns = list(dict.fromkeys(noun for noun, _ in kit.values()))
    new = dict(zip(nouns, new_nouns(dict.fromkeys(nouns, ()), known, replace_known=params.replace), strict=True))
    return {
        name: MeshLabel(noun, attributes_of_folder(label, new[noun]) if label else ())
        for name, (noun, label) in kit.items()
    }


def _check(request: JobRequest, settings: Settings, files: frozenset[str]) -> TeachParams:
    params = params_of(request, TeachParams)
    if request.prompt:
        raise ParameterError.at(["prompt"], "A lesson has no prompt.", "Leave it out; params.noun is the word.")
    check_weights_part(params.model, files)
    if is_sent(params.model):
        return params
    offered = settings.offered_models
    model = configured_name(params.model, offered)
    if model != BUILTIN_MODEL and not is_taught(model):
        raise ParameterError.at(
            ["params", "model"], f"{params.model!r} cannot be taught.", "Start from `builtin`, or from taught weights."
        )
    if model not in offered:
        known = [name for model, name in public_names(offered).items() if model == BUILTIN_MODEL or is_taught(model)]
        raise ModelError(
            f"This server has no taught weights {params.model!r}.",
            advice=f"Use one of: {', '.join(known)}.",
            models=known,
        )
    with hidden_folders(offered):
        lesson_of(params, known_words(model), ())
    return params.model_copy(update={"model": model})


def _check_files(_request: JobRequest, params: TeachParams, files: Mapping[str, AssetSummary]) -> None:
    if not is_sent(params.model):
        _check_names(params, known_words(params.model), files)


def _check_words(request: JobRequest, known: Words, files: Mapping[str, AssetSummary]) -> None:
    _check_names(params_of(request, TeachParams), known, files)


def _check_names(params: TeachParams, known: Words, files: Mapping[str, AssetSummary]) -> None:
    """Refuse nouns that cannot be taught, and folders that do not name attributes."""
    summary = files.get(MESHES_PART)
    lesson_of(params, known, [str(mesh["name"]) for mesh in summary.mesh_names] if summary else ())


def _uses(request: JobRequest) -> Collection[str]:
    return [MESHES_PART, *([WEIGHTS_PART] if is_sent(params_of(request, TeachParams).model) else [])]


PRIOR_TEACH = Kind(
    name=JobKind.PRIOR_TEACH,
    summary="Teaches the builtin model nouns from meshes, so that prompts of the same owner may name them.",
    reads=(
        FilePart(
            MESHES_PART,
            "Meshes of the noun: one GLB, OBJ, PLY or STL, or a ZIP of at most 200; folders in it name attributes, "
            "and in a kit nouns.",
            required=True,
            media_types=("application/zip", "model/gltf-binary", "model/obj", "model/ply", "model/stl"),
            content="lesson",
        ),
        WEIGHTS_FILE,
    ),
    params=TeachParams,
    check=_check,
    steps=lambda request, _model, _kept: params_of(request, TeachParams).steps,
    load=start_of("meshdeform.runs.prior_teach"),
    artifacts=(
        ArtifactKind(
            WEIGHTS_ARTIFACT,
            TAUGHT_WEIGHTS,
            "The taught weights: `params.guidance.model` = `job:ID` in later jobs of the owner, with this job's id.",
        ),
        ArtifactKind(
            "report.json",
            "application/json",
            "Measures of the lesson: held-out losses, and which noun held-out pictures are taken for.",
        ),
        ArtifactKind("preview.png", "image/png", "Pictures that the model now draws for the nouns, from four sides."),
    ),
    uses=_uses,
    check_files=_check_files,
    check_words=_check_words,
    goal=lambda request, _files: params_of(request, TeachParams).noun or "a kit",
)


@dataclass(frozen=True)
class MeshLabel:
    """Label of a mesh."""

    noun: str
    attributes: tuple[Attribute, ...] = ()


@dataclass(frozen=True)
class MeshFile:
    """A file to learn from."""

    name: str
    data: bytes
    label: MeshLabel


def check_count(count: int) -> None:
    """Refuse a lesson without meshes or with too many."""
    if not count:
        raise ParameterError("There is no mesh to learn from.", advice="Give at least one GLB, OBJ, PLY, STL or ZIP.")
    if count > MAX_MESHES:
        raise ParameterError(
            f"There are more than {MAX_MESHES} meshes, and a lesson takes at most {MAX_MESHES}.",
            advice="Choose those that show the variety: ten good ones are enough for most things.",
        )


def packed_meshes(data: bytes, filename: str, params: TeachParams, known: Words, limits: Limits) -> list[MeshFile]:
    """Unpack the meshes of a lesson: one file, or a ZIP with folders; see `lesson_of`."""
    files = open_lesson(data, filename, limits)
    labels = lesson_of(params, known, list(files))
    return [MeshFile(name, content, labels[name]) for name, content in files.items()]


def labelled(names: Sequence[str], new: NewNoun) -> dict[str, tuple[Attribute, ...]]:
    """Return the attributes of meshes in a ZIP by name, from the names of their folders.

    A folder that holds everything is usually the one that was packed: unless it names attributes, its name is left out.
    """
    folders = {name: name.split("/")[:-1] for name in names}
    first = {tuple(folder[:1]) for folder in folders.values()}
    if len(first) == 1 and (outer := first.pop()) and not _is_label(outer[0], new):
        folders = {name: folder[1:] for name, folder in folders.items()}
    return {name: attributes_of_folder(" ".join(folder), new) if folder else () for name, folder in folders.items()}


def _is_label(folder: str, new: NewNoun) -> bool:
    try:
        attributes_of_folder(folder, new)
    except ParameterError:
        return False
    return True
