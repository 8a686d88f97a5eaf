"""The kinds of job, by name. Torch-free: what runs a kind is imported when a worker first needs it.

A new kind is a module like `text_deform_kind.py`, a name in `JobKind`, and a line at the end of this one. The check at
the door, the parts that a form may have, the worker's start and the lists in the documentation follow from its
description.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from meshdeform.errors import ParameterError
from meshdeform.requests.document import JobKind, JobRequest, use_params
from meshdeform.runs.base import JobRun, Kind, RunInput
from meshdeform.runs.text_deform_kind import TEXT_DEFORM

if TYPE_CHECKING:
    from pydantic import BaseModel

    from meshdeform.settings import Settings

__all__ = ["check_request", "file_parts", "kind_of", "kinds", "register", "start_run"]

_registered: dict[JobKind, Kind] = {}


def _built_in() -> list[Kind]:
    from meshdeform.runs.text_deform_kind import TEXT_DEFORM

    return [TEXT_DEFORM]


def register(kind: Kind) -> None:
    """Make a kind known, in place of one of the same name."""
    kinds()  # the built-in ones come first, whoever is registered before anybody asks for them
    _registered[kind.name] = kind
    use_params(kind.name, kind.params)


def kinds() -> list[Kind]:
    """Return every kind, in the order in which they were registered."""
    if not _registered:
        _registered.update({kind.name: kind for kind in _built_in()})
    return list(_registered.values())


def kind_of(name: JobKind) -> Kind:
    """Return the description of a kind.

    Raises
    ------
    ParameterError
        None is registered under this name.
    """
    kinds()
    if name not in _registered:
        raise ParameterError(f"There is no kind of job {str(name)!r}.", advice=f"There are: {', '.join(_registered)}.")
    return _registered[name]


def file_parts() -> tuple[str, ...]:
    """Return the names of the files that any kind reads, each once."""
    return tuple(dict.fromkeys(part.name for kind in kinds() for part in kind.reads))


def check_request(request: JobRequest, settings: Settings, *, files: Collection[str]) -> BaseModel:
    """Refuse a request that no worker of this deployment could run; return what its parameters come to.

    Parameters
    ----------
    request : JobRequest
    settings : Settings
        Names the models of this deployment.
    files : collection of str
        The names of the files that come with it, or that it names.

    Raises
    ------
    RequestError
        One of its subclasses says what to change.
    ModelError
        The model is not one of this deployment's, or not on this machine.
    """
    kind = kind_of(request.kind)
    for part in kind.reads:
        if part.required and part.name not in files:
            raise _refused(
                part.name, f"`{part.name}` is missing.", f"Send it as the part `{part.name}`: {part.summary}"
            )
    for name in sorted(set(files) - {part.name for part in kind.reads}):
        reads = ", ".join(part.name for part in kind.reads) or "no file"
        raise _refused(name, f"The kind `{kind.name}` does not read `{name}`.", f"It reads: {reads}.")
    return kind.check(request, settings, frozenset(files))


def start_run(given: RunInput) -> JobRun:
    """Start the run of a job, of whichever kind it is.

    Raises
    ------
    MeshdeformError
        What is wrong with the request, its files or this machine.
    """
    return kind_of(given.request.kind).load()(given)


def _refused(name: str, detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, errors=[{"loc": [name], "msg": detail, "type": "value_error"}])


register(TEXT_DEFORM)
