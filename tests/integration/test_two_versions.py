"""Two versions at once: processes of this one on a record that a newer one has migrated, begun before it or after."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import sqlalchemy as sa

from meshdeform.record.models import EventType, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import metadata
from tests.integration.record_calls import LEASE_S, artifact, at, claimed, history, posted
from tests.newer_version import NEWER, upgrade_record

pytestmark = pytest.mark.both_databases


@pytest.fixture(autouse=True)
def _reset(record: JobRecord, database_url: str) -> Iterator[None]:
    yield
    with record.database.write() as connection:
        connection.execute(sa.text("DROP TABLE IF EXISTS things"))
        metadata.drop_all(connection)
        connection.execute(sa.text("DROP TABLE alembic_version"))
    JobRecord(database_url).close()


def test_processes_that_run_and_processes_that_start_finish_jobs(record: JobRecord, database_url: str) -> None:
    # Statements that a driver has prepared before the upgrade are used again after it.
    running = claimed(record, posted(record, metadata={"shot": "1"}))
    record.leases.save_progress(running.id, 1, at(1))
    assert [job.id for job in record.list_jobs().jobs] == [running.id]
    upgrade_record(record.database)
    started = JobRecord(database_url)
    try:
        for here, other in ((record, started), (started, record)):
            waiting = posted(here)
            here.leases.save_progress(running.id, here.get(running.id).attempt, at(2))
            here.leases.release(running.id, here.get(running.id).attempt)
            running = claimed(other, other.get(running.id))
            assert other.leases.heartbeat(running.id, running.attempt, LEASE_S) is JobState.RUNNING
            taken = claimed(other, waiting)
            other.leases.finish(taken.id, 1, JobState.SUCCEEDED, results=[artifact()])
            assert here.get(taken.id).state is JobState.SUCCEEDED
            assert history(here, taken.id)[-1] is EventType.SUCCEEDED
            here.delete(taken.id)
        assert [job.id for job in record.list_jobs(metadata={"shot": "1"}).jobs] == [running.id]
        assert started.request_cancel(running.id).state is JobState.CANCELING
    finally:
        started.close()
    # Nobody has taken the newer version's schema back.
    with record.database.read() as connection:
        assert connection.scalar(sa.text("SELECT version_num FROM alembic_version")) == NEWER
