"""Build a job's request from command-line options."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.requests.document import JobRequest
    from meshdeform.requests.morph import MorphPath
    from meshdeform.settings import Settings

__all__ = [
    "make_request",
    "make_settings",
    "merge_params",
    "parse_exclude",
    "parse_labels",
    "parse_morph_path",
]


def make_settings(pairs: Sequence[str], option: str = "--set") -> dict[str, Any]:
    """Parse parameters written as NAME=VALUE; a value that is not JSON is text.

    Raises
    ------
    typer.BadParameter
        A pair has no `=`.
    """
    parameters: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE", param_hint=option)
        try:
            parameters[name.strip()] = json.loads(value)
        except ValueError:
            parameters[name.strip()] = value
    return parameters


def merge_params(pairs: Sequence[str], **options: Any) -> dict[str, Any]:
    """Return the parameters from `--set`, overridden by the options that are not None."""
    return {**make_settings(pairs), **{name: value for name, value in options.items() if value is not None}}


def parse_exclude(texts: Sequence[str] | None) -> list[str | int] | None:
    """Parse nodes, of which those of digits are indices; None if there are none."""
    return [int(text) if text.isascii() and text.isdecimal() else text for text in texts] if texts else None


def parse_labels(pairs: Sequence[str]) -> dict[str, str]:
    """Parse labels written as NAME=TEXT.

    Raises
    ------
    typer.BadParameter
        A pair has no `=`.
    """
    labels = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not NAME=TEXT", param_hint="--label")
        labels[name.strip()] = text
    return labels


def parse_morph_path(pairs: list[str] | None) -> MorphPath | None:
    """Parse the parameters of a morph, written as NAME=VALUE; None if there are none.

    Raises
    ------
    ParameterError
        A parameter is unknown or out of range.
    """
    if not pairs:
        return None
    from pydantic import ValidationError

    from meshdeform.requests.morph import MorphPath

    try:
        return MorphPath.model_validate(make_settings(pairs, "--morph-path"))
    except ValidationError as error:
        sentences = [f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in error.errors()]
        raise ParameterError(
            f"--morph-path is not valid: {'; '.join(sentences)}.",
            advice="docs/control.md has its parameters with their bounds.",
        ) from error


def make_request(
    prompt: str,
    params: Mapping[str, Any],
    *,
    output: Mapping[str, Any] | None = None,
    more: Mapping[str, Any] | None = None,
    place: str = "The request",
) -> JobRequest:
    """Build and validate a request; parameters that are None count as left out.

    Parameters
    ----------
    prompt : str
    params : mapping
        As in docs/parameters.md.
    output : mapping, optional
        The options of `output` (docs/parameters.md); those that are False or None count as left out.
    more : mapping, optional
        Further members of the document, such as `priority`.
    place : str
        Name of the request in errors.

    Raises
    ------
    ParameterError
        A member is unknown or out of range.
    """
    from pydantic import ValidationError

    from meshdeform.requests.document import JobRequest
    from meshdeform.requests.removed import instead

    document = {
        "prompt": prompt,
        "params": {name: value for name, value in params.items() if value is not None},
        "output": {name: wanted for name, wanted in (output or {}).items() if wanted},
        **{name: value for name, value in (more or {}).items() if value is not None},
    }
    try:
        return JobRequest.model_validate(document)
    except ValidationError as error:
        found = [
            {"loc": list(e["loc"]), "msg": instead(e["loc"]) or e["msg"], "type": e["type"]} for e in error.errors()
        ]
        sentences = [f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in found]
        raise ParameterError(
            f"{place} is not valid: {'; '.join(sentences)}.",
            advice="docs/parameters.md has every parameter with its bounds, docs/http.md those of other kinds.",
            errors=found,
        ) from error


def find_taught(request: JobRequest, settings: Settings) -> JobRequest:
    """Return the request with the path of taught weights that are named by a file in MESHDEFORM_MODELS."""
    from meshdeform.priors.public_names import configured_name
    from meshdeform.requests.models import is_taught

    model = request.params.model
    if model is None or not is_taught(model) or Path(model).expanduser().exists():
        return request
    path = configured_name(model, settings.further_models)
    return request.model_copy(update={"params": request.params.model_copy(update={"model": path})})
