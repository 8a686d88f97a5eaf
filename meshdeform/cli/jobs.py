"""The commands for a service's jobs: list, follow, fetch, cancel, continue and delete them; and `run --url`.

The events of a job arrive in a thread, so that timeout and Ctrl-C take effect at once whatever the network does.
"""

from __future__ import annotations

import hashlib
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from meshdeform.cli.environment import command_line, connect
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors, report
from meshdeform.cli.form import form_command, of_kind, overlaid, written
from meshdeform.cli.local import writing
from meshdeform.cli.options import (
    ApiKeyFileOption,
    ApiKeyOption,
    JobIdArgument,
    JobIdsArgument,
    JsonOption,
    QuietOption,
    SetOption,
    TimeoutOption,
    UrlOption,
    complete_states,
)
from meshdeform.cli.output import ago, duration, emit, note, plain, table
from meshdeform.cli.progress import show_progress
from meshdeform.cli.request import make_request, merge_params, parse_labels
from meshdeform.errors import ConflictError, MeshdeformError, NotFoundError, UnavailableError

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.cli.progress import ProgressView
    from meshdeform.client import Client
    from meshdeform.requests.document import JobRequest

__all__ = [
    "BranchCommand",
    "Deadline",
    "branch",
    "cancel",
    "delete",
    "fetch",
    "follow",
    "jobs",
    "left_running",
    "outcome_failure",
    "path_lines",
    "print_new",
    "retry",
    "run_on_service",
    "save_artifacts",
    "show_event",
    "wait",
    "watch",
]

T = TypeVar("T")
_PAGE = 100
_FOLDER = "Choose another folder with -o."
_ENDED = {"failed": "failed", "canceled": "was canceled", "expired": "expired"}
_PATIENCE_S = 120.0
"""Seconds that a service may be unreachable once it has responded: longer than a restart takes."""

BranchCommand = form_command(of_kind("text_deform"))


