"""Options of `meshdeform submit` for kinds of job other than `text_deform`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from meshdeform.requests.choices import JobKind

__all__ = ["parse_files", "refuse_deformation"]


def parse_files(pairs: Sequence[str] | None, kind: JobKind, first: Path) -> dict[str, Path]:
    """Return the files of a job by part: `first`, and those written as PART=FILE.

    Raises
    ------
    typer.BadParameter
        A pair has no `=`, its part is none that the kind reads besides the first, or its file does not exist.
    """
    from meshdeform.runs import kinds

    reads = next(each for each in kinds() if each.name == kind).reads
    others = [each.name for each in reads[1:]]
    found = {reads[0].name: first}
    for pair in pairs or []:
        part, equals, path = pair.partition("=")
        part = part.strip()
        if not equals or part not in others:
            known = ", ".join(others) or "no others"
            raise typer.BadParameter(f"{pair!r} is not PART=FILE; {kind} reads {known}", param_hint="--file")
        if not Path(path).is_file():
            raise typer.BadParameter(f"{path!r} is not a file", param_hint="--file")
        found[part] = Path(path)
    if missing := [each.name for each in reads if each.required and each.name not in found]:
        raise typer.BadParameter(f"{kind} also needs {missing[0]}=FILE", param_hint="--file")
    return found


def refuse_deformation(kind: JobKind, prompt: str, output: Mapping[str, Any]) -> None:
    """Refuse what only a deformation has: a prompt, and options of the output.

    Raises
    ------
    typer.BadParameter
        There is one of them.
    """
    if prompt:
        raise typer.BadParameter(f"a job of kind {kind} has no prompt", param_hint="PROMPT")
    for name, wanted in output.items():
        if wanted:
            raise typer.BadParameter(
                f"is only for text_deform, not for {kind}", param_hint=f"--{name.replace('_', '-')}"
            )
