"""Measure the record with a thousand and with a hundred thousand jobs.

    python -m bench.record_load                          SQLite
    python -m bench.record_load --database postgresql
    python -m bench.record_load --database postgresql --jobs 1000000
    python -m bench.record_load --database postgresql --queued 100      as many wait

Prints for each question its statements, its duration with a hundred thousand jobs (`--jobs`) relative to that with a
thousand in the same run, and the tables and indices that a statement's plan reads from end to end, or until it has
enough rows. Durations on a shared machine mean little, so only ratios are printed.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from meshdeform.record.counters import statistics as job_statistics
from meshdeform.record.files import StorageQuotas
from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.record.reconciler import RECONCILE_EVERY_S
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import events, files, job_files, job_texts, jobs, labels
from meshdeform.requests.document import JobRequest
from service.jobs.estimates import estimate
from tests.servers import PostgresServer

SMALL, LARGE = 1_000, 100_000
_AT_ONCE = 10_000
"""Rows of one statement: the driver does not wait for an answer for minutes."""
_FIRST = 10_000_000
"""The number in the first id: all ids have the same length."""
REPEATS, _WARM = 45, 3
PAGE = 10
"""Jobs that every question finds in both records."""
_PREFIX = "job_01kg9zqk2xf3v8c5m7"
_REQUEST = JobRequest.model_validate({"prompt": "a mushroom", "params": {"preset": "preview"}})
_TABLES = "jobs|events|labels|files|job_files|job_texts"

Question = Callable[[JobRecord], object]


def stored_files(name: str = "a") -> dict[str, StoredFile]:
    """Return the files of a job; nothing is really stored."""
    return {"asset": StoredFile(key=f"assets/{name}", filename="a.glb", size=1, sha256="a" * 64)}


def fill(record: JobRecord, count: int, queued: int) -> None:
    """Write jobs as copies of one, so many in 100 queued, the others over, each with a label and a file of its own."""
    first = record.create(NewJob(_REQUEST, stored_files("first"), owner_id="owner-0"))
    fill_between(record, first.id, range(count), queued)
    settle(record)


def fill_between(record: JobRecord, like: str, numbers: range, queued: int) -> None:
    """Write the jobs of these numbers as copies of one, which may wait for later."""
    for start in numbers[::_AT_ONCE]:
        _fill(record, like, range(start, min(start + _AT_ONCE, numbers.stop)), queued)


def settle(record: JobRecord) -> None:
    """Do what the server does by itself after a while, and SQLite never does."""
    if record.database.is_sqlite:
        return
    url = record.database._engine.url.set(drivername="postgresql+pg8000")
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.exec_driver_sql("VACUUM ANALYZE")
        connection.exec_driver_sql("CHECKPOINT")
    engine.dispose()


def _fill(record: JobRecord, like: str, some: range, share: int) -> None:
    numbers = sa.select(sa.literal(some.start).label("n")).cte("numbers", recursive=True)
    numbers = numbers.union_all(sa.select(numbers.c.n + 1).where(numbers.c.n < some.stop - 1))
    n, now, later = numbers.c.n, record.database.now(), record.database.now(86_400.0)
    text = sa.cast(n + _FIRST, sa.String)
    queued = n % 100 < share
    first = jobs.alias("first")
    changed: dict[str, Any] = {
        "id": sa.literal(_PREFIX) + text,
        "owner_id": sa.literal("owner-") + sa.cast(n % 50, sa.String),
        "state": sa.case((queued, "queued"), else_="succeeded"),
        "step_s": sa.case((queued, None), else_=0.5),
        "ran_s": sa.case((queued, 0.0), else_=60.0),
        "retain_until": sa.case((queued, None), else_=later),
        "retry_at": None,
    }

    def put(table: sa.Table, values: dict[str, Any], source: Any) -> None:
        columns = [sa.type_coerce(value, table.c[name].type).label(name) for name, value in values.items()]
        connection.execute(sa.insert(table).from_select(list(values), sa.select(*columns).select_from(source)))

    with record.database.write() as connection:
        every = {column.name: changed.get(column.name, first.c[column.name]) for column in jobs.c}
        put(jobs, every, numbers.join(first, first.c.id == like))
        label = {"job_id": changed["id"], "name": "batch", "value": sa.cast(n % 100, sa.String)}
        put(labels, label, numbers)
        job_file = {"job_id": changed["id"], "part": "asset", "owner_id": changed["owner_id"]}
        put(job_files, {**job_file, "key": sa.literal("assets/") + text, "size": 1}, numbers)
        words = sa.case((n % 100 == 7, "a vase"), else_="a mushroom") + sa.literal("\na.glb\n") + text
        put(job_texts, {"job_id": changed["id"], "text": words}, numbers)
        put(files, {"key": sa.literal("assets/") + text, "pins": 0, "touched_at": now}, numbers)
        happened = {"job_id": changed["id"], "seq": sa.literal(1), "type": sa.literal("queued"), "at": now}
        put(events, {**happened, "attempt": sa.literal(0), "data": sa.literal({"reason": "created"}, sa.JSON)}, numbers)


@functools.cache
def rooms(_: JobRecord) -> StorageQuotas:
    """Return what a process remembers of the owners' sums in this record."""
    return StorageQuotas()


def room(record: JobRecord, known: StorageQuotas) -> None:
    """Ask for room for a file of an owner."""
    with record.database.read() as connection:
        known.check(connection, "owner-7", {"assets/1": 1}, 10**15)


def claim_and_release(record: JobRecord) -> None:
    """Take the next job as a worker does, and hand it back."""
    job = record.leases.claim_next("worker", 60.0)
    assert job is not None
    record.leases.release(job.id, job.attempt)


