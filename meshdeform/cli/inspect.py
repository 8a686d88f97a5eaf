"""`meshdeform inspect`: show what an asset consists of, and which parts should keep their shape."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import AlsoOption, JsonOption, ModelOption, SetOption
from meshdeform.cli.orientation import orientation_line
from meshdeform.cli.output import emit, plain, table
from meshdeform.cli.prompts import parse_also
from meshdeform.cli.request import find_taught, make_request, merge_params

if TYPE_CHECKING:
    from meshdeform.requests.document import JobRequest
    from meshdeform.settings import Settings

__all__ = ["inspect"]

_SHOWN = 40


@clean_errors
def inspect(
    asset: Annotated[Path, typer.Argument(help="A GLB, OBJ, PLY or STL.", exists=True, dir_okay=False, readable=True)],
    prompt: Annotated[
        str, typer.Option(help="Also find the side that a job with this prompt would make the front.")
    ] = "",
    also: AlsoOption = None,
    model: ModelOption = None,
    param: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show what can be selected in ASSET, and propose components that should keep their shape.

    Congruent parts and round ones are proposed, each with the options of `run` and `submit` that keep them.

    meshdeform inspect truck.glb

    meshdeform inspect truck.glb --prompt "a car"
    """
    require("torch", "deform")
    from meshdeform.assets import Limits, load_asset
    from meshdeform.runs.inspection import inspect_parts

    settings = load_settings()
    data = asset.read_bytes()
    found = inspect_parts(load_asset(data, asset.name, Limits.from_settings(settings)))
    if prompt or also:
        written = merge_params(param or [], model=model, prompts=parse_also(also))
        request = make_request(prompt, {"orientation": "auto", **written})
        found["orientation"] = _front(data, asset.name, find_taught(request, settings), settings)
    if as_json:
        emit(found)
        return
    typer.echo(_described(found))
    if prompt or also:
        typer.echo(f"\n{orientation_line(found['orientation'])}")
    for warning in found["warnings"]:
        typer.echo(warning, err=True)


def _front(data: bytes, filename: str, request: JobRequest, settings: Settings) -> dict[str, Any]:
    """Return the orientation that a job would have, as its report would describe it."""
    from meshdeform.assets import Limits
    from meshdeform.priors import load_prior
    from meshdeform.runs import text_deform, text_deform_checks
    from meshdeform.runs.devices import resolve_device, use_threads

    named = [request.params.model] if request.params.model else []
    params = text_deform_checks.check(
        request, default_model=settings.model, allowed_models=named, revision=settings.model_revision
    )
    revision = settings.model_revision if params.model == settings.model else ""
    use_threads(settings.threads)
    device = resolve_device(settings.device)
    prior = load_prior(params.model, device=device, revision=revision, dtype=settings.dtype)
    limits = Limits.from_settings(settings)
    run = text_deform.start(
        asset=data, filename=filename, request=request, prior=prior, limits=limits, device=device, resolved=params
    )
    return run.orientation.to_dict()


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
    lines += ["", *_selectable(found)]
    for proposal in found["proposals"][:_SHOWN]:
        lines += ["", _sentence(proposal, names)]
    return "\n".join(lines)


def _selectable(found: dict[str, Any]) -> list[str]:
    """Return lines about what else `--keep` and `--only` can refer to."""
    low, high = (", ".join(f"{value:.6g}" for value in found["box"][end]) for end in ("min", "max"))
    lines = [f"Coordinates {low} to {high}"]
    for title, what in (("Meshes", "mesh_names"), ("Joints", "joints")):
        listed = found[what][:_SHOWN]
        if listed:
            named = plain(", ".join(f"{item['index']} {item['name']}".strip() for item in listed))
            lines.append(f"{title} {named}{' ...' if len(found[what]) > _SHOWN else ''}")
    if found["colors"]:
        lines.append("It has vertex colours.")
    if found["symmetry"]:
        lines.append(f"Symmetric along {', '.join(found['symmetry'])}.")
    return lines


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
