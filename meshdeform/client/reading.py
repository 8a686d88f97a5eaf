"""Read jobs, their results and checkpoints, limits and models; wait for, cancel and delete jobs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from meshdeform.api.states import JobState
from meshdeform.client.commands import Answer, Call, Callback, Emit, Operation, Pause
from meshdeform.client.documents import (
    ArtifactList,
    ArtifactView,
    CheckpointList,
    CheckpointView,
    EventView,
    JobList,
    JobView,
    Limits,
    ModelList,
    SignedUrl,
    read,
)
from meshdeform.client.events import followed
from meshdeform.client.paths import JobLike, identity, job_path
from meshdeform.client.problems import WaitTimeoutError, job_failure
from meshdeform.client.retries import Patience, Policy, answered, pace
from meshdeform.errors import ConflictError

__all__ = [
    "artifacts",
    "canceled",
    "checkpoints",
    "deleted",
    "got",
    "identity",
    "job_link",
    "limits",
    "listed",
    "listing",
    "made",
    "models",
    "signed_url",
    "succeeded",
    "waited",
]

_HELD_S = 30
_MAKE_S = 300.0
_LEAST_PACE_S, _MOST_PACE_S = 0.05, 30.0


def got(job: JobLike, policy: Policy) -> Operation[JobView]:
    """Return a job's current state."""
    answer = yield from answered(Call("GET", job_path(job)), policy)
    return read(JobView, answer.json(), answer.url)


def listing(
    state: str | None, metadata: Mapping[str, str], created_after: datetime | None, search: str, limit: int
) -> dict[str, str | int]:
    """Return the query for a list of jobs."""
    query: dict[str, str | int] = {"limit": limit} | {f"metadata[{name}]": text for name, text in metadata.items()}
    if state is not None:
        query["state"] = str(state)
    if created_after is not None:
        query["created_after"] = created_after.astimezone().isoformat()
    if search:
        query["q"] = search
    return query


def listed(query: dict[str, str | int], policy: Policy) -> Operation[None]:
    """Emit the jobs of a query, newest first, requesting a page at a time."""
    while True:
        answer = yield from answered(Call("GET", "/v1/jobs", query=query), policy)
        page = read(JobList, answer.json(), answer.url)
        for job in page.jobs:
            yield Emit(job)
        if page.next_cursor is None:
            return
        query["cursor"] = page.next_cursor


def canceled(job: JobLike, policy: Policy) -> Operation[JobView]:
    """Request cancellation of a job."""
    answer = yield from answered(Call("POST", job_path(job, "cancel")), policy)
    return read(JobView, answer.json(), answer.url)


def deleted(job: JobLike, policy: Policy) -> Operation[None]:
    """Delete a finished job."""
    yield from answered(Call("DELETE", job_path(job)), policy)


def artifacts(job: JobLike, policy: Policy) -> Operation[list[ArtifactView]]:
    """Return a job's artifacts."""
    answer = yield from answered(Call("GET", job_path(job, "artifacts")), policy)
    return read(ArtifactList, answer.json(), answer.url).artifacts


def made(job: JobLike, name: str, policy: Policy) -> Operation[ArtifactView]:
    """Let the service make an artifact that the job was not asked for, and return it."""
    call = Call("POST", job_path(job, "artifacts", name), read_timeout_s=_MAKE_S)
    answer = yield from answered(call, policy)
    return read(ArtifactView, answer.json(), answer.url)


def checkpoints(job: JobLike, policy: Policy) -> Operation[list[CheckpointView]]:
    """Return the checkpoints from which a job can continue."""
    answer = yield from answered(Call("GET", job_path(job, "checkpoints")), policy)
    return read(CheckpointList, answer.json(), answer.url).checkpoints


def signed_url(job: JobLike, name: str, policy: Policy) -> Operation[SignedUrl]:
    """Return a URL of an artifact that needs no key."""
    return (yield from _link(Call("POST", job_path(job, "artifacts", name, "url")), policy))


