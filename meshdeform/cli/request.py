"""Build a job's request from command-line options. A pair that is not NAME=VALUE is a `typer.BadParameter`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.cli.form import overlaid
from meshdeform.errors import ParameterError
from meshdeform.requests.choices import JobKind

if TYPE_CHECKING:
    from meshdeform.requests.document import JobRequest

__all__ = ["make_request", "make_settings", "merge_params", "parse_files", "parse_labels"]


def make_settings(pairs: Sequence[str], option: str = "--set") -> dict[str, Any]:
    """Parse parameters written as NAME=VALUE, or GROUP.NAME=VALUE; a value that is not JSON is text."""
    parameters: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE", param_hint=option)
        try:
            read = json.loads(value)
        except ValueError:
            read = value
        for part in reversed(name.split(".")):
            read = {part.strip(): read}
        parameters = overlaid(parameters, read)
    return parameters


def merge_params(pairs: Sequence[str], **options: Any) -> dict[str, Any]:
    """Return the parameters from `--set`, overridden by the options that are not None.

    Parameters of a deformation may be named without their group, which they are put in.
    """
    from meshdeform.requests.removed import grouped

    written = {name: value for name, value in options.items() if value is not None}
    return overlaid(grouped(make_settings(pairs)), grouped(written))


def parse_labels(pairs: Sequence[str]) -> dict[str, str]:
    """Parse labels written as NAME=TEXT."""
    labels = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not NAME=TEXT", param_hint="--label")
        labels[name.strip()] = text
    return labels


def parse_files(pairs: Sequence[str] | None, kind: JobKind, first: Path) -> dict[str, Path]:
    """Return the files of a job by part: `first`, and those written as PART=FILE, of parts that the kind reads."""
    from meshdeform.runs import kinds

    reads = next(each for each in kinds() if each.name == kind).reads
    others = [each.name for each in reads[1:]]
    files = {reads[0].name: first}
    for pair in pairs or []:
        part, equals, path = pair.partition("=")
        part = part.strip()
        if not equals or part not in others:
            known = ", ".join(others) or "no others"
            raise typer.BadParameter(f"{pair!r} is not PART=FILE; {kind} reads {known}", param_hint="--file")
        if not Path(path).is_file():
            raise typer.BadParameter(f"{path!r} is not a file", param_hint="--file")
        files[part] = Path(path)
    if missing := [each.name for each in reads if each.required and each.name not in files]:
        raise typer.BadParameter(f"{kind} also needs {missing[0]}=FILE", param_hint="--file")
    return files


def make_request(
    prompt: str,
    params: Mapping[str, Any],
    *,
    output: Mapping[str, Any] | None = None,
    more: Mapping[str, Any] | None = None,
    place: str = "The request",
) -> JobRequest:
    """Build and validate a request; parameters that are None count as left out.

    `more` are further members of the document, such as `priority`; `place` is the request's name in the ParameterError.
    """
    from pydantic import ValidationError

    from meshdeform.requests.document import JobRequest
    from meshdeform.requests.removed import instead, plain_place
    from meshdeform.runs import kinds

    kinds()  # the kinds register their parameters

    document = {
        "prompt": prompt,
        "params": {name: value for name, value in params.items() if value is not None},
        "output": dict(output or {}),
        **{name: value for name, value in (more or {}).items() if value is not None},
    }
    try:
        return JobRequest.model_validate(document)
    except ValidationError as error:
        found = [
            {"loc": plain_place(each["loc"]), "msg": instead(each["loc"]) or each["msg"], "type": each["type"]}
            for each in error.errors()
        ]
        sentences = [f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in found]
        raise ParameterError(
            f"{place} is not valid: {'; '.join(sentences)}.",
            advice="docs/parameters.md has every parameter with its bounds, docs/http.md those of other kinds.",
            errors=found,
        ) from error
