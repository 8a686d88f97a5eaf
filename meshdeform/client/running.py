"""Run a job from submission to success."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from meshdeform.client.commands import Operation, Shield
from meshdeform.client.documents import EventView, JobView
from meshdeform.client.reading import canceled, waited
from meshdeform.client.retries import Policy
from meshdeform.client.submitting import Files, Order, submitted
from meshdeform.errors import MeshdeformError

__all__ = ["deformed"]

_FAREWELL_S = 5.0


def deformed(
    order: Order,
    files: Files,
    policy: Policy,
    on_event: Callable[[EventView], Any] | None,
    timeout_s: float | None,
    *,
    cancel: bool,
) -> Operation[JobView]:
    """Post a job and wait until it has succeeded; see `Client.deform`."""
    job = yield from submitted(order, files, policy)
    try:
        done = yield from waited(job, policy, timeout_s=timeout_s, on_event=on_event)
    except (Exception, GeneratorExit):
        raise
    except BaseException:
        # KeyboardInterrupt, SystemExit, a canceled task.
        if cancel:
            yield Shield(_abandon(job, replace(policy, timeout_s=_FAREWELL_S, max_retries=1)), _FAREWELL_S)
        raise
    return done


def _abandon(job: JobView, policy: Policy) -> Operation[None]:
    with contextlib.suppress(MeshdeformError):
        yield from canceled(job, policy)
