"""The commands of further kinds of job: `surface-fit` and `unfold`, `family-fit` and `family-synthesize`, `teach`."""

from __future__ import annotations

import dataclasses
import io
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, with_options, written
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
    flag,
    option,
    output_option,
)
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import ANCHOR, make_request, merge_params
from meshdeform.errors import AssetEmptyError, AssetError, AssetTooLargeError, ParameterError
from meshdeform.support.files import slug, zipped

if TYPE_CHECKING:
    from meshdeform.runs.base import InputFile

_FIT = "Base, network and fit"
_MAX_FACES = 4_000_000


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
            "The .ndf to write, or a .glb of the finest level with the .ndf beside it. Default: SURFACE.ndf here."
        ),
    ] = None,
    meshes: Annotated[
        bool, flag("--meshes", "Also write each level as a GLB, and the intrinsic triangulation.")
    ] = False,
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
    params = merge_params(ctx, param)
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
        from meshdeform.kinds.surface_fit.intrinsic import delaunay

        mesh = delaunay(verts, triangles)
        contents[intrinsic] = intrinsic_npz(mesh, verts)
    write_all(contents, what="The mesh")
    typer.echo(f"{output}: {len(triangles)} triangles, {len(verts)} vertices")


_ENDINGS = {".glb", ".obj", ".ply", ".stl"}
_FILE = "family.safetensors"


