"""`meshdeform inspect`: show what an asset consists of, and which parts should keep their shape."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import JsonOption
from meshdeform.cli.output import emit, plain, table

__all__ = ["inspect"]

_SHOWN = 40


@clean_errors
def inspect(
    asset: Annotated[Path, typer.Argument(help="A GLB, OBJ, PLY or STL.", exists=True, dir_okay=False, readable=True)],
    as_json: JsonOption = False,
) -> None:
    """Show the connected components of ASSET, and propose those that should keep their shape.

    Congruent parts and round ones are proposed, each with the options of `run` and `submit` that keep them.

    meshdeform inspect truck.glb
    """
    require("torch", "deform")
    from meshdeform.assets import Limits, load_asset
    from meshdeform.runs.inspection import inspect_parts

    settings = load_settings()
    found = inspect_parts(load_asset(asset.read_bytes(), asset.name, Limits.from_settings(settings)))
    if as_json:
        emit(found)
        return
    typer.echo(_described(found))
    for warning in found["warnings"]:
        typer.echo(warning, err=True)


def _described(found: dict[str, Any]) -> str:
    names = {what: {part["index"]: part["name"] for part in found[what]} for what in ("nodes", "materials")}
    components = found["components"]
    rows = [
        (
            str(item["number"]),
            f"{item['triangles']:,}",
            f"{item['size']:.0%}",
            *(_names(names[what], item[what]) for what in ("nodes", "materials")),
        )
        for item in components[:_SHOWN]
    ]
    lines = [table(("COMPONENT", "TRIANGLES", "SIZE", "NODE", "MATERIAL"), rows)]
    if len(components) > _SHOWN:
        lines.append(f"and {len(components) - _SHOWN} more; --json lists all.")
    for proposal in found["proposals"][:_SHOWN]:
        lines += ["", _sentence(proposal, names)]
    return "\n".join(lines)


def _sentence(proposal: dict[str, Any], names: dict[str, dict[int, str]]) -> str:
    """Return a proposal in words, with the options that accept it."""
    numbers = proposal["components"]
    kind = " ".join(word for word in ("congruent", "round") if proposal[word])
    listed = ", ".join(map(str, numbers))
    what = f"{len(numbers)} {kind} components: {listed}." if len(numbers) > 1 else f"Component {listed} is {kind}."
    options = " ".join(f"--rigid {place}={index}" for item in proposal["selectors"] for place, index in item.items())
    called = {
        name
        for item in proposal["selectors"]
        for place, index in item.items()
        if (name := names.get(f"{place}s", {}).get(index))
    }
    return f"{what} Keep them with {options}{' (' + plain(', '.join(sorted(called))) + ')' if called else ''}"


def _names(names: dict[int, str], indices: list[int]) -> str:
    return plain(", ".join(f"{index} {names.get(index, '')}".strip() for index in indices[:3]))
