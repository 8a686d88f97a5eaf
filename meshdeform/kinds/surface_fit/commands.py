"""The commands `surface-fit` and `unfold`, and what they print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import ShortForm, of_kind, with_options
from meshdeform.cli.kinds import run_kind
from meshdeform.cli.local import check_free, check_glb, write_all
from meshdeform.cli.options import (
    ForceOption,
    Here,
    JobWhere,
    Printed,
    SetOption,
    file_argument,
    file_option,
    option,
    output_option,
)
from meshdeform.cli.request import merge_params, read_point
from meshdeform.errors import AssetError, ParameterError

if TYPE_CHECKING:
    from meshdeform.cli.local import FinishedRun

OUTPUTS = {"surface_fit": {".ndf": "surface.ndf", ".glb": "level_{level}.glb"}}

_FIT = "Base, network and fit"
_MAX_FACES = 4_000_000


def _read_anchor(text: str) -> dict[str, list[float]]:
    """Read a pair of points written as X,Y,Z:X,Y,Z."""
    try:
        base, surface = (read_point(point) for point in text.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not X,Y,Z:X,Y,Z", param_hint="--anchor") from error
    return {"base": base, "surface": surface}


_ANCHOR = {
    "anchors": [
        ShortForm(
            "--anchor",
            "X,Y,Z:X,Y,Z",
            "A point of the base, and the point of SURFACE where it goes; repeatable.",
            _FIT,
            _read_anchor,
        )
    ]
}


@clean_errors
@with_options(of_kind("surface_fit", _FIT, short=_ANCHOR))
def surface_fit(
    ctx: typer.Context,
    surface: Annotated[
        Path,
        file_argument("A mesh, oriented points (PLY, XYZ), a signed distance grid (NPZ) or a network (safetensors)."),
    ],
    output: Annotated[
        Path | None,
        output_option(
            "The .ndf to write; a .glb of the finest level, with the .ndf beside it; or a folder for all levels. "
            "Default: SURFACE.ndf here."
        ),
    ] = None,
    base: Annotated[
        Path | None,
        file_option("A base mesh of its own, instead of one made from SURFACE; its holes may be others.", _FIT),
    ] = None,
    scalars: Annotated[
        Path | None,
        file_option("Values at points near SURFACE, an NPZ, to learn along it and to keep in the .ndf.", _FIT),
    ] = None,
    param: SetOption = None,
    *,
    here: Here,
    where: JobWhere,
    printed: Printed,
) -> None:
    """Fit a neural displacement field to SURFACE: a coarse mesh and a small network, a few kilobytes together.

    meshdeform surface-fit bunny.obj -o bunny.ndf

    meshdeform surface-fit scan.ply --base-faces 2000 --steps 3000 -o scan

    meshdeform surface-fit points.xyz -o mesh.glb
    """
    files = {part: path for part, path in (("asset", surface), ("base", base), ("scalars", scalars)) if path}
    output = output or Path(surface.stem if where.url else f"{surface.stem}.ndf")
    run_kind("surface_fit", merge_params(ctx, param), files, output, here, where, printed)


@clean_errors
def unfold(
    field: Annotated[Path, file_argument("The .ndf.")],
    output: Annotated[Path | None, output_option("The GLB to write. Default: FIELD.glb here.")] = None,
    level: Annotated[int, option("Each level has four times the faces of the one before.", min=0, max=8)] = 2,
    intrinsic: Annotated[Path | None, option("Also write the intrinsic Delaunay triangulation to this .npz.")] = None,
    force: ForceOption = False,
) -> None:
    """Unfold FIELD, a file that surface-fit wrote, into a mesh.

    meshdeform unfold bunny.ndf --level 3 -o bunny.glb
    """
    require("numpy", "asset")
    output = output or Path(f"{field.stem}.glb")
    check_glb(output)
    check_free([path for path in (output, intrinsic) if path is not None], [field], force=force)
    from meshdeform.kinds.surface_fit.level_files import intrinsic_npz, level_glb
    from meshdeform.kinds.surface_fit.reader import read_field
    from meshdeform.kinds.surface_fit.scalar_sections import colours_at

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
    contents = {output: level_glb(verts, triangles, colours_at(surface, level))}
    if intrinsic is not None:
        require("numba", "deform")
        from meshdeform.kinds.surface_fit.intrinsic import delaunay

        mesh = delaunay(verts, triangles)
        contents[intrinsic] = intrinsic_npz(mesh, verts)
    write_all(contents, what="The mesh")
    typer.echo(f"{output}: {len(triangles)} triangles, {len(verts)} vertices")


def _surface(run: FinishedRun, files: Mapping[str, Path]) -> dict[str, Any]:
    report, names = run.report, {"surface.ndf": "result", "report.json": "report", "preview.png": "preview"}
    best = report["levels"][-1]
    return {
        **{names.get(name, name): str(path) for name, path in files.items()},
        "bytes": len(run.artifacts["surface.ndf"]),
        "level": best["level"],
        "faces": best["faces"],
        "distance": best["distance"]["mean"],
        "eigenvalue_error": report["eigenvalues"]["mean_relative_error"],
        "geodesic_error": report["geodesics"]["mean_relative_error"],
        "steps": run.steps,
        "warnings": report["input"]["warnings"],
    }


def _surface_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    yield f"Field      {summary['result']} ({summary['bytes']} bytes)"
    if mesh := summary.get(f"level_{summary['level']}.glb"):
        yield f"Mesh       {mesh}"
    yield f"Report     {summary['report']}"
    yield f"Picture    {summary['preview']}"
    eigenvalues, geodesics = (
        # Where parts leave nothing to compare there is no error.
        "an unknown share" if summary[name] is None else f"{summary[name]:.2%}"
        for name in ("eigenvalue_error", "geodesic_error")
    )
    yield (
        f"Level {summary['level']}: {summary['faces']} faces, distance {summary['distance']:.3%} of the diagonal, "
        f"eigenvalues off by {eigenvalues}, geodesics by {geodesics}."
    )


COMMANDS = (surface_fit, unfold)

PRINTED = {"surface_fit": (_surface, _surface_lines)}
