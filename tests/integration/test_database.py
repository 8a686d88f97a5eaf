"""What a database does for the record beside keeping it."""

from __future__ import annotations

import dataclasses
import gc
import socket
import sqlite3
import struct
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import httpx
import pytest
import sqlalchemy as sa

from meshdeform.errors import UnavailableError
from meshdeform.record import database as module
from meshdeform.record.database import DatabasePatience
from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs
from meshdeform.settings import Settings
from tests.claims import claim_job
from tests.fault_proxy import FaultProxy
from tests.integration.conftest import DEADLINE_S, new_job, serving, serving_api
from tests.integration.http_calls import check_problem, post
from tests.shut_database import WAYS, database_to_shut
from tests.waiting import until


def test_postgresql_ends_a_session_that_sleeps_in_a_transaction(postgres_url: str) -> None:
    record = JobRecord(postgres_url)  # the first, since migrations import much within their transaction
    sleeper = JobRecord(postgres_url)
    sleeper.database._engine.dialect.idle_s = 0.3
    try:
        job = new_job(record)
        claimed = claim_job(record.leases, job.id, "the sleeper", -1.0)
        assert claimed is not None
        held, woken = threading.Event(), threading.Event()
        errors: list[BaseException] = []

        def sleep() -> None:
            # Stopped between two statements, with the job's row locked. On a busy machine the session may end before it
            # gets there.
            while not held.is_set():
                try:
                    with sleeper.database.write() as connection:
                        connection.execute(sa.update(jobs).where(jobs.c.id == job.id).values(phase="asleep"))
                        held.set()
                        woken.wait(DEADLINE_S)
                        connection.execute(sa.select(jobs.c.id))
                except BaseException as error:
                    if held.is_set():
                        errors.append(error)

        thread = threading.Thread(target=sleep)
        thread.start()
        assert held.wait(DEADLINE_S)
        deadline = time.monotonic() + DEADLINE_S
        while record.get(job.id).state is not JobState.QUEUED:
            record.upkeep.reclaim_expired(max_attempts=3)
            assert time.monotonic() < deadline, "the sleeper still holds the job"
            time.sleep(0.05)
        woken.set()
        thread.join()
        assert [type(error) for error in errors] == [UnavailableError]
        assert record.get(job.id).progress.phase == "queued"
    finally:
        sleeper.close()
        record.close()


@pytest.mark.parametrize("way", WAYS)
def test_a_server_that_takes_no_writes_or_no_logins_is_away_until_it_does(
    way: str, postgres_url: str, redis_url: str, sphere: bytes, tmp_path: Path
) -> None:
    with database_to_shut(postgres_url) as database:
        settings = Settings(data_dir=tmp_path, database_url=database.url, redis_url=redis_url, queue="test")
        files = {"asset": ("sphere.glb", sphere), "request": (None, '{"prompt": "a mushroom"}')}
        with serving(settings) as url, httpx.Client(base_url=url, timeout=DEADLINE_S) as http:
            accepted = http.post("/v1/jobs", files=files)
            assert accepted.status_code == 202
            job_id = accepted.json()["id"]
            database.shut(way)
            refused = http.post("/v1/jobs", files=files)
            check_problem(refused, 503, "unavailable")
            assert int(refused.headers["Retry-After"]) > 0
            ready = http.get("/readyz")
            assert (ready.status_code, ready.json()["record"]["status"]) == (503, "unavailable")
            assert http.get("/healthz").status_code == 200
            # What a standby still answers.
            assert http.get(f"/v1/jobs/{job_id}").status_code == (200 if way == "read-only" else 503)
            database.open(way)
            until(lambda: http.get("/readyz").status_code == 200)
            until(lambda: http.post(f"/v1/jobs/{job_id}/cancel").json().get("state") == "canceled")


def test_connections_to_a_server_that_became_a_standby_are_given_up(postgres_url: str) -> None:
    """Which only happens where sessions survive it: another server may be the primary by now."""
    record = JobRecord(postgres_url)
    try:
        job = new_job(record)
        for ask in (record.ping, lambda: record.request_cancel(job.id)):
            with record.database.read() as connection:
                connection.execute(sa.text("SET SESSION CHARACTERISTICS AS TRANSACTION READ ONLY"))
            with pytest.raises(UnavailableError, match="read-only"):
                ask()
            record.ping()
    finally:
        record.close()


