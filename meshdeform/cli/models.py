"""`meshdeform models`: list the models and the words that the built-in one accepts."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import complete_models, load_settings
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import JsonOption, Where
from meshdeform.cli.output import emit, table
from meshdeform.errors import ModelError

_STATES = {True: "available", False: "missing", None: "unknown"}


@clean_errors
def models(
    model: Annotated[
        str | None,
        typer.Argument(
            help="Only this model, with the words that it accepts; or `shapes`: what there are shapes of, which "
            "prompts name where no model is asked.",
            autocompletion=complete_models,
        ),
    ] = None,
    *,
    where: Where,
    as_json: JsonOption = False,
) -> None:
    """List the models of the service that --url or MESHDEFORM_URL names, else of this machine.

    meshdeform models

    meshdeform models shapes
    """
    from meshdeform.priors import public_name

    if where.url:
        with where.connect() as client:
            document = client.models().model_dump(mode="json")
    else:
        document = _local()
    if model == "shapes" and document.get("shapes"):
        if as_json:
            emit(document["shapes"])
        else:
            typer.echo("\n".join(_words(document["shapes"])))
        return
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
    from meshdeform.priors.catalogue import list_models, shapes_vocabulary
    from meshdeform.words import WordFolder, parts_to_set

    settings = load_settings()
    models = list_models(settings.model, settings.allowed_models, settings.model_revision)
    own = {word.noun: parts_to_set(word) for word in WordFolder(settings.words_folder).words()}
    shapes = shapes_vocabulary(own)
    return {"default": settings.model, "shapes": asdict(shapes), "models": [asdict(entry) for entry in models]}


def _described(entry: dict[str, Any]) -> str:
    lines = [entry["id"], *filter(None, [entry.get("title"), entry.get("description")])]
    words = entry.get("vocabulary") or {}
    if entry.get("problem"):
        lines.append(entry["problem"])
    lines += _words(words)
    lines.append(f"Licence: {entry.get('licence') or 'not stated here; see its model card'}")
    if not words:
        lines.append("Accepts any prompt.")
    return "\n".join(lines)


def _words(words: dict[str, Any]) -> list[str]:
    """Return the lines about a vocabulary."""
    lines = [f"{len(words['nouns'])} nouns"] if words.get("nouns") else []
    groups = (words.get("groups") or {}).items()
    lines += [f"  {name}: {', '.join(nouns)}" for name, nouns in groups if nouns]
    return lines + [f"{name}: {', '.join(words[name])}" for name in ("attributes", "examples") if words.get(name)]
