"""`meshdeform apply`: another strength of a result, without a new run, or its morph."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_request, written
from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import MAX_STRENGTH, ForceOption
from meshdeform.cli.request import make_request
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.assets import Asset, Limits
    from meshdeform.requests.morph import MorphPath

__all__ = ["ApplyCommand", "apply"]

ApplyCommand = form_command(of_request("output", "Morph", only=("morph_path",)))


@clean_errors
def apply(
    ctx: typer.Context,
    result: Annotated[Path, typer.Argument(help="The deformed GLB.", exists=True, dir_okay=False)],
    strength: Annotated[
        float,
        typer.Option(help="0: the source; 1: the result; more: exaggerated.", min=0.0, max=MAX_STRENGTH),
    ] = 1.0,
    source: Annotated[
        Path | None,
        typer.Option(
            help="The asset that was deformed. Default: the one that the report beside RESULT names.",
            exists=True,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The GLB to write. Default: RESULT-60.glb.", show_default=False),
    ] = None,
    morph: Annotated[bool, typer.Option("--morph", help="Instead: the whole way, as an animation.")] = False,
    compact: Annotated[bool, typer.Option("--compact", help="Drop data that the new shape made unused.")] = False,
    force: ForceOption = False,
) -> None:
    """Write RESULT at another strength, or its morph. Needs the asset that was deformed, and no new run.

    meshdeform apply mushroom.glb --strength 0.6 --source examples/sphere.glb

    meshdeform apply mushroom.glb --morph --frames 12 --ping-pong
    """
    require("torch", "deform")
    output_options = written(ctx, "output")
    morph = morph or bool(output_options)
    way = make_request("", {}, output=output_options).output.morph_path
    ending = "morph" if morph else f"{100 * strength:g}"
    path = output or result.with_name(f"{result.stem}{'.' if morph else '-'}{ending}.glb")
    check_free([path], [result, source], force=force)
    write_all({path: _made(result, source, strength, way, morph=morph, compact=compact)}, what=path)
    typer.echo(path)


def _made(result: Path, source: Path | None, strength: float, way: MorphPath, *, morph: bool, compact: bool) -> bytes:
    from meshdeform.assets import Limits
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.preparation import read_result
    from meshdeform.runs.strength import AssetPath, matched, with_strength, write_morph

    settings = load_settings()
    use_threads(settings.threads)
    data = result.read_bytes()
    limits = Limits.from_settings(settings)
    report = _report_of(result, hashlib.sha256(data).hexdigest())
    asset = _source(result, report, source, limits)
    exclude = report["params"].get("exclude", [])
    if not morph:
        return with_strength(asset, data, strength, exclude=exclude, limits=limits, compact=compact)
    asset, end = matched(asset, read_result(data), exclude, limits)
    path = AssetPath(asset, end.surface.positions)
    return write_morph(asset, path, path.at(1), way, compact=compact, provenance=end.provenance)


def _source(result: Path, report: dict[str, Any], source: Path | None, limits: Limits) -> Asset:
    """Return the asset that was deformed, or raise ParameterError if it was not given and is not found."""
    from meshdeform.assets import load_asset
    from meshdeform.assets.bundle import read_with_files

    if source is not None:
        return load_asset(read_with_files(source, limits), source.name, limits)
    wanted = report["input"]
    if not wanted:
        raise ParameterError(
            f"Beside {result.name} there is no report that names the asset it was made from.",
            advice="Name the asset with --source.",
        )
    name = Path(wanted["filename"]).name
    for folder in dict.fromkeys((result.parent.absolute(), Path.cwd())):
        if (folder / name).is_file():
            found = read_with_files(folder / name, limits)
            if hashlib.sha256(found).hexdigest() == wanted["sha256"]:
                return load_asset(found, name, limits)
    raise ParameterError(
        f"{result.name} was made from {name}, which is neither beside it nor in this folder, or has changed.",
        advice="Name the asset with --source.",
    )


def _report_of(result: Path, sha256: str) -> dict[str, Any]:
    """Return `input` and `params` of the report of this very result; empty ones if there is none."""
    for path in (result.with_suffix(".report.json"), result.with_name("report.json")):
        try:
            report = json.loads(path.read_bytes())
            if report["result"]["sha256"] == sha256 and {"filename", "sha256"} <= report["input"].keys():
                return {"input": dict(report["input"]), "params": dict(report["params"])}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
    return {"input": {}, "params": {}}
