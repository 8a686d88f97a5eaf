"""`meshdeform teach`: teach the builtin prior a noun from meshes, on this machine."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.connection import command_line, connect
from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import (
    ApiKeyFileOption,
    ApiKeyOption,
    JsonOption,
    QuietOption,
    UrlOption,
    complete_models,
)
from meshdeform.cli.output import emit, note
from meshdeform.cli.overwriting import check_outputs
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.api.jobs import JobView
    from meshdeform.cli.progress import ProgressView
    from meshdeform.client import Client
    from meshdeform.priors.builtin.teaching.lesson import NewNoun
    from meshdeform.runs.teaching import TeachingRun

__all__ = ["teach"]

_WORDS, _TRAINING, _RESUME = "The word", "Training", "Interrupt and resume"
_CHECKPOINT_EVERY = 50


@clean_errors
def teach(
    noun: Annotated[str, typer.Argument(help='What the meshes show: "a teapot".')],
    meshes: Annotated[
        list[Path],
        typer.Argument(
            help="GLB, OBJ, PLY, STL or ZIP files, or folders of them. The subfolders of a folder are named by "
            "attributes: tall, long-nose.",
            exists=True,
            readable=True,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The file of weights. Default: NOUN.safetensors.")
    ] = None,
    synonym: Annotated[
        list[str] | None, typer.Option(help="Another name of the same thing; repeatable.", rich_help_panel=_WORDS)
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Give a noun that the model knows a new meaning.", rich_help_panel=_WORDS)
    ] = False,
    licence: Annotated[
        str,
        typer.Option(help="One line about the licence of the meshes, kept in the file.", rich_help_panel=_WORDS),
    ] = "",
    front: Annotated[
        float,
        typer.Option(
            min=-360, max=360, help="Azimuth of the front of the meshes: 0 is +Z, 90 is +X.", rich_help_panel=_WORDS
        ),
    ] = 0.0,
    family: Annotated[
        Path | None,
        typer.Option(
            help="The family.safetensors that family-fit found in the meshes: members are new shapes of it.",
            exists=True,
            dir_okay=False,
            rich_help_panel=_TRAINING,
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="What to start from: builtin, or a file that this command wrote.",
            rich_help_panel=_TRAINING,
            autocompletion=complete_models,
        ),
    ] = "builtin",
    steps: Annotated[
        int, typer.Option(min=1, max=100_000, help="Most steps of the training.", rich_help_panel=_TRAINING)
    ] = 600,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Random seed.", rich_help_panel=_TRAINING)] = 0,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.", rich_help_panel=_TRAINING)] = None,
    threads: Annotated[
        int | None, typer.Option(min=0, help="CPU threads; 0: all cores.", rich_help_panel=_TRAINING)
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            help="Save the state to this file regularly and at Ctrl-C.",
            rich_help_panel=_RESUME,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            help="Continue from a file that --checkpoint wrote.",
            rich_help_panel=_RESUME,
            exists=True,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that no earlier run wrote.")] = False,
    service: Annotated[
        bool,
        typer.Option(
            "--service",
            help="Let a service hold the lesson as a job of yours, and print its id; --model job:ID then names it.",
            rich_help_panel="Service",
        ),
    ] = False,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Teach the builtin model a noun from your own meshes, so that prompts may name it.

    meshdeform teach "a teapot" teapots/*.glb -o mine.safetensors

    meshdeform run sphere.glb "a teapot" --model mine.safetensors
    """
    if service:
        local = {"--output": output, "--checkpoint": checkpoint, "--resume": resume, "--device": device}
        _refuse_local({**local, "--threads": threads, "--force": force, "--family": family})
        words = {"synonyms": synonym or [], "replace": replace, "licence": licence, "front_deg": front}
        with connect(url, api_key, api_key_file) as client:
            job = _posted(client, noun, meshes, {**words, "model": model, "steps": steps, "seed": seed})
        if as_json:
            emit(job.as_json())
        else:
            typer.echo(job.id)
            note(f"Follow it: {command_line(f'watch {job.id}', url)}", quiet=quiet)
        return
    require("torch", "deform")
    settings = load_settings(device=device, threads=threads)
    base, new = _base(model, settings.offered_models), _new_noun(noun, model, settings.offered_models, synonym, replace)
    output = output or Path(f"{new.noun}.safetensors")
    if output.suffix != ".safetensors":
        raise typer.BadParameter(f"{output.name} does not end in .safetensors", param_hint="--output")
    from meshdeform.assets import Limits
    from meshdeform.runs.lesson_files import find_meshes, read_meshes

    found = find_meshes(meshes, new)
    limits = Limits.from_settings(settings)
    paths = {
        "result": output,
        "report": output.with_suffix(".report.json"),
        "preview": output.with_suffix(".preview.png"),
    }
    if not force:
        check_outputs(paths, [mesh.path for mesh in found] + [path for path in (resume, base) if path])
        _check_state(checkpoint)
    files = read_meshes(found, limits)
    from meshdeform.cli.local_job import try_folder, writing
    from meshdeform.cli.progress import show_progress
    from meshdeform.priors.builtin.teaching.teacher import TeachConfig
    from meshdeform.priors.builtin.weights_file import WEIGHTS
    from meshdeform.runs.devices import resolve_device, use_threads
    from meshdeform.runs.teaching import TeachRequest, start
    from meshdeform.support.files import write_files

    with writing():
        try_folder(output)
    if checkpoint is not None:
        with writing("The checkpoint", "--checkpoint"):
            try_folder(checkpoint)
    use_threads(settings.threads)
    request = TeachRequest(
        noun=noun,
        synonyms=tuple(synonym or ()),
        replace=replace,
        licence=licence,
        front_deg=front,
        base=base or WEIGHTS,
        config=TeachConfig(steps=steps, seed=seed),
    )
    with show_progress(quiet=quiet) as progress:
        progress.phase("drawing the pictures")
        state = resume.read_bytes() if resume else None
        learned = family.read_bytes() if family else None
        device = resolve_device(settings.device)
        run = start(request, files, family=learned, state=state, device=device, limits=limits)
        progress.phase("training")
        _drive(run, progress, checkpoint)
        progress.phase("measuring")
        made = run.finish()
        with writing():
            write_files({paths[name]: data for name, data in made.items()})
    report = json.loads(made["report"])
    if as_json:
        emit({**{name: str(path) for name, path in paths.items()}, **report, "result": str(output)})
    elif not quiet:
        _show(paths, report)


