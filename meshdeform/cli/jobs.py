"""The commands for a service's jobs: list, follow, fetch, cancel, continue and delete them; and `run --url`.

The events of a job arrive in a thread, so that timeout and Ctrl-C take effect at once whatever the network does.
"""

from __future__ import annotations

import hashlib
import json
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import command_line
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors, report
from meshdeform.cli.form import of_kind, with_options
from meshdeform.cli.local import writing
from meshdeform.cli.options import (
    JobIdArgument,
    JobIdsArgument,
    JobWhere,
    JsonOption,
    Printed,
    SetOption,
    TimeoutOption,
    Where,
    complete_states,
    flag,
    option,
    output_option,
)
from meshdeform.cli.output import ago, duration, emit, note, plain, show_progress, show_uploads, table
from meshdeform.cli.report_lines import verdict_line
from meshdeform.cli.request import make_request, merge_params, parse_labels
from meshdeform.errors import ConflictError, MeshdeformError, NotFoundError, UnavailableError
from meshdeform.verdicts import read_verdict

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.cli.output import ProgressView
    from meshdeform.client import Client
    from meshdeform.requests.document import JobRequest

_PAGE = 100
_FOLDER = "Choose another folder with -o."
_ENDED = {
    "failed": (ExitCode.JOB_FAILED, "failed"),
    "canceled": (ExitCode.JOB_ENDED, "was canceled"),
    "expired": (ExitCode.JOB_ENDED, "expired"),
}
_PATIENCE_S = 120.0
"""Seconds that a service may be unreachable once it has responded: longer than a restart takes."""


def refuse_unused_options(where: JobWhere, *, here: Mapping[str, Any], there: Mapping[str, Any]) -> None:
    """Refuse options that mean nothing where the job runs."""
    wrong = [name for name, value in (here if where.url else there).items() if value]
    if wrong:
        only = "on this machine, not for a service" if where.url else "for a service: name it with --url"
        raise typer.BadParameter(f"this is {only}", param_hint=wrong[0])


def run_on_service(
    request: JobRequest,
    files: Mapping[str, Path],
    where: JobWhere,
    folder: Path,
    printed: Printed,
    *,
    idempotency_key: str | None = None,
) -> None:
    """Submit a job, follow it to its end unless it is to be left alone, and save its artifacts into the folder.

    The files are by field. An OutcomeError tells that the job did not succeed, that the time is over, or that Ctrl-C
    came.
    """
    with show_uploads(quiet=printed.quiet) as show, where.connect(show) as client:
        job = _submitted(client, request, files, idempotency_key)
    if where.detach:
        _print_new(job, where, printed)
        return
    with where.connect() as client:
        note(f"{job.id}  (Ctrl-C leaves it running)", quiet=printed.quiet)
        ended = _followed(client, job.id, Deadline(where.timeout), where, printed)
        if failure := outcome_failure(ended):
            if printed.as_json:
                emit(ended.as_json())
            raise failure
        saved = save_artifacts(client, job.id, folder)
    found = _saved_verdict(saved)
    if printed.as_json:
        emit({"verdict": found, **ended.as_json(), "files": saved})
    else:
        typer.echo("\n".join([job.id, *_path_lines(saved), *([verdict_line(found)] if found else [])]))


def _followed(
    client: Client, job_id: str, deadline: Deadline, where: Where, printed: Printed, *, replay: bool = True
) -> JobView:
    with show_progress(quiet=printed.quiet) as view:
        shown = partial(show_event, view=view)
        return follow(client, job_id, shown, deadline=deadline, url=where.url, replay=replay)


