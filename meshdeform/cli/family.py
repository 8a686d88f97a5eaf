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
from meshdeform.errors import AssetEmptyError, AssetError, ParameterError

if TYPE_CHECKING:
    from meshdeform.runs.base import InputFile
    from meshdeform.settings import Settings

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
    threads: ThreadsOption = None,
    checkpoint: CheckpointOption = None,
    resume: ResumeOption = None,
    force: OverwriteOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ --labels labels.json -o chairs-family
    """
    require("torch", "deform")
    settings, output = load_settings(threads=threads), output or Path(f"{collection.stem}-family")
    params = overlaid(merge_params(param or []), written(ctx))
    sources = {"collection": (collection, labels)}
    states = checkpoint, resume
    summary, report = _run("family_fit", params, sources, output, settings, states, force=force, quiet=quiet)
    summary |= {name: report[name] for name in ("accuracy", "classes", "strangers", "warnings")}
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    typer.echo(f"Folder     {output}")
    typer.echo(f"Files      {', '.join(summary['files'])}")
    typer.echo(f"Parts      {', '.join(report['parts'])}")
    if accuracy := report["accuracy"]:
        typer.echo(f"Accuracy   {accuracy['parts']:.1%} of the surface of {accuracy['held_out']} held-out assets")
    if report["classes"]:
        typer.echo(f"Classes    {report['classes']['nearest_neighbour']:.1%} have a nearest neighbour of their class")
    for warning in report["warnings"]:
        typer.echo(warning, err=True)


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
    threads: ThreadsOption = None,
    checkpoint: CheckpointOption = None,
    resume: ResumeOption = None,
    force: OverwriteOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make new assets of a family out of parts of its members.

    meshdeform family-synthesize chairs-family chairs/ --count 8
    """
    require("torch", "deform")
    settings = load_settings(threads=threads)
    source, assets = _sources(family, collection)
    output = output or Path(f"{source.parent.name if family.is_dir() else source.stem}-shapes")
    params = overlaid(merge_params(param or [], members=member), written(ctx))
    sources: dict[str, Path | tuple[Path, Path | None]] = {"family": source, "collection": (assets, None)}
    states = checkpoint, resume
    summary, report = _run("family_synthesize", params, sources, output, settings, states, force=force, quiet=quiet)
    summary |= {name: report[name] for name in ("shapes", "nearest_members", "warnings")}
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    typer.echo(f"Folder     {output}")
    typer.echo(f"Files      {', '.join(summary['files'])}")
    for shape in report["shapes"]:
        parts = ", ".join(f"{each['part']} of {each['member']}" for each in shape["parts"])
        typer.echo(f"{shape['name']}  {parts}; more plausible than {shape['plausibility']:.0%} of the members")
    for each in report["nearest_members"] or ():
        typer.echo(f"{each['distance']:9.3f}  {each['name']}")
    for warning in report["warnings"]:
        typer.echo(warning, err=True)


def _run(
    kind: str,
    params: Mapping[str, Any],
    sources: Mapping[str, Path | tuple[Path, Path | None]],
    folder: Path,
    settings: Settings,
    states: tuple[Path | None, Path | None],
    *,
    force: bool,
    quiet: bool,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run a job whose results fill a folder; return what to say about it, and its report."""
    from meshdeform.assets import Limits
    from meshdeform.cli.local import LocalJob
    from meshdeform.cli.progress import show_progress
    from meshdeform.runs import kind_of
    from meshdeform.runs.base import InputFile

    request = make_request("", params, more={"kind": kind})
    most = Limits.from_settings(settings).max_bytes
    files: dict[str, Path | InputFile] = {
        part: source if isinstance(source, Path) else InputFile(packed(source[0], most, source[1]), source[0].name)
        for part, source in sources.items()
    }
    outputs = {artifact.name: folder / artifact.name for artifact in kind_of(request.kind).artifacts}
    job = LocalJob(
        request, files, outputs, settings, checkpoint=states[0], resume=states[1], whole_folder=True
    )  # fmt: skip
    job.check(force=force)
    with show_progress(quiet=quiet) as progress:
        finished = job.run(progress)
    summary = {
        "folder": str(folder),
        "files": list(finished.artifacts),
        "steps": finished.steps,
        "resumed": finished.resumed_from is not None,
    }
    return summary, finished.report


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
