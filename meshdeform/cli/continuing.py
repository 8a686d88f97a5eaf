"""`meshdeform retry`, `branch` and `delete`: continue from jobs that have ended, or delete them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.connection import command_line, connect
from meshdeform.cli.exits import clean_errors, report
from meshdeform.cli.options import (
    ApiKeyFileOption,
    ApiKeyOption,
    JobIdArgument,
    JobIdsArgument,
    JsonOption,
    QuietOption,
    SetOption,
    UrlOption,
)
from meshdeform.cli.output import emit, note
from meshdeform.cli.request import make_request, merge_params
from meshdeform.errors import ConflictError, MeshdeformError, NotFoundError
from meshdeform.requests.choices import Preset

if TYPE_CHECKING:
    from meshdeform.api.jobs import JobView

__all__ = ["branch", "delete", "retry"]


@clean_errors
def retry(
    job_id: JobIdArgument,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Retry a job that did not succeed, and print the id of the new job.

    It continues from the last checkpoint.

    meshdeform retry job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """
    with connect(url, api_key, api_key_file) as client:
        _print_new(client.retry(job_id), url, as_json=as_json, quiet=quiet)


@clean_errors
def branch(
    job_id: JobIdArgument,
    prompt: Annotated[str, typer.Argument(help='What it should become from there, e.g. "a vase".')],
    step: Annotated[
        int | None, typer.Option(min=0, help="Step of the checkpoint; default: the last one.", show_default=False)
    ] = None,
    preset: Annotated[
        Preset | None, typer.Option(help="Quality: preview (fast), balanced (the default) or paper (slow).")
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Optimiser iterations; default: the preset's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: 0.")] = None,
    settings: SetOption = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Start a new job from the shape of a job at a checkpoint, with another prompt, and print its id.

    meshdeform branch job_01kg9zqk2xf3v8c5m7n9p1r4t6 "a vase" --step 100
    """
    params = merge_params(settings or [], preset=preset, steps=steps, seed=seed)
    request = make_request(prompt, params)
    with connect(url, api_key, api_key_file) as client:
        if step is None:
            found = client.checkpoints(job_id)
            if not found:
                raise NotFoundError(f"The job {job_id} has no checkpoint.", advice="Submit a new job instead.")
            step = max(checkpoint.step for checkpoint in found)
        job = client.branch(job_id, step, request.prompt, params=request.params)
    _print_new(job, url, as_json=as_json, quiet=quiet)


@clean_errors
def delete(
    job_ids: JobIdsArgument,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Delete jobs that have ended, with all their artifacts. This cannot be undone.

    meshdeform delete job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """
    deleted, failures = list[str](), list[MeshdeformError]()
    with connect(url, api_key, api_key_file) as client:
        for job_id in dict.fromkeys(job_ids):
            try:
                client.delete(job_id)
            except (ConflictError, NotFoundError) as error:
                # Delete the others even if one is running or does not exist.
                failures.append(error)
                continue
            deleted.append(job_id)
            if not (as_json or quiet):
                typer.echo(f"{job_id}  deleted")
    if as_json:
        emit({"deleted": deleted})
    for failure in failures[:-1]:
        report(failure, as_json=as_json)
    if failures:
        raise failures[-1]


def _print_new(job: JobView, url: str | None, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        emit(job.as_json())
    else:
        typer.echo(job.id)
        note(f"Follow it: {command_line(f'watch {job.id}', url)}", quiet=quiet)
