"""What is asked again and again is answered from an index, with ten thousand jobs, on SQLite and PostgreSQL."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy import event

from meshdeform.record.counters import statistics
from meshdeform.record.ids import encode_cursor
from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import (
    deliveries,
    events,
    files,
    idempotency,
    job_files,
    job_texts,
    jobs,
    labels,
    metadata,
    uploads,
    webhooks,
)
from meshdeform.record.schema import words as own_words
from meshdeform.record.turns import Turns
from meshdeform.requests.document import JobRequest
from service.jobs.estimates import estimate
from tests.cases import each_case
from tests.integration.record_calls import LEASE_S, at, posted

pytestmark = pytest.mark.both_databases

COUNT = 10_000
LARGE = ("jobs", "events", "labels", "idempotency", "deliveries", "uploads", "files", "job_files", "job_texts", "words")
_PREFIX = "job_01kg9zqk2xf3v8c5m7n9p"
MIDDLE = f"{_PREFIX}{COUNT + COUNT // 2}"


@pytest.fixture(scope="module")
def large(database_url: str) -> Iterator[JobRecord]:
    """Ten thousand jobs, nearly all of them over, with what belongs to them."""
    record = JobRecord(database_url)
    posted(record)
    with record.database.write() as connection:
        _multiply(connection, record)
    if not record.database.is_sqlite:
        # As the server does by itself after a while; SQLite never does.
        engine = sa.create_engine(
            record.database._engine.url.set(drivername="postgresql+pg8000"), isolation_level="AUTOCOMMIT"
        )
        with engine.connect() as connection:
            connection.exec_driver_sql("VACUUM ANALYZE")
        engine.dispose()
    yield record
    with record.database.write() as connection:
        for table in reversed(metadata.sorted_tables):
            connection.execute(sa.delete(table))
    record.close()


def _multiply(connection: sa.Connection, record: JobRecord) -> None:
    numbers = sa.select(sa.literal(0).label("n")).cte("numbers", recursive=True)
    numbers = numbers.union_all(sa.select(numbers.c.n + 1).where(numbers.c.n < COUNT - 1))
    n, now = numbers.c.n, record.database.now()
    text = sa.cast(n + COUNT, sa.String)
    job_id = sa.literal(_PREFIX) + text
    running, queued = n % 1000 == 0, n % 100 == 1
    later = record.database.now(86_400.0)
    changed: dict[str, Any] = {
        "id": job_id,
        "owner_id": sa.literal("owner-") + sa.cast(n % 50, sa.String),
        "workload": sa.literal("workload-") + sa.cast(n % 20, sa.String),
        "state": sa.case((running, "running"), (queued, "queued"), else_="succeeded"),
        "priority": n % 5,
        "event_seq": 3,
        "attempt": sa.case((queued, 0), else_=1),
        "step_s": sa.case((running, None), (queued, None), else_=0.5),
        "ran_s": sa.case((running, 0.0), (queued, 0.0), else_=9.0),
        "worker_id": sa.case((running, "worker"), else_=None),
        "lease_expires_at": sa.case((running, later), else_=None),
        "deadline_at": sa.case((n % 10 == 0, later), else_=None),
        "retain_until": sa.case((running, None), (queued, None), else_=later),
    }

    def put(table: sa.Table, values: dict[str, Any], source: Any = numbers) -> None:
        columns = [sa.type_coerce(value, table.c[name].type).label(name) for name, value in values.items()]
        connection.execute(sa.insert(table).from_select(list(values), sa.select(*columns).select_from(source)))

    first = jobs.alias("first")
    every = {column.name: changed.get(column.name, first.c[column.name]) for column in jobs.c}
    put(jobs, every, numbers.join(first, sa.true()))
    put(labels, {"job_id": job_id, "name": "batch", "value": sa.cast(n % 100, sa.String)})
    cast = "" if record.database.is_sqlite else "::json"
    empty: Any = sa.literal_column(f"'{{}}'{cast}")
    for seq in (1, 2, 3):
        put(events, {"job_id": job_id, "seq": seq, "type": "progress", "at": now, "attempt": 1, "data": empty})
    key, owner = sa.literal("assets/") + text, changed["owner_id"]
    put(job_files, {"job_id": job_id, "part": "asset", "owner_id": owner, "key": key, "size": 3})
    words = sa.case((n % 1000 == 7, "a vase"), else_="a mushroom") + sa.literal("\na.glb\n") + text
    put(job_texts, {"job_id": job_id, "text": words})
    put(files, {"key": sa.literal("assets/") + text, "pins": 0, "touched_at": now})
    put(uploads, {
        "id": sa.literal("upl_") + text, "owner_id": "", "filename": "a.glb", "size": 3,
        "key": sa.literal("assets/") + text, "created_at": now, "expires_at": later,
    })  # fmt: skip
    put(own_words, {
        "owner_id": owner, "noun": text, "sha256": "s", "key": sa.literal("assets/") + text, "size": 3,
        "told": empty, "faces": empty, "created_at": now,
    })  # fmt: skip
    put(idempotency, {
        "owner_id": "me", "key": text, "request_hash": "h", "token": "t", "locked_until": now, "created_at": now,
    })  # fmt: skip
    connection.execute(sa.insert(webhooks).values(
        id="wh_1", owner_id="me", url="https://example.org", events=[], secret="s", created_at=now
    ))  # fmt: skip
    put(deliveries, {
        "id": sa.literal("msg_") + text, "webhook_id": "wh_1", "job_id": job_id, "type": "job.queued",
        "payload": empty, "state": sa.case((queued, "pending"), else_="delivered"), "attempts": 0,
        "next_at": sa.case((queued, later), else_=None), "created_at": now,
    })  # fmt: skip


@contextmanager
def _asked(record: JobRecord) -> Iterator[list[tuple[str, Any]]]:
    """Every statement that is sent in the `with` block."""
    sent: list[tuple[str, Any]] = []

    def note(_c: Any, _k: Any, statement: str, parameters: Any, _x: Any, many: bool) -> None:
        if not many and statement.lstrip().startswith(("SELECT", "UPDATE", "DELETE", "WITH")):
            sent.append((statement, parameters))

    engine = record.database._engine
    event.listen(engine, "before_cursor_execute", note)
    try:
        yield sent
    finally:
        event.remove(engine, "before_cursor_execute", note)


def _scanned(record: JobRecord, statement: str, parameters: Any) -> list[str]:
    """The large tables that a statement reads from end to end."""
    explain = "EXPLAIN QUERY PLAN " if record.database.is_sqlite else "EXPLAIN "
    with record.database.write() as connection:
        plan = "\n".join(str(row[-1]) for row in connection.exec_driver_sql(explain + statement, parameters))
    tables = "|".join(LARGE)
    pattern = rf"^SCAN ({tables})(?! USING)" if record.database.is_sqlite else rf"Seq Scan on ({tables})\b"
    return [f"{found}: {statement}\n{plan}" for found in re.findall(pattern, plan, re.MULTILINE)]


OWNER = "owner-7"
Ask = Callable[[JobRecord], object]
QUESTIONS: dict[str, Ask] = {
    "a job": lambda record: record.get(MIDDLE),
    "the next job": lambda record: record.leases.claim_next("worker", LEASE_S),
    "the next job of owners that may run few": lambda record: record.leases.claim_next(
        "worker", LEASE_S, Turns(9.0, 99)
    ),
    "whether to make room": lambda record: record.leases.hand_over(record.get(f"{_PREFIX}{COUNT}"), Turns(0.0, 99)),
    "what a worker writes": lambda record: _work(record),
    "artifacts": lambda record: record.artifacts(MIDDLE),
    "a heartbeat": lambda record: record.leases.heartbeat(f"{_PREFIX}{COUNT}", 1, LEASE_S),
    "a page": lambda record: record.list_jobs(cursor=encode_cursor(MIDDLE)),
    "a page of a state": lambda record: record.list_jobs(JobState.QUEUED),
    "a page of an owner": lambda record: record.list_jobs(owner=OWNER),
    "a page of an owner from its middle": lambda record: record.list_jobs(owner=OWNER, cursor=encode_cursor(MIDDLE)),
    "a page of an owner's jobs in a state": lambda record: record.list_jobs(JobState.RUNNING, owner=OWNER),
    "a page of a label": lambda record: record.list_jobs(metadata={"batch": "7"}),
    "a page of an owner's label": lambda record: record.list_jobs(owner=OWNER, metadata={"batch": "7"}),
    "events": lambda record: record.events.after(MIDDLE, 1),
    "heads": lambda record: record.events.heads([MIDDLE, f"{_PREFIX}{COUNT}"]),
    "silent workers": lambda record: record.upkeep.reclaim_expired(3),
    "leases ahead": lambda record: record.upkeep.shorten_leases(86_400.0),
    "deadlines": lambda record: record.upkeep.expire_deadlines(),
    "retention": lambda record: record.upkeep.delete_retained(),
    "files that nobody needs": lambda record: record.files.unused(),
    "old keys": lambda record: record.upkeep.delete_stale_requests(),
    "a key": lambda record: record.idempotency.begin("me", str(COUNT), "h"),
    "uploads over their time": lambda record: record.upkeep.expired_uploads(),
    "an owner's words": lambda record: record.words.all(OWNER),
    "how many are queued": lambda record: record.upkeep.queued_count(2_000),
    "how many may start": lambda record: record.upkeep.queued_count(2_000, 2),
    "who is queued": lambda record: record.upkeep.queued_ids(2_000),
    "a worker that is gone": lambda record: record.leases.worker_ended("worker"),
    "an owner's unfinished jobs": lambda record: posted(record, OWNER, 10_000),
    "room for an owner's files": lambda record: record.check_room(OWNER, {"assets/1": 1, "assets/2": 1}, 10**15),
    "deliveries that are due": lambda record: record.deliveries.due(10),
    "how many jobs are in each state": lambda record: statistics(record.database),
    "an estimate": lambda record: estimate(
        record.database, record.leases, JobRequest(prompt="x"), default_model="builtin", queue="q"
    ),
}


def _work(record: JobRecord) -> None:
    """All that a worker writes; the job is queued again at last."""
    taken = record.leases.claim_next("worker", LEASE_S)
    assert taken is not None
    record.leases.save_progress(taken.id, taken.attempt, at(3))
    record.leases.set_checkpoint(taken.id, taken.attempt, key="k", step=3, sha256="s")
    record.leases.checkpoints(taken.id)
    record.leases.forget_checkpoint(taken.id, taken.attempt, key="k")
    record.leases.release(taken.id, taken.attempt)


@each_case("question", QUESTIONS)
def test_it_is_answered_from_an_index(large: JobRecord, question: str) -> None:
    with _asked(large) as sent:
        QUESTIONS[question](large)
    assert sent
    scans = [scan for statement, parameters in sent for scan in _scanned(large, statement, parameters)]
    assert scans == []


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
@each_case(
    ("words", "state", "expected"),
    [("giraffe", None, 0), ("VASE", None, 10), ("a giraffe", JobState.QUEUED, 0), ("VASE glb", JobState.SUCCEEDED, 10)],
)
def test_rare_words_are_found_by_their_trigrams(
    large: JobRecord, words: str, state: JobState | None, expected: int
) -> None:
    with _asked(large) as sent:
        assert len(large.list_jobs(state, words=words).jobs) == expected
    (statement, parameters) = sent[0]
    assert _scanned(large, statement, parameters) == []
    with large.database.write() as connection:
        plan = "\n".join(str(row[-1]) for row in connection.exec_driver_sql("EXPLAIN " + statement, parameters))
    assert "ix_job_texts_text" in plan
