"""What owners have used: counted once for each attempt and job, however workers end, on SQLite and PostgreSQL."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import pytest
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.client import Client
from meshdeform.errors import StaleAttemptError, UnavailableError
from meshdeform.record.leases import HANDED_OVER
from meshdeform.record.models import JobError, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.usage import MonthOfOwner
from tests.integration.conftest import Start
from tests.integration.record_calls import LEASE_S, OVER, artifact, claimed, posted, set_to

pytestmark = pytest.mark.both_databases

RAN_S = 100.0
ERROR = JobError.of(UnavailableError("It does not answer."))


def running(record: JobRecord, owner: str = "ann", lease_s: float = LEASE_S) -> str:
    """A job that a worker has had for `RAN_S` seconds; the first attempt of an owner's new job."""
    job = posted(record, owner)
    return again(record, job.id, lease_s)


def again(record: JobRecord, job_id: str, lease_s: float = LEASE_S) -> str:
    job = claimed(record, record.get(job_id), lease_s)
    set_to(record, job, claimed_at=datetime.now(UTC) - timedelta(seconds=RAN_S))
    return job.id


def used(record: JobRecord, owner: str = "ann") -> MonthOfOwner:
    [month] = record.usage.months(owner)
    assert month.month in {f"{datetime.now(UTC) - timedelta(hours=h):%Y-%m}" for h in (0, 1)}
    return month


ENDS: dict[str, Callable[[JobRecord, str, int], object]] = {
    "released": lambda record, job, attempt: record.leases.release(job, attempt),
    "handed over": lambda record, job, attempt: record.leases.release(job, attempt, HANDED_OVER),
    "out of memory": lambda record, job, attempt: record.leases.out_of_memory(job, attempt, 9),
    "failed for now": lambda record, job, attempt: record.leases.postpone(job, attempt, ERROR, 9, 0.0),
}


def test_every_attempt_counts_once_and_a_late_write_of_one_that_is_over_counts_nothing(record: JobRecord) -> None:
    job = running(record)
    for attempt, end in enumerate(ENDS.values(), 1):
        end(record, job, attempt)
        again(record, job)
        with pytest.raises(StaleAttemptError):
            end(record, job, attempt)
        month = used(record)
        assert (month.jobs, month.bytes) == (0, 0)
        assert month.seconds == pytest.approx(RAN_S * attempt, abs=5.0)
    attempt += 1
    record.leases.finish(job, attempt, JobState.SUCCEEDED, results=[artifact(), artifact("report.json")])
    with pytest.raises(StaleAttemptError):
        record.leases.finish(job, attempt, JobState.SUCCEEDED, results=[artifact()])
    assert used(record) == MonthOfOwner("ann", used(record).month, 1, used(record).seconds, 14)
    assert used(record).seconds == pytest.approx(record.get(job).ran_s)
    record.add_artifact(job, artifact("result.stl"))
    record.add_artifact(job, artifact("result.stl"))
    record.delete(job)
    assert (used(record).jobs, used(record).bytes) == (1, 21), "made once, and counted after the job is deleted"


def test_workers_that_die_are_counted_while_they_were_alive(record: JobRecord) -> None:
    job = running(record, lease_s=OVER)
    assert record.upkeep.reclaim_expired(2) == [job]
    assert used(record).seconds == pytest.approx(RAN_S, abs=5.0)
    assert record.upkeep.reclaim_expired(2) == []
    again(record, job)
    assert record.leases.worker_ended("worker")
    assert record.upkeep.reclaim_expired(2) == []
    assert (used(record).jobs, record.get(job).state) == (1, JobState.FAILED)
    assert used(record).seconds == pytest.approx(2 * RAN_S, abs=5.0)


def test_deadlines_and_cancellations_count_what_ran(record: JobRecord) -> None:
    late = running(record)
    set_to(record, record.get(late), deadline_at=record.database.now(-1.0))
    assert record.upkeep.expire_deadlines() == [late]
    record.request_cancel(posted(record, "ann").id)  # which never ran
    canceled = running(record)
    record.request_cancel(canceled)
    record.leases.finish(canceled, 1, JobState.SUCCEEDED, results=[artifact()])
    assert (used(record).jobs, used(record).bytes) == (3, 0)
    assert used(record).seconds == pytest.approx(2 * RAN_S, abs=5.0)


def test_a_transaction_that_fails_counts_nothing_and_many_at_once_count_all(
    record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = [running(record, owner) for owner in ("ann", "bob") * 6]
    monkeypatch.setattr(record.leases, "_publish", lambda *_: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        record.leases.finish(jobs[0], 1, JobState.SUCCEEDED, results=[artifact()])
    monkeypatch.undo()
    assert record.usage.months() == []
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda job: record.leases.finish(job, 1, JobState.SUCCEEDED, results=[artifact()]), jobs))
    months = record.usage.months()
    assert [(month.owner_id, month.jobs, month.bytes) for month in months] == [("ann", 6, 42), ("bob", 6, 42)]
    assert sum(month.seconds for month in months) == pytest.approx(sum(record.get(job).ran_s for job in jobs))


def test_an_owner_reads_its_own_by_api_and_client_and_the_operator_all(
    start: Start, record: JobRecord, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for owner in ("ann", "bob", "bob"):
        record.leases.finish(running(record, owner), 1, JobState.SUCCEEDED, results=[artifact()])
    http = start(auth="on")
    assert http.get("/v1/usage").status_code == 401
    key = record.keys.create("bob")[1]
    [month] = http.get("/v1/usage", headers={"Authorization": f"Bearer {key}"}).json()["months"]
    assert (month["jobs"], month["bytes"]) == (2, 14)
    with Client(str(http.base_url), api_key=key) as client:
        assert [each.model_dump() for each in client.usage()] == [month]
    monkeypatch.setenv("MESHDEFORM_DATABASE_URL", database_url)
    printed = CliRunner().invoke(app, ["keys", "usage", "--json"]).stdout
    assert {each["owner_id"]: each["jobs"] for each in json.loads(printed)} == {"ann": 1, "bob": 2}
    [line] = CliRunner().invoke(app, ["keys", "usage", "--owner", "bob"]).stdout.splitlines()
    assert line.split()[1:4] == ["bob", "2", "jobs"]
