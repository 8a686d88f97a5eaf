"""`meshdeform wait` and `meshdeform watch`: wait until jobs have ended."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.connection import connect
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors, report
from meshdeform.cli.following import Deadline, follow, left_running, outcome_failure, show_event
from meshdeform.cli.options import (
    ApiKeyFileOption,
    ApiKeyOption,
    JobIdArgument,
    JobIdsArgument,
    JsonOption,
    QuietOption,
    UrlOption,
)
from meshdeform.cli.output import emit, note
from meshdeform.cli.progress import show_progress

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.client import Client

__all__ = ["wait", "watch"]

_TimeoutOption = Annotated[float | None, typer.Option(min=0.0, help="Wait at most this many seconds.")]


@clean_errors
def wait(
    job_ids: JobIdsArgument,
    timeout: _TimeoutOption = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Wait until jobs have ended.

    Exit code 0: all succeeded; 5: one failed; 6: one was canceled or expired; 7: timed out.

    meshdeform wait $(meshdeform submit examples/sphere.glb "a mushroom") --timeout 600
    """
    ids = list(dict.fromkeys(job_ids))
    with connect(url, api_key, api_key_file) as client:
        jobs = _wait_for(client, ids, Deadline(timeout), url, as_json=as_json, quiet=quiet)
    failures = [failure for job in jobs if (failure := outcome_failure(job))]
    if as_json:
        emit({"jobs": [job.as_json() for job in jobs]})
    if failures:
        worst = min(failures, key=lambda failure: failure.exit_code)
        for failure in failures:
            if failure is not worst:
                report(failure, as_json=as_json)
        raise worst


def _wait_for(
    client: Client, ids: list[str], deadline: Deadline, url: str | None, *, as_json: bool, quiet: bool
) -> list[JobView]:
    jobs: list[JobView] = []
    for job_id in ids:
        try:
            with show_progress(quiet=quiet) as view:
                shown = partial(show_event, view=view)
                job = follow(client, job_id, shown, deadline=deadline, url=url, replay=False)
        except OutcomeError as failure:
            if failure.exit_code is ExitCode.INTERRUPTED:
                raise left_running(ids[len(jobs) :], url) from None
            raise
        jobs.append(job)
        if not (as_json or quiet):
            typer.echo(f"{job.id}  {job.state}")
    return jobs


@clean_errors
def watch(
    job_id: JobIdArgument,
    timeout: _TimeoutOption = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Follow a job to its end.

    Shows a bar with loss and time left, plain lines in a log; with --json every event as a line. Reconnects
    after dropped connections. Ctrl-C leaves the job running.

    meshdeform watch job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """
    with (
        connect(url, api_key, api_key_file) as client,
        show_progress(quiet=quiet or as_json) as view,
    ):

        def on_start(job: JobView) -> None:
            if not as_json:
                note(f"{job.id}  {job.asset.filename}  {job.prompt}".rstrip(), quiet=quiet)

        def on_event(event: EventView) -> None:
            if as_json:
                emit(event.model_dump(mode="json"))
            show_event(event, view)

        job = follow(client, job_id, on_event, deadline=Deadline(timeout), url=url, on_start=on_start)
    if not (as_json or quiet):
        typer.echo(f"{job.id}  {job.state}")
    if failure := outcome_failure(job):
        raise failure
