"""Generate the list of commands in docs/cli.md, and the exit codes."""

from __future__ import annotations

import inspect
import re

from docs.generation.between import renewed
from docs.generation.cli import parts
from meshdeform.cli import exits

__all__ = ["page"]


def page(text: str) -> str:
    """Return docs/cli.md with its lists of commands and exit codes regenerated."""
    lines = [f"- `meshdeform {name}`: {_summary(command.help or '')}\n" for name, command in parts()]
    text = renewed(text, "meshdeform/cli", "".join(lines))
    codes = re.findall(r"^(\d+) +(.+)$", exits.__doc__ or "", re.MULTILINE)
    if [int(code) for code, _ in codes] != sorted(exits.ExitCode):
        raise ValueError("the docstring of meshdeform/cli/exits.py lacks an exit code")
    return renewed(text, "meshdeform/cli/exits.py", "".join(f"- {code}: {what}\n" for code, what in codes))


def _summary(text: str) -> str:
    return " ".join(inspect.cleandoc(text).partition("\n\n")[0].split())
