"""What commands print: results on standard output, everything about how it goes on standard error."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Sequence
from typing import Any

import typer

__all__ = ["ago", "duration", "emit", "note", "plain", "table"]

_MINUTE, _HOUR, _DAY = 60, 3600, 86_400


def emit(document: Any) -> None:
    """Print one JSON document as one line, at once: who reads a pipe gets every line when it is there."""
    typer.echo(json.dumps(document))


def note(text: str, *, quiet: bool = False) -> None:
    """Say something about how it goes, on standard error."""
    if not quiet:
        typer.echo(plain(text), err=True)


def plain(text: str) -> str:
    """The text without control characters: a prompt or a name must not be able to command the terminal."""
    return "".join(letter for letter in text if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cf"))


def duration(seconds: float) -> str:
    """Seconds for people: `8 s`, `2 min 05 s`, `1 h 20 min`."""
    whole = max(0, round(seconds))
    if whole < _MINUTE:
        return f"{whole} s"
    if whole < _HOUR:
        return f"{whole // _MINUTE} min {whole % _MINUTE:02} s"
    return f"{whole // _HOUR} h {whole % _HOUR // _MINUTE:02} min"


def ago(seconds: float) -> str:
    """How long something has been, in its largest unit: `3 min ago`."""
    for size, unit in ((_DAY, "d"), (_HOUR, "h"), (_MINUTE, "min")):
        if seconds >= size:
            return f"{int(seconds // size)} {unit} ago"
    return f"{max(0, int(seconds))} s ago"


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns of text, aligned with spaces, the same on a terminal and in a file; the last column is not padded."""
    lines = [titles, *([plain(cell).replace("\n", " ") for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(titles))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
