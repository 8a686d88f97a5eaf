"""Follow a job's events as they happen, each exactly once, reconnecting as needed."""

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

_LIVED_S = 5.0  # a connection that lasted this long does not count as a failure
_STALE = 0.75


def followed(
    job_id: str,
    after: int,
    policy: Policy,
    give: Callable[[EventView], Command],
    *,
    deadline: float | None = None,
) -> Operation[EventView | None]:
    """Deliver the events after a number, up to the one that ends the job.

    Parameters
    ----------
    job_id : str
    after : int
        Number of the last known event.
    policy : Policy
    give : callable
        Returns the command that delivers an event.
    deadline : float, optional
        In the time of the monotonic clock.

    Returns
    -------
    EventView or None
        The last event, or None if the job had finished and no event was left.

    Raises
    ------
    NotFoundError
        The job does not exist, or was deleted.
    WaitTimeoutError
        The deadline has passed.
    MeshdeformError
        The service refused; `UnavailableError` if it does not answer for longer than the policy allows.
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
                    # An event is missing. Request it once more; if it is gone, continue without it.
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
    """The events of one connection."""

    def __init__(self, job_id: str, url: str, read_timeout_s: float) -> None:
        self._job_id, self._url, self._read_timeout_s = job_id, url, read_timeout_s
        self._parser, self._since = Parser(), time.monotonic()

    @property
    def lived_s(self) -> float:
        return time.monotonic() - self._since

    def stale(self, deadline: float | None) -> bool:
        """Return whether its read timeout, which httpx fixes when connecting, is much longer than the time left."""
        return deadline is not None and deadline - time.monotonic() < _STALE * self._read_timeout_s

    def events(self, data: bytes) -> list[EventView]:
        found = [self._event(event) for event in self._parser.feed(data)]
        return [event for event in found if event is not None]

    def _event(self, received: ServerEvent) -> EventView | None:
        """Return the event, or None for a type that only newer services send."""
        try:
            document: Any = json.loads(received.data)
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
        raise MeshdeformError(f"{answer.url} is not a stream of events.", advice="Check the service's address.")
    return _Connection(job_id, answer.url, silence_s)


def _within(seconds: float, deadline: float | None) -> float:
    return seconds if deadline is None else max(min(seconds, deadline - time.monotonic()), 0.0)


def _check(deadline: float | None, job_id: str) -> None:
    if deadline is not None and time.monotonic() >= deadline:
        raise WaitTimeoutError(f"The job {job_id} has not finished in time.", job_id=job_id)
