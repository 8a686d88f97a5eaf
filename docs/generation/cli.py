"""Generate the page cli_reference.md: every command with its arguments and options, as `--help` has them.

docs/cli.md, written by hand, explains what the commands are for.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import typer
import typer.main

from meshdeform.cli.app import app

__all__ = ["page", "parts"]

_HEAD = """\
# Command reference

Every command with its arguments and options, as `meshdeform COMMAND --help` prints them. This page is generated when
the site is built. [Command line](cli.md) explains what they are for.
"""


def page() -> str:
    """Return the whole page."""
    return "\n".join([_HEAD, *(_command(name, command) for name, command in parts())])


def parts() -> Iterator[tuple[str, Any]]:
    """Yield each command that is shown, with its name; of a group, its commands."""
    for name, command in sorted(typer.main.get_command(app).commands.items()):  # type: ignore[attr-defined]
        if hasattr(command, "commands"):
            yield from ((f"{name} {each}", child) for each, child in command.commands.items())
        elif not command.hidden:
            yield name, command


def _command(name: str, command: Any) -> str:
    context = typer.Context(command, info_name=f"meshdeform {name}")
    records = (each.get_help_record(context) for each in command.get_params(context) if each.name != "help")
    rows = [f"| `{option}` | {_cell(meaning)} |" for option, meaning in filter(None, records)]
    summary = inspect.cleandoc(command.help or "").partition("\n\n")[0]
    return "\n".join([f"## meshdeform {name}\n", f"{summary}\n", "| option | meaning |", "|---|---|", *rows, ""])


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
