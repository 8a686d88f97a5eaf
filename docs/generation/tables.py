"""Generate tables of pages from those of the code: changes in plain words, the `.ndf` file."""

from __future__ import annotations

from docs.generation.between import renewed
from meshdeform.kinds.surface_fit import reader
from meshdeform.plain.table import KINDS, SHAPES, TABLE

__all__ = ["fields", "plain"]

_MOST_EXAMPLES = 8


def plain(text: str) -> str:
    """Return docs/plain.md with its table of operations regenerated."""
    lines = ["| kind | such as | operations |", "|---|---|---|"]
    for kind, operations in TABLE.items():
        words = [word for word, of in KINDS.items() if of == kind and word != kind]
        told = ", ".join(f"{name}: {way}" for name, way in operations.items() if name not in SHAPES)
        lines.append(f"| `{kind}` | {', '.join(words[:_MOST_EXAMPLES])} | {told} |")
    return renewed(text, "meshdeform/plain/table.py", "\n".join(lines) + "\n")


def fields(text: str) -> str:
    """Return docs/surface_fit.md with the layout of the file regenerated, from the reader's docstring."""
    told = (reader.__doc__ or "").partition("\n\n")[2]
    return renewed(text, "meshdeform/kinds/surface_fit/reader.py", told)
