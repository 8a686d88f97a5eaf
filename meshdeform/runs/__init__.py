"""Kinds of job. Each has a torch-free check at the door and a run in the worker."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from meshdeform.errors import ParameterError
from meshdeform.requests.document import JobKind, JobRequest, ResolvedParams

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["check_request"]


def check_request(request: JobRequest, settings: Settings, *, has_target: bool) -> ResolvedParams:
    """Refuse a request that no worker of this deployment could run; return what its parameters come to. Torch-free.

    Parameters
    ----------
    request : JobRequest
    settings : Settings
        Names the models of this deployment.
    has_target : bool
        Whether a second mesh was sent.

    Raises
    ------
    RequestError
        One of its subclasses says what to change.
    ModelError
        The model is not one of this deployment's, or not on this machine.
    """
    if request.output.usd and not settings.writes_usd:
        detail = "The request asks for result.usdz, and this deployment does not write USDZ."
        raise ParameterError(
            detail,
            advice="Leave output.usd out. Whoever runs the service can install the extra `usd` and set MESHDEFORM_USD.",
            errors=[{"loc": ["output", "usd"], "msg": detail, "type": "value_error"}],
        )
    return _CHECKS[request.kind](request, settings, has_target)


def _check_text_deform(request: JobRequest, settings: Settings, has_target: bool) -> ResolvedParams:
    from meshdeform.runs import text_deform_check

    return text_deform_check.check(
        request,
        default_model=settings.model,
        allowed_models=settings.allowed_models,
        revision=settings.model_revision,
        has_target=has_target,
    )


_CHECKS: Mapping[JobKind, Callable[[JobRequest, Settings, bool], ResolvedParams]] = {
    JobKind.TEXT_DEFORM: _check_text_deform
}
