"""The commands of further kinds of job: `surface-fit` and `unfold`, `family-fit` and `family-synthesize`."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, with_options
from meshdeform.cli.jobs import refuse_other_place, run_on_service
from meshdeform.cli.local import check_free, check_glb, run_here, write_all
from meshdeform.cli.options import (
    ForceOption,
    Here,
    JobPlace,
    Printed,
    SetOption,
    file_argument,
    file_option,
    option,
    output_option,
)
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import ANCHOR, make_request, merge_params
from meshdeform.errors import AssetError, ParameterError
from meshdeform.requests.choices import JobKind
from meshdeform.support.files import zipped

_FIT = "Base, network and fit"
_MAX_FACES = 4_000_000
_NAMED: Mapping[str, Mapping[str, str]] = {
    JobKind.SURFACE_FIT: {".ndf": "surface.ndf", ".glb": "level_{level}.glb"},
}
"""The artifacts that `--output` may name, by its ending; the first one is written in any case."""


@clean_errors
@with_options(of_kind("surface_fit", _FIT, short=ANCHOR))
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
    place: JobPlace,
    printed: Printed,
) -> None:
    """Fit a neural displacement field to SURFACE: a coarse mesh and a small network, a few kilobytes together.

    meshdeform surface-fit bunny.obj -o bunny.ndf

    meshdeform surface-fit scan.ply --base-faces 2000 --steps 3000 -o scan

    meshdeform surface-fit points.xyz -o mesh.glb
    """
    files = {part: path for part, path in (("asset", surface), ("base", base), ("scalars", scalars)) if path}
    output = output or Path(surface.stem if place.url else f"{surface.stem}.ndf")
    run_kind(JobKind.SURFACE_FIT, merge_params(ctx, param), files, output, here, place, printed)


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


@clean_errors
@with_options(of_kind("family_fit"))
def family_fit(
    ctx: typer.Context,
    collection: Annotated[
        Path,
        typer.Argument(
            help="A folder or a ZIP of 10 to 3,000 assets of one family, with labels.json, if some have labels "
            "(docs/families.md).",
            exists=True,
        ),
    ],
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-family.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    place: JobPlace,
    printed: Printed,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ -o chairs-family
    """
    output = output or Path(f"{collection.stem}-family")
    run_kind(JobKind.FAMILY_FIT, merge_params(ctx, param), {"collection": collection}, output, here, place, printed)


@clean_errors
@with_options(of_kind("family_synthesize"))
def family_synthesize(
    ctx: typer.Context,
    family: Annotated[
        Path, typer.Argument(help="The folder that family-fit wrote, or its family.safetensors.", exists=True)
    ],
    collection: Annotated[
        Path | None,
        typer.Argument(
            help="The folder or ZIP that was fitted. Default: labelled.zip beside the family, if it is there.",
            exists=True,
        ),
    ] = None,
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-shapes.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    place: JobPlace,
    printed: Printed,
) -> None:
    """Make new assets of a family out of parts of its members.

    meshdeform family-synthesize chairs-family chairs/ --count 8
    """
    files = family_files(family, collection)
    output = output or Path(f"{family.stem}-shapes")
    run_kind(JobKind.FAMILY_SYNTHESIZE, merge_params(ctx, param), files, output, here, place, printed)


def family_files(family: Path, collection: Path | None) -> dict[str, Path]:
    """Return the files of a fitted family, which is a folder or a file, by part.

    Raises ParameterError: one is missing.
    """
    source = family / "family.safetensors" if family.is_dir() else family
    files = {"family": source, "collection": collection or source.with_name("labelled.zip")}
    for path in files.values():
        if not path.exists():
            raise ParameterError(
                f"There is no {path}.",
                advice="Name the folder that meshdeform family-fit wrote, and the collection that it was fitted to.",
            )
    return files


def run_kind(
    kind: JobKind,
    params: Mapping[str, Any],
    files: Mapping[str, Path],
    output: Path,
    here: Here,
    place: JobPlace,
    printed: Printed,
    *,
    idempotency_key: str | None = None,
    **more: Any,
) -> None:
    """Run a job of a kind that is no deformation, here or on a service, and print its result.

    The files are by part; folders are packed. `more` are further members of the request.
    """
    request = make_request("", params, more={**more, "kind": kind})
    refuse_other_place(place, here=here.written(), there=place.written())
    with tempfile.TemporaryDirectory(prefix="meshdeform-") as folder:
        sent = {part: packed(path, Path(folder)) for part, path in files.items()}
        if place.url:
            run_on_service(request, sent, place, output, printed, idempotency_key=idempotency_key)
            return
        require("scipy", "deform")
        paths, whole_folder = _outputs(kind, output, getattr(request.params, "level", 0))
        run = run_here(request, sent, paths, here, quiet=printed.quiet, whole_folder=whole_folder)
    print_result(kind, run, paths, printed)


def packed(path: Path, folder: Path) -> Path:
    """Return a file, or a ZIP in a temporary folder of the meshes in a folder."""
    from meshdeform.client.orders import files_in

    if path.is_file():
        return path
    try:
        files = files_in([path])
    except ValueError as error:
        raise ParameterError(str(error)) from error
    packed = folder / f"{path.resolve().stem}.zip"
    packed.write_bytes(zipped({name: file.read_bytes() for name, file in files.items()}))
    return packed


def _outputs(kind: JobKind, output: Path, level: int) -> tuple[dict[str, Path], bool]:
    """Return the paths of artifacts, and whether they are all those of the kind, in a folder."""
    from meshdeform.runs import kind_of

    named = _NAMED.get(kind, {})
    if not named or not output.suffix or output.is_dir():
        return {artifact.name: output / artifact.name for artifact in kind_of(kind).artifacts}, True
    if output.suffix.lower() not in named:
        raise typer.BadParameter(
            f"{output.name} does not end in {' or '.join(named)}, and is no folder", param_hint="--output"
        )
    beside = {artifact: output.with_suffix(f".{artifact}") for artifact in ("report.json", "preview.png")}
    ending, main = next(iter(named.items()))
    chosen = {named[output.suffix.lower()].format(level=level): output}
    return {main: output.with_suffix(ending), **beside, **chosen}, False
