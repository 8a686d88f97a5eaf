"""`meshdeform family-fit` and `family-synthesize`: learn what a folder of assets has in common; make new ones of it."""

from __future__ import annotations

import dataclasses
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_kind, overlaid, written
from meshdeform.cli.local import run_here
from meshdeform.cli.options import Here, Printed, SetOption
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import make_request, merge_params
from meshdeform.errors import AssetEmptyError, AssetError, ParameterError

if TYPE_CHECKING:
    from meshdeform.runs.base import InputFile

__all__ = ["FamilyFitCommand", "FamilySynthesizeCommand", "family_fit", "family_synthesize", "packed"]

_ENDINGS = {".glb", ".obj", ".ply", ".stl"}
_FILE = "family.safetensors"

FamilyFitCommand = form_command(of_kind("family_fit"))
FamilySynthesizeCommand = form_command(of_kind("family_synthesize", hidden=("members",)))


@clean_errors
def family_fit(
    ctx: typer.Context,
    collection: Annotated[
        Path, typer.Argument(help="A folder or a ZIP of 10 to 3,000 assets of one family.", exists=True, readable=True)
    ],
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Parts of some of the assets (docs/families.md). Default: labels.json in the folder or ZIP.",
            exists=True,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The folder to write. Default: NAME-family.", show_default=False),
    ] = None,
    param: SetOption = None,
    *,
    here: Here,
    printed: Printed,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ --labels labels.json -o chairs-family
    """
    require("torch", "deform")
    params = overlaid(merge_params(param or []), written(ctx))
    folder = output or Path(f"{collection.stem}-family")
    _run("family_fit", params, {"collection": _part(collection, labels)}, folder, here, printed)


@clean_errors
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
            show_default=False,
        ),
    ] = None,
    member: Annotated[
        list[str] | None,
        typer.Option(help="A member: two for interpolate, one for complete and search.", show_default=False),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The folder to write. Default: NAME-shapes.", show_default=False),
    ] = None,
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
    params = overlaid(merge_params(param or [], members=member), written(ctx))
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
    if path.is_file() and labels is None:
        return path.read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        if path.is_dir():
            chosen = sorted(each for each in path.rglob("*") if each.suffix.lower() in _ENDINGS and each.is_file())
            if not chosen:
                raise AssetEmptyError(
                    f"The folder {path} holds no asset.", advice="Give a folder with 10 to 3,000 GLB, OBJ, PLY or STL."
                )
            total = sum(each.stat().st_size for each in chosen)
            if total > most:
                raise AssetError(f"The assets have {total} bytes; the limit is {most} (MESHDEFORM_MAX_UPLOAD_BYTES).")
            for each in chosen:
                archive.writestr(zipfile.ZipInfo(each.relative_to(path).as_posix()), each.read_bytes())
            beside = path / "labels.json"
            labels = labels or (beside if beside.is_file() else None)
        else:
            for name, data in _unpacked(path, most).items():
                archive.writestr(zipfile.ZipInfo(name), data)
        if labels is not None:
            archive.writestr(zipfile.ZipInfo("labels.json"), labels.read_bytes())
    return buffer.getvalue()


def _unpacked(path: Path, most: int) -> dict[str, bytes]:
    """Return the files of a ZIP but its labels, with the checks that the job makes."""
    from meshdeform.assets.collection import LABELS_FILE, unpacked
    from meshdeform.assets.limits import Limits

    files = unpacked(path.read_bytes(), dataclasses.replace(Limits(), max_bytes=most))
    return {name: data for name, data in files.items() if name != LABELS_FILE}


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