@clean_errors
@with_options(of_kind("family_fit"))
def family_fit(
    ctx: typer.Context,
    collection: Annotated[
        Path, typer.Argument(help="A folder or a ZIP of 10 to 3,000 assets of one family.", exists=True, readable=True)
    ],
    labels: Annotated[
        Path | None,
        file_option("Parts of some of the assets (docs/families.md). Default: labels.json in the folder or ZIP."),
    ] = None,
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-family.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    printed: Printed,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ --labels labels.json -o chairs-family
    """
    require("torch", "deform")
    params = merge_params(ctx, param)
    folder = output or Path(f"{collection.stem}-family")
    _run("family_fit", params, {"collection": _part(collection, labels)}, folder, here, printed)


@clean_errors
@with_options(of_kind("family_synthesize", hidden=("members",)))
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
    member: Annotated[list[str] | None, option("A member: two for interpolate, one for complete and search.")] = None,
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-shapes.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    printed: Printed,
) -> None:
    """Make new assets of a family out of parts of its members.

    meshdeform family-synthesize chairs-family chairs/ --count 8
    """
    require("torch", "deform")
    source, assets = _sources(family, collection)
    output = output or Path(f"{source.parent.name if family.is_dir() else source.stem}-shapes")
    params = merge_params(ctx, param, members=member)
    _run("family_synthesize", params, {"family": source, "collection": _part(assets)}, output, here, printed)


def _run(
    kind: str,
    params: Mapping[str, Any],
    files: Mapping[str, Path | InputFile],
    folder: Path,
    here: Here,
    printed: Printed,
) -> None:
    """Run a job whose results fill a folder."""
    from meshdeform.runs import kind_of

    request = make_request("", params, more={"kind": kind})
    outputs = {artifact.name: folder / artifact.name for artifact in kind_of(request.kind).artifacts}
    run = run_here(request, files, outputs, here, quiet=printed.quiet, whole_folder=True)
    print_result(request.kind, run, outputs, printed)


def _part(collection: Path, labels: Path | None = None) -> InputFile:
    from meshdeform.assets import Limits
    from meshdeform.runs.base import InputFile

    most = Limits.from_settings(load_settings()).max_bytes
    return InputFile(packed(collection, most, labels), collection.name)


def packed(path: Path, most: int, labels: Path | None = None) -> bytes:
    """Return the ZIP of a folder, or the given one, with the labels; refuse none, or too many bytes, as AssetError."""
    from meshdeform.assets.collection import LABELS_FILE, unpacked
    from meshdeform.assets.limits import Limits

    if path.is_file() and labels is None:
        return path.read_bytes()
    if path.is_dir():
        files = _files_in(path, most)
        beside = path / LABELS_FILE
        labels = labels or (beside if beside.is_file() else None)
    else:  # with the checks that the job makes
        files = unpacked(path.read_bytes(), dataclasses.replace(Limits(), max_bytes=most))
    if labels is not None:
        files[LABELS_FILE] = labels.read_bytes()
    return zipped(files)


def _files_in(folder: Path, most: int) -> dict[str, bytes]:
    """Return the assets in a folder by their names in it."""
    paths = sorted(each for each in folder.rglob("*") if each.suffix.lower() in _ENDINGS and each.is_file())
    if not paths:
        raise AssetEmptyError(
            f"The folder {folder} holds no asset.", advice="Give a folder with 10 to 3,000 GLB, OBJ, PLY or STL."
        )
    if sum(each.stat().st_size for each in paths) > most:
        raise AssetTooLargeError.more_than(most, "The assets have")
    return {each.relative_to(folder).as_posix(): each.read_bytes() for each in paths}


def _sources(family: Path, collection: Path | None) -> tuple[Path, Path]:
    """Return the family's file and the collection, or raise ParameterError if one is not there."""
    source = family / _FILE if family.is_dir() else family
    if not source.is_file():
        raise ParameterError(
            f"There is no {_FILE} in {family}.", advice="Give the folder that meshdeform family-fit wrote."
        )
    assets = collection or source.parent / "labelled.zip"
    if not assets.exists():
        raise ParameterError(
            "The collection is missing.", advice="Give the folder or ZIP that was fitted as the second argument."
        )
    return source, assets


@clean_errors
@with_options(of_kind("prior_teach", "Lesson", hidden=("noun", "synonyms", "front_deg")))
def teach(
    ctx: typer.Context,
    noun: Annotated[str | None, typer.Argument(help='What the meshes show: "a teapot"; not with --folder.')] = None,
    meshes: Annotated[
        list[Path] | None,
        typer.Argument(
            help="GLB, OBJ, PLY, STL or ZIP files, or folders of them. The subfolders of a folder are named by "
            "attributes: tall, long-nose.",
            exists=True,
            readable=True,
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        option(
            "A kit, instead of NOUN and MESHES: its subfolders, or files without one, are named by nouns.",
            exists=True,
            file_okay=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option(
            "The file of weights, default: NOUN.safetensors, or the name of the folder; with --url a folder."
        ),
    ] = None,
    synonym: Annotated[list[str] | None, option("Another name of the same thing; repeatable.")] = None,
    front: Annotated[float, option("Azimuth of the front of the meshes: 0 is +Z, 90 is +X.", min=-360, max=360)] = 0.0,
    *,
    here: Here,
    place: JobPlace,
    printed: Printed,
) -> None:
    """Teach the builtin model nouns from your own meshes, so that prompts may name them.

    meshdeform teach "a teapot" teapots/*.glb -o mine.safetensors

    meshdeform run sphere.glb "a teapot" --model mine.safetensors

    meshdeform teach --folder kit/ -o kit.safetensors
    """
    if folder and (noun or meshes):
        raise typer.BadParameter("a kit has no NOUN and MESHES beside it", param_hint="--folder")
    if not folder and not (noun and meshes):
        raise typer.BadParameter("give NOUN and MESHES, or --folder", param_hint="NOUN MESHES")
    meshes = [folder] if folder else meshes or []
    data, filename = _packed(meshes)
    params = {"noun": noun, "synonyms": synonym or [], "front_deg": front, **written(ctx)}
    if folder:
        params = {"steps": _steps_of_kit(data, printed), **params}
    request = make_request("", params, more={"kind": "prior_teach"})
    refuse_other_place(place, here=here.written(), there={})
    name = _slug(noun) if noun else slug(meshes[0].resolve().name) or "kit"
    if place.url:
        run_on_service(request, {"meshes": data}, place, output or Path(name), printed, filename=filename)
        return
    require("torch", "deform")
    output = output or Path(f"{name}.safetensors")
    if output.suffix != ".safetensors":
        raise typer.BadParameter(f"{output.name} does not end in .safetensors", param_hint="--output")
    from meshdeform.runs.base import WEIGHTS_ARTIFACT, InputFile

    paths = {
        WEIGHTS_ARTIFACT: output,
        "report.json": output.with_suffix(".report.json"),
        "preview.png": output.with_suffix(".preview.png"),
    }
    inputs = [*meshes, Path(request.params.model or "builtin")]
    run = run_here(request, {"meshes": InputFile(data, filename)}, paths, here, quiet=printed.quiet, inputs=inputs)
    print_result(request.kind, run, paths, printed)


def _steps_of_kit(data: bytes, printed: Printed) -> int:
    """Say which nouns a kit has; return the steps to learn them."""
    from meshdeform.priors.builtin.teaching.lesson import nouns_of_kit
    from meshdeform.requests.teaching import TEACH_STEPS, TEACH_STEPS_FURTHER

    nouns = Counter(noun for noun, _ in nouns_of_kit(zipfile.ZipFile(io.BytesIO(data)).namelist()).values())
    if not printed.quiet:
        listed = ", ".join(f"{noun} ({count})" for noun, count in nouns.items())
        typer.echo(f"{len(nouns)} nouns and their meshes: {listed}", err=True)
    return TEACH_STEPS + TEACH_STEPS_FURTHER * (len(nouns) - 1)


def _packed(meshes: list[Path]) -> tuple[bytes, str]:
    """Return the meshes as the part of a job, with its file name: one file as it is, several as a ZIP."""
    from meshdeform.client.orders import packed_meshes

    try:
        data, filename = packed_meshes(meshes[0] if len(meshes) == 1 else meshes)
    except ValueError as error:
        raise ParameterError(str(error)) from error
    return (data, filename or "mesh") if isinstance(data, bytes) else (meshes[0].read_bytes(), meshes[0].name)


def _slug(noun: str) -> str:
    """Return the noun without its article, as the name of a file."""
    first, _, rest = noun.strip().partition(" ")
    return slug(rest if first.lower() in ("a", "an", "the") and rest else noun) or "noun"
