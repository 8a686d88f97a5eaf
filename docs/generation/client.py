"""Generate the reference in docs/client.md: every method of the Python client with its arguments."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from docs.generation.between import renewed
from meshdeform.client import Client, JobOptions, Result

__all__ = ["page"]


def page(text: str) -> str:
    """Return docs/client.md with its reference regenerated."""
    options = ", ".join(f"`{name}`" for name in JobOptions.__annotations__)
    parts = [f"`{kind.__name__}`:\n\n" + "".join(_line(*each) for each in _methods(kind)) for kind in (Client, Result)]
    return renewed(text, "meshdeform/client", "\n".join([*parts, f"`**options` (`JobOptions`): {options}.\n"]))


def _methods(kind: type) -> list[tuple[str, Callable[..., Any]]]:
    return [(name, value) for name, value in vars(kind).items() if not name.startswith("_") and callable(value)]


def _line(name: str, method: Callable[..., Any]) -> str:
    summary = " ".join((inspect.getdoc(method) or "").partition("\n\n")[0].split())
    return f"- `{name}({', '.join(_arguments(method))})`: {summary}\n"


def _arguments(method: Callable[..., Any]) -> list[str]:
    """Return the names of a method's arguments, with a star before those that are given by name alone."""
    names, starred = [], False
    for name, parameter in list(inspect.signature(method).parameters.items())[1:]:
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not starred:
            starred = True
            names.append("*")
        names.append(f"**{name}" if parameter.kind is inspect.Parameter.VAR_KEYWORD else name)
    return names
