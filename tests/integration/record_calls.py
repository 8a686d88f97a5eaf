"""What the tests of the record have in common."""

from __future__ import annotations

from collections.abc import Iterable

import sqlalchemy as sa

from meshdeform.record.models import Artifact, EventType, Job, NewJob, Progress
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs as jobs_table
from meshdeform.requests.document import JobRequest
from tests.claims import claim_job
from tests.integration.conftest import stored_file

LEASE_S = 60.0
OVER = -1.0  # a lease that was over when it was given: nobody has to wait for it


def claimed(record: JobRecord, job: Job, lease_s: float = LEASE_S) -> Job:
    """Take a queued job."""
    taken = claim_job(record.leases, job.id, "worker", lease_s)
    assert taken is not None
    return taken


def posted(record: JobRecord, owner_id: str = "", max_active: int = 0, **request: object) -> Job:
    """A queued job of this owner and this request."""
    asked = JobRequest.model_validate({"prompt": "a mushroom", **request})
    return record.create(NewJob(asked, {"asset": stored_file()}, owner_id=owner_id, max_active=max_active))


def set_to(record: JobRecord, job: Job, **columns: object) -> Job:
    """Change a job's row behind the record's back: nobody has to wait for a deadline."""
    with record.database.write() as connection:
        connection.execute(sa.update(jobs_table).where(jobs_table.c.id == job.id).values(columns))
    return record.get(job.id)


def late(record: JobRecord) -> Job:
    """A queued job whose deadline is over."""
    return set_to(record, posted(record, deadline_s=60.0), deadline_at=record.database.now(-1.0))


def artifact(name: str = "result.glb", sha256: str = "c" * 64) -> Artifact:
    """A result that nobody really stored."""
    return Artifact(name=name, content_type="model/gltf-binary", size=7, sha256=sha256, key=f"jobs/x/{name}")


def at(step: int, total_steps: int = 10) -> Progress:
    """The progress of a job at a step."""
    return Progress(step=step, total_steps=total_steps, fraction=step / total_steps, phase="optimizing")


def history(record: JobRecord, job_id: str) -> list[EventType]:
    """The types of a job's events, whose numbers are 1, 2, 3 ... and of which one at most, the last, is terminal."""
    events = record.events.after(job_id)
    assert [event.seq for event in events] == list(range(1, len(events) + 1))
    assert record.get(job_id).event_seq == len(events)
    assert record.get(job_id).state.terminal == events[-1].type.terminal
    assert not any(event.type.terminal for event in events[:-1])
    if events[-1].type.terminal:
        assert events[-1].type.value == record.get(job_id).state.value
    return [event.type for event in events]


def ids(jobs: Iterable[Job]) -> list[str]:
    """Their ids."""
    return [job.id for job in jobs]
