"""Name the members of requests that were removed or are in a group now, and what to do instead. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.parameters import GUIDANCES, CommonParams, Control

_CONSTANT = "The preset sets it."
_CONSTANTS = (
    "elevation_max_deg", "elevation_min_deg", "fov_max_deg", "fov_min_deg", "framing", "framing_max",
    "guidance_rescale", "guidance_weight", "stiffness", "timestep_max", "timestep_max_end",
)  # fmt: skip
_NO_GAIN = "It brought no gain when measured."
_MEASURED = (
    "annealing", "candidate_steps", "candidates", "coarse_until", "distillation", "ism_interval", "ism_stride",
    "learning_rate_end", "negative", "negative_weight", "noise_draws", "optimizer", "parametrization",
    "regularizer_scale_end", "resolution_start", "rigidity", "smoothing_start", "stop_when_settled",
    "timestep_min_end", "view_prompts", "views",
)  # fmt: skip

REMOVED: Mapping[str, str] = {
    **{f"params.{name}": _NO_GAIN for name in _MEASURED},
    **{f"params.{name}": _CONSTANT for name in _CONSTANTS},
    "params.attachment_weight": "Use params.carrier.",
    "params.encoder": "Leave it out: a model encodes with its own autoencoder.",
    "params.length": "Scale the result along its axes, or keep regions (docs/control.md#keep-and-only).",
    "params.sketch": "Make a mesh of the drawing (docs/sketch.md), and send it as the part `target`.",
    "params.stages": "Branch a job for each further goal (docs/cli.md#meshdeform-branch).",
    "params.target": "Send the mesh that the model made as the part `target` (docs/control.md#fit-a-mesh).",
    "params.translation_rate": "Use params.carrier.",
    "output.usd": "Convert result.glb (docs/recipes.md#to-usdz).",
}
"""What replaces each removed member, by its place in the request. No later member may have one of these names: any
other unknown member is of a later version."""


PLACES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    **dict.fromkeys(CommonParams.model_fields, ("", ())),
    **dict.fromkeys(Control.model_fields, ("control", ())),
    **{
        name: ("guidance", tuple(kind for kind, other in GUIDANCES.items() if name in other.model_fields))
        for group in GUIDANCES.values()
        for name in group.model_fields
        if name != "kind"
    },
}
"""The group of each parameter, empty for those that are in none, and for `guidance` the kinds that have it."""


def plain_place(place: Sequence[Any]) -> list[Any]:
    """Return a place in a request without the kind of guidance, which pydantic adds to the path of a union's member."""
    tagged = list(place[:2]) == ["params", "guidance"] and place[2:3] and place[2] in list(GuidanceKind)
    return [*place[:2], *place[3:]] if tagged else list(place)


def instead(place: Sequence[Any]) -> str | None:
    """Return a sentence about a member that is elsewhere now, or was removed; None if there was none at this place."""
    path = plain_place(place)
    if path[:1] != ["params"] and path[:1] != ["output"]:
        return None
    name = str(path[-1])
    if (removed := REMOVED.get(f"{path[0]}.{name}")) is not None:
        return f"it was removed. {removed}"
    if path[0] != "params" or len(path) > 3 or name not in PLACES:
        return None
    group, kinds = PLACES[name]
    said = f"it is params.{group}.{name}" if group else f"it is params.{name}"
    return f"{said}, where the guidance is {' or '.join(kinds)}." if group == "guidance" else f"{said}."


def grouped(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with each in its group; what is in one already stays there.

    Parameters
    ----------
    params : mapping
        Parameters by their names alone, and `guidance` by its kind, as requests of earlier editions had them and as the
        command line takes them. Unknown names stay where they are.
    """
    kind = params.get("guidance")
    groups: dict[str, dict[str, Any]] = {"guidance": {}, "control": dict(params.get("control") or {})}
    if kind is not None:
        groups["guidance"] = dict(kind) if isinstance(kind, Mapping) else {"kind": kind}
    rest: dict[str, Any] = {}
    for name, value in params.items():
        if name not in groups:
            group = PLACES.get(name, ("", ()))[0]
            (groups[group] if group else rest)[name] = value
    return {**rest, **{name: group for name, group in groups.items() if group}}


def without_removed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a stored request without what was removed since, in `params` and in `output`."""

    def is_kept(place: str, value: Any) -> bool:
        # Once a matrix of 16 numbers.
        return place not in REMOVED and not (place == "params.align" and isinstance(value, list))

    return {
        name: {inner: each for inner, each in value.items() if is_kept(f"{name}.{inner}", each)}
        if isinstance(value, Mapping)
        else value
        for name, value in document.items()
    }


def translated(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a stored request of an earlier edition in the form of this one.

    What was removed, and what its kind of guidance never used, is left out.
    """
    document = without_removed(document)
    params = document.get("params")
    if document.get("kind", "text_deform") != "text_deform" or not isinstance(params, Mapping):
        return document
    return {**document, "params": without_unused(grouped(params))}


def without_unused(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return grouped parameters without those that only another kind of guidance has."""
    guidance = params.get("guidance")
    used = GUIDANCES.get(guidance.get("kind", GuidanceKind.SDS)) if isinstance(guidance, Mapping) else None
    if used is None or not isinstance(guidance, Mapping):
        return dict(params)
    # What is unknown altogether is of a later edition, and not to be dropped.
    own = {name: value for name, value in guidance.items() if name in used.model_fields or name not in PLACES}
    return {**params, "guidance": own}
