"""Run a job on the service and follow it. Knows nothing of ComfyUI."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from meshdeform import Client
from meshdeform.api.jobs import JobView
from meshdeform.errors import LimitError, MeshdeformError, RequestTimeoutError, UnavailableError

__all__ = ["NodeError", "explained", "run"]

_POLL_S = 1.0
_CHECK_S = 0.1
_OUTAGE_S = 300.0
_ANSWER_S = 15.0
_FAREWELL_S = 5.0
_PASSING = (LimitError, RequestTimeoutError, UnavailableError)


class NodeError(RuntimeError):
    """Why a node failed, and what to do about it, as ComfyUI shows it."""


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Turn the service's errors into ones whose text has the advice, the code and the request's id."""
    try:
        yield
    except MeshdeformError as error:
        request = f", request {error.request_id}" if error.request_id else ""
        raise NodeError(f"{error.detail} {error.advice_text} ({error.code}{request})") from error


def run(
    asset: Path,
    prompt: str,
    params: dict[str, Any],
    *,
    target: Path | None = None,
    check: Callable[[], None],
    progress: Callable[[float], None],
) -> JobView:
    """Post a job to the service that MESHDEFORM_URL names, with the key in MESHDEFORM_API_KEY, and wait for it.

    Parameters
    ----------
    asset, target : Path
        The files to send; `target` for `params` with the guidance `target`.
    check : callable
        Called ten times a second. An exception from it cancels the job and is raised.
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.

    Returns
    -------
    JobView
        The job, which has succeeded.
    """
    with Client() as client:
        job = client.submit(asset, prompt, params=params, target=target)
    # Neither a busy nor a silent service may keep an interruption waiting: no request is repeated by the client.
    with Client(timeout_s=_ANSWER_S, max_retries=0) as client:
        answered = time.monotonic()
        while not job.state.terminal:
            try:
                _pause(_POLL_S, check)
            except BaseException:
                _cancel(job)
                raise
            try:
                job = client.get(job)
            except _PASSING:
                if time.monotonic() - answered > _OUTAGE_S:
                    raise
                continue
            answered = time.monotonic()
            progress(job.progress.fraction)
    with Client() as client:
        return client.wait(job)  # raises the job's own error unless it has succeeded


def _cancel(job: JobView) -> None:
    with contextlib.suppress(MeshdeformError), Client(timeout_s=_FAREWELL_S, max_retries=1) as client:
        client.cancel(job)


def _pause(seconds: float, check: Callable[[], None]) -> None:
    until = time.monotonic() + seconds
    check()
    while (left := until - time.monotonic()) > 0:
        time.sleep(min(left, _CHECK_S))
        check()
