"""Following a job of a service until it is over: its events, through broken connections, with a time limit and Ctrl-C.

The events come in a thread, so that a limit and Ctrl-C take effect at once whatever the network does.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from meshdeform.cli.connection import again
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.errors import UnavailableError

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.cli.progress import ProgressView
    from meshdeform.client import Client

__all__ = ["Deadline", "follow", "left_running", "outcome_failure", "show_event"]

_PATIENCE_S = 120.0
"""How long a service that answered once may be away: longer than a restart takes."""


class Deadline:
    """A moment that may never come.

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
        """Seconds left; None: any number."""
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
    """Pass a job's events on until it is over.

    Parameters
    ----------
    client : Client
    job_id : str
    on_event : callable
        Gets every event once, in order, in this thread.
    deadline : Deadline
    url : str, optional
        As it was given, for the commands that the advice names.
    on_start : callable
        Gets the job as it stands at the beginning.
    replay : bool
        Whether the events of a job that is over by then are of interest.

    Returns
    -------
    JobView
        In its terminal state.

    Raises
    ------
    OutcomeError
        The time is over (`timed_out`), or Ctrl-C came (`interrupted`). The job goes on.
    MeshdeformError
        There is no such job, or the service is away for good.
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
        except Exception as error:  # it belongs to the thread that waits
            events.put(error)
        else:
            events.put(None)
        return


def _timed_out(job_id: str, deadline: Deadline, url: str | None) -> OutcomeError:
    return OutcomeError(
        ExitCode.TIMED_OUT,
        "timed_out",
        f"The job {job_id} is not over after {deadline.timeout_s:g} s. It goes on.",
        f"Go on waiting: {again(f'wait {job_id}', url)}",
        job_id=job_id,
    )


def left_running(job_ids: list[str], url: str | None) -> OutcomeError:
    """What Ctrl-C means while a job of a service is waited for: nothing to the job."""
    ids = " ".join(job_ids)
    what = f"The job {ids} goes" if len(job_ids) == 1 else f"The jobs {ids} go"
    come_back = "watch" if len(job_ids) == 1 else "wait"
    return OutcomeError(
        ExitCode.INTERRUPTED,
        "interrupted",
        f"Interrupted. {what} on.",
        f"Come back: {again(f'{come_back} {ids}', url)}\nEnd it: {again(f'cancel {ids}', url)}",
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
    """What a job's end means for the command; None: it succeeded."""
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
        f"The job {job.id} is {job.state.value}.",
        "Submit it again, with a later deadline if it had one.",
        job_id=job.id,
        state=job.state.value,
    )
