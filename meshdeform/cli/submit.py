"""`meshdeform submit`: submit a job to a service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.connection import command_line, connect
from meshdeform.cli.control import parse_handles, parse_regions, parse_rigid
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.fetch import path_lines, save_artifacts
from meshdeform.cli.following import Deadline, follow, outcome_failure, show_event
from meshdeform.cli.goals import parse_goals
from meshdeform.cli.job_kinds import parse_files, refuse_deformation
from meshdeform.cli.options import (
    AlsoOption,
    ApiKeyFileOption,
    ApiKeyOption,
    ExcludeOption,
    HandleOption,
    JsonOption,
    KeepOption,
    ModelOption,
    MorphPathOption,
    OnlyOption,
    QuietOption,
    RigidOption,
    RigOption,
    SetOption,
    SilhouetteOption,
    SymmetryOption,
    UrlOption,
)
from meshdeform.cli.output import emit, note
from meshdeform.cli.progress import show_progress
from meshdeform.cli.prompts import parse_also
from meshdeform.cli.request import (
    make_request,
    merge_params,
    parse_exclude,
    parse_labels,
    parse_morph_path,
)
from meshdeform.cli.silhouettes import parse_pictures
from meshdeform.requests.choices import JobKind, Preset

if TYPE_CHECKING:
    from meshdeform.api.jobs import JobView
    from meshdeform.client import Client

__all__ = ["submit"]

_METHOD, _JOB, _WAIT = "Method", "Job", "Waiting"


@clean_errors
def submit(
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
    preset: Annotated[
        Preset | None,
        typer.Option(
            help="Quality: preview (fast), balanced (the default) or paper (slow).",
            rich_help_panel=_METHOD,
            show_default=False,
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Optimiser iterations; default: the preset's.", rich_help_panel=_METHOD)
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Random seed: another seed gives another variation; default: 0.", rich_help_panel=_METHOD),
    ] = None,
    model: ModelOption = None,
    orientation: Annotated[
        str | None,
        typer.Option(
            help="Which side of the asset becomes the front: auto, keep or degrees from +Z towards +X.",
            rich_help_panel=_METHOD,
        ),
    ] = None,
    guidance_scale: Annotated[
        float | None,
        typer.Option(help="How strongly the prompt pulls (classifier-free guidance).", rich_help_panel=_METHOD),
    ] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="How far one step may go (Adam's step size).", rich_help_panel=_METHOD)
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            help="A mesh to deform towards, instead of a prompt.",
            exists=True,
            dir_okay=False,
            rich_help_panel=_METHOD,
            show_default=False,
        ),
    ] = None,
    sketch: Annotated[
        Path | None,
        typer.Option(
            help="A line drawing (PNG, JPEG or WebP) whose first guess is the target. Correct it by "
            """--set 'sketch={"family": "vase", "values": {"handles": "two"}}'.""",
            exists=True,
            dir_okay=False,
            rich_help_panel=_METHOD,
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
    symmetry: SymmetryOption = None,
    rig: RigOption = None,
    settings: SetOption = None,
    morph: Annotated[bool, typer.Option("--morph", help="Also make morph.glb.", rich_help_panel=_JOB)] = False,
    morph_path: MorphPathOption = None,
    subdivide: Annotated[
        bool,
        typer.Option(
            "--subdivide", help="Split long edges first, so that large triangles can bend.", rich_help_panel=_JOB
        ),
    ] = False,
    compact: Annotated[
        bool, typer.Option("--compact", help="Drop data that the new shape made unused.", rich_help_panel=_JOB)
    ] = False,
    provenance: Annotated[
        bool, typer.Option("--provenance", help="Store prompt, seed and source in the GLB.", rich_help_panel=_JOB)
    ] = False,
    kind: Annotated[
        JobKind,
        typer.Option(
            help="What the job does. Other kinds than text_deform take their parameters by --set, --steps, --seed and "
            "--learning-rate.",
            rich_help_panel=_JOB,
        ),
    ] = JobKind.TEXT_DEFORM,
    file: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART=FILE", help="A further file that jobs of --kind read; repeatable.", rich_help_panel=_JOB
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TEXT", help="A label of your own; repeatable.", rich_help_panel=_JOB),
    ] = None,
    priority: Annotated[
        int | None,
        typer.Option(help="-100 to 100; the queued job with the highest value runs first.", rich_help_panel=_JOB),
    ] = None,
    deadline_s: Annotated[
        float | None, typer.Option(help="Seconds after which the job expires.", rich_help_panel=_JOB)
    ] = None,
    idempotency_key: Annotated[
        str | None,
        typer.Option(help="The same key within a day returns the same job.", rich_help_panel=_JOB, show_default=False),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait until the job has ended.", rich_help_panel=_WAIT)] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Wait, then save all artifacts into this folder.",
            file_okay=False,
            rich_help_panel=_WAIT,
            show_default=False,
        ),
    ] = None,
    timeout: Annotated[
        float | None, typer.Option(min=0.0, help="Wait at most this many seconds.", rich_help_panel=_WAIT)
    ] = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Submit a job to a service and print its id.

    meshdeform submit examples/sphere.glb "a mushroom" --preset preview

    meshdeform submit examples/sphere.glb "a vase" -o vase --url http://127.0.0.1:8765

    meshdeform submit scan.xyz --kind surface_fit --set base_faces=500 -o scan
    """
    parts = parse_files(file, kind, asset)
    goals = parse_goals(target, sketch)
    pictures = parse_pictures(silhouette)
    if silhouette and not (prompt or also) and not goals.params:
        goals.params["guidance"] = "silhouettes"
    params = merge_params(
        settings or [],
        preset=preset,
        **goals.params,
        silhouettes=pictures.views or None,
        model=model,
        steps=steps,
        seed=seed,
        orientation=orientation,
        guidance_scale=guidance_scale,
        learning_rate=learning_rate,
        exclude=parse_exclude(exclude),
        rigid=parse_rigid(rigid),
        regions=parse_regions(keep, only),
        prompts=parse_also(also),
        handles=parse_handles(handle),
        symmetry=symmetry,
    )
    more = {"kind": kind, "metadata": parse_labels(label or []), "priority": priority, "deadline_s": deadline_s}
    # Validate before the asset is uploaded.
    wanted = {
        "morph": morph or bool(morph_path),
        "morph_path": parse_morph_path(morph_path),
        "compact": compact,
        "subdivide": subdivide,
        "provenance": provenance,
        "rig": rig,
    }
    if kind != JobKind.TEXT_DEFORM:
        refuse_deformation(kind, prompt, wanted)
    request = make_request(prompt, params, output=wanted, more=more)
    with connect(url, api_key, api_key_file) as client:
        job = _submitted(
            client,
            request.prompt,
            kind=kind,
            params=request.params,
            output=request.output,
            metadata=request.metadata,
            files={**parts, **goals.files, **pictures.parts},
            priority=request.priority,
            deadline_s=request.deadline_s,
            idempotency_key=idempotency_key,
        )
        if not (wait or output):
            if as_json:
                emit(job.as_json())
            else:
                typer.echo(job.id)
                note(f"Follow it: {command_line(f'watch {job.id}', url)}", quiet=quiet)
            return
        note(f"{job.id}  (Ctrl-C leaves it running)", quiet=quiet)
        with show_progress(quiet=quiet) as view:
            ended = follow(client, job.id, lambda event: show_event(event, view), deadline=Deadline(timeout), url=url)
        if failure := outcome_failure(ended):
            if as_json:
                emit(ended.as_json())
            raise failure
        files = save_artifacts(client, job.id, output) if output else []
    if as_json:
        emit({**ended.as_json(), **({"files": files} if output else {})})
    else:
        typer.echo("\n".join([job.id, *path_lines(files)]))


def _submitted(client: Client, prompt: str, **options: Any) -> JobView:
    try:
        return client.submit(None, prompt, **options)
    except KeyboardInterrupt:
        raise OutcomeError(
            ExitCode.INTERRUPTED,
            "interrupted",
            "Interrupted while submitting. The job may have been created.",
            "See: meshdeform jobs",
        ) from None