def _refuse_local(given: dict[str, Any]) -> None:
    """Refuse options that mean nothing to a lesson of a service."""
    if found := [name for name, value in given.items() if value]:
        raise typer.BadParameter("this is for lessons on this machine, not for --service", param_hint=found[0])


def _posted(client: Client, noun: str, meshes: list[Path], params: dict[str, Any]) -> JobView:
    try:
        return client.teach(noun, meshes, params=params)
    except ValueError as error:
        raise ParameterError(str(error)) from error


def _base(model: str, offered: list[str]) -> Path | None:
    """Return the file to start from; None for the weights in the package."""
    from meshdeform.priors.public_names import configured_name
    from meshdeform.requests.models import is_builtin, is_taught

    if not is_builtin(model):
        raise ParameterError(
            f"{model!r} cannot be taught.", advice="Start from builtin, or from a file that this command wrote."
        )
    return Path(configured_name(model, offered)).expanduser() if is_taught(model) else None


def _new_noun(noun: str, model: str, offered: list[str], synonyms: list[str] | None, replace: bool) -> NewNoun:
    """Check the words before torch is imported, which takes seconds."""
    from meshdeform.priors.builtin.taught import known_words
    from meshdeform.priors.builtin.teaching.lesson import new_noun
    from meshdeform.priors.public_names import configured_name

    return new_noun(noun, known_words(configured_name(model, offered)), synonyms=synonyms or (), replace_known=replace)


def _check_state(path: Path | None) -> None:
    from meshdeform.priors.builtin.teaching.lesson import STATE_MAGIC

    if path is None or not path.exists():
        return
    with path.open("rb") as file:
        if file.read(len(STATE_MAGIC)) != STATE_MAGIC:
            raise ParameterError(
                f"{path} exists and is not a checkpoint of this command.",
                advice="Choose another name with --checkpoint, or overwrite it with --force.",
            )


def _drive(run: TeachingRun, progress: ProgressView, checkpoint: Path | None) -> None:
    """Do the steps; store checkpoints, also at Ctrl-C."""
    from meshdeform.cli.interrupting import ctrl_c_between_steps
    from meshdeform.cli.local_job import writing
    from meshdeform.support.files import write_files

    with ctrl_c_between_steps() as interrupted:
        for done in run:
            progress.step(done.step, done.total_steps, done.loss)
            stop = interrupted()
            if checkpoint is not None and (stop or done.step % _CHECKPOINT_EVERY == 0):
                with writing("The checkpoint", "--checkpoint"):
                    write_files({checkpoint: run.state()})
            if stop:
                detail, advice = "Nothing was written.", "With --checkpoint FILE it could be resumed."
                if checkpoint is not None:
                    detail = f"The state is in {checkpoint}."
                    advice = f"Continue with --resume {shlex.quote(str(checkpoint))}"
                where = f"Interrupted at step {done.step} of {done.total_steps}."
                raise OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"{where} {detail}", advice)


def _show(paths: dict[str, Path], report: dict[str, Any]) -> None:
    steps, seen = report["steps"], report["retrieval"]
    typer.echo(f"Weights    {paths['result']}")
    typer.echo(f"Picture    {paths['preview']}")
    typer.echo(f"Report     {paths['report']}")
    typer.echo(f"Steps      {steps['done']} of at most {steps['most']}; the best weights are those of {steps['best']}")
    new, before, after = seen["new"], seen["old_before"], seen["old_after"]
    typer.echo(f"New noun   {new['hits']} of {new['pictures']} held-out pictures are taken for a {report['noun']}")
    typer.echo(
        f"Old nouns  {after['hits']} of {after['pictures']} pictures are taken for what they show; "
        f"before the lesson {before['hits']}"
    )
    for warning in report["warnings"]:
        typer.echo(warning, err=True)
