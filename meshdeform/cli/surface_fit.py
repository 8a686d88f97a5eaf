"""`meshdeform surface-fit`: fit a neural displacement field to a surface on this machine, without a server."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import JsonOption, QuietOption
from meshdeform.cli.output import emit
from meshdeform.cli.overwriting import check_checkpoint, check_outputs

if TYPE_CHECKING:
    from meshdeform.cli.progress import ProgressView
    from meshdeform.requests.document import JobRequest
    from meshdeform.runs.base import ArtifactData, JobRun
    from meshdeform.settings import Settings

__all__ = ["surface_fit"]

_FIT, _RESUME = "Base, network and fit", "Interrupt and resume"


def _number(text: str) -> Any:
    return typer.Option(help=text, rich_help_panel=_FIT, show_default=False)


@clean_errors
def surface_fit(
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
        typer.Option("-o", "--output", help="The .ndf to write. Default: SURFACE.ndf here.", show_default=False),
    ] = None,
    meshes: Annotated[
        bool, typer.Option("--meshes", help="Also write each level as a GLB, and the intrinsic triangulation.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that no earlier run wrote.")] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    base_faces: Annotated[int | None, _number("Faces of the base mesh; default: 1000.")] = None,
    features: Annotated[int | None, _number("Features at each vertex of the base; default: 8.")] = None,
    octaves: Annotated[int | None, _number("Octaves of positions; default: 6.")] = None,
    width: Annotated[int | None, _number("Neurons of each hidden layer; default: 32.")] = None,
    depth: Annotated[int | None, _number("Hidden layers; default: 2.")] = None,
    steps: Annotated[int | None, _number("Optimiser iterations; default: 1500.")] = None,
    learning_rate: Annotated[float | None, _number("Adam's highest step size; default: 0.01.")] = None,
    level: Annotated[int | None, _number("Highest level to measure and to write, 0 to 4; default: 2.")] = None,
    seed: Annotated[int | None, _number("Random seed; default: 0.")] = None,
    base: Annotated[
        Path | None,
        typer.Option(
            help="A base mesh of its own, instead of one made from SURFACE; its holes may be others.",
            exists=True,
            dir_okay=False,
            readable=True,
            rich_help_panel=_FIT,
            show_default=False,
        ),
    ] = None,
    scalars: Annotated[
        Path | None,
        typer.Option(
            help="Values at points near SURFACE, an NPZ, to learn along it and to keep in the .ndf.",
            exists=True,
            dir_okay=False,
            readable=True,
            rich_help_panel=_FIT,
            show_default=False,
        ),
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
    threads: Annotated[int | None, typer.Option(min=0, help="CPU threads; 0: all cores.", rich_help_panel=_FIT)] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            help="Save the state to this file regularly and at Ctrl-C.", dir_okay=False, rich_help_panel=_RESUME
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            help="Continue from a file that --checkpoint wrote.", exists=True, dir_okay=False, rich_help_panel=_RESUME
        ),
    ] = None,
) -> None:
    """Fit a neural displacement field to SURFACE: a coarse mesh and a small network, a few kilobytes together.

    meshdeform surface-fit bunny.obj -o bunny.ndf

    meshdeform surface-fit scan.ply --base-faces 2000 --steps 3000 --meshes
    """
    require("torch", "deform")
    settings = load_settings(threads=threads)
    output = output or Path(f"{surface.stem}.ndf")
    if output.suffix.lower() != ".ndf":
        raise typer.BadParameter(f"the result is a .ndf, but {output.name} does not end so", param_hint="--output")
    given = {
        "base_faces": base_faces,
        "features": features,
        "octaves": octaves,
        "width": width,
        "depth": depth,
        "steps": steps,
        "learning_rate": learning_rate,
        "level": level,
        "seed": seed,
        "anchors": [_anchor(text) for text in anchor] if anchor else None,
    }
    request = _request({name: value for name, value in given.items() if value is not None})
    given_files = {"asset": surface, "base": base, "scalars": scalars}
    files = {part: path for part, path in given_files.items() if path is not None}
    paths = _paths(output, request.params.level if meshes else None)  # type: ignore[attr-defined]
    if not force:
        check_outputs(paths, [*files.values(), *([resume] if resume else [])])
        if checkpoint is not None:
            check_checkpoint(checkpoint)
    from meshdeform.cli.interrupting import ctrl_c_between_steps
    from meshdeform.cli.local_job import try_folder, writing
    from meshdeform.cli.progress import show_progress
    from meshdeform.support.files import write_files

    with writing():
        try_folder(output)
    if checkpoint is not None:
        with writing("The checkpoint", "--checkpoint"):
            try_folder(checkpoint)
    with show_progress(quiet=quiet) as progress:
        progress.phase("loading")
        run = _start(files, request, resume, settings)
        progress.phase("optimizing")
        _optimize(run, progress, checkpoint, request.params.checkpoint_every_steps)
        progress.phase("writing")
        artifacts = run.finish()
        with ctrl_c_between_steps(), writing():
            write_files({path: _artifact(artifacts, name).data for name, path in paths.items()})
    report = json.loads(artifacts["report.json"].data)
    summary = {
        **{name: str(path) for name, path in paths.items()},
        "bytes": len(artifacts["surface.ndf"].data),
        "distance": report["levels"][-1]["distance"]["mean"],
        "eigenvalue_error": report["eigenvalues"]["mean_relative_error"],
        "geodesic_error": report["geodesics"]["mean_relative_error"],
        "steps": run.step,
        "warnings": report["input"]["warnings"],
    }
    if as_json:
        emit(summary)
    elif not quiet:
        typer.echo(f"Field      {output} ({summary['bytes']} bytes)")
        typer.echo(f"Report     {paths['report']}")
        typer.echo(f"Picture    {paths['preview']}")
        typer.echo(
            f"Level {report['levels'][-1]['level']}: {report['levels'][-1]['faces']} faces, distance "
            f"{summary['distance']:.3%} of the diagonal, eigenvalues off by {_share(summary['eigenvalue_error'])}, "
            f"geodesics by {_share(summary['geodesic_error'])}."
        )
        for warning in summary["warnings"]:
            typer.echo(f"Warning: {warning}", err=True)


def _share(error: float | None) -> str:
    """Return a relative error; where parts leave nothing to compare there is none."""
    return "an unknown share" if error is None else f"{error:.2%}"


def _request(params: dict[str, Any]) -> JobRequest:
    """Return the request, or refuse a number that is out of range, naming its option."""
    from pydantic import ValidationError

    from meshdeform.requests.document import JobRequest
    from meshdeform.runs import kinds

    kinds()  # the kinds register their parameters
    try:
        return JobRequest.model_validate({"kind": "surface_fit", "params": params})
    except ValidationError as error:
        first = error.errors()[0]
        name = next(str(part) for part in first["loc"] if part != "params")
        option = "--anchor" if name == "anchors" else f"--{name.replace('_', '-')}"
        raise typer.BadParameter(first["msg"], param_hint=option) from error


def _paths(output: Path, level: int | None) -> dict[str, Path]:
    """Return the paths of the outputs by the names that `check_outputs` knows; `level` also asks for the meshes."""
    found = {
        "result": output,
        "report": output.with_suffix(".report.json"),
        "preview": output.with_suffix(".preview.png"),
    }
    if level is not None:
        found |= {f"level_{k}.glb": output.with_suffix(f".level_{k}.glb") for k in range(level + 1)}
        found["intrinsic.npz"] = output.with_suffix(".intrinsic.npz")
    return found


def _artifact(artifacts: dict[str, ArtifactData], name: str) -> ArtifactData:
    return artifacts[{"result": "surface.ndf", "report": "report.json", "preview": "preview.png"}.get(name, name)]


def _anchor(text: str) -> dict[str, list[float]]:
    """Parse a pair of points."""
    try:
        one, other = ([float(number) for number in point.split(",")] for point in text.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not X,Y,Z:X,Y,Z", param_hint="--anchor") from error
    return {"base": one, "surface": other}


def _start(paths: dict[str, Path], request: JobRequest, resume: Path | None, settings: Settings) -> JobRun:
    from meshdeform.assets import Limits
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.runs import start_run
    from meshdeform.runs.base import InputFile, RunInput
    from meshdeform.runs.devices import use_threads

    limits = Limits.from_settings(settings)
    files = {part: InputFile(read_with_files(path, limits), path.name) for part, path in paths.items()}
    use_threads(settings.threads)
    checkpoint = resume.read_bytes() if resume else None
    return start_run(RunInput(request, files, checkpoint=checkpoint, limits=limits))


def _optimize(run: JobRun, progress: ProgressView, path: Path | None, every: int) -> None:
    from meshdeform.cli.interrupting import ctrl_c_between_steps
    from meshdeform.cli.local_job import writing
    from meshdeform.support.files import write_files

    with ctrl_c_between_steps() as interrupted:
        for report in run:
            progress.step(report.step, report.total_steps, report.losses["total"])
            stop = interrupted()
            if path is not None and (stop or report.step % every == 0):
                with writing("The checkpoint", "--checkpoint"):
                    write_files({path: run.checkpoint()})
            if stop:
                where = f"Interrupted at step {report.step} of {report.total_steps}."
                detail, advice = "Nothing was written.", "With --checkpoint FILE it could be resumed."
                if path is not None:
                    detail, advice = f"The state is in {path}.", f"Continue with --resume {shlex.quote(str(path))}"
                raise OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"{where} {detail}", advice)
