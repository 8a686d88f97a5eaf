"""Describe the kind `family_synthesize`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from meshdeform.errors import ParameterError
from meshdeform.kinds.families.params import FamilySynthesisParams, SynthesisMode
from meshdeform.requests.choices import JobKind
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import FORMATS_OF_RESULT, ArtifactKind, FileField, JobFile, Kind, params_of, start_of

if TYPE_CHECKING:
    from meshdeform.settings import Settings

_MEMBERS = {
    SynthesisMode.SAMPLE: 0,
    SynthesisMode.INTERPOLATE: 2,
    SynthesisMode.COMPLETE: 1,
    SynthesisMode.SEARCH: 1,
}


def _check(request: JobRequest, _settings: Settings, _files: Mapping[str, JobFile]) -> FamilySynthesisParams:
    params = params_of(request, FamilySynthesisParams)
    wanted = _MEMBERS[params.mode]
    if len(params.members) != wanted:
        many = {0: "no member", 1: "one member", 2: "two members"}[wanted]
        raise ParameterError.at(
            ["params", "members"],
            f"The mode {params.mode} takes {many}, not {len(params.members)}.",
            "Change params.members.",
        )
    if len(set(params.members)) < len(params.members):
        raise ParameterError.at(["params", "members"], "The two members are the same.", "Name two different members.")
    if params.mode is SynthesisMode.COMPLETE and not params.keep:
        raise ParameterError.at(
            ["params", "keep"], "The mode complete needs the parts to keep.", "Name them in params.keep."
        )
    if params.mode is not SynthesisMode.COMPLETE and params.keep:
        raise ParameterError.at(
            ["params", "keep"], "params.keep is for the mode complete.", "Leave it out, or choose that mode."
        )
    if params.mode is SynthesisMode.INTERPOLATE and params.count < 2:
        raise ParameterError.at(
            ["params", "count"], "An interpolation has at least two shapes.", "Take a count of at least 2."
        )
    return params


def total_steps(params: FamilySynthesisParams) -> int:
    """Return the number of steps of a run."""
    return 1 if params.mode is SynthesisMode.SEARCH else params.count


FAMILY_SYNTHESIZE = Kind(
    name=JobKind("family_synthesize"),
    summary="Makes new assets of a fitted family out of parts of its members.",
    reads=(
        FileField(
            "family",
            "The `family.safetensors` of a `family_fit` job.",
            required=True,
            media_types=("application/octet-stream",),
            content="family",
        ),
        FileField(
            "collection",
            "The collection of that job, or its `labelled.zip`.",
            required=True,
            media_types=("application/zip",),
            content="collection",
        ),
    ),
    params=FamilySynthesisParams,
    check=_check,
    steps=lambda request, _model, _kept: total_steps(params_of(request, FamilySynthesisParams)),
    load=start_of("meshdeform.kinds.families.synthesis_run"),
    artifacts=(
        ArtifactKind("result.glb", "model/gltf-binary", "The first shape, if shapes are made."),
        ArtifactKind("shapes.zip", "application/zip", "All shapes as GLB, if shapes are made."),
        ArtifactKind(
            "report.json",
            "application/json",
            "For each shape the member of each part, gaps, free energy, plausibility and the nearest members.",
        ),
        ArtifactKind("preview.png", "image/png", "All shapes; for `search`, the member and those nearest to it."),
        ArtifactKind(
            "wall.glb",
            "model/gltf-binary",
            "The same side by side with few triangles, coloured by part, with their corresponding points.",
        ),
        *FORMATS_OF_RESULT,
        ArtifactKind("points.npz", "application/x-npz", "The points of the shapes, and which of them exist."),
    ),
    goal=lambda _request, _files: "family",
)
