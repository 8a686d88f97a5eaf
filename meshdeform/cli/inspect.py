"""`meshdeform inspect`: show what an asset consists of, and which parts should keep their shape."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, overlaid, with_options, written
from meshdeform.cli.local import LocalJob, read_asset
from meshdeform.cli.options import ForceOption, JsonOption, SetOption, file_argument, option
from meshdeform.cli.output import emit, plain, table
from meshdeform.cli.parted import PartsAsOption, PartsGlbOption, check_parts_glb, write_parts_glb
from meshdeform.cli.report_lines import orientation_line
from meshdeform.cli.request import ALSO, make_request, merge_params
from meshdeform.errors import ParameterError
from meshdeform.requests.choices import PartsAs

if TYPE_CHECKING:
    from meshdeform.requests.document import JobRequest

_SHOWN = 40
_READ = ("guidance.model", "guidance.source_noun", "guidance.prompts")


@clean_errors
@with_options(of_kind("text_deform", short=ALSO, only=_READ))
def inspect(
    ctx: typer.Context,
    asset: Annotated[Path, file_argument("A GLB, OBJ, PLY or STL.")],
    prompt: Annotated[str, option("Also find the side that a job with this prompt would make the front.")] = "",
    parts_glb: PartsGlbOption = None,
    parts_as: PartsAsOption = PartsAs.ATTRIBUTE,
    param: SetOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show what can be selected in ASSET, and propose components that should keep their shape.

    Congruent parts and round ones are proposed, each with the options of `run` that keep them.

    meshdeform inspect truck.glb

    meshdeform inspect truck.glb --prompt "a car"

    meshdeform inspect truck.glb --parts-glb truck-parts.glb
    """
    require("torch", "deform")
    check_parts_glb(parts_glb, asset, force=force)
    from meshdeform.assets import Limits
    from meshdeform.runs.control import inspect_parts

    source = read_asset(asset, Limits.from_settings(load_settings()))
    parts = inspect_parts(source)
    if parts_glb is not None:
        typer.echo(write_parts_glb(parts_glb, source, parts_as), err=True)
    prompted = bool(prompt or written(ctx).get("guidance", {}).get("prompts"))
    if prompted:
        params = overlaid({"guidance": {"orientation": "auto"}}, merge_params(ctx, param))
        parts["orientation"] = _front(asset, make_request(prompt, params))
    if as_json:
        emit(parts)
        return
    typer.echo(_described(parts))
    if prompted:
        typer.echo(f"\n{orientation_line(parts['orientation'])}")
    for warning in parts["warnings"]:
        typer.echo(warning, err=True)


def _front(asset: Path, request: JobRequest) -> dict[str, Any]:
    """Return the orientation that a job would have, as its report would describe it."""
    from meshdeform.runs.text_deform import TextDeformRun

    job = LocalJob(request, {"asset": asset}, {}, load_settings())
    job.check(force=True)
    run = job.start()
    if not isinstance(run, TextDeformRun):
        raise ParameterError("The prompt is a change in plain words, which has no front.", advice="Leave it out.")
    return run.orientation.to_dict()


def _described(parts: dict[str, Any]) -> str:
    names = {what: {part["index"]: part["name"] for part in parts[what]} for what in ("nodes", "materials")}
    components = parts["components"]
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
    lines += ["", *_selectable(parts)]
    for proposal in parts["proposals"][:_SHOWN]:
        lines += ["", _sentence(proposal, names)]
    return "\n".join(lines)


def _selectable(parts: dict[str, Any]) -> list[str]:
    """Return lines about what else `--keep` and `--only` can refer to."""
    low, high = (", ".join(f"{value:.6g}" for value in parts["box"][end]) for end in ("min", "max"))
    lines = [f"Coordinates {low} to {high}"]
    for title, what in (("Meshes", "mesh_names"), ("Joints", "joints")):
        listed = parts[what][:_SHOWN]
        if listed:
            named = plain(", ".join(f"{item['index']} {item['name']}".strip() for item in listed))
            lines.append(f"{title} {named}{' ...' if len(parts[what]) > _SHOWN else ''}")
    if parts["colors"]:
        lines.append("It has vertex colours.")
    if parts["parts"]:
        lines.append(f"Parts that words can name: {plain(', '.join(parts['parts'][:_SHOWN]))}.")
    if parts["symmetry"]:
        lines.append(f"Symmetric along {', '.join(parts['symmetry'])}.")
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
