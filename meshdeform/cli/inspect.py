"""`meshdeform inspect`: show what an asset consists of, and which parts should keep their shape."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, overlaid, with_options
from meshdeform.cli.local import check_locally
from meshdeform.cli.options import ForceOption, JsonOption, SetOption, file_argument, option
from meshdeform.cli.output import emit, plain, table
from meshdeform.cli.parted import PartsAsOption, PartsGlbOption, check_parts_glb, write_parts_glb
from meshdeform.cli.report_lines import reading_lines
from meshdeform.cli.request import make_request, merge_params
from meshdeform.requests.choices import PartsAs

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.requests.document import ResolvedParams
    from meshdeform.runs.reading import ReadingSource

_SHOWN = 40
_READ = ("guidance.source_noun",)


@clean_errors
@with_options(of_kind("text_deform", only=_READ))
def inspect(
    ctx: typer.Context,
    asset: Annotated[Path, file_argument("A GLB, OBJ, PLY or STL.")],
    front: Annotated[
        float | None, option("Where it faces, in degrees: 0 is +Z, 90 is +X. Default: found.", min=-360, max=360)
    ] = None,
    parts_glb: PartsGlbOption = None,
    parts_as: PartsAsOption = PartsAs.ATTRIBUTE,
    param: SetOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show what ASSET is and what its parts are, what can be selected, and components that should keep their shape.

    What it is, and where it faces, can be corrected. Congruent components and round ones are proposed, each with the
    options of `run` that keep them.

    meshdeform inspect truck.glb

    meshdeform inspect truck.glb --source-noun truck --front 90

    meshdeform inspect truck.glb --parts-glb truck-parts.glb
    """
    require("scipy", "deform")
    check_parts_glb(parts_glb, asset, force=force)
    from meshdeform.runs.control import inspect_parts
    from meshdeform.words import WordFolder, in_use

    given = {} if front is None else {"guidance": {"orientation": front}}
    params = overlaid(merge_params(ctx, param), given)
    own = WordFolder(load_settings().words_folder).words()
    with in_use(own):
        loaded, resolved, source = _read(asset, params)
        resolved = resolved.model_copy(update={"words": {word.noun: word.sha256 for word in own}})
        parts = inspect_parts(loaded, resolved, source)
        if parts_glb is not None:
            typer.echo(write_parts_glb(parts_glb, loaded, parts_as, resolved, source), err=True)
    if as_json:
        emit(parts)
        return
    typer.echo(_described(parts))
    for warning in parts["warnings"]:
        typer.echo(warning, err=True)


def _read(path: Path, params: dict[str, Any]) -> tuple[Asset, ResolvedParams, ReadingSource]:
    """Return an asset, what the parameters say of it, and where its reading is kept."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.requests.choices import BackdropMode
    from meshdeform.requests.default_kind import with_kind
    from meshdeform.requests.document import resolve
    from meshdeform.runs.base import sha256_hex
    from meshdeform.runs.kept_readings import FolderReadings
    from meshdeform.runs.reading import ReadingSource

    settings, limits = load_settings(), Limits.from_settings(load_settings())
    guidance = {name: value for name, value in params.get("guidance", {}).items() if name != "prompts"}
    request = make_request("taller", {**params, "guidance": guidance})  # any change: it needs no model
    request = with_kind(request, settings.model, ["asset"])
    check_locally(request, settings, ["asset"])
    resolved = resolve(request.params, default_model=settings.model)
    resolved = resolved.model_copy(update={"exclude": (), "backdrop": BackdropMode.LEAVE})  # all of it is shown
    data = read_with_files(path, limits)
    source = ReadingSource(sha256_hex(data), path.name, kept=FolderReadings(settings.cache_folder))
    return load_asset(data, path.name, limits), resolved, source


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
    lines += [*reading_lines(parts["reading"]), *_parts_line(parts["parts"])]
    if parts["symmetry"]:
        lines.append(f"Symmetric along {', '.join(parts['symmetry'])}.")
    return lines


def _parts_line(parts: list[dict[str, Any]]) -> list[str]:
    """Return a line about the parts that words can name, each with how sure it is or what says so."""
    told = [
        f"{part['name']} ({part['found_by'] if part['confidence'] is None else format(part['confidence'], '.0%')})"
        for part in parts[:_SHOWN]
    ]
    return [f"Parts that words can name: {plain(', '.join(told))}."] if told else []


def _sentence(proposal: dict[str, Any], names: dict[str, dict[int, str]]) -> str:
    """Return a proposal in words, with the options that accept it."""
    numbers = proposal["components"]
    kind = " ".join(word for word in ("congruent", "round") if proposal[word])
    listed = ", ".join(map(str, numbers))
    what = f"{len(numbers)} {kind} components: {listed}." if len(numbers) > 1 else f"Component {listed} is {kind}."
    options = " ".join(f"--rigid {what}={index}" for item in proposal["selectors"] for what, index in item.items())
    called = {
        name
        for item in proposal["selectors"]
        for what, index in item.items()
        if (name := names.get(f"{what}s", {}).get(index))
    }
    return f"{what} Keep them with {options}{' (' + plain(', '.join(sorted(called))) + ')' if called else ''}"


def _names(names: dict[int, str], indices: list[int]) -> str:
    return plain(", ".join(f"{index} {names.get(index, '')}".strip() for index in indices[:3]))
