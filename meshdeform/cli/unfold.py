"""`meshdeform unfold`: make a mesh of a neural displacement field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.errors import AssetError, ParameterError, UnavailableError

__all__ = ["unfold"]

_MAX_FACES = 4_000_000


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
    if output.suffix.lower() != ".glb":
        raise typer.BadParameter(f"the result is a GLB, but {output.name} does not end in .glb", param_hint="--output")
    paths = [path for path in (output, intrinsic) if path is not None]
    if not force:
        for path in paths:
            if path.exists():
                raise ParameterError(
                    f"{path} exists.", advice="Choose another name with -o, or overwrite it with --force."
                )
    from meshdeform.fields.level_files import intrinsic_npz, level_glb
    from meshdeform.fields.reader import read_field
    from meshdeform.support.files import write_files

    try:
        found = read_field(field)
    except ValueError as error:
        raise AssetError(str(error), advice="Download or fit it again.") from error
    faces = len(found.faces) * 4**level
    if faces > _MAX_FACES:
        raise ParameterError(
            f"Level {level} has {faces} faces; the limit is {_MAX_FACES}.", advice="Choose a lower --level."
        )
    verts, triangles = found.unfold(level)
    contents = {output: level_glb(verts, triangles)}
    if intrinsic is not None:
        require("numba", "deform")
        from meshdeform.fields.intrinsic import delaunay

        mesh = delaunay(verts, triangles)
        contents[intrinsic] = intrinsic_npz(mesh, verts)
    try:
        for path in paths:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_files(contents)
    except OSError as error:
        raise UnavailableError(
            f"The mesh cannot be written: {error}.", advice="Choose another place with -o."
        ) from error
    typer.echo(f"{output}: {len(triangles)} triangles, {len(verts)} vertices")
