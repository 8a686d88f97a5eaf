"""Generate tables of pages from those of the code: changes in plain words, families of drawings, the `.ndf` file."""

from __future__ import annotations

from docs.generation.between import renewed
from meshdeform.kinds.surface_fit import reader
from meshdeform.plain.table import KINDS, SHAPES, TABLE
from meshdeform.requests.sketches import SKETCH_FAMILIES

__all__ = ["drawings", "fields", "plain"]

_MOST_EXAMPLES = 8


def plain(text: str) -> str:
    """Return docs/plain.md with its table of operations regenerated."""
    lines = ["| kind | such as | operations |", "|---|---|---|"]
    for kind, operations in TABLE.items():
        words = [word for word, of in KINDS.items() if of == kind and word != kind]
        told = ", ".join(f"{name}: {way}" for name, way in operations.items() if name not in SHAPES)
        lines.append(f"| `{kind}` | {', '.join(words[:_MOST_EXAMPLES])} | {told} |")
    return renewed(text, "meshdeform/plain/table.py", "\n".join(lines) + "\n")


def drawings(text: str) -> str:
    """Return docs/sketch.md with its table of families regenerated."""
    lines = ["| family | numbers | choices |", "|---|---|---|"]
    for name, family in SKETCH_FAMILIES.items():
        numbers = ", ".join(f"`{each.name}`" for each in family.numbers)
        choices = "; ".join(f"`{each.name}`: {', '.join(each.options)}" for each in family.choices)
        lines.append(f"| `{name}` | {numbers} | {choices} |")
    return renewed(text, "meshdeform/requests/sketches.py", "\n".join(lines) + "\n")


def fields(text: str) -> str:
    """Return docs/surface_fit.md with the layout of the file regenerated, from the reader's docstring."""
    told = (reader.__doc__ or "").partition("\n\n")[2]
    return renewed(text, "meshdeform/kinds/surface_fit/reader.py", told)
