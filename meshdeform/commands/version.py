"""`meshdeform version`."""

from __future__ import annotations

import typer

import meshdeform

__all__ = ["version"]


def version() -> None:
    """Print the version."""
    typer.echo(meshdeform.__version__)
