"""Name the members of requests that were removed, and what to do instead. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["REMOVED", "instead", "without_removed"]

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


def instead(place: Sequence[Any]) -> str | None:
    """Return a sentence about a member that earlier versions had; None if there was none at this place."""
    found = REMOVED.get(".".join(map(str, place)))
    return None if found is None else f"it was removed. {found}"


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
