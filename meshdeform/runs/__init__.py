"""The kinds of job by name. Torch-free: the code that runs a kind is imported when a worker first needs it.

To add a kind, write a module like `text_deform_kind.py`, add a name to `JobKind`, its parameters to
`requests.document.PARAMS_OF_KIND`, and itself to this module. The check of requests, the parts of a form, the start in
the worker and the lists in the documentation follow from its description.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from meshdeform.errors import KindRetiredError, ParameterError
from meshdeform.requests.choices import RETIRED_PARTS, is_retired
from meshdeform.requests.document import JobKind, JobRequest, OutputOptions
from meshdeform.runs.base import JobRun, Kind, RunInput
from meshdeform.runs.family_fit_kind import FAMILY_FIT
from meshdeform.runs.family_synthesize_kind import FAMILY_SYNTHESIZE
from meshdeform.runs.surface_fit_kind import SURFACE_FIT
from meshdeform.runs.text_deform_kind import TEXT_DEFORM

if TYPE_CHECKING:
    from pydantic import BaseModel

    from meshdeform.settings import Settings

__all__ = ["check_request", "file_parts", "kind_of", "kinds", "start_run"]

_KINDS = {kind.name: kind for kind in (TEXT_DEFORM, SURFACE_FIT, FAMILY_FIT, FAMILY_SYNTHESIZE)}


def kinds() -> list[Kind]:
    """Return all kinds; where their order matters, the deformation comes first."""
    return list(_KINDS.values())


def kind_of(name: JobKind) -> Kind:
    """Return the description of a kind; `ParameterError`: only another version has it."""
    if name not in _KINDS:
        raise ParameterError(f"There is no kind of job {str(name)!r}.", advice=f"Use one of: {', '.join(_KINDS)}.")
    return _KINDS[name]


def file_parts() -> tuple[str, ...]:
    """Return the names of the files read by any kind, without duplicates."""
    return tuple(dict.fromkeys(name for kind in kinds() for name in kind.parts))


def check_request(request: JobRequest, settings: Settings, *, files: Collection[str]) -> BaseModel:
    """Refuse a request that no worker of this deployment could run; return the values of all its parameters.

    `settings`: lists the models of this deployment; `files`: the names of the files sent with the request or named by
    it.
    """
    _refuse_retired(request, files)
    kind = kind_of(request.kind)
    for part in kind.reads:
        if part.required and part.name not in files:
            raise ParameterError.at(
                [part.name], f"`{part.name}` is missing.", f"Send it as the part `{part.name}`: {part.summary}"
            )
    for name in sorted(set(files) - set(kind.parts)):
        reads = ", ".join(kind.parts) or "no file"
        raise ParameterError.at([name], f"The kind `{kind.name}` does not read `{name}`.", f"It reads: {reads}.")
    if request.output != OutputOptions() and not kind.takes_output:
        raise ParameterError.at(["output"], "`output` is for jobs that deform one asset.", "Leave it out.")
    return kind.check(request, settings, frozenset(files))


def _refuse_retired(request: JobRequest, files: Collection[str]) -> None:
    """Refuse a job with taught weights, sent or taken from another job."""
    if not RETIRED_PARTS.isdisjoint(files) or is_retired(getattr(request.params, "model", None) or ""):
        raise KindRetiredError("Weights whose words were taught are no longer used.")


def start_run(job_input: RunInput) -> JobRun:
    """Start the run of a job of any kind; of one that was accepted with taught weights, KindRetiredError."""
    _refuse_retired(job_input.request, job_input.files)
    return kind_of(job_input.request.kind).load()(job_input)
