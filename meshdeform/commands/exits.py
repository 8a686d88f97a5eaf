"""Errors as one clean line and its advice, and the exit code that tells a script what kind it was.

===  =========================================================================================
0    done
1    an internal error: a bug, with its traceback
2    wrong usage: an unknown option, a file that does not exist
3    bad input: the asset, the prompt or a parameter is not valid
4    something that is needed is not there: a model, a package, a program, a port, a directory
130  interrupted with Ctrl-C
===  =========================================================================================
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from enum import IntEnum
from typing import ParamSpec

import typer

from meshdeform.errors import (
    AssetError,
    CheckpointError,
    DependencyError,
    MeshdeformError,
    ModelError,
    NotFoundError,
    RequestError,
    UnavailableError,
)

__all__ = ["ExitCode", "clean_errors", "exit_code"]

P = ParamSpec("P")


class ExitCode(IntEnum):
    """What the process ends with."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    BAD_INPUT = 3
    UNAVAILABLE = 4
    INTERRUPTED = 130


def exit_code(error: MeshdeformError) -> ExitCode:
    """The exit code of an expected error."""
    if isinstance(error, AssetError | RequestError | CheckpointError | NotFoundError):
        return ExitCode.BAD_INPUT
    if isinstance(error, ModelError | DependencyError | UnavailableError):
        return ExitCode.UNAVAILABLE
    return ExitCode.INTERNAL


def clean_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Print an expected error as a line and its advice; everything else is a bug and keeps its traceback."""

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except MeshdeformError as error:
            typer.secho(f"Error: {error.detail}", err=True, fg="red", bold=True)
            typer.echo(error.advice_text, err=True)
            raise typer.Exit(exit_code(error)) from None
        except KeyboardInterrupt:
            typer.echo("Interrupted; nothing was written.", err=True)
            raise typer.Exit(ExitCode.INTERRUPTED) from None

    return guarded
