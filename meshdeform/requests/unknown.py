"""Say in plain words what is wrong with an unknown name in a request, and which one was probably meant. Torch-free."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel

from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.groups import elsewhere, plain_place
from meshdeform.requests.parameters import GUIDANCES

_CLOSE = 0.6


def did_you_mean(name: str, known: Collection[str], what: str = "member") -> str:
    """Return a sentence about an unknown name, with the known name that it resembles or else all of them.

    `what` says what the name is of.
    """
    sentence = f"there is no such {what}."
    if found := get_close_matches(name.lower(), sorted(known), 1, _CLOSE):
        return f"{sentence} Did you mean {found[0]!r}?"
    return f"{sentence} There are: {', '.join(sorted(known)) or 'none'}."


def in_plain_words(findings: Sequence[Any], model: type[BaseModel]) -> list[dict[str, Any]]:
    """Return pydantic's findings about a document, with what to use in place of each unknown member."""
    return [
        {
            **found,
            "loc": plain_place(found["loc"]),
            **({"msg": _unknown(found["loc"], model)} if found["type"] == "extra_forbidden" else {}),
        }
        for found in findings
    ]


def _unknown(place: Sequence[Any], model: type[BaseModel]) -> str:
    if said := elsewhere(place):
        return said
    inner: type[BaseModel] | None = model
    for step in place[:-1]:
        inner = GUIDANCES[step] if step in list(GuidanceKind) else _model_of(inner, step) if inner is not None else None
    return did_you_mean(str(place[-1]), inner.model_fields if inner is not None else ())


def _model_of(model: type[BaseModel], name: Any) -> type[BaseModel] | None:
    """Return the model of a member, or None if it has none."""
    field = model.model_fields.get(name)
    choices = [field.annotation, *get_args(field.annotation)] if field is not None else []
    return next((each for each in choices if isinstance(each, type) and issubclass(each, BaseModel)), None)