def test_a_file_that_takes_no_writes_is_away(tmp_path: Path) -> None:
    record = JobRecord(f"sqlite:///{tmp_path / 'record.sqlite'}")
    try:
        job = new_job(record)
        record.close()
        # As if its file system had been mounted again for reading, which even root cannot get around.
        sa.event.listen(record.database._engine, "connect", lambda opened, _: opened.execute("PRAGMA query_only = ON"))
        assert record.get(job.id).state is JobState.QUEUED
        for ask in (record.ping, lambda: record.request_cancel(job.id)):
            with pytest.raises(UnavailableError):
                ask()
    finally:
        record.close()


# pg8000 leaves such a socket to the garbage collector, which is asked here so that no other test gets the blame.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("manner", ["reset", "closed", "nonsense"])
def test_a_server_that_breaks_off_while_it_is_connected_to_is_away(
    manner: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The log that pytest keeps would keep the error, which has the frames, which have the socket.
    monkeypatch.setattr(module._log, "disabled", True)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                if manner == "reset":
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                if manner == "nonsense":
                    connection.sendall(b"NX")
                connection.close()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with pytest.raises(UnavailableError):
            JobRecord(f"postgresql://meshdeform@127.0.0.1:{server.getsockname()[1]}/postgres")
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
    gc.collect()


def test_a_connection_that_is_reset_in_the_middle_is_replaced(postgres_port: int, postgres_url: str) -> None:
    with FaultProxy(postgres_port) as proxy:
        record = JobRecord(postgres_url.replace(f":{postgres_port}/", f":{proxy.port}/"))
        try:
            job = new_job(record)
            proxy.cut_after(10)
            with pytest.raises(UnavailableError):
                record.get(job.id)
            proxy.pass_through()
            # At once, whatever has become of the connections in the pool.
            assert record.get(job.id).id == job.id
        finally:
            record.close()


def test_requests_are_answered_soon_while_postgresql_is_frozen(
    postgres_port: int, postgres_url: str, redis_server_url: str, tmp_path: Path, sphere: bytes
) -> None:
    with FaultProxy(postgres_port) as proxy:
        url = postgres_url.replace(f":{postgres_port}/", f":{proxy.port}/")
        settings = Settings(data_dir=tmp_path, database_url=url, redis_url=redis_server_url, queue="frozen")
        with serving_api(settings) as api, ThreadPoolExecutor(24) as threads:
            job_id = post(api, sphere).json()["id"]
            proxy.hang()

            def ask(number: int) -> tuple[httpx.Response, float]:
                began = time.monotonic()
                http = httpx.Client(base_url=api.url, timeout=DEADLINE_S)
                with http:
                    answer = (
                        http.get(f"/v1/jobs/{job_id}")
                        if number % 4
                        else post(dataclasses.replace(api, http=http), sphere)
                    )
                return answer, time.monotonic() - began

            # More than there are connections: those who wait for one do not begin to wait anew.
            for answer, taken_s in threads.map(ask, range(24)):
                check_problem(answer, 503, "unavailable")
                assert taken_s < 15.0, "it waits for as long as workers do"
            proxy.pass_through()
            until(lambda: api.http.get(f"/v1/jobs/{job_id}").status_code == 200)
            assert post(api, sphere).status_code == 202


def test_a_record_that_another_process_holds_is_not_waited_for(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'record.sqlite'}"
    JobRecord(url).close()
    hasty = JobRecord(url, patience=DatabasePatience(0.1, 0.1, 0.1))
    with closing(sqlite3.connect(tmp_path / "record.sqlite", isolation_level=None)) as holder:
        holder.execute("BEGIN IMMEDIATE")
        with pytest.raises(UnavailableError):
            new_job(hasty)
        holder.execute("ROLLBACK")
    assert new_job(hasty).id
    hasty.close()
