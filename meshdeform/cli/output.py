"""Print results on standard output and everything about progress on standard error."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Sequence
from typing import Any

import typer

__all__ = ["ago", "duration", "emit", "note", "plain", "table"]

_MINUTE, _HOUR, _DAY = 60, 3600, 86_400


def emit(document: Any) -> None:
    """Print a JSON document as one line and flush it, so that a reader of the pipe gets it at once."""
    typer.echo(json.dumps(document))


def note(text: str, *, quiet: bool = False) -> None:
    """Print a note about progress on standard error, unless `quiet`."""
    if not quiet:
        typer.echo(plain(text), err=True)


def plain(text: str) -> str:
    """Return the text without control characters, so that no prompt or name can control the terminal."""
    return "".join(letter for letter in text if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cf"))


def duration(seconds: float) -> str:
    """Format seconds for people: `8 s`, `2 min 05 s`, `1 h 20 min`."""
    whole = max(0, round(seconds))
    if whole < _MINUTE:
        return f"{whole} s"
    if whole < _HOUR:
        return f"{whole // _MINUTE} min {whole % _MINUTE:02} s"
    return f"{whole // _HOUR} h {whole % _HOUR // _MINUTE:02} min"


def ago(seconds: float) -> str:
    """Format an age in seconds in its largest unit: `3 min ago`."""
    for size, unit in ((_DAY, "d"), (_HOUR, "h"), (_MINUTE, "min")):
        if seconds >= size:
            return f"{int(seconds // size)} {unit} ago"
    return f"{max(0, int(seconds))} s ago"


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return columns of text aligned with spaces; the last column is not padded."""
    lines = [titles, *([plain(cell).replace("\n", " ") for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(titles))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
