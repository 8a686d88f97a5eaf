"""Print errors as one line and its advice; map their kinds to exit codes.

===  =========================================================================================
0    done
1    an internal error: a bug, with its traceback
2    wrong usage: an unknown option, a file that does not exist
3    bad input: the asset, the prompt, a parameter or an id is not valid
4    something required is missing: a model, a package, a program, a port, a directory, a service
5    the job failed
6    the job was canceled, or it expired
7    the wait timed out; the job continues
8    some rows of a batch failed
9    not authorised: no API key, or not a valid one
10   over a limit: too many requests or too many jobs; try again later
130  interrupted with Ctrl-C
===  =========================================================================================

With ``--json`` the last line of standard error is the error as JSON: a problem document like those of the HTTP API,
with `exit_code`.
"""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import IntEnum
from inspect import Parameter, Signature
from typing import Any, ParamSpec, get_type_hints

import typer

from meshdeform.cli.output import plain
from meshdeform.errors import (
    AssetError,
    CheckpointError,
    ConflictError,
    DependencyError,
    ForbiddenError,
    LimitError,
    MeshdeformError,
    ModelError,
    NotFoundError,
    RangeError,
    RecordVersionError,
    RequestError,
    RequestTimeoutError,
    UnauthorizedError,
    UnavailableError,
)

P = ParamSpec("P")


class ExitCode(IntEnum):
    """Exit codes of the process."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    BAD_INPUT = 3
    UNAVAILABLE = 4
    JOB_FAILED = 5
    JOB_ENDED = 6
    TIMED_OUT = 7
    SOME_FAILED = 8
    UNAUTHORIZED = 9
    LIMITED = 10
    INTERRUPTED = 130


_KINDS: tuple[tuple[tuple[type[MeshdeformError], ...], ExitCode], ...] = (
    (
        (AssetError, RequestError, CheckpointError, NotFoundError, ConflictError, RangeError, RecordVersionError),
        ExitCode.BAD_INPUT,
    ),
    ((ModelError, DependencyError, UnavailableError, RequestTimeoutError), ExitCode.UNAVAILABLE),
    ((UnauthorizedError, ForbiddenError), ExitCode.UNAUTHORIZED),
    ((LimitError,), ExitCode.LIMITED),
)


class OutcomeError(Exception):
    """The command worked, but its outcome is not a success.

    `name` is the `code` of the problem document and stable; `extra` are further members of it.
    """

    def __init__(self, code: ExitCode, name: str, detail: str, advice: str, **extra: Any) -> None:
        super().__init__(detail)
        self.exit_code, self.name, self.detail, self.advice, self.extra = code, name, detail, advice, extra


def exit_code(error: MeshdeformError) -> ExitCode:
    """Return the exit code of an expected error."""
    return next((code for kinds, code in _KINDS if isinstance(error, kinds)), ExitCode.INTERNAL)


def problem(error: MeshdeformError | OutcomeError) -> dict[str, Any]:
    """Return the problem document of an error like those of the HTTP API, with the exit code."""
    if isinstance(error, OutcomeError):
        name, code, status, title = error.name, error.exit_code, None, error.name.replace("_", " ").capitalize()
        advice = error.advice
    else:
        name, code, status, title, advice = error.code, exit_code(error), error.status, error.title, error.advice_text
    return {
        **error.extra,
        "type": f"urn:meshdeform:problem:{name}",
        "title": title,
        **({"status": status} if status is not None else {}),
        "code": name,
        "detail": error.detail,
        "advice": advice,
        "exit_code": int(code),
    }


def report(error: MeshdeformError | OutcomeError, *, as_json: bool) -> None:
    """Print an error on standard error: as text, or as one line of JSON."""
    document = problem(error)
    if as_json:
        typer.echo(json.dumps(document), err=True)
        return
    if document["exit_code"] == ExitCode.INTERRUPTED:
        typer.echo(plain(document["detail"]), err=True)
    else:
        typer.secho(f"Error: {plain(document['detail'])}", err=True, fg="red", bold=True)
    typer.echo(plain(document["advice"]), err=True)


def clean_errors(command: Callable[P, None]) -> Callable[..., None]:
    """Print expected errors as a line and its advice; everything else is a bug and keeps its traceback.

    A parameter of the command whose type is a dataclass stands for its fields, which are options.
    """
    signature = inspect.signature(command, eval_str=True)
    hints = {name: each.annotation for name, each in signature.parameters.items()}
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and is_dataclass(hint)}

    @functools.wraps(command)
    def guarded(**values: Any) -> None:
        as_json = bool(values.get("as_json", False))
        for name, group in groups.items():
            values[name] = group(**{each.name: values.pop(each.name) for each in fields(group)})
        try:
            command(**values)  # type: ignore[call-arg]
        except (MeshdeformError, OutcomeError) as error:
            report(error, as_json=as_json)
            raise typer.Exit(problem(error)["exit_code"]) from None
        except KeyboardInterrupt:
            detail, advice = "Interrupted.", "Run the same command again."
            report(OutcomeError(ExitCode.INTERRUPTED, "interrupted", detail, advice), as_json=as_json)
            raise typer.Exit(ExitCode.INTERRUPTED) from None

    options = [option for each in signature.parameters.values() for option in _options(each)]
    guarded.__signature__ = Signature(options)  # type: ignore[attr-defined]
    return guarded


def _options(parameter: Parameter) -> list[Parameter]:
    """Return the parameters of a command for typer: those of a group, or the parameter itself."""
    group = parameter.annotation
    if not is_dataclass(group):
        return [parameter.replace(kind=Parameter.KEYWORD_ONLY)]
    hints = get_type_hints(group, include_extras=True)
    return [
        Parameter(each.name, Parameter.KEYWORD_ONLY, default=each.default, annotation=hints[each.name])
        for each in fields(group)
    ]