def job_link(job: JobLike, policy: Policy) -> Operation[SignedUrl]:
    """Return a link to a job's page that needs no key."""
    return (yield from _link(Call("POST", job_path(job, "url")), policy))


def _link(call: Call, policy: Policy) -> Operation[SignedUrl]:
    """Return the link that a service answers with, absolute: services name their own pages by path."""
    answer = yield from answered(call, policy)
    link = read(SignedUrl, answer.json(), answer.url)
    if "://" in link.url:
        return link
    return link.model_copy(update={"url": answer.url.rpartition("/v1/jobs/")[0] + link.url})


def limits(policy: Policy) -> Operation[Limits]:
    """Return the service's limits on requests."""
    answer = yield from answered(Call("GET", "/v1/limits"), policy)
    return read(Limits, answer.json(), answer.url)


def models(policy: Policy) -> Operation[ModelList]:
    """Return the models that jobs may use."""
    answer = yield from answered(Call("GET", "/v1/models"), policy)
    return read(ModelList, answer.json(), answer.url)


def waited(
    job: JobLike,
    policy: Policy,
    *,
    timeout_s: float | None = None,
    on_change: Callable[[JobView], Any] | None = None,
    on_event: Callable[[EventView], Any] | None = None,
    check: bool = True,
) -> Operation[JobView]:
    """Wait until a job has finished; see `Client.wait`."""
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    job_id = identity(job)
    if on_event is not None:
        callback = on_event
        yield from followed(job_id, 0, policy, lambda event: Callback(callback, event), deadline=deadline)
        if on_change is None:
            found = yield from got(job_id, policy)
            return succeeded(found) if check else found
    found = yield from _polled(job_id, policy, deadline, on_change)
    return succeeded(found) if check else found


def succeeded(job: JobView) -> JobView:
    """Return the job if it succeeded.

    Raises
    ------
    MeshdeformError
        The job's error if it failed; `ConflictError` if it ended otherwise.
    """
    if job.state is JobState.SUCCEEDED:
        return job
    if job.error is not None:
        raise job_failure(job.error.code, job.error.status, job.error.detail, job.error.advice, job.id)
    raise ConflictError(f"The job {job.id} is {job.state}.", advice="Post it again, or retry it.", job_id=job.id)


def _polled(
    job_id: str, policy: Policy, deadline: float | None, on_change: Callable[[JobView], Any] | None
) -> Operation[JobView]:
    """Poll a job until it has finished; an unchanged job costs a 304. Without `on_change`, use long polling."""
    tag, retries = "", None if policy.max_retries else 0
    while True:
        left = math.inf if deadline is None else deadline - time.monotonic()
        held_s = 0 if on_change is not None else int(min(_HELD_S, max(left, 0.0)))
        headers = {"If-None-Match": tag} if tag else {}
        if held_s:
            headers["Prefer"] = f"wait={held_s}"
        call = Call("GET", job_path(job_id), headers=headers, read_timeout_s=policy.timeout_s + held_s)
        asked = time.monotonic()
        patience = Patience(policy, retries=retries, seconds=min(policy.reconnect_s, max(left, 0.0)))
        answer: Answer = yield from answered(call, policy, patience)
        if answer.status != 304:
            job = read(JobView, answer.json(), answer.url)
            tag = answer.headers.get("etag", "")
            if on_change is not None:
                yield Callback(on_change, job)
            if job.state.terminal:
                return job
        pause = pace(answer, 1.0, _LEAST_PACE_S, _MOST_PACE_S)
        if held_s and time.monotonic() - asked >= 0.5 * held_s:
            pause = 0.0  # the long poll has already waited
        if deadline is not None:
            left = deadline - time.monotonic()
            if left <= 0:
                raise WaitTimeoutError(f"The job {job_id} has not finished in time.", job_id=job_id)
            pause = min(pause, left)
        if pause:
            yield Pause(pause)
