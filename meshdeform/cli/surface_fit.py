"""`meshdeform surface-fit` and `unfold`: fit a neural displacement field to a surface, and make a mesh of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_kind, overlaid, written
from meshdeform.cli.local import LocalJob, check_free, check_glb, write_all
from meshdeform.cli.options import (
    CheckpointOption,
    JsonOption,
    OverwriteOption,
    QuietOption,
    ResumeOption,
    SetOption,
    ThreadsOption,
)
from meshdeform.cli.output import emit
from meshdeform.cli.request import make_request, merge_params
from meshdeform.cli.written import parse_anchors
from meshdeform.errors import AssetError, ParameterError

__all__ = ["SurfaceFitCommand", "surface_fit", "unfold"]

_FIT = "Base, network and fit"
_MAX_FACES = 4_000_000

SurfaceFitCommand = form_command(of_kind("surface_fit", _FIT))


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
    anchor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z:X,Y,Z",
            help="A point of the base, and the point of SURFACE where it goes; repeatable.",
            rich_help_panel=_FIT,
            show_default=False,
        ),
    ] = None,
    param: SetOption = None,
    threads: ThreadsOption = None,
    checkpoint: CheckpointOption = None,
    resume: ResumeOption = None,
    force: OverwriteOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
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
    params = overlaid(merge_params(param or [], anchors=parse_anchors(anchor)), written(ctx))
    request = make_request("", params, more={"kind": "surface_fit"})
    sources = {"asset": surface, "base": base, "scalars": scalars}
    level: int = request.params.level  # type: ignore[attr-defined]
    from meshdeform.cli.progress import show_progress

    files = {part: path for part, path in sources.items() if path is not None}
    paths = _paths(output, level if meshes else None)
    if mesh is not None:
        paths[f"level_{level}.glb"] = mesh
    job = LocalJob(request, files, paths, load_settings(threads=threads), checkpoint=checkpoint, resume=resume)
    job.check(force=force)
    with show_progress(quiet=quiet) as progress:
        finished = job.run(progress)
    report = finished.report
    best = report["levels"][-1]
    names = {"surface.ndf": "result", "report.json": "report", "preview.png": "preview"}
    summary = {
        **{names.get(name, name): str(path) for name, path in paths.items()},
        "bytes": len(finished.artifacts["surface.ndf"]),
        "distance": best["distance"]["mean"],
        "eigenvalue_error": report["eigenvalues"]["mean_relative_error"],
        "geodesic_error": report["geodesics"]["mean_relative_error"],
        "steps": finished.steps,
        "warnings": report["input"]["warnings"],
    }
    if as_json:
        emit(summary)
    elif not quiet:
        typer.echo(f"Field      {output} ({summary['bytes']} bytes)")
        if mesh is not None:
            typer.echo(f"Mesh       {mesh}")
        typer.echo(f"Report     {paths['report.json']}")
        typer.echo(f"Picture    {paths['preview.png']}")
        typer.echo(
            f"Level {best['level']}: {best['faces']} faces, distance {summary['distance']:.3%} of the diagonal, "
            f"eigenvalues off by {_share(summary['eigenvalue_error'])}, "
            f"geodesics by {_share(summary['geodesic_error'])}."
        )
        for warning in summary["warnings"]:
            typer.echo(f"Warning: {warning}", err=True)


def _share(error: float | None) -> str:
    """Return a relative error; where parts leave nothing to compare there is none."""
    return "an unknown share" if error is None else f"{error:.2%}"


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
