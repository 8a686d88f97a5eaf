"""`meshdeform version`: print the version."""

from __future__ import annotations

import platform

import typer

import meshdeform
from meshdeform.cli.options import JsonOption
from meshdeform.cli.output import emit

__all__ = ["print_version", "version"]


def print_version(wanted: bool) -> None:
    """Print the version and exit, for the option `--version`."""
    if wanted:
        typer.echo(meshdeform.__version__)
        raise typer.Exit


def version(as_json: JsonOption = False) -> None:
    """Print the version."""
    if as_json:
        emit({"meshdeform": meshdeform.__version__, "python": platform.python_version()})
        return
    typer.echo(meshdeform.__version__)
