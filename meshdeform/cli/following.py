"""Follow a job of a service to its end, through dropped connections, with a timeout and Ctrl-C.

The events arrive in a thread, so that timeout and Ctrl-C take effect at once whatever the network does.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from meshdeform.cli.connection import command_line
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.errors import UnavailableError

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.cli.progress import ProgressView
    from meshdeform.client import Client

__all__ = ["Deadline", "follow", "left_running", "outcome_failure", "show_event"]

_ENDED = {"failed": "failed", "canceled": "was canceled", "expired": "expired"}
_PATIENCE_S = 120.0
"""Seconds that a service may be unreachable once it has responded: longer than a restart takes."""


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
