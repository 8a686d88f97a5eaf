"""The record behind PgBouncer, which gives every transaction whichever connection to the server is free."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import sqlalchemy as sa

from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from tests.integration.conftest import new_job
from tests.integration.record_calls import LEASE_S, at
from tests.servers import NotInstalledError, PgBouncer

CLIENTS, ROUNDS, CONNECTIONS = 6, 15, 3


@pytest.fixture
def pooled_url(postgres_url: str) -> Iterator[str]:
    """The database behind a PgBouncer in transaction mode with fewer connections than clients."""
    url = sa.make_url(postgres_url)
    assert url.port is not None
    # Not in pytest's folder, which only its user may enter: PgBouncer does not run as root.
    with tempfile.TemporaryDirectory() as folder:
        try:
            pooler = PgBouncer(Path(folder), url.port, CONNECTIONS)
        except NotInstalledError as missing:
            pytest.skip(str(missing))
        pooler.start()
        yield url.set(port=pooler.port).render_as_string()
        pooler.stop()


def test_clients_that_share_connections_never_meet_each_others_statements(pooled_url: str) -> None:
    # The statements differ, so that one prepared by another client would be noticed if it did not fail.
    def ask(client: int) -> list[int]:
        record = JobRecord(pooled_url, connections=1)
        found = []
        for number in range(ROUNDS):
            with record.database.read() as connection:
                found.append(connection.exec_driver_sql(f"SELECT {client} * 1000 + %s::int", (number,)).scalar_one())
        record.close()
        return found

    with ThreadPoolExecutor(CLIENTS) as pool:
        answers = list(pool.map(ask, range(CLIENTS)))
    assert answers == [[client * 1000 + number for number in range(ROUNDS)] for client in range(CLIENTS)]


def test_jobs_are_run_to_their_end_behind_it(pooled_url: str) -> None:
    record = JobRecord(pooled_url)
    jobs = {new_job(record).id for _ in range(2 * CLIENTS)}

    def work(number: int) -> list[str]:
        mine = JobRecord(pooled_url, connections=1)
        ended = []
        while (job := mine.leases.claim_next(f"worker {number}", LEASE_S)) is not None:
            for step in (1, 2, 3):
                mine.leases.save_progress(job.id, job.attempt, at(step), as_event=step % 2 == 0)
                mine.leases.heartbeat(job.id, job.attempt, LEASE_S)
            mine.leases.set_checkpoint(job.id, job.attempt, key="k", step=3, sha256="s")
            mine.leases.finish(job.id, job.attempt, JobState.SUCCEEDED)
            ended.append(job.id)
        mine.close()
        return ended

    with ThreadPoolExecutor(CLIENTS) as pool:
        ended = [job_id for some in pool.map(work, range(CLIENTS)) for job_id in some]
    assert sorted(ended) == sorted(jobs)
    for job_id in jobs:
        assert [event.seq for event in record.events.after(job_id)] == [1, 2, 3, 4, 5]
        assert record.get(job_id).state is JobState.SUCCEEDED
    record.close()


def test_the_limit_of_idle_transactions_holds_on_whichever_connection_they_run(pooled_url: str) -> None:
    record = JobRecord(pooled_url)
    with record.database.write() as connection:
        inside = connection.exec_driver_sql("SHOW idle_in_transaction_session_timeout").scalar_one()
    record.close()
    # All that the pooler has: it gives them to other programs too.
    engine = sa.create_engine(sa.make_url(pooled_url).set(drivername="postgresql+pg8000"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        show = "SHOW idle_in_transaction_session_timeout"
        outside = {connection.exec_driver_sql(show).scalar_one() for _ in range(CONNECTIONS)}
    engine.dispose()
    assert (inside, outside) == ("10s", {"0"})
