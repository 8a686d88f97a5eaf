"""`meshdeform family-fit`: find what a folder of assets of one family has in common, on this machine."""

from __future__ import annotations

import io
import json
import shlex
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import JsonOption, QuietOption, SetOption
from meshdeform.cli.output import emit
from meshdeform.cli.overwriting import check_checkpoint
from meshdeform.cli.request import make_request, merge_params
from meshdeform.errors import AssetError, ParameterError

if TYPE_CHECKING:
    from meshdeform.cli.progress import ProgressView
    from meshdeform.requests.family import FamilyParams
    from meshdeform.runs.base import ArtifactData, JobRun

__all__ = ["family_fit"]

_ENDINGS = {".glb", ".obj", ".ply", ".stl"}


@clean_errors
def family_fit(
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
    points: Annotated[int | None, typer.Option(help="Number of template points; default: 500.")] = None,
    parts: Annotated[int | None, typer.Option(help="Number of parts without labels; default: 4.")] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: 0.")] = None,
    embed_labels: Annotated[
        bool, typer.Option("--embed-labels", help="Also write the assets with their parts, as labelled.zip.")
    ] = False,
    param: SetOption = None,
    threads: Annotated[int | None, typer.Option(min=0, help="CPU threads; 0: all cores.")] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="Save the state to this file regularly and at Ctrl-C.", dir_okay=False, show_default=False),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            help="Continue from a file that --checkpoint wrote.", exists=True, dir_okay=False, show_default=False
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that no earlier run wrote.")] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ --labels labels.json -o chairs-family
    """
    require("torch", "deform")
    settings = load_settings(threads=threads)
    output = output or Path(f"{collection.stem}-family")
    named = merge_params(param or [], points=points, parts=parts, seed=seed, embed_labels=embed_labels or None)
    from meshdeform.runs.family_fit_kind import params_of  # registers the kind, which make_request needs

    request = make_request("", named, more={"kind": "family_fit"})
    params = params_of(request)
    if not force:
        _check_output(output)
        if checkpoint is not None:
            check_checkpoint(checkpoint)
    from meshdeform.assets import Limits
    from meshdeform.cli.local_job import try_folder, writing
    from meshdeform.cli.progress import show_progress
    from meshdeform.runs.base import InputFile, RunInput
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.family_fit import start

    with writing():
        try_folder(output / "report.json")
    if checkpoint is not None:
        with writing("The checkpoint", "--checkpoint"):
            try_folder(checkpoint)
    limits = Limits.from_settings(settings)
    data = _packed(collection, labels, limits.max_bytes)
    use_threads(settings.threads)
    state = resume.read_bytes() if resume else None
    with show_progress(quiet=quiet) as progress:
        progress.phase("loading")
        files = {"collection": InputFile(data, collection.name)}
        run = start(RunInput(request=request, files=files, checkpoint=state, limits=limits))
        progress.phase("optimizing")
        _drive(run, params, progress, checkpoint)
        progress.phase("writing")
        written = _write(run.finish(), output)
    report = json.loads((output / "report.json").read_text(encoding="utf-8"))
    summary = {"folder": str(output), "files": written, "steps": run.step, "resumed": state is not None}
    summary |= {name: report[name] for name in ("accuracy", "classes", "strangers", "warnings")}
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    typer.echo(f"Folder     {output}")
    typer.echo(f"Files      {', '.join(written)}")
    typer.echo(f"Parts      {', '.join(report['parts'])}")
    if report["accuracy"]:
        found = report["accuracy"]
        typer.echo(f"Accuracy   {found['parts']:.1%} of the surface of {found['held_out']} held-out assets")
    if report["classes"]:
        typer.echo(f"Classes    {report['classes']['nearest_neighbour']:.1%} have a nearest neighbour of their class")
    for warning in report["warnings"]:
        typer.echo(warning, err=True)


def _drive(run: JobRun, params: FamilyParams, progress: ProgressView, checkpoint: Path | None) -> None:
    """Do the steps; store checkpoints, also at Ctrl-C."""
    from meshdeform.cli.local_job import ctrl_c_between_steps, writing
    from meshdeform.support.atomic_files import write_files

    with ctrl_c_between_steps() as interrupted:
        for report in run:
            progress.step(report.step, report.total_steps, report.losses["total"])
            stop = interrupted()
            if checkpoint is not None and (stop or report.step % params.checkpoint_every_steps == 0):
                with writing("The checkpoint", "--checkpoint"):
                    write_files({checkpoint: run.checkpoint()})
            if stop:
                detail, advice = "Nothing was written.", "With --checkpoint FILE it could be resumed."
                if checkpoint is not None:
                    detail = f"The state is in {checkpoint}."
                    advice = f"Continue with --resume {shlex.quote(str(checkpoint))}"
                where = f"Interrupted at step {report.step} of {report.total_steps}."
                raise OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"{where} {detail}", advice)


def _packed(path: Path, labels: Path | None, most: int) -> bytes:
    """Return the ZIP of a folder, or the given one, with the labels."""
    if path.is_file() and labels is None:
        return path.read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        if path.is_dir():
            chosen = sorted(each for each in path.rglob("*") if each.suffix.lower() in _ENDINGS and each.is_file())
            total = sum(each.stat().st_size for each in chosen)
            if total > most:
                raise AssetError(f"The assets have {total} bytes; the limit is {most} (MESHDEFORM_MAX_UPLOAD_BYTES).")
            for each in chosen:
                archive.writestr(zipfile.ZipInfo(each.relative_to(path).as_posix()), each.read_bytes())
            beside = path / "labels.json"
            labels = labels or (beside if beside.is_file() else None)
        else:
            _copy(path, archive, most)
        if labels is not None:
            archive.writestr(zipfile.ZipInfo("labels.json"), labels.read_bytes())
    return buffer.getvalue()


def _copy(path: Path, archive: zipfile.ZipFile, most: int) -> None:
    try:
        with zipfile.ZipFile(path) as source:
            entries = [entry for entry in source.infolist() if entry.filename != "labels.json"]
            if sum(entry.file_size for entry in entries) > most:
                raise AssetError(f"{path} unpacks to more than {most} bytes (MESHDEFORM_MAX_UPLOAD_BYTES).")
            for entry in entries:
                archive.writestr(zipfile.ZipInfo(entry.filename), source.read(entry))
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError) as error:
        raise AssetError(f"{path} cannot be read: {error}.", advice="Pack it again.") from error


def _check_output(folder: Path) -> None:
    """Refuse a folder that holds files of somebody else under the names of results."""
    from meshdeform.runs.family_fit_kind import FAMILY_FIT

    there = [artifact.name for artifact in FAMILY_FIT.artifacts if (folder / artifact.name).exists()]
    if not there:
        return
    try:
        ours = json.loads((folder / "report.json").read_bytes())["kind"] == "family_fit"
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        raise ParameterError(
            f"{folder / there[0]} exists and was not written by an earlier run.",
            advice="Choose another folder with -o, or overwrite it with --force.",
        )


def _write(artifacts: dict[str, ArtifactData], folder: Path) -> list[Any]:
    from meshdeform.cli.local_job import ctrl_c_between_steps, writing
    from meshdeform.support.atomic_files import write_files

    with ctrl_c_between_steps(), writing():
        write_files({folder / name: artifact.data for name, artifact in artifacts.items()})
    return list(artifacts)