def _submitted(client: Client, request: JobRequest, files: Mapping[str, Path], key: str | None) -> JobView:
    try:
        return client.submit(
            None,
            request.prompt,
            kind=request.kind,
            params=request.params,
            output=request.output,
            metadata=request.metadata,
            files=dict(files),
            priority=request.priority,
            deadline_s=request.deadline_s,
            max_run_s=request.max_run_s,
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
        str | None, option("Only jobs in this state, e.g. running.", autocompletion=complete_states)
    ] = None,
    label: Annotated[list[str] | None, option("Only jobs with this label; repeatable.", metavar="NAME=TEXT")] = None,
    search: Annotated[
        str, option("Only jobs whose prompt, file names or labels have these words.", metavar="WORDS")
    ] = "",
    limit: Annotated[int, option("At most this many.", min=1)] = 20,
    failed: Annotated[str, option("Only jobs that failed with this error.", metavar="CODE")] = "",
    *,
    where: Where,
    as_json: JsonOption = False,
) -> None:
    """List the jobs of a service, newest first.

    meshdeform jobs --state running --search "duck vase"
    """
    if state is not None and state not in (known := complete_states("")):
        raise typer.BadParameter(f"{state!r} is not one of {', '.join(known)}", param_hint="--state")
    with where.connect() as client:
        every = client.jobs(
            state=state, metadata=parse_labels(label or []), search=search, error=failed, limit=min(limit, _PAGE)
        )
        listed = list(islice(every, limit))
    if as_json:
        emit({"jobs": [job.as_json() for job in listed]})
        return
    titles = ("ID", "STATE", "PROGRESS", "LEFT", "CREATED", "ASSET", "PROMPT")
    now = datetime.now(UTC)
    typer.echo(table(titles, [_row(job, now) for job in listed]))


def _row(job: JobView, now: datetime) -> tuple[str, ...]:
    from meshdeform.requests.parameters import prompt_words

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
def wait(job_ids: JobIdsArgument, timeout: TimeoutOption = None, *, where: Where, printed: Printed) -> None:
    """Wait until jobs have ended.

    Exit code 0: all succeeded; 5: one failed; 6: one was canceled or expired; 7: timed out.

    meshdeform wait $(meshdeform run examples/sphere.glb "a mushroom" --url URL --detach) --timeout 600
    """
    ids, deadline = list(dict.fromkeys(job_ids)), Deadline(timeout)
    ended: list[JobView] = []
    with where.connect() as client:
        for job_id in ids:
            try:
                job = _followed(client, job_id, deadline, where, printed, replay=False)
            except OutcomeError as failure:
                if failure.exit_code is ExitCode.INTERRUPTED:
                    raise left_running(ids[len(ended) :], where.url) from None
                raise
            ended.append(job)
            _print_end(job, printed)
    if printed.as_json:
        emit({"jobs": [job.as_json() for job in ended]})
    failures = list(filter(None, map(outcome_failure, ended)))
    failures.sort(key=lambda each: each.exit_code, reverse=True)  # the last one has the exit code: a failed job's
    _raise_last(failures, as_json=printed.as_json)


@clean_errors
def watch(job_id: JobIdArgument, timeout: TimeoutOption = None, *, where: Where, printed: Printed) -> None:
    """Follow a job to its end.

    Shows a bar with loss and time left, plain lines in a log; with --json every event as a line. Reconnects
    after dropped connections. Ctrl-C leaves the job running.

    meshdeform watch job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """

    def on_start(job: JobView) -> None:
        if not printed.as_json:
            note(f"{job.id}  {job.asset.filename}  {job.prompt}".rstrip(), quiet=printed.quiet)

    def on_event(event: EventView) -> None:
        if printed.as_json:
            emit(event.model_dump(mode="json"))
        show_event(event, view)

    with where.connect() as client, show_progress(quiet=not printed.text) as view:
        job = follow(client, job_id, on_event, deadline=Deadline(timeout), url=where.url, on_start=on_start)
    _print_end(job, printed)
    if failure := outcome_failure(job):
        raise failure


def _print_end(job: JobView, printed: Printed) -> None:
    if printed.text:
        typer.echo(f"{job.id}  {job.state}")


