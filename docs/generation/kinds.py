"""Generate the tables in docs/http.md of the files and artifacts of each kind of job."""

from __future__ import annotations

from docs.generation.between import renewed
from meshdeform.runs import kinds
from meshdeform.runs.base import Kind

__all__ = ["page"]


def page(text: str) -> str:
    """Return docs/http.md with its tables of files and artifacts regenerated."""
    return renewed(text, "meshdeform/runs", "\n".join(tables(kind) for kind in kinds()))


def tables(kind: Kind) -> str:
    """Return the tables of the files that a kind reads and writes."""
    reads = [f"| `{each.name}`{' (required)' if each.required else ''} | {each.summary} |" for each in kind.reads]
    writes = [f"| `{each.name}` | {each.summary} |" for each in kind.artifacts]
    lines = [f"**`{kind.name}`.** {kind.summary}", "", "| it reads | |", "|---|---|", *reads]
    lines += ["", "| it writes | |", "|---|---|", *writes]
    return "\n".join(lines) + "\n"
