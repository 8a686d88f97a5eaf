"""Decide the kind of guidance of a request that names none, at the door, so that whatever is stored names it.

It is the first kind that fits the files and the prompt, and that has every option that was sent; so whatever only the
optimiser or a diffusion model has means `sds`. Torch-free.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TypeVar

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import BUILTIN_MODEL, GuidanceKind
from meshdeform.requests.document import DeformParams, JobRequest
from meshdeform.requests.groups import GROUPS
from meshdeform.requests.parameters import (
    GUIDANCES,
    OF_OPTIMISER,
    SILHOUETTE_FIELDS,
    TARGET_FIELDS,
    OpenGuidanceParams,
)

__all__ = ["kind_like", "with_kind"]

R = TypeVar("R", bound=JobRequest)

_OF_STEPS = OF_OPTIMISER | {"preset"}
"""Parameters outside of the groups that `exemplar` guidance has no use for."""


def with_kind(request: R, default_model: str, files: Collection[str]) -> R:
    """Return a request that names its kind of guidance; one that does so already, and other kinds of job, as they are.

    `default_model`: the setting MESHDEFORM_MODEL; `files`: the names of the files of the job. Raises ParameterError: no
    kind has all options that were sent.
    """
    return _named(request, _kinds(request, default_model, files)) if _is_open(request) else request


def kind_like(job: JobRequest, branch: R) -> R:
    """Return a branch's request that names its kind: that of its job if it has all options that were sent, else `sds`.

    A prompt needs a kind that has one, which a target or pictures are not.
    """
    if not _is_open(branch):
        return branch
    prompted = branch.prompt or branch.params.prompts
    without = prompted and job.params.kind in (GuidanceKind.TARGET, GuidanceKind.SILHOUETTES)
    return _named(branch, [*([] if without else [job.params.kind]), GuidanceKind.SDS])


def _kinds(request: JobRequest, default_model: str, files: Collection[str]) -> list[GuidanceKind]:
    """Return the kinds that fit a prompt and files, the preferred one first."""
    targets = [name for name in TARGET_FIELDS if name in files]
    if targets:
        return [*([GuidanceKind.TARGET] if targets == [TARGET_FIELDS[0]] else []), GuidanceKind.EXEMPLAR]
    prompted = request.prompt or request.params.prompts
    if not prompted and not set(SILHOUETTE_FIELDS).isdisjoint(files):
        return [GuidanceKind.SILHOUETTES]
    shapes_first = [GuidanceKind.EXEMPLAR, GuidanceKind.SDS]
    return shapes_first if default_model == BUILTIN_MODEL else shapes_first[::-1]


def _is_open(request: JobRequest) -> bool:
    return isinstance(request.params, DeformParams) and isinstance(request.params.guidance, OpenGuidanceParams)


def _named(request: R, kinds: Sequence[GuidanceKind]) -> R:
    """Return the request with the first of these kinds that has all options that were sent, else with the last one."""
    params = request.params
    kind = next((kind for kind in kinds if _has_all(kind, params)), kinds[-1])
    for name in sorted(params.guidance.model_fields_set - GUIDANCES[kind].model_fields.keys()):
        raise ParameterError.at(
            ["params", "guidance", name],
            f"No kind of guidance for this job has all options that were sent: `{kind}` has no {name}.",
            f"Leave it out, or set params.guidance.kind; {' and '.join(GROUPS[name][1])} have it.",
        )
    written = {name: getattr(params.guidance, name) for name in params.guidance.model_fields_set}
    guidance = GUIDANCES[kind].model_validate({"kind": kind.value, **written})
    return request.model_copy(update={"params": params.model_copy(update={"guidance": guidance})})


def _has_all(kind: GuidanceKind, params: DeformParams) -> bool:
    """Return whether a kind has all options that were written."""
    steered = not _OF_STEPS.isdisjoint(params.model_fields_set)
    return params.guidance.model_fields_set <= GUIDANCES[kind].model_fields.keys() and not (
        steered and kind is GuidanceKind.EXEMPLAR
    )
