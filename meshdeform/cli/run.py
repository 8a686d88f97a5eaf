"""`meshdeform run`: deform one asset on this machine, or run a job of any kind on a service."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.animate import check_animation, drawn_animation
from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_kind, of_request, overlaid, written
from meshdeform.cli.jobs import run_on_service
from meshdeform.cli.local import LocalJob, check_glb, write_all
from meshdeform.cli.options import (
    AlsoOption,
    ApiKeyFileOption,
    ApiKeyOption,
    CheckpointOption,
    DetachOption,
    ExcludeOption,
    HandleOption,
    JsonOption,
    KeepOption,
    LabelOption,
    OnlyOption,
    QuietOption,
    ResumeOption,
    RigidOption,
    SetOption,
    SilhouetteOption,
    TimeoutOption,
)
from meshdeform.cli.output import emit
from meshdeform.cli.progress import show_progress
from meshdeform.cli.report_lines import report_lines, report_summary
from meshdeform.cli.request import make_request, merge_params, parse_files, parse_labels
from meshdeform.cli.written import parse_also, parse_exclude, parse_handles, parse_pictures, parse_regions, parse_rigid
from meshdeform.requests.choices import JobKind

if TYPE_CHECKING:
    from meshdeform.cli.local import FinishedRun
    from meshdeform.requests.document import JobRequest

__all__ = ["RunCommand", "run"]

_OUTPUTS = "Outputs"
_LOCAL = {JobKind.SURFACE_FIT: "surface-fit", JobKind.PRIOR_TEACH: "teach"}

RunCommand = form_command(
    of_kind("text_deform"),
    of_request("output", _OUTPUTS),
    of_request("job", "Service", only=("kind", "priority", "deadline_s", "retention_s")),
)


def _file(text: str) -> Any:
    return typer.Option(help=text, rich_help_panel=_OUTPUTS, dir_okay=False, show_default=False)


@clean_errors
def run(
    ctx: typer.Context,
    asset: Annotated[
        Path,
        typer.Argument(
            help="The GLB, OBJ, PLY, STL or ZIP, or what else jobs of --kind read.", exists=True, dir_okay=False
        ),
    ],
    prompt: Annotated[
        str,
        typer.Argument(help='What the asset should become: "a mushroom". Or --also, --target or --silhouette.'),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="The GLB to write, default: ASSET-deformed.glb in this folder; with --url a folder.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[Path | None, _file("Where the report goes (default: beside the GLB).")] = None,
    preview: Annotated[Path | None, _file("Where the picture goes (default: beside the GLB).")] = None,
    animate: Annotated[Path | None, _file("Also draw source to result and back, as this .webp or .gif.")] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Overwrite files that no earlier run wrote.", rich_help_panel=_OUTPUTS),
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    target: Annotated[
        Path | None,
        typer.Option(
            help="A mesh to deform towards, instead of a prompt.",
            exists=True,
            dir_okay=False,
            rich_help_panel="Method",
            show_default=False,
        ),
    ] = None,
    also: AlsoOption = None,
    silhouette: SilhouetteOption = None,
    exclude: ExcludeOption = None,
    rigid: RigidOption = None,
    keep: KeepOption = None,
    only: OnlyOption = None,
    handle: HandleOption = None,
    param: SetOption = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.", rich_help_panel="Method")] = None,
    threads: Annotated[
        int | None, typer.Option(min=0, help="CPU threads; 0: all cores.", rich_help_panel="Method")
    ] = None,
    checkpoint: CheckpointOption = None,
    resume: ResumeOption = None,
    url: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Run the job on this service: submit it, follow it, and save its artifacts.",
            rich_help_panel="Service",
            show_default=False,
        ),
    ] = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    file: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART=FILE", help="A further file that jobs of --kind read; repeatable.", rich_help_panel="Service"
        ),
    ] = None,
    label: LabelOption = None,
    idempotency_key: Annotated[
        str | None,
        typer.Option(
            help="The same key within a day returns the same job.", rich_help_panel="Service", show_default=False
        ),
    ] = None,
    detach: DetachOption = False,
    timeout: TimeoutOption = None,
) -> None:
    """Deform ASSET until it looks like PROMPT, on this machine or on a service.

    meshdeform run examples/sphere.glb "a mushroom" -o mushroom.glb

    meshdeform run examples/sphere.glb --target examples/vase.glb --set laplacian_weight=0.3

    meshdeform run examples/sphere.glb "a mushroom" --url http://127.0.0.1:8765 -o mushroom
    """
    job = written(ctx, "job")
    kind = JobKind(job.get("kind", JobKind.TEXT_DEFORM))
    if animate is not None:
        check_animation(animate, "--animate")
    pictures = parse_pictures(silhouette)
    options: dict[str, Any] = {
        **({"guidance": "target"} if target else {}),
        **({"guidance": "silhouettes"} if silhouette and not (prompt or also or target) else {}),
        "silhouettes": pictures.views or None,
        "exclude": parse_exclude(exclude),
        "rigid": parse_rigid(rigid),
        "regions": parse_regions(keep, only),
        "prompts": parse_also(also),
        "handles": parse_handles(handle),
    }
    params = overlaid(merge_params(param or [], **options), written(ctx))
    outputs = written(ctx, "output")
    if "morph_path" in outputs:
        outputs["morph"] = True
    files = {**parse_files(file, kind, asset), **({"target": target} if target else {}), **pictures.parts}
    _refuse_other_place(
        url,
        kind,
        here={"--report": report, "--preview": preview, "--animate": animate, "--force": force, "--device": device,
              "--threads": threads, "--checkpoint": checkpoint, "--resume": resume},
        there={"--api-key-file": api_key_file, "--label": label, "--idempotency-key": idempotency_key,
               "--detach": detach, "--timeout": timeout},
    )  # fmt: skip
    if kind is not JobKind.TEXT_DEFORM:
        _refuse_deformation(kind, prompt, outputs)
    request = make_request(prompt, params, output=outputs, more={**job, "metadata": parse_labels(label or [])})
    if url:
        folder = output or Path(f"{asset.stem}-deformed" if kind is JobKind.TEXT_DEFORM else f"{asset.stem}-{kind}")
        place = (url, api_key, api_key_file)
        run_on_service(
            request,
            files,
            place,
            None if detach else folder,
            idempotency_key=idempotency_key,
            timeout=timeout,
            as_json=as_json,
            quiet=quiet,
        )
        return
    require("torch", "deform")
    output = output or Path(f"{asset.stem}-deformed.glb")
    check_glb(output)
    paths = _paths(request, output, report, preview)
    settings = load_settings(device=device, threads=threads)
    local = LocalJob(request, files, paths, settings, checkpoint=checkpoint, resume=resume)
    local.check(force=force, also=[animate] if animate else [])
    with show_progress(quiet=quiet) as progress:
        finished = local.run(progress)
        if animate is not None:
            data = drawn_animation(asset, output, animate.suffix, settings)
            write_all({animate: data}, what=animate, advice="Choose another path with --animate.")
    _print(_summary(local, finished, animate), as_json=as_json, quiet=quiet)


def _refuse_other_place(url: str | None, kind: JobKind, *, here: Mapping[str, Any], there: Mapping[str, Any]) -> None:
    """Refuse options that mean nothing where the job runs."""
    if not url and kind is not JobKind.TEXT_DEFORM:
        command = _LOCAL.get(kind, str(kind).replace("_", "-"))
        raise typer.BadParameter(
            f"jobs of kind {kind} run on this machine by meshdeform {command}, and on a service with --url",
            param_hint="--kind",
        )
    wrong = [name for name, value in (here if url else there).items() if value]
    if wrong:
        place = "on this machine, not for a service" if url else "for a service: name it with --url"
        raise typer.BadParameter(f"this is {place}", param_hint=wrong[0])


def _refuse_deformation(kind: JobKind, prompt: str, outputs: Mapping[str, Any]) -> None:
    """Refuse what only a deformation has: a prompt, and options of the output."""
    if prompt:
        raise typer.BadParameter(f"a job of kind {kind} has no prompt", param_hint="PROMPT")
    for name in outputs:
        raise typer.BadParameter(f"is only for text_deform, not for {kind}", param_hint=f"--{name.replace('_', '-')}")


def _paths(request: JobRequest, output: Path, report: Path | None, preview: Path | None) -> dict[str, Path]:
    """Return where each artifact goes."""
    return {
        "result.glb": output,
        "report.json": report or output.with_suffix(".report.json"),
        "preview.png": preview or output.with_suffix(".preview.png"),
        **({"morph.glb": output.with_suffix(".morph.glb")} if request.output.morph else {}),
    }


def _summary(job: LocalJob, finished: FinishedRun, animation: Path | None) -> dict[str, Any]:
    morph = job.outputs.get("morph.glb")
    return {
        "result": str(job.outputs["result.glb"]),
        "report": str(job.outputs["report.json"]),
        "preview": str(job.outputs["preview.png"]),
        "morph": str(morph) if morph else None,
        "steps": finished.steps,
        "resumed_from": finished.resumed_from,
        "losses": finished.losses,
        **report_summary(finished.report),
        "elapsed_s": finished.elapsed_s,
        "animation": str(animation) if animation else None,
    }


def _print(summary: Mapping[str, Any], *, as_json: bool, quiet: bool) -> None:
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    titles = {"result": "GLB", "morph": "Morph GLB", "report": "Report", "preview": "Picture"}
    titles |= {"animation": "Animation"}
    for name, title in titles.items():
        if summary[name] is not None:
            typer.echo(f"{title:<10} {summary[name]}")
    for line in filter(None, report_lines(summary)):
        typer.echo(line)
    for warning in summary["warnings"]:
        typer.echo(warning, err=True)
