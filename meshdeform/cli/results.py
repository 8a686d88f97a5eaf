"""Make files of an asset or a result without a new run: `meshdeform apply`, `animate` and `convert`."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from meshdeform.assets.export import WRITTEN, ending_of, export
from meshdeform.assets.pose import Pose
from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_request, with_options, written
from meshdeform.cli.local import check_free, read_asset, write_all
from meshdeform.cli.options import (
    MAX_STRENGTH,
    ForceOption,
    JsonOption,
    file_argument,
    file_option,
    flag,
    option,
    output_option,
)
from meshdeform.cli.output import emit, plain
from meshdeform.cli.request import make_request
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.assets import Asset, Limits
    from meshdeform.deformation.edit_map import EditMap
    from meshdeform.requests.document import MorphParams
    from meshdeform.settings import Settings

_ANIMATED = (".webp", ".gif")
_MAP = ".safetensors"


@clean_errors
@with_options(of_request("output", "Morph", only=("morph_path",)))
def apply(
    ctx: typer.Context,
    files: Annotated[list[Path], file_argument("The deformed GLB. With --map, the files to deform alike.")],
    strength: Annotated[
        float, option("0: the source; 1: the result; more: exaggerated.", min=0.0, max=MAX_STRENGTH)
    ] = 1.0,
    source: Annotated[
        Path | None, file_option("The asset that was deformed. Default: the one that the report beside RESULT names.")
    ] = None,
    output: Annotated[
        Path | None,
        output_option(
            "The GLB to write; of several files, the folder. A name in .safetensors: the map of RESULT, for --map. "
            "Default: RESULT-60.glb, or FILE-edited.glb with --map."
        ),
    ] = None,
    edit: Annotated[
        Path | None,
        typer.Option("--map", help="Deform FILES as this deformed GLB was, or by a map.", exists=True, dir_okay=False),
    ] = None,
    outside: Annotated[
        Literal["refuse", "rigid"], option("Of pieces that reach out of what the map deforms, with --map.")
    ] = "refuse",
    morph: Annotated[bool, flag("--morph", "Instead: the whole way, as an animation.")] = False,
    compact: Annotated[bool, flag("--compact", "Drop data that the new shape made unused.")] = False,
    force: ForceOption = False,
) -> None:
    """Write RESULT at another strength, or its morph; or deform other files as it was. Needs no new run.

    meshdeform apply mushroom.glb --strength 0.6 --source examples/sphere.glb

    meshdeform apply mushroom.glb --morph --frames 12 --ping-pong

    meshdeform apply lod1.glb lod2.glb collision.glb --map knight.glb -o edited
    """
    require("scipy", "deform")
    output_options = written(ctx, "output")
    morph = morph or bool(output_options)
    if edit is not None:
        if morph:
            raise typer.BadParameter("a map has no morph; leave --map or the options of the morph out")
        _apply_map(edit, files, output, source, strength, outside, compact=compact, force=force)
        return
    if len(files) > 1:
        raise typer.BadParameter("name one result; to deform several files as another one was, give that one as --map")
    (result,) = files
    way = make_request("", {}, output=output_options).output.morph_path
    ending = "morph" if morph else f"{100 * strength:g}"
    path = output or result.with_name(f"{result.stem}{'.' if morph else '-'}{ending}.glb")
    check_free([path], [result, source], force=force)
    if path.suffix.lower() == _MAP:
        write_all({path: _map_of(result, source, strength).to_bytes()}, what=path)
    else:
        write_all({path: _at_strength(result, source, strength, way, morph=morph, compact=compact)}, what=path)
    typer.echo(path)


def _apply_map(
    edit: Path,
    files: list[Path],
    output: Path | None,
    source: Path | None,
    strength: float,
    outside: Literal["refuse", "rigid"],
    *,
    compact: bool,
    force: bool,
) -> None:
    from meshdeform.assets import Limits
    from meshdeform.deformation.edit_map import EditMap, Outside
    from meshdeform.runs.strength import with_edit

    if output is not None and len(files) > 1 and output.suffix:
        raise typer.BadParameter("of several files, name a folder", param_hint="--output")
    names = [f"{path.stem}-edited.glb" if output is None else f"{path.stem}.glb" for path in files]
    if output is None or len(files) == 1:
        paths = [output or path.with_name(name) for path, name in zip(files, names, strict=True)]
    else:
        paths = [output / name for name in names]
    if len(set(paths)) < len(paths):
        raise typer.BadParameter("two files have the same name; deform them one by one")
    is_map = edit.suffix.lower() == _MAP
    if is_map and strength != 1:
        raise typer.BadParameter("a map has one strength; give the deformed GLB as --map")
    check_free(paths, [*files, edit, source], force=force)
    carried = EditMap.read(str(edit)) if is_map else _map_of(edit, source, strength)
    limits = Limits.from_settings(load_settings())
    for file, path in zip(files, paths, strict=True):
        applied = with_edit(read_asset(file, limits), carried, Outside(outside), compact=compact)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_all({path: applied}, what=path)
        typer.echo(path)


def _read(result: Path, source: Path | None) -> tuple[bytes, Asset, list[str | int], Limits]:
    """Return the bytes of a result, its source, and what its run excluded, and set the threads."""
    from meshdeform.assets import Limits
    from meshdeform.runs.devices import use_threads

    settings = load_settings()
    use_threads(settings.threads)
    data = result.read_bytes()
    limits = Limits.from_settings(settings)
    report = _report_of(result, hashlib.sha256(data).hexdigest())
    return data, _source(result, report, source, limits), report["params"].get("exclude", []), limits


def _map_of(result: Path, source: Path | None, strength: float) -> EditMap:
    from meshdeform.runs.strength import edit_of

    data, asset, exclude, limits = _read(result, source)
    return edit_of(asset, data, strength, exclude=exclude, limits=limits)


def _at_strength(
    result: Path, source: Path | None, strength: float, way: MorphParams, *, morph: bool, compact: bool
) -> bytes:
    from meshdeform.runs.strength import AssetPath, matched, with_strength, write_morph
    from meshdeform.runs.surfaces import read_result

    data, asset, exclude, limits = _read(result, source)
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
        return read_asset(source, limits)
    recorded = report["input"]
    if not recorded:
        raise ParameterError(
            f"Beside {result.name} there is no report that names the asset it was made from.",
            advice="Name the asset with --source.",
        )
    name = Path(recorded["filename"]).name
    for folder in dict.fromkeys((result.parent.absolute(), Path.cwd())):
        if (folder / name).is_file():
            content = read_with_files(folder / name, limits)
            if hashlib.sha256(content).hexdigest() == recorded["sha256"]:
                return load_asset(content, name, limits)
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


@clean_errors
def animate(
    source: Annotated[Path, typer.Argument(help="The asset before; alone: the asset to turn.", exists=True)],
    result: Annotated[Path | None, typer.Argument(help="Its deformed GLB.", exists=True)] = None,
    output: Annotated[Path, output_option("The .webp or .gif to write.")] = Path("animation.webp"),
    force: ForceOption = False,
) -> None:
    """Draw SOURCE becoming RESULT and back, or one turn of SOURCE.

    meshdeform animate examples/sphere.glb mushroom.glb -o mushroom.webp

    meshdeform animate mushroom.glb -o turn.gif
    """
    require("scipy", "deform")
    check_animation(output, "--output")
    check_free([output], [source, result], force=force)
    write_all({output: drawn_animation(source, result, output.suffix, load_settings())}, what=output)
    typer.echo(output)


def check_animation(path: Path, option: str) -> None:
    """Refuse a path whose suffix names no animated format, as a `typer.BadParameter`."""
    if path.suffix.lower() not in _ANIMATED:
        raise typer.BadParameter(f"{path.name} ends in neither .webp nor .gif", param_hint=option)


def drawn_animation(source: Path, result: Path | None, suffix: str, settings: Settings) -> bytes:
    """Return a picture of a source that becomes its result, or of one turn of a source without one."""
    from meshdeform.assets import Limits
    from meshdeform.rendering.studio import FORMATS, SurfaceState, morph_animation, turntable_animation
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.surfaces import read_result, subdivided

    use_threads(settings.threads)
    limits = Limits.from_settings(settings)
    asset = read_asset(source, limits)
    before, kind = SurfaceState(asset.surface.positions, asset.surface.normals), FORMATS[suffix.lower()]
    if result is None:
        return turntable_animation(asset.appearance(), before, kind=kind)
    after = read_result(result.read_bytes()).surface
    if len(asset.surface.triangles) < len(after.triangles):
        asset, _ = subdivided(asset, limits)
        before = SurfaceState(asset.surface.positions, asset.surface.normals)
    if asset.surface.triangles.tobytes() != after.triangles.tobytes():
        raise ParameterError(
            f"{result.name} was not made from {source.name}: their triangles differ.",
            advice="Name the asset that was deformed, then its result.",
        )
    return morph_animation(asset.appearance(), before, SurfaceState(after.positions, after.normals), kind=kind)


@clean_errors
def convert(
    asset: Annotated[Path, file_argument("A GLB; or a glTF, OBJ, PLY, STL or ZIP.")],
    target: Annotated[
        Path | None, typer.Argument(help=f"The file to write; its ending says the format: {', '.join(WRITTEN)}.")
    ] = None,
    output: Annotated[Path | None, output_option("The same. Default with --pose: FILE-posed.glb.")] = None,
    pose: Annotated[
        str | None,
        option("CLIP@SECONDS: as the asset stands then, without its rig. A clip by name, or by number from 0."),
    ] = None,
    up: Annotated[
        Literal["y", "z"] | None, option("Of STL and OBJ: the axis that points up. Slicers expect z. Default: y.")
    ] = None,
    unit: Annotated[
        Literal["m", "cm", "mm"] | None,
        option("Of STL, OBJ and 3MF: the unit of lengths. Slicers expect mm. Default: m; for 3MF mm."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write ASSET in another format, and say what the format cannot hold, and of an STL whether it is closed.

    meshdeform convert scan.ply scan.glb

    meshdeform convert fox.glb fox.usdz

    meshdeform convert knight.glb knight.stl --pose "Idle@0.5" --up z --unit mm
    """
    require("numpy", "asset")
    if (target is None) == (output is None) and (target is not None or pose is None):
        raise typer.BadParameter("name one file to write", param_hint="--output")
    output = target or output or asset.with_name(f"{asset.stem}-posed.glb")
    ending_of(output.name)
    moment = None if pose is None else Pose.parse(pose)
    check_free([output], [asset], force=force)
    from meshdeform.assets import Limits

    read = read_asset(asset, Limits.from_settings(load_settings()))
    made = export(read, output.name, pose=moment, up=up, unit=unit)
    files = {output.parent / name: data for name, data in made.files.items()}
    check_free([path for path in files if path != output], [asset], force=force)
    write_all(files, what=output)
    if as_json:
        emit(
            {"file": str(output), "files": [str(path) for path in files], **made.facts, "warnings": list(made.warnings)}
        )
        return
    typer.echo(plain(str(output)))
    typer.echo(plain("\n".join([_described(made.facts), *made.warnings])), err=True)


def _described(facts: dict[str, Any]) -> str:
    """Return what is known of a converted asset, in words."""
    words = f"{facts['triangles']:,} triangles"
    if "closed" in facts:
        words += f"; the surface is {'closed' if facts['closed'] else 'not closed'}"
    if any(facts.get("origin", ())):
        moved = ", ".join(f"{value:g}" for value in facts["origin"])
        words += f". It lies far from the origin: places are relative to ({moved}), as the file's header says"
    return f"{words}."
