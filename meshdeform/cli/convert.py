"""`meshdeform convert`: an asset as OBJ or STL."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import ForceOption, JsonOption
from meshdeform.cli.output import emit, plain
from meshdeform.errors import ParameterError, UnavailableError

if TYPE_CHECKING:
    from meshdeform.assets.world import Edges, Unit, Up

__all__ = ["convert"]

_ENDINGS = (".obj", ".zip", ".stl")


@dataclass(frozen=True)
class _Made:
    files: dict[Path, bytes]
    facts: dict[str, Any]
    words: str


@clean_errors
def convert(
    asset: Annotated[Path, typer.Argument(help="A GLB; or a glTF, OBJ, PLY, STL or ZIP.", exists=True, dir_okay=False)],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="The file to write; its ending says the format: .obj (with .mtl and textures/ beside it), .zip (the "
            "same in one file) or .stl.",
        ),
    ],
    up: Annotated[Literal["y", "z"], typer.Option(help="The axis that points up. Slicers expect z.")] = "y",
    unit: Annotated[Literal["m", "cm", "mm"], typer.Option(help="The unit of lengths. Slicers expect mm.")] = "m",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write ASSET as OBJ or STL, and say whether its surface is closed.

    meshdeform convert mushroom.glb -o mushroom.obj.zip

    meshdeform convert mushroom.glb -o mushroom.stl --up z --unit mm
    """
    require("numpy", "asset")
    ending = output.suffix.lower()
    if ending not in _ENDINGS:
        raise typer.BadParameter(f"{output.name} ends in none of {', '.join(_ENDINGS)}", param_hint="--output")
    made = _made(asset, output, up, unit)
    if output.exists() and output.samefile(asset):
        raise ParameterError(f"{output} is the input of this command.", advice="Choose another name with -o.")
    taken = [path for path in made.files if path.exists()]
    if taken and not force:
        raise ParameterError(f"{taken[0]} exists.", advice="Choose another name with -o, or overwrite it with --force.")
    _write(made.files)
    if as_json:
        emit({"files": [str(path) for path in made.files], **made.facts})
        return
    for path in made.files:
        typer.echo(plain(str(path)))
    typer.echo(plain(made.words), err=True)


def _made(source: Path, output: Path, up: Up, unit: Unit) -> _Made:
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.assets.world import Frame

    limits = Limits.from_settings(load_settings())
    asset = load_asset(read_with_files(source, limits), source.name, limits)
    frame, ending = Frame(up, unit), output.suffix.lower()
    scene = asset.scene()
    if ending == ".stl":
        from meshdeform.assets.stl_file import write_stl

        stl = write_stl(scene, frame)
        return _Made({output: stl.data}, *_facts(stl.triangles, stl.edges, frame.words, {}))
    from meshdeform.assets.obj_file import write_obj

    stem = output.name[: -len(ending)].removesuffix(".obj")
    obj = write_obj(scene, frame, stem)
    facts = _facts(obj.triangles, obj.edges, frame.words, obj.left_out)
    if ending == ".zip":
        return _Made({output: obj.to_zip()}, *facts)
    return _Made({output.parent / name: data for name, data in obj.files.items()}, *facts)


def _facts(triangles: int, edges: Edges, frame: str, left_out: dict[str, int]) -> tuple[dict[str, Any], str]:
    facts = {
        "triangles": triangles,
        "closed": edges.closed,
        "open_edges": edges.open,
        "tangled_edges": edges.tangled,
        "left_out": left_out,
    }
    without = f" Left out: {_listed(left_out)}." if left_out else ""
    return facts, f"{triangles:,} triangles in {frame}; {edges.words}.{without}"


def _listed(left_out: dict[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in sorted(left_out.items()))


def _write(files: dict[Path, bytes]) -> None:
    from meshdeform.support.files import write_files

    first = next(iter(files))
    try:
        for folder in {path.parent for path in files}:
            folder.mkdir(parents=True, exist_ok=True)
        write_files(files)
    except OSError as error:
        raise UnavailableError(
            f"{first} cannot be written: {error}.", advice="Choose another place with -o."
        ) from error