class Deadline:
    """A point in time, so many seconds from now; without a timeout never."""

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
    """Pass on a job's events until it has ended, each once, in order, in this thread; return it in its last state.

    `url` is as written on the command line, for the commands in the advice; `on_start` is called with the job at the
    beginning. Without `replay`, the events of a job that has already ended are left out. An OutcomeError tells of a
    timeout (`timed_out`) or Ctrl-C (`interrupted`): the job continues.
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
                event = events.get(timeout=deadline.left_s)
            except queue.Empty:
                raise _timed_out(job_id, deadline, url) from None
            if event is None:
                return client.get(job_id)
            if isinstance(event, Exception):
                raise event
            on_event(event)
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
    state = job.state.value
    if state == "succeeded":
        return None
    code, ended = _ENDED[state]
    name, detail, advice = f"job_{state}", f"{ended}.", "Submit it again, with a later deadline if it had one."
    if job.error is not None and state == "failed":
        name, detail, advice = job.error.code, f"failed: {job.error.detail}", job.error.advice
    return OutcomeError(code, name, f"The job {job.id} {detail}", advice, job_id=job.id, state=state)


def _complete_names(incomplete: str) -> list[str]:
    from meshdeform.runs import kinds

    names = dict.fromkeys(artifact.name for kind in kinds() for artifact in kind.artifacts)
    return [name for name in names if name.startswith(incomplete)]


@clean_errors
def fetch(
    job_id: JobIdArgument,
    output: Annotated[Path | None, output_option("The folder; default: named after the job.", file_okay=False)] = None,
    name: Annotated[
        list[str] | None,
        option(
            "Only this artifact; repeatable. Default: all. morph.glb and other formats are made if needed.",
            autocompletion=_complete_names,
        ),
    ] = None,
    step: Annotated[int | None, option("Instead: the shape at this checkpoint, as step-N.glb.", min=0)] = None,
    asset: Annotated[bool, flag("--asset", "Instead: the asset as it was submitted.")] = False,
    *,
    where: Where,
    printed: Printed,
) -> None:
    """Save the artifacts of a job.

    Each file is verified against its SHA-256 before it appears; a file that is already there is not downloaded again.

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --name result.glb --name morph.glb

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --step 100
    """
    if (step is not None) + asset + bool(name) > 1:
        raise typer.BadParameter("give only one of --name, --step and --asset")
    folder = output or Path(job_id)
    with where.connect() as client:
        job = client.get(job_id)
        if not (asset or step is not None or job.state.terminal):
            note(f"The job is {job.state}: more artifacts may follow.", quiet=printed.quiet)
        if asset:
            files = [_save_one(folder / _safe_name(job.asset.filename), partial(client.download_asset, job_id))]
        elif step is not None:
            files = [_save_one(folder / f"step-{step}.glb", partial(client.download_checkpoint, job_id, step))]
        else:
            files = save_artifacts(client, job_id, folder, name)
    if printed.as_json:
        emit({"job_id": job_id, "files": files})
    elif printed.text:
        found = _saved_verdict(files)
        typer.echo("\n".join([*_path_lines(files), *([verdict_line(found)] if found else [])]))


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

    Those that can still be made are made if they are named; a NotFoundError tells of others that the job does not have.
    """
    from meshdeform.client.documents import AFTERWARDS

    known = {artifact.name: artifact for artifact in client.artifacts(job_id)}
    missing = [name for name in names or [] if name not in known]
    for name in [name for name in missing if known and name in AFTERWARDS]:
        known[name] = client.make(job_id, name)
        missing.remove(name)
        for warning in known[name].warnings:
            note(f"{name}: {warning}", quiet=False)
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


def _path_lines(files: list[dict[str, Any]]) -> list[str]:
    """Return a line with the path of each file."""
    return [plain(file["path"]) for file in files]


