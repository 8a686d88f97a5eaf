"""`meshdeform surface-fit` and `unfold`: fit a neural displacement field to a surface, and make a mesh of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_kind, overlaid, written
from meshdeform.cli.local import check_free, check_glb, run_here, write_all
from meshdeform.cli.options import Here, Printed, SetOption
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import make_request, merge_params
from meshdeform.cli.written import ANCHOR
from meshdeform.errors import AssetError, ParameterError

__all__ = ["SurfaceFitCommand", "surface_fit", "unfold"]

_FIT = "Base, network and fit"
_MAX_FACES = 4_000_000

SurfaceFitCommand = form_command(of_kind("surface_fit", _FIT, short=ANCHOR))


def _file(text: str) -> Any:
    return typer.Option(help=text, exists=True, dir_okay=False, rich_help_panel=_FIT, show_default=False)


@clean_errors
def surface_fit(
    ctx: typer.Context,
    surface: Annotated[
        Path,
        typer.Argument(
            help="A mesh, oriented points (PLY, XYZ), a signed distance grid (NPZ) or a network (safetensors).",
            exists=True,
            dir_okay=False,
            readable=True,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="The .ndf to write, or a .glb of the finest level with the .ndf beside it. Default: SURFACE.ndf here.",
            show_default=False,
        ),
    ] = None,
    meshes: Annotated[
        bool, typer.Option("--meshes", help="Also write each level as a GLB, and the intrinsic triangulation.")
    ] = False,
    base: Annotated[
        Path | None, _file("A base mesh of its own, instead of one made from SURFACE; its holes may be others.")
    ] = None,
    scalars: Annotated[
        Path | None, _file("Values at points near SURFACE, an NPZ, to learn along it and to keep in the .ndf.")
    ] = None,
    param: SetOption = None,
    *,
    here: Here,
    printed: Printed,
) -> None:
    """Fit a neural displacement field to SURFACE: a coarse mesh and a small network, a few kilobytes together.

    meshdeform surface-fit bunny.obj -o bunny.ndf

    meshdeform surface-fit scan.ply --base-faces 2000 --steps 3000 --meshes

    meshdeform surface-fit points.xyz -o mesh.glb
    """
    require("torch", "deform")
    output = output or Path(f"{surface.stem}.ndf")
    mesh = output if output.suffix.lower() == ".glb" else None
    output = output.with_suffix(".ndf") if mesh else output
    if output.suffix.lower() != ".ndf":
        raise typer.BadParameter(f"{output.name} is neither a .ndf nor a .glb", param_hint="--output")
    params = overlaid(merge_params(param or []), written(ctx))
    request = make_request("", params, more={"kind": "surface_fit"})
    level: int = request.params.level  # type: ignore[attr-defined]
    files = {part: path for part, path in (("asset", surface), ("base", base), ("scalars", scalars)) if path}
    paths = _paths(output, level if meshes else None)
    if mesh is not None:
        paths[f"level_{level}.glb"] = mesh
    run = run_here(request, files, paths, here, quiet=printed.quiet)
    print_result(request.kind, run, paths, printed)


def _paths(output: Path, level: int | None) -> dict[str, Path]:
    """Return where each artifact goes; `level` also asks for the meshes."""
    paths = {
        "surface.ndf": output,
        "report.json": output.with_suffix(".report.json"),
        "preview.png": output.with_suffix(".preview.png"),
    }
    if level is not None:
        paths |= {f"level_{k}.glb": output.with_suffix(f".level_{k}.glb") for k in range(level + 1)}
        paths["intrinsic.npz"] = output.with_suffix(".intrinsic.npz")
    return paths


@clean_errors
def unfold(
    field: Annotated[Path, typer.Argument(help="The .ndf.", exists=True, dir_okay=False, readable=True)],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The GLB to write. Default: FIELD.glb here.", show_default=False),
    ] = None,
    level: Annotated[
        int, typer.Option(min=0, max=8, help="Each level has four times the faces of the one before.")
    ] = 2,
    intrinsic: Annotated[
        Path | None,
        typer.Option(help="Also write the intrinsic Delaunay triangulation to this .npz.", show_default=False),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Unfold FIELD, a file that surface-fit wrote, into a mesh.

    meshdeform unfold bunny.ndf --level 3 -o bunny.glb
    """
    require("numpy", "asset")
    output = output or Path(f"{field.stem}.glb")
    check_glb(output)
    check_free([path for path in (output, intrinsic) if path is not None], [field], force=force)
    from meshdeform.fields.level_files import intrinsic_npz, level_glb
    from meshdeform.fields.reader import read_field

    try:
        surface = read_field(field)
    except ValueError as error:
        raise AssetError(str(error), advice="Download or fit it again.") from error
    faces = len(surface.faces) * 4**level
    if faces > _MAX_FACES:
        raise ParameterError(
            f"Level {level} has {faces} faces; the limit is {_MAX_FACES}.", advice="Choose a lower --level."
        )
    verts, triangles = surface.unfold(level)
    contents = {output: level_glb(verts, triangles)}
    if intrinsic is not None:
        require("numba", "deform")
        from meshdeform.fields.intrinsic import delaunay

        mesh = delaunay(verts, triangles)
        contents[intrinsic] = intrinsic_npz(mesh, verts)
    write_all(contents, what="The mesh")
    typer.echo(f"{output}: {len(triangles)} triangles, {len(verts)} vertices")
