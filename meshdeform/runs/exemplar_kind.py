"""Say what `exemplar` guidance takes of a request, and of how many steps its run consists. Torch-free, numpy-free.

Nothing is optimised: whatever belongs to the optimiser or to a diffusion model is refused by its name. A target takes
the place of the prompt.
"""

from __future__ import annotations

from collections.abc import Collection

from meshdeform.errors import ParameterError
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import OF_OPTIMISER, TARGET_FIELDS, active_prompts

__all__ = ["STEPS", "check_exemplar", "steps_of"]

STEPS = 20
"""Steps of the run of one prompt, over which the stages of the fit are spread by their share of the time."""

_OF_TARGETS = ("align", "landmarks")


def steps_of(request: JobRequest, params: ResolvedParams) -> int:
    """Return the steps of a run: those of each prompt, or of the target."""
    return STEPS * max(1, len(active_prompts(request.prompt, params.prompts)))


def check_exemplar(request: JobRequest, params: ResolvedParams, targets: Collection[str]) -> None:
    """Refuse what belongs to other guidance, a target beside a prompt, and options of a target where there is none.

    `targets`: the names of the parts with target meshes.
    """
    for name in sorted(OF_OPTIMISER & request.params.model_fields_set):
        raise ParameterError.at(
            ["params", name],
            f"params.{name} is a setting of the optimiser, and `exemplar` guidance does without one.",
            f"Leave {name} out, or the kind, or set params.guidance.kind to sds.",
        )
    if not targets:
        _refuse_options_of_targets(request)
    elif request.prompt or params.prompts:
        detail = "A target was sent, and there is a prompt: either says what the asset is fitted to."
        raise ParameterError.at(["prompt"], detail, "Leave one of the two out.")
    elif params.silhouettes:
        detail = "Pictures cannot guide beside a target, which has all its silhouettes."
        raise ParameterError.at(["params", "guidance", "silhouettes"], detail, "Leave one of the two out.")
    if len(targets) > 1 and params.landmarks:
        detail = "Landmarks are places on one target, and several were sent."
        raise ParameterError.at(["params", "guidance", "landmarks"], detail, "Send one target, or no landmarks.")
    if targets and TARGET_FIELDS[0] not in targets:
        detail = f"`{min(targets)}` was sent, and `{TARGET_FIELDS[0]}` was not."
        raise ParameterError.at([min(targets)], detail, f"Send the first target as `{TARGET_FIELDS[0]}`.")


def _refuse_options_of_targets(request: JobRequest) -> None:
    for name in _OF_TARGETS:
        if name in request.params.guidance.model_fields_set:
            raise ParameterError.at(
                ["params", "guidance", name],
                f"params.guidance.{name} is about a target, and none was sent.",
                f"Send a mesh as the field `{TARGET_FIELDS[0]}`, or leave {name} out.",
            )
