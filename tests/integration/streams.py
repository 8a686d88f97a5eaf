"""A reader of server-sent events for the tests, which is strict where a browser is lenient."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx

from meshdeform.record.models import JobState, Progress
from meshdeform.record.repository import JobRecord
from tests.claims import claim_job
from tests.waiting import until

STREAM = {"Accept": "text/event-stream"}


@dataclass
class Stream:
    """What comes on one connection."""

    answer: httpx.Response
    retry_ms: int | None = None
    comments: list[str] = field(default_factory=list)

    def events(self) -> Iterator[dict[str, Any]]:
        """The documents as they come; what the lines around them say must be the same."""
        lines: dict[str, str] = {}
        for line in self.answer.iter_lines():
            name, separator, value = line.partition(": ")
            if line == "":
                if "data" in lines:
                    document: dict[str, Any] = json.loads(lines["data"])
                    assert lines == {"id": str(document["seq"]), "event": document["type"], "data": lines["data"]}
                    yield document
                lines = {}
            elif name == "":
                self.comments.append(value)
            elif name == "retry":
                self.retry_ms = int(value)
            else:
                assert separator
                assert name in ("id", "event", "data")
                assert name not in lines
                lines[name] = value
        assert lines == {}, "the stream breaks off within an event"


@contextmanager
def stream(http: httpx.Client, job_id: str, last_event_id: int | None = None, **headers: str) -> Iterator[Stream]:
    """Follow a job."""
    sent = {**STREAM, **headers, **({} if last_event_id is None else {"Last-Event-ID": str(last_event_id)})}
    with http.stream("GET", f"/v1/jobs/{job_id}/events", headers=sent) as answer:
        assert answer.status_code == 200, answer.read()
        assert answer.headers["content-type"].startswith("text/event-stream")
        yield Stream(answer)


def progress(record: JobRecord, job_id: str, attempt: int, step: int, total: int = 8) -> None:
    """What a worker writes after a step."""
    done = Progress(step=step, total_steps=total, fraction=step / total, phase="optimizing", attempt=attempt)
    record.leases.save_progress(job_id, attempt, done)


def recovered_run(record: JobRecord, job_id: str) -> None:
    """A whole life: a first attempt that loses its worker, and a second one that goes on from a checkpoint."""
    assert claim_job(record.leases, job_id, "first", 60.0)
    for step in (1, 2, 3, 4):
        progress(record, job_id, 1, step)
    record.leases.set_checkpoint(job_id, 1, f"jobs/{job_id}/1/checkpoint-2", 2, "a" * 64)
    assert record.leases.worker_ended("first")
    until(lambda: record.upkeep.reclaim_expired(3) or record.get(job_id).state is JobState.QUEUED, "it is taken back")
    assert claim_job(record.leases, job_id, "second", 60.0)
    for step in (3, 4, 5, 6, 7, 8):
        progress(record, job_id, 2, step)
    record.leases.finish(job_id, 2, JobState.SUCCEEDED)
