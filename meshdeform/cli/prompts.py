"""Read further prompts from the command line, and say in lines what the result looks like for each."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import typer

from meshdeform.cli.control import parse_selection
from meshdeform.cli.likeness import likeness_line, percent

__all__ = ["parse_also", "prompt_lines"]

_OPTION = "--also"
_WEIGHT = re.compile(r"^(.*\S)\s*:\s*(\d+(?:\.\d+)?|\.\d+)$", re.DOTALL)
_OUTSIDE = "outside:"


def parse_also(texts: Sequence[str] | None) -> list[dict[str, Any]] | None:
    """Parse prompts written as PROMPT[:WEIGHT][@[outside:]PLACE=VALUE]...; None if there are none.

    Several places make one region. What a text of this form cannot say, such as an `@` in a name, `--set prompts=` can.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    return [_prompt(text) for text in texts] if texts else None


def prompt_lines(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each of the report's `prompts` that was compared with the result."""
    lines = []
    for each in found:
        if each.get("likeness") is not None:
            before = each["likeness"].get("before")
            earlier = f", {percent(before['probability'])} before" if before else ""
            where = f" (in its region{earlier})" if each["regions"] else ""
            lines.append(f"{each['prompt']}{where}: {likeness_line(each['likeness'])}")
    return lines


def _prompt(text: str) -> dict[str, Any]:
    first, *places = text.split("@")
    weighted = _WEIGHT.match(first.strip())
    words, weight = (weighted[1], float(weighted[2])) if weighted else (first.strip(), None)
    if not words:
        raise typer.BadParameter(f"{text!r} has no prompt before the weight or the place", param_hint=_OPTION)
    outside = [place.strip().startswith(_OUTSIDE) for place in places]
    if any(outside) and not all(outside):
        raise typer.BadParameter(f"{text!r}: either all places of a prompt are {_OUTSIDE} or none", param_hint=_OPTION)
    regions = [parse_selection(place.strip().removeprefix(_OUTSIDE), _OPTION) for place in places]
    return {
        "prompt": words,
        **({"weight": weight} if weight is not None else {}),
        **({"regions": regions} if regions else {}),
        **({"outside": True} if any(outside) else {}),
    }
