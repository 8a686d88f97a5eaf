"""Generate the lists in docs/http.md of the files and artifacts of each kind of job."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable

from docs.generation.between import renewed
from meshdeform.runs import kinds
from meshdeform.runs.base import Kind

__all__ = ["page"]


def page(text: str) -> str:
    """Return docs/http.md with its lists of files and artifacts regenerated."""
    deformation, *others = kinds()
    return renewed(text, "meshdeform/runs", "\n".join([lists(deformation), *(names(kind) for kind in others)]))


def lists(kind: Kind) -> str:
    """Return the lists of the files that a kind reads and writes."""
    reads = _rows((each.name, f"{'Required. ' if each.required else ''}{each.summary}") for each in kind.reads)
    writes = _rows((each.name, each.summary) for each in kind.artifacts)
    lines = [f"**`{kind.name}`.** {kind.summary}", "", "It reads", "", *reads, "", "and writes", "", *writes]
    return "\n".join(lines) + "\n"


def names(kind: Kind) -> str:
    """Return what a kind does, and the names of its files; `GET /v1/limits` describes them."""
    reads = ", ".join(f"`{each.name}`{'' if each.required else ' (optional)'}" for each in kind.reads)
    writes = ", ".join(f"`{each.name}`" for each in kind.artifacts)
    return f"**`{kind.name}`.** {kind.summary} Reads {reads}; writes {writes}.\n"


def _rows(files: Iterable[tuple[str, str]]) -> list[str]:
    """Return a line for each file; one for those that differ in a number alone, such as `level_1.glb`."""
    rows = []
    for _, group in itertools.groupby(files, key=lambda each: re.sub(r"\d+", "N", " ".join(each))):
        (name, summary), *others = group
        if others:
            last, told = others[-1]
            name, numbers = f"{name}` to `{last}", iter(re.findall(r"\d+", told))
            summary = re.sub(r"\d+", lambda found: _span(found[0], next(numbers)), summary)  # noqa: B023
        rows.append(f"- `{name}`: {summary}")
    return rows


def _span(first: str, last: str) -> str:
    return first if first == last else f"{first} to {last}"
