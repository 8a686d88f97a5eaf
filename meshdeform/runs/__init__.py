"""The kinds of job by name. Torch-free: the code that runs a kind is imported when a worker first needs it.

To add a kind, add a folder to `meshdeform/kinds`, whose docstring says what belongs in it. The check of requests, the
fields of a form, the start in the worker and the lists in the documentation follow from its description.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from typing import TYPE_CHECKING

from meshdeform.errors import KindRetiredError, ParameterError
from meshdeform.requests.choices import RETIRED_FIELDS, is_retired
from meshdeform.requests.document import JobRequest, OutputParams
from meshdeform.requests.kind_folders import kind_modules
from meshdeform.runs.base import JobFile, JobRun, Kind, RunInput
from meshdeform.runs.text_deform_kind import TEXT_DEFORM

if TYPE_CHECKING:
    from pydantic import BaseModel

    from meshdeform.settings import Settings

__all__ = ["check_request", "file_fields", "kind_of", "kinds", "start_run"]


@cache
def _kinds() -> dict[str, Kind]:
    further = [kind for module in kind_modules("description") for kind in module.KINDS]
    return {kind.name: kind for kind in (TEXT_DEFORM, *further)}


def kinds() -> list[Kind]:
    """Return all kinds; where their order matters, the deformation comes first."""
    return list(_kinds().values())


def kind_of(name: str) -> Kind:
    """Return the description of a kind; `ParameterError`: only another version has it."""
    if name not in _kinds():
        raise ParameterError(f"There is no kind of job {str(name)!r}.", advice=f"Use one of: {', '.join(_kinds())}.")
    return _kinds()[name]


def file_fields() -> tuple[str, ...]:
    """Return the names of the files read by any kind, without duplicates."""
    return tuple(dict.fromkeys(name for kind in kinds() for name in kind.fields))


def check_request(
    request: JobRequest, settings: Settings, *, files: Collection[str], known: Mapping[str, JobFile] | None = None
) -> BaseModel:
    """Refuse a request that no worker of this deployment could run; return the values of all its parameters.

    `settings`: lists the models of this deployment; `files`: the names of the files sent with the request or named by
    it; `known`: what is known of some of them.
    """
    _refuse_retired(request, files)
    kind = kind_of(request.kind)
    for field in kind.reads:
        if field.required and field.name not in files:
            raise ParameterError.at(
                [field.name], f"`{field.name}` is missing.", f"Send it as the field `{field.name}`: {field.summary}"
            )
    for name in sorted(set(files) - set(kind.fields)):
        reads = ", ".join(kind.fields) or "no file"
        raise ParameterError.at([name], f"The kind `{kind.name}` does not read `{name}`.", f"It reads: {reads}.")
    if request.output != OutputParams() and not kind.takes_output:
        raise ParameterError.at(["output"], "`output` is for jobs that deform one asset.", "Leave it out.")
    return kind.check(request, settings, dict.fromkeys(files, JobFile()) | dict(known or {}))


def _refuse_retired(request: JobRequest, files: Collection[str]) -> None:
    """Refuse a job with taught weights, sent or taken from another job."""
    if not RETIRED_FIELDS.isdisjoint(files) or is_retired(getattr(request.params, "model", None) or ""):
        raise KindRetiredError("Weights whose words were taught are no longer used.")


def start_run(job_input: RunInput) -> JobRun:
    """Start the run of a job of any kind; of one that was accepted with taught weights, KindRetiredError."""
    _refuse_retired(job_input.request, job_input.files)
    return kind_of(job_input.request.kind).load()(job_input)
