"""Describe the kind `family_fit`: its file, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from meshdeform.errors import ParameterError
from meshdeform.kinds.families.params import FamilyParams
from meshdeform.requests.choices import JobKind
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import ArtifactKind, FileField, JobFile, Kind, params_of, start_of
from meshdeform.vocabulary.lookup import noun_of

if TYPE_CHECKING:
    from meshdeform.settings import Settings

READ_STEPS = 10
"""The assets are read in so many steps."""
_NPZ = "application/x-npz"


def _check(request: JobRequest, _settings: Settings, _files: Mapping[str, JobFile]) -> FamilyParams:
    params = params_of(request, FamilyParams)
    if params.samples < params.points:
        detail = f"params.samples is {params.samples}, less than params.points: {params.points}."
        advice = "Take at least as many samples as template points; twice as many is usual."
        raise ParameterError.at(["params", "samples"], detail, advice)
    if params.noun is not None and noun_of(params.noun) is None:
        detail = f"params.noun is {params.noun[:80]!r}, which is no noun of the builtin prior."
        raise ParameterError.at(["params", "noun"], detail, "Leave it out, or name one of GET /v1/models.")
    return params


def total_steps(params: FamilyParams) -> int:
    """Return the number of steps of a run."""
    return READ_STEPS + params.iterations + params.epochs


FAMILY_FIT = Kind(
    name=JobKind("family_fit"),
    summary="Finds the parts and the correspondences of a collection of assets of one family, and learns its shapes.",
    reads=(
        FileField(
            "collection",
            "A ZIP of 10 to 3,000 assets (GLB, OBJ, PLY, STL), and `labels.json`, if some are labelled.",
            required=True,
            media_types=("application/zip",),
            content="collection",
        ),
    ),
    params=FamilyParams,
    check=_check,
    steps=lambda request, _model, _kept: total_steps(params_of(request, FamilyParams)),
    load=start_of("meshdeform.kinds.families.fit_run"),
    artifacts=(
        ArtifactKind(
            "report.json",
            "application/json",
            "Parameters, what each asset is made of and how likely it is, and accuracies where labels are held out.",
        ),
        ArtifactKind("preview.png", "image/png", "The collection, coloured by part."),
        ArtifactKind(
            "wall.glb",
            "model/gltf-binary",
            "Up to 120 assets side by side with few triangles, coloured by part, with their corresponding points.",
        ),
        ArtifactKind("segmentation.npz", _NPZ, "The part of each triangle of each asset."),
        ArtifactKind(
            "correspondences.npz", _NPZ, "Where each template point lies on each asset, and how sure that is."
        ),
        ArtifactKind("descriptors.npz", _NPZ, "Descriptors of the assets."),
        ArtifactKind(
            "family.safetensors",
            "application/octet-stream",
            "All that `family_synthesize` reads: template, Beta shape machine, places and parts of the assets.",
        ),
        ArtifactKind(
            "labelled.zip",
            "application/zip",
            "The assets with the vertex attribute `_PART`, if `params.embed_labels` is set.",
        ),
    ),
    goal=lambda _request, _files: "family",
)
