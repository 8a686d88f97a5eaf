"""`meshdeform models`: list the models and the words that the built-in one accepts."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import complete_models, load_settings
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import JsonOption, Place
from meshdeform.cli.output import emit, table
from meshdeform.errors import ModelError

_STATES = {True: "available", False: "missing", None: "unknown"}


@clean_errors
def models(
    model: Annotated[
        str | None,
        typer.Argument(help="Only this model, with the words that it accepts.", autocompletion=complete_models),
    ] = None,
    *,
    place: Place,
    as_json: JsonOption = False,
) -> None:
    """List the models of the service that --url or MESHDEFORM_URL names, else of this machine.

    meshdeform models

    meshdeform models builtin
    """
    from meshdeform.priors import public_name

    if place.url:
        with place.connect() as client:
            document = client.models().model_dump(mode="json")
    else:
        document = _local()
    entries = [entry for entry in document["models"] if model in (None, entry["id"], public_name(entry["id"]))]
    if not entries:
        known = ", ".join(entry["id"] for entry in document["models"])
        raise ModelError(f"There is no model {model!r} here.", advice=f"Models: {known}.")
    if as_json:
        emit({**document, "models": entries})
        return
    if model is not None:
        typer.echo(_described(entries[0]))
        return
    rows = [
        (
            entry["id"],
            "default" if entry["id"] == document["default"] else "",
            _STATES.get(entry["available"], ""),
            entry.get("licence") or "",
            entry.get("title") or "",
        )
        for entry in entries
    ]
    typer.echo(table(("MODEL", "", "STATE", "LICENCE", "TITLE"), rows))


def _local() -> dict[str, Any]:
    from meshdeform.priors.catalogue import list_models

    settings = load_settings()
    models = list_models(settings.model, settings.allowed_models, settings.model_revision)
    return {"default": settings.model, "models": [asdict(entry) for entry in models]}


def _described(entry: dict[str, Any]) -> str:
    lines = [entry["id"], *filter(None, [entry.get("title"), entry.get("description")])]
    words = entry.get("vocabulary") or {}
    if entry.get("problem"):
        lines.append(entry["problem"])
    if words.get("nouns"):
        lines.append(f"{len(words['nouns'])} nouns")
    for name, nouns in (words.get("groups") or {}).items():
        if nouns:
            lines.append(f"  {name}: {', '.join(nouns)}")
    for name in ("attributes", "examples"):
        if words.get(name):
            lines.append(f"{name}: {', '.join(words[name])}")
    lines.append(f"Licence: {entry.get('licence') or 'not stated here; see its model card'}")
    if not words:
        lines.append("Accepts any prompt.")
    return "\n".join(lines)
