"""Generate the table in docs/troubleshooting.md: every error code with its meaning and advice."""

from __future__ import annotations

from docs.generation.between import renewed
from meshdeform import errors
from meshdeform.errors import MeshdeformError

SOURCE = "meshdeform/errors.py"


def page(text: str) -> str:
    """Return the page with its table regenerated."""
    return renewed(text, SOURCE, table())


def table() -> str:
    """Return a table of all codes, sorted by name."""
    rows = [
        f"| [{kind.code}](errors.md#{kind.code}) | {kind.status} | {_cell(kind.__doc__ or '')} | {_cell(kind.advice)} |"
        for kind in sorted(_below(MeshdeformError), key=lambda kind: kind.code)
    ]
    return "\n".join(["| code | status | what happened | what to do |", "|---|---|---|---|", *rows]) + "\n"


def _below(kind: type[MeshdeformError]) -> set[type[MeshdeformError]]:
    """Return the class and all its subclasses that the module of errors defines."""
    found = {kind}
    for child in kind.__subclasses__():
        if child.__module__ == errors.__name__:
            found |= _below(child)
    return found


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
