"""`meshdeform convert`: an asset as GLB or STL."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import ForceOption, JsonOption
from meshdeform.cli.output import emit, plain
from meshdeform.errors import ParameterError

__all__ = ["convert"]

_ENDINGS = (".glb", ".stl")
_OBJ = (
    "OBJ is not written any more. Convert the GLB with Blender, which keeps its materials: "
    "docs/recipes.md has the command for USDZ, and wm.obj_export writes OBJ."
)


@clean_errors
def convert(
    asset: Annotated[Path, typer.Argument(help="A GLB; or a glTF, OBJ, PLY, STL or ZIP.", exists=True, dir_okay=False)],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The file to write; its ending says the format: .glb or .stl.")
    ],
    up: Annotated[Literal["y", "z"], typer.Option(help="Of an STL: the axis that points up. Slicers expect z.")] = "y",
    unit: Annotated[
        Literal["m", "cm", "mm"], typer.Option(help="Of an STL: the unit of lengths. Slicers expect mm.")
    ] = "m",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write ASSET as GLB or STL, and say of an STL whether its surface is closed.

    meshdeform convert scan.ply -o scan.glb

    meshdeform convert mushroom.glb -o mushroom.stl --up z --unit mm
    """
    require("numpy", "asset")
    ending = output.suffix.lower()
    if ending == ".obj" or output.name.lower().endswith(".obj.zip"):
        raise ParameterError(_OBJ, advice="Choose .glb or .stl.")
    if ending not in _ENDINGS:
        raise typer.BadParameter(f"{output.name} ends in none of {', '.join(_ENDINGS)}", param_hint="--output")
    check_free([output], [asset], force=force)
    data, facts, words = _converted(asset, ending, up, unit)
    write_all({output: data}, what=output)
    if as_json:
        emit({"file": str(output), **facts})
        return
    typer.echo(plain(str(output)))
    typer.echo(plain(words), err=True)


def _converted(
    source: Path, ending: str, up: Literal["y", "z"], unit: Literal["m", "cm", "mm"]
) -> tuple[bytes, dict[str, Any], str]:
    """Return the file, and what is known of it as JSON and in words."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.bundle import read_with_files

    limits = Limits.from_settings(load_settings())
    asset = load_asset(read_with_files(source, limits), source.name, limits)
    if ending == ".glb":
        warnings = list(asset.summary.warnings)
        triangles = len(asset.surface.triangles)
        words = "\n".join([f"{triangles:,} triangles.", *warnings])
        return asset.to_bytes(), {"triangles": triangles, "warnings": warnings}, words
    from meshdeform.assets.stl_file import write_stl

    stl = write_stl(asset, up, unit)
    closed = "closed" if stl.closed else "not closed"
    facts = {"triangles": stl.triangles, "closed": stl.closed, "origin": list(stl.origin)}
    words = f"{stl.triangles:,} triangles in {unit}, +{up.upper()} up; the surface is {closed}."
    if any(stl.origin):
        moved = ", ".join(f"{value:g}" for value in stl.origin)
        words += f"\nThe surface lies far from the origin: places are relative to ({moved}), as the file's header says."
    return stl.data, facts, words