def run_on_service(
    request: JobRequest,
    files: Mapping[str, Path | bytes],
    place: tuple[str, str | None, Path | None],
    folder: Path | None,
    *,
    filename: str | None = None,
    idempotency_key: str | None = None,
    timeout: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Submit a job, follow it to its end, and save its artifacts.

    Parameters
    ----------
    request : JobRequest
    files : mapping of str to Path or bytes
        By part.
    place : tuple
        The service's address, the API key and the file of a key.
    folder : Path, optional
        Where the artifacts go; None: print the id, and do not wait.
    filename : str, optional
        That of the first file, if it has none of its own.
    idempotency_key : str, optional
    timeout : float, optional
        The longest wait, in seconds.
    as_json, quiet : bool

    Raises
    ------
    OutcomeError
        The job did not succeed, the time is over, or Ctrl-C came.
    """
    with connect(*place) as client:
        job = _submitted(client, request, files, filename, idempotency_key)
        if folder is None:
            print_new(job, place[0], as_json=as_json, quiet=quiet)
            return
        note(f"{job.id}  (Ctrl-C leaves it running)", quiet=quiet)
        with show_progress(quiet=quiet) as view:
            shown, deadline = partial(show_event, view=view), Deadline(timeout)
            ended = follow(client, job.id, shown, deadline=deadline, url=place[0])
        if failure := outcome_failure(ended):
            if as_json:
                emit(ended.as_json())
            raise failure
        saved = save_artifacts(client, job.id, folder)
    if as_json:
        emit({**ended.as_json(), "files": saved})
    else:
        typer.echo("\n".join([job.id, *path_lines(saved)]))


def _submitted(
    client: Client, request: JobRequest, files: Mapping[str, Path | bytes], filename: str | None, key: str | None
) -> JobView:
    try:
        return client.submit(
            None,
            request.prompt,
            kind=request.kind,
            params=request.params,
            output=request.output,
            metadata=request.metadata,
            files=dict(files),
            filename=filename,
            priority=request.priority,
            deadline_s=request.deadline_s,
            retention_s=request.retention_s,
            idempotency_key=key,
        )
    except KeyboardInterrupt:
        raise OutcomeError(
            ExitCode.INTERRUPTED,
            "interrupted",
            "Interrupted while submitting. The job may have been created.",
            "See: meshdeform jobs",
        ) from None


@clean_errors
def jobs(
    state: Annotated[
        str | None,
        typer.Option(help="Only jobs in this state, e.g. running.", autocompletion=complete_states, show_default=False),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TEXT", help="Only jobs with this label; repeatable.", show_default=False),
    ] = None,
    search: Annotated[
        str,
        typer.Option(
            metavar="WORDS", help="Only jobs whose prompt, file names or labels have these words.", show_default=False
        ),
    ] = "",
    limit: Annotated[int, typer.Option(min=1, help="At most this many.")] = 20,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """List the jobs of a service, newest first.

    meshdeform jobs --state running --search "duck vase"
    """
    if state is not None and state not in (known := complete_states("")):
        raise typer.BadParameter(f"{state!r} is not one of {', '.join(known)}", param_hint="--state")
    with connect(url, api_key, api_key_file) as client:
        every = client.jobs(state=state, metadata=parse_labels(label or []), search=search, limit=min(limit, _PAGE))
        found = list(islice(every, limit))
    if as_json:
        emit({"jobs": [job.as_json() for job in found]})
        return
    titles = ("ID", "STATE", "PROGRESS", "LEFT", "CREATED", "ASSET", "PROMPT")
    now = datetime.now(UTC)
    typer.echo(table(titles, [_row(job, now) for job in found]))


def _row(job: JobView, now: datetime) -> tuple[str, ...]:
    from meshdeform.requests.prompts import prompt_words

    progress = job.progress
    left = "" if progress.eta_s is None or job.state.terminal else duration(progress.eta_s)
    created = ago((now - job.created_at).total_seconds())
    # `fraction` is less than 1 for a job that was canceled half way.
    share = f"{progress.fraction:.0%}" if progress.total_steps else ""
    goal = prompt_words(job.prompt, job.params) or (f"like {job.target.filename}" if job.target else "")
    # By the server: its workers leave such a job to those of another version.
    state = f"{job.state.value} (unreadable)" if job.unreadable else job.state.value
    return job.id, state, share, left, created, job.asset.filename, goal


@clean_errors
def wait(
    job_ids: JobIdsArgument,
    timeout: TimeoutOption = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Wait until jobs have ended.

    Exit code 0: all succeeded; 5: one failed; 6: one was canceled or expired; 7: timed out.

    meshdeform wait $(meshdeform run examples/sphere.glb "a mushroom" --url URL --detach) --timeout 600
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
    timeout: TimeoutOption = None,
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


class Deadline:
    """A point in time, possibly never.

    Parameters
    ----------
    timeout_s : float, optional
        Seconds from now; None: never.
    """

    def __init__(self, timeout_s: float | None) -> None:
        self.timeout_s = timeout_s
        self._end = math.inf if timeout_s is None else time.monotonic() + timeout_s

    @property
    def left_s(self) -> float | None:
        """Seconds left; None without a limit."""
        return None if math.isinf(self._end) else max(0.0, self._end - time.monotonic())


def follow(
    client: Client,
    job_id: str,
    on_event: Callable[[EventView], None],
    *,
    deadline: Deadline,
    url: str | None = None,
    on_start: Callable[[JobView], None] = lambda _: None,
    replay: bool = True,
) -> JobView:
    """Pass on a job's events until it has ended.

    Parameters
    ----------
    client : Client
    job_id : str
    on_event : callable
        Called with every event once, in order, in this thread.
    deadline : Deadline
    url : str, optional
        As given on the command line, for the commands in the advice.
    on_start : callable
        Called with the job in its state at the beginning.
    replay : bool
        Whether to pass on the events of a job that has already ended.

    Returns
    -------
    JobView
        The job in its terminal state.

    Raises
    ------
    OutcomeError
        Timeout (`timed_out`) or Ctrl-C (`interrupted`). The job continues.
    MeshdeformError
        The job does not exist, or the service stays unreachable.
    """
    try:
        job = client.get(job_id)
        on_start(job)
        if job.state.terminal and not replay:
            return job
        events: queue.SimpleQueue[EventView | Exception | None] = queue.SimpleQueue()
        threading.Thread(target=_listen, args=(client, job_id, events), name=f"events of {job_id}", daemon=True).start()
        while True:
            try:
                found = events.get(timeout=deadline.left_s)
            except queue.Empty:
                raise _timed_out(job_id, deadline, url) from None
            if found is None:
                return client.get(job_id)
            if isinstance(found, Exception):
                raise found
            on_event(found)
    except KeyboardInterrupt:
        raise left_running([job_id], url) from None


def _listen(client: Client, job_id: str, events: queue.SimpleQueue[EventView | Exception | None]) -> None:
    after, alive_at = None, time.monotonic()
    while True:
        try:
            for event in client.watch(job_id, after=after):
                after, alive_at = event.seq, time.monotonic()
                events.put(event)
        except UnavailableError as error:
            if time.monotonic() - alive_at < _PATIENCE_S:
                time.sleep(1.0)
                continue
            events.put(error)
        except Exception as error:  # raised again in the waiting thread
            events.put(error)
        else:
            events.put(None)
        return


def _timed_out(job_id: str, deadline: Deadline, url: str | None) -> OutcomeError:
    return OutcomeError(
        ExitCode.TIMED_OUT,
        "timed_out",
        f"The job {job_id} has not ended after {deadline.timeout_s:g} s. It continues.",
        f"To keep waiting: {command_line(f'wait {job_id}', url)}",
        job_id=job_id,
    )


def left_running(job_ids: list[str], url: str | None) -> OutcomeError:
    """Return the error for Ctrl-C while waiting for jobs, which continue."""
    ids = " ".join(job_ids)
    what = f"The job {ids} continues" if len(job_ids) == 1 else f"The jobs {ids} continue"
    reattach = "watch" if len(job_ids) == 1 else "wait"
    return OutcomeError(
        ExitCode.INTERRUPTED,
        "interrupted",
        f"Interrupted. {what}.",
        f"To reattach: {command_line(f'{reattach} {ids}', url)}\nTo cancel: {command_line(f'cancel {ids}', url)}",
        job_ids=job_ids,
    )


def show_event(event: EventView, view: ProgressView) -> None:
    """Show a job's event as progress."""
    data: dict[str, Any] = event.data
    if event.type.value != "progress":
        if event.type.value != "checkpoint":
            view.phase(event.type.value)
        return
    view.phase(str(data.get("phase", "running")))
    if total := int(data.get("total_steps", 0)):
        loss = (data.get("losses") or {}).get("total", math.nan)
        view.step(int(data.get("step", 0)), total, loss, data.get("eta_s"))


def outcome_failure(job: JobView) -> OutcomeError | None:
    """Return the error for a job that did not succeed; None for one that did."""
    if job.state.value == "succeeded":
        return None
    if job.error is not None and job.state.value == "failed":
        return OutcomeError(
            ExitCode.JOB_FAILED,
            job.error.code,
            f"The job {job.id} failed: {job.error.detail}",
            job.error.advice,
            job_id=job.id,
            state=job.state.value,
        )
    return OutcomeError(
        ExitCode.JOB_FAILED if job.state.value == "failed" else ExitCode.JOB_ENDED,
        f"job_{job.state.value}",
        f"The job {job.id} {_ENDED[job.state.value]}.",
        "Submit it again, with a later deadline if it had one.",
        job_id=job.id,
        state=job.state.value,
    )


def _complete_names(incomplete: str) -> list[str]:
    from meshdeform.runs import kinds

    names = dict.fromkeys(artifact.name for kind in kinds() for artifact in kind.artifacts)
    return [name for name in names if name.startswith(incomplete)]


@clean_errors
def fetch(
    job_id: JobIdArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The folder; default: named after the job.", file_okay=False, show_default=False
        ),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this artifact; repeatable. Default: all. morph.glb and result.stl are made if needed.",
            autocompletion=_complete_names,
            show_default=False,
        ),
    ] = None,
    step: Annotated[
        int | None,
        typer.Option(min=0, help="Instead: the shape at this checkpoint, as step-N.glb.", show_default=False),
    ] = None,
    asset: Annotated[bool, typer.Option("--asset", help="Instead: the asset as it was submitted.")] = False,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Save the artifacts of a job.

    Each file is verified against its SHA-256 before it appears; a file that is already there is not downloaded again.

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --name result.glb --name morph.glb

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --step 100
    """
    if (step is not None) + asset + bool(name) > 1:
        raise typer.BadParameter("give only one of --name, --step and --asset")
    folder = output or Path(job_id)
    with connect(url, api_key, api_key_file) as client:
        job = client.get(job_id)
        if not (asset or step is not None or job.state.terminal):
            note(f"The job is {job.state}: more artifacts may follow.", quiet=quiet)
        if asset:
            files = [_save_one(folder / _safe_name(job.asset.filename), partial(client.download_asset, job_id))]
        elif step is not None:
            files = [_save_one(folder / f"step-{step}.glb", partial(client.download_checkpoint, job_id, step))]
        else:
            files = save_artifacts(client, job_id, folder, name)
    if as_json:
        emit({"job_id": job_id, "files": files})
    elif not quiet:
        typer.echo("\n".join(path_lines(files)))


def _safe_name(filename: str) -> str:
    """Return the last part of a file name that a client sent, which may hold anything."""
    name = plain(filename.replace("\\", "/").rpartition("/")[2]).strip()
    return name if name not in ("", ".", "..") else "asset"


def _save_one(path: Path, download: Callable[[Path], Path]) -> dict[str, Any]:
    with writing(path.parent, _FOLDER):
        path.parent.mkdir(parents=True, exist_ok=True)
        download(path)
        data = path.read_bytes()
    return {"name": path.name, "path": str(path), "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def save_artifacts(client: Client, job_id: str, folder: Path, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Save a job's artifacts into a folder and return name, path, size in bytes and SHA-256 of each.

    Those that can still be made are made if they are named.

    Raises
    ------
    NotFoundError
        The job has no artifact of such a name.
    UnavailableError
        The folder cannot be written, or the service does not respond.
    """
    from meshdeform.client.downloads import AFTERWARDS

    known = {artifact.name: artifact for artifact in client.artifacts(job_id)}
    missing = [name for name in names or [] if name not in known]
    for name in [name for name in missing if known and name in AFTERWARDS]:
        known[name] = client.make(job_id, name)
        missing.remove(name)
    if missing:
        has = f"It has {', '.join(known)}." if known else "It has none yet."
        raise NotFoundError(f"The job {job_id} has no {', '.join(missing)}.", advice=has)
    if not known:
        raise NotFoundError(f"The job {job_id} has no artifacts.", advice="Only a job that succeeded has results.")
    with writing(folder, _FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        paths = client.fetch(job_id, folder, names)
    return [
        {"name": path.name, "path": str(path), "size": known[path.name].size, "sha256": known[path.name].sha256}
        for path in paths
        if path.name in known
    ]


def path_lines(files: list[dict[str, Any]]) -> list[str]:
    """Return a line with the path of each file."""
    return [plain(file["path"]) for file in files]


@clean_errors
def cancel(
    job_ids: JobIdsArgument,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Cancel jobs.

    A running job stops after its current step; a job that has ended stays as it is.

    meshdeform cancel job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """

    def end(client: Client, job_id: str) -> JobView:
        job = client.cancel(job_id)
        if not as_json:
            typer.echo(f"{job.id}  {job.state}")
        return job

    with connect(url, api_key, api_key_file) as client:
        jobs, failures = _each(client, job_ids, end)
    if as_json:
        emit({"jobs": [job.as_json() for job in jobs]})
    _raise_last(failures, as_json=as_json)


def _each(
    client: Client, job_ids: Sequence[str], end: Callable[[Client, str], T]
) -> tuple[list[T], list[MeshdeformError]]:
    """End each job, the others too if one is not there or in another state."""
    ended, failures = list[T](), list[MeshdeformError]()
    for job_id in dict.fromkeys(job_ids):
        try:
            ended.append(end(client, job_id))
        except (ConflictError, NotFoundError) as error:
            failures.append(error)
    return ended, failures


def _raise_last(failures: Sequence[MeshdeformError], *, as_json: bool) -> None:
    for failure in failures[:-1]:
        report(failure, as_json=as_json)
    if failures:
        raise failures[-1]


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
        print_new(client.retry(job_id), url, as_json=as_json, quiet=quiet)


@clean_errors
def branch(
    ctx: typer.Context,
    job_id: JobIdArgument,
    prompt: Annotated[str, typer.Argument(help='What it should become from there, e.g. "a vase".')],
    step: Annotated[
        int | None, typer.Option(min=0, help="Step of the checkpoint; default: the last one.", show_default=False)
    ] = None,
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
    request = make_request(prompt, overlaid(merge_params(settings or []), written(ctx)))
    with connect(url, api_key, api_key_file) as client:
        if step is None:
            found = client.checkpoints(job_id)
            if not found:
                raise NotFoundError(f"The job {job_id} has no checkpoint.", advice="Submit a new job instead.")
            step = max(checkpoint.step for checkpoint in found)
        job = client.branch(job_id, step, request.prompt, params=request.params)
    print_new(job, url, as_json=as_json, quiet=quiet)


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

    def end(client: Client, job_id: str) -> str:
        client.delete(job_id)
        if not (as_json or quiet):
            typer.echo(f"{job_id}  deleted")
        return job_id

    with connect(url, api_key, api_key_file) as client:
        deleted, failures = _each(client, job_ids, end)
    if as_json:
        emit({"deleted": deleted})
    _raise_last(failures, as_json=as_json)


def print_new(job: JobView, url: str | None, *, as_json: bool, quiet: bool) -> None:
    """Print a job that was created."""
    if as_json:
        emit(job.as_json())
    else:
        typer.echo(job.id)
        note(f"Follow it: {command_line(f'watch {job.id}', url)}", quiet=quiet)