def _saved_verdict(files: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the verdict of the report among saved files; None if there is none."""
    report = next((Path(file["path"]) for file in files if file["name"] == "report.json"), None)
    return None if report is None else read_verdict(json.loads(report.read_bytes()))


@clean_errors
def cancel(job_ids: JobIdsArgument, *, where: Where, as_json: JsonOption = False) -> None:
    """Cancel jobs.

    A running job stops after its current step; a job that has ended stays as it is.

    meshdeform cancel job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """

    def end(client: Client, job_id: str) -> dict[str, Any]:
        job = client.cancel(job_id)
        if not as_json:
            typer.echo(f"{job.id}  {job.state}")
        return job.as_json()

    _end_each(job_ids, end, "jobs", where, as_json=as_json)


def _end_each(
    job_ids: Sequence[str], end: Callable[[Client, str], Any], name: str, where: Where, *, as_json: bool
) -> None:
    """End each job, the others too if one is not there or in another state; as JSON, print what `end` returns."""
    ended, failures = list[Any](), list[MeshdeformError]()
    with where.connect() as client:
        for job_id in dict.fromkeys(job_ids):
            try:
                ended.append(end(client, job_id))
            except (ConflictError, NotFoundError) as error:
                failures.append(error)
    if as_json:
        emit({name: ended})
    _raise_last(failures, as_json=as_json)


def _raise_last(failures: Sequence[MeshdeformError | OutcomeError], *, as_json: bool) -> None:
    for failure in failures[:-1]:
        report(failure, as_json=as_json)
    if failures:
        raise failures[-1]


@clean_errors
def retry(
    job_id: JobIdArgument,
    max_run_s: Annotated[
        float | None, option("Seconds for which the new job may run; default: as for the old one.")
    ] = None,
    *,
    where: Where,
    printed: Printed,
) -> None:
    """Retry a job that did not succeed, and print the id of the new job.

    It continues from the last checkpoint.

    meshdeform retry job_01kg9zqk2xf3v8c5m7n9p1r4t6 --max-run-s 7200
    """
    with where.connect() as client:
        _print_new(client.retry(job_id, max_run_s=max_run_s), where, printed)


@clean_errors
@with_options(of_kind("text_deform"), usual="--step --seed --preset --guidance --set --url")
def branch(
    ctx: typer.Context,
    job_id: JobIdArgument,
    prompt: Annotated[str, typer.Argument(help='New shape from there on, e.g. "a vase".')],
    step: Annotated[int | None, option("Step of the checkpoint; default: the last one.", min=0)] = None,
    settings: SetOption = None,
    *,
    where: Where,
    printed: Printed,
) -> None:
    """Start a new job from the shape of a job at a checkpoint, with another prompt, and print its id.

    meshdeform branch job_01kg9zqk2xf3v8c5m7n9p1r4t6 "a vase" --step 100
    """
    request = make_request(prompt, merge_params(ctx, settings))
    with where.connect() as client:
        if step is None:
            checkpoints = client.checkpoints(job_id)
            if not checkpoints:
                raise NotFoundError(f"The job {job_id} has no checkpoint.", advice="Submit a new job instead.")
            step = max(checkpoint.step for checkpoint in checkpoints)
        job = client.branch(job_id, step, request.prompt, params=request.params)
    _print_new(job, where, printed)


@clean_errors
def delete(job_ids: JobIdsArgument, *, where: Where, printed: Printed) -> None:
    """Delete jobs that have ended, with all their artifacts. This cannot be undone.

    meshdeform delete job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """

    def end(client: Client, job_id: str) -> str:
        client.delete(job_id)
        if printed.text:
            typer.echo(f"{job_id}  deleted")
        return job_id

    _end_each(job_ids, end, "deleted", where, as_json=printed.as_json)


def _print_new(job: JobView, where: Where, printed: Printed) -> None:
    if printed.as_json:
        emit(job.as_json())
    else:
        typer.echo(job.id)
        note(f"Follow it: {command_line(f'watch {job.id}', where.url)}", quiet=printed.quiet)
