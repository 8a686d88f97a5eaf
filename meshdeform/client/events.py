"""Follow a job: its events as they happen, each once and none left out, over any number of connections."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import httpx

from meshdeform.client.commands import Answer, Call, Command, Operation, Pause, Read, Stream
from meshdeform.client.documents import EventView, read
from meshdeform.client.paths import job_path
from meshdeform.client.problems import WaitTimeoutError, error_of, unreachable
from meshdeform.client.retries import NOT_WORTH_A_RETRY, Patience, Policy, worth_a_retry
from meshdeform.client.sse import Parser, ServerEvent
from meshdeform.errors import MeshdeformError, UnavailableError

__all__ = ["followed"]

_LIVED_S = 5.0  # a connection that held for so long was no failure
_STALE = 0.75


def followed(
    job_id: str,
    after: int,
    policy: Policy,
    give: Callable[[EventView], Command],
    *,
    deadline: float | None = None,
) -> Operation[EventView | None]:
    """Give the events after a number; the last one is the one that ends the job.

    Parameters
    ----------
    job_id : str
    after : int
        Number of the last event that is known.
    policy : Policy
    give : callable
        Makes the command that hands an event on.
    deadline : float, optional
        By the monotonic clock.

    Returns
    -------
    EventView or None
        The last one; None where the job was over and nothing was left to come.

    Raises
    ------
    NotFoundError
        There is no such job (any more).
    WaitTimeoutError
        The deadline has passed.
    MeshdeformError
        The service refuses; `UnavailableError` where it does not answer for longer than the policy bears.
    """
    patience = Patience(policy, retries=None if policy.max_retries else 0, seconds=policy.reconnect_s)
    connection: _Connection | None = None
    doubted = -1
    while True:
        _check(deadline, job_id)
        error: MeshdeformError
        try:
            if connection is None:
                connection = yield from _connected(job_id, after, policy, deadline)
                if connection is None:
                    return None
                patience.alive()
            data: bytes = yield Read()
            if not data:
                raise UnavailableError(f"The stream of events of {job_id} ended before the job did.")
            events = connection.events(data)
        except httpx.HTTPError as failure:
            _check(deadline, job_id)
            error = unreachable(failure, job_path(job_id, "events"))
            if isinstance(failure, NOT_WORTH_A_RETRY):
                raise error from failure
        except MeshdeformError as refused:
            if not worth_a_retry(refused):
                raise
            error = refused
        else:
            if connection.lived_s > _LIVED_S:
                patience.renew()
            for event in events:
                if event.seq <= after:
                    continue
                if event.seq > after + 1 and doubted != after:
                    # One is missing. Ask again from there, once: where it is gone for good, go on without it.
                    doubted, connection = after, None
                    break
                after = event.seq
                patience.renew()
                yield give(event)
                if event.type.terminal:
                    return event
            if connection is not None and connection.stale(deadline):
                connection = None
            continue
        connection = None
        yield Pause(_within(patience.pause(error), deadline))


class _Connection:
    """What comes on one connection."""

    def __init__(self, job_id: str, url: str, read_timeout_s: float) -> None:
        self._job_id, self._url, self._read_timeout_s = job_id, url, read_timeout_s
        self._parser, self._since = Parser(), time.monotonic()

    @property
    def lived_s(self) -> float:
        return time.monotonic() - self._since

    def stale(self, deadline: float | None) -> bool:
        """Whether it could be silent for much longer than the caller waits: httpx fixes that when it connects."""
        return deadline is not None and deadline - time.monotonic() < _STALE * self._read_timeout_s

    def events(self, data: bytes) -> list[EventView]:
        told = [self._event(event) for event in self._parser.feed(data)]
        return [event for event in told if event is not None]

    def _event(self, told: ServerEvent) -> EventView | None:
        """Return the event; None for something that a newer service tells besides."""
        try:
            document: Any = json.loads(told.data)
        except ValueError:
            return None
        if not isinstance(document, dict) or "seq" not in document:
            return None
        return read(EventView, {"job_id": self._job_id, **document}, self._url)


def _connected(job_id: str, after: int, policy: Policy, deadline: float | None) -> Operation[_Connection | None]:
    silence_s = _within(policy.silence_s, deadline)
    headers = {"Accept": "text/event-stream", "Accept-Encoding": "identity", "Last-Event-ID": str(after)}
    answer: Answer = yield Stream(
        Call("GET", job_path(job_id, "events"), headers=headers, read_timeout_s=max(silence_s, 0.01))
    )
    if answer.status == 204:
        return None
    if not answer.ok:
        raise error_of(answer)
    if not answer.headers.get("content-type", "").startswith("text/event-stream"):
        raise MeshdeformError(f"{answer.url} is no stream of events.", advice="Check the service's address.")
    return _Connection(job_id, answer.url, silence_s)


def _within(seconds: float, deadline: float | None) -> float:
    return seconds if deadline is None else max(min(seconds, deadline - time.monotonic()), 0.0)


def _check(deadline: float | None, job_id: str) -> None:
    if deadline is not None and time.monotonic() >= deadline:
        raise WaitTimeoutError(f"The job {job_id} is not over in time.", job_id=job_id)