QUESTIONS: dict[str, Question] = {
    "get a job": lambda record: record.get(f"{_PREFIX}{_FIRST + SMALL // 2}"),
    "events": lambda record: record.events.after(f"{_PREFIX}{_FIRST + SMALL // 2}"),
    "what 100 streams ask": lambda record: record.events.heads([f"{_PREFIX}{_FIRST + n}" for n in range(100)]),
    "list a page": lambda record: record.list_jobs(limit=PAGE),
    "list an owner's page": lambda record: record.list_jobs(owner="owner-7", limit=PAGE),
    "list a state": lambda record: record.list_jobs(JobState.QUEUED, limit=PAGE),
    "list a label": lambda record: record.list_jobs(metadata={"batch": "7"}, limit=PAGE),
    "search 1 % of all": lambda record: record.list_jobs(words="VASE glb", limit=PAGE),
    "search 1 % of an owner": lambda record: record.list_jobs(owner="owner-7", words="VASE glb", limit=PAGE),
    "search in vain": lambda record: record.list_jobs(words="giraffe", limit=PAGE),
    "search a state in vain": lambda record: record.list_jobs(JobState.QUEUED, words="giraffe", limit=PAGE),
    "claim and release": claim_and_release,
    "post": lambda record: record.create(NewJob(_REQUEST, stored_files(), owner_id="owner-7", max_active=10**6)),
    "room, summed up": lambda record: room(record, StorageQuotas()),
    "room, remembered": lambda record: room(record, rooms(record)),
    "estimate": lambda record: estimate(
        record.database, record.leases, _REQUEST, default_model="builtin", queue="q", owner_id="owner-7"
    ),
    "files.unused": lambda record: record.files.unused(),
    "delete_retained": lambda record: record.upkeep.delete_retained(),
    "expire_deadlines": lambda record: record.upkeep.expire_deadlines(),
    "reclaim_expired": lambda record: record.upkeep.reclaim_expired(3),
    "metrics": lambda record: job_statistics(record.database),
}
PERIODIC = ("files.unused", "delete_retained", "expire_deadlines", "reclaim_expired")


@contextlib.contextmanager
def sent(record: JobRecord) -> Iterator[list[tuple[str, Any]]]:
    """Collect the statements that are sent in the `with` block."""
    found: list[tuple[str, Any]] = []

    def note(_c: Any, _k: Any, statement: str, parameters: Any, _x: Any, many: bool) -> None:
        found.append((statement, None if many else parameters))

    engine = record.database._engine
    sa.event.listen(engine, "before_cursor_execute", note)
    try:
        yield found
    finally:
        sa.event.remove(engine, "before_cursor_execute", note)


def scanned(record: JobRecord, statements: list[tuple[str, Any]]) -> set[str]:
    """Return the tables and indices that the plans of the statements read from end to end."""
    explain = "EXPLAIN QUERY PLAN " if record.database.is_sqlite else "EXPLAIN "
    scan = rf"^SCAN ((?:{_TABLES})(?: USING.*)?)" if record.database.is_sqlite else rf"Seq Scan on ({_TABLES})\b"
    found: set[str] = set()
    with record.database.write() as connection:
        for statement, parameters in statements:
            if parameters is not None and statement.lstrip().startswith(("SELECT", "UPDATE", "DELETE", "WITH")):
                plan = connection.exec_driver_sql(explain + statement, parameters)
                found |= set(re.findall(scan, "\n".join(str(row[-1]) for row in plan), re.MULTILINE))
    return found


def ratio(question: Question, large: JobRecord, small: JobRecord) -> float:
    """Return by how much longer a question takes in the large record, asked of both in turns: the shortest of each."""
    taken: dict[JobRecord, list[float]] = {large: [], small: []}
    for turn in range(_WARM + REPEATS):
        for record, durations in taken.items():
            start = time.perf_counter()
            question(record)
            if turn >= _WARM:
                durations.append(time.perf_counter() - start)
    return min(taken[large]) / min(taken[small])


def ask(small: JobRecord, large: JobRecord, only: str) -> None:
    """Print what each question costs whose name has these words."""
    print(f"{'':24}{'statements':>11}{'large / small':>15}  read from end to end")
    counts = {}
    for name, question in QUESTIONS.items():
        if only not in name:
            continue
        relative = ratio(question, large, small)
        with sent(large) as statements:
            question(large)
        counts[name] = len(statements)
        tables = ", ".join(sorted(scanned(large, statements))) or "nothing"
        print(f"{name:24}{len(statements):>11}{relative:>15.1f}  {tables}")
    rate = sum(counts.get(name, 0) for name in PERIODIC) / RECONCILE_EVERY_S
    print(f"the four periodic ones, every {RECONCILE_EVERY_S:g} s: {rate:.1f} statements a second")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--jobs", type=int, default=LARGE)
    parser.add_argument("--queued", type=int, default=1, metavar="PERCENT", help="of the jobs; the others are over")
    parser.add_argument("--only", default="", metavar="WORDS", help="questions whose names have these words")
    options = parser.parse_args()
    with contextlib.ExitStack() as cleanup:
        base = Path(cleanup.enter_context(tempfile.TemporaryDirectory(prefix="meshdeform-record-", dir="/tmp")))
        base.chmod(0o755)
        records = []
        for name, count in (("small", SMALL), ("large", options.jobs)):
            (base / name).mkdir()
            url = f"sqlite:///{base / name / 'record.sqlite'}"
            if options.database == "postgresql":
                server = PostgresServer(base / name, durable=True, options={"autovacuum": "off"})
                server.start()
                cleanup.callback(server.kill)
                url = server.url
            record = JobRecord(url)
            cleanup.callback(record.close)
            fill(record, count, options.queued)
            records.append(record)
        small, large = records
        ask(small, large, options.only)


if __name__ == "__main__":
    main()
