"""The database under the record: its schema, migrations with data in them, and URLs that mean nothing."""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

import alembic.command
import alembic.config
import pytest
import sqlalchemy as sa

import meshdeform.record
from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.record.database import Database
from meshdeform.record.models import EventType, JobState, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import HEAD, jobs, metadata
from tests.cases import each_case
from tests.integration.conftest import DEADLINE_S
from tests.integration.record_calls import LEASE_S, history, ids

pytestmark = pytest.mark.both_databases


def test_the_migrations_make_what_the_tables_say(record: JobRecord) -> None:
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    def applies(found: object, *_: object) -> bool:
        """Whether this database has it: SQLite has no index of trigrams, which `metadata` says by its DDL only."""
        gin = isinstance(found, sa.Index) and found.dialect_options["postgresql"]["using"] == "gin"
        return not (gin and record.database.is_sqlite)

    with record._database.read() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True, "include_object": applies})
        assert compare_metadata(context, metadata) == []
        assert context.get_current_revision() == HEAD


def test_many_may_start_on_an_empty_database_at_once(database_url: str, record: JobRecord) -> None:
    with record._database.write() as connection:
        metadata.drop_all(connection)
        connection.execute(sa.text("DROP TABLE alembic_version"))
    with ThreadPoolExecutor(4) as pool:
        opened = list(pool.map(JobRecord, [database_url] * 4))
    assert opened[0].upkeep.queued_ids() == []
    for each in opened:
        each.close()


def test_a_record_of_a_newer_version_is_refused(database_url: str, record: JobRecord) -> None:
    def say(version: str) -> None:
        with record._database.write() as connection:
            connection.execute(sa.text("UPDATE alembic_version SET version_num = :version"), {"version": version})

    say("9999")
    try:
        with pytest.raises(UnavailableError, match="newer"):
            JobRecord(database_url)
    finally:
        say(HEAD)


@each_case("url", ["nonsense", "sqlite://", "sqlite:///:memory:", "postgresql+nodriver://host/x", "oracle9://x"])
def test_a_url_that_means_nothing_is_refused_with_advice(url: str) -> None:
    with pytest.raises(DependencyError) as caught:
        Database(url)
    assert "sqlite" in caught.value.advice_text


def test_a_database_that_does_not_answer_is_unavailable() -> None:
    started = time.monotonic()
    with pytest.raises(UnavailableError):
        Database("postgresql://nobody@127.0.0.1:1/nothing")
    assert time.monotonic() - started < DEADLINE_S


def test_sqlite_is_durable(tmp_path) -> None:
    database = Database(f"sqlite:///{tmp_path}/deep/er/record.sqlite")
    with database.read() as connection:
        pragma = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar_one()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout", "cache_size")
        }
    kept = {"cache_size": -512}  # kB in each connection
    assert pragma == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 30_000, **kept}
    database.close()


def test_only_its_user_can_read_a_record_on_sqlite(tmp_path: Path) -> None:
    def modes(folder: Path) -> dict[str, int]:
        return {path.name: stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.iterdir())}

    private = {
        "data": 0o700,
        "meshdeform.sqlite": 0o600,
        "meshdeform.sqlite-wal": 0o600,
        "meshdeform.sqlite-shm": 0o600,
    }
    folder, before = tmp_path / "data", os.umask(0o022)
    try:
        first = Database(f"sqlite:///{folder}/meshdeform.sqlite")
        with first.read() as connection:
            connection.execute(sa.text("SELECT * FROM alembic_version"))
        assert modes(folder) == private
        for path in (folder, *folder.iterdir()):
            path.chmod(0o755 if path.is_dir() else 0o644)
        # One that an older version left, also while another process has it open.
        Database(f"sqlite:///{folder}/meshdeform.sqlite").close()
        assert modes(folder) == private
        first.close()
        # A folder that others may need stays as it is.
        (tmp_path / "home").mkdir(mode=0o755)
        Database(f"sqlite:///{tmp_path}/home/record.sqlite").close()
        assert modes(tmp_path / "home") == {"home": 0o755, "record.sqlite": 0o600}
    finally:
        os.umask(before)


# -- migrations with data in them
Migrate = Callable[[str], None]


@pytest.fixture
def migrate(record: JobRecord, database_url: str) -> Iterator[Migrate]:
    """Bring the database, which is empty at first, up to a version."""
    config = alembic.config.Config()
    config.set_main_option("script_location", str(Path(meshdeform.record.__file__).parent / "migrations"))

    def to(version: str) -> None:
        with record.database.write() as connection:
            config.attributes["connection"] = connection
            alembic.command.upgrade(config, version)

    _drop_everything(record)
    yield to
    _drop_everything(record)
    JobRecord(database_url).close()


def _drop_everything(record: JobRecord) -> None:
    with record.database.write() as connection:
        metadata.drop_all(connection)
        connection.execute(sa.text("DROP TABLE IF EXISTS alembic_version"))


_MADE = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
_ENDED = datetime(2026, 1, 2, 4, 0, 0, tzinfo=UTC)


_TARGET = {"key": "assets/b", "filename": "b.obj", "size": 2**33, "sha256": "b" * 64}


def _fill_0001(record: JobRecord) -> None:
    """Jobs in every state, as the first version wrote them."""
    tables = sa.MetaData()
    with record.database.write() as connection:
        tables.reflect(connection)
        for number, state in enumerate(JobState):
            over = state.terminal
            error = {"code": "worker_lost", "title": "t", "detail": "d", "advice": "a", "status": 500}
            request = {"prompt": "a mushroom", "metadata": {"number": str(number)}}
            asset = {"key": "assets/a", "filename": "a.glb", "size": 3, "sha256": "a" * 64}
            row = {
                "id": _old_id(state), "kind": "text_deform", "state": state.value, "request": request,
                "asset_key": "assets/a", "asset": asset, "created_at": _MADE, "version": 3,
                **({"target_key": "assets/b", "target": _TARGET} if state is JobState.QUEUED else {}),
                "attempt": 0 if state is JobState.QUEUED else 2, "lost_attempts": 1, "step": 5, "total_steps": 10,
                "started_at": None if state is JobState.QUEUED else _MADE, "finished_at": _ENDED if over else None,
                "fraction": 0.5, "phase": "optimizing", "losses": {"guidance": 0.5},
                "error": error if state is JobState.FAILED else None,
                "lease_expires_at": _ENDED if state in (JobState.RUNNING, JobState.CANCELING) else None,
            }  # fmt: skip
            connection.execute(sa.insert(tables.tables["jobs"]).values(row))
        connection.execute(
            sa.insert(tables.tables["checkpoints"]).values(
                job_id=_old_id(JobState.RUNNING), attempt=1, step=5, sha256="c" * 64, key="jobs/x/1/checkpoint-000005"
            )
        )
        connection.execute(
            sa.insert(tables.tables["artifacts"]).values(
                job_id=_old_id(JobState.SUCCEEDED), name="result.glb", attempt=2, content_type="model/gltf-binary",
                size=7, sha256="d" * 64, key="jobs/x/2/result.glb", created_at=_ENDED,
            )
        )  # fmt: skip
        connection.execute(sa.insert(tables.tables["files"]).values(key="assets/a", pins=0, touched_at=_MADE))


def _old_id(state: JobState) -> str:
    return f"job_01kg9zqk2xf3v8c5m7n9p1r4t{list(JobState).index(state)}"


_PAST = {
    JobState.QUEUED: ["queued"],
    JobState.RUNNING: ["queued", "started"],
    JobState.CANCELING: ["queued", "started", "canceling"],
    JobState.SUCCEEDED: ["queued", "started", "succeeded"],
    JobState.FAILED: ["queued", "started", "failed"],
    JobState.CANCELED: ["queued", "started", "canceled"],
    JobState.EXPIRED: ["queued", "started", "expired"],
}


def test_the_jobs_of_the_first_version_are_kept_with_events_labels_and_who_is_to_be_told(
    record: JobRecord, migrate: Migrate, database_url: str
) -> None:
    migrate("0001")
    _fill_0001(record)
    opened = JobRecord(database_url)  # it migrates
    try:
        for number, (state, past) in enumerate(_PAST.items()):
            job = opened.get(_old_id(state))
            assert (job.state, job.progress.step, job.owner_id, job.created_at) == (state, 5, "", _MADE)
            assert history(opened, job.id) == past
            assert opened.events.after(job.id)[0].at == _MADE
            assert ids(opened.list_jobs(metadata={"number": str(number)}, owner="").jobs) == [job.id]
        failed = opened.get(_old_id(JobState.FAILED))
        assert failed.error is not None
        assert opened.events.after(failed.id)[-1].data["error"] == failed.error.model_dump()
        assert opened.upkeep.unannounced() == [_old_id(JobState.QUEUED)]
        assert [job.id for job in opened.list_jobs(words="A.GLB b.obj").jobs] == [_old_id(JobState.QUEUED)]
        assert [artifact.key for artifact in opened.artifacts(_old_id(JobState.SUCCEEDED))] == ["jobs/x/2/result.glb"]
        with opened.database.read() as connection:
            kept = sa.select(jobs.c.stored_bytes).where(jobs.c.id == _old_id(JobState.SUCCEEDED))
            assert connection.scalar(kept) == 7
        (checkpoint,) = opened.leases.checkpoints(_old_id(JobState.RUNNING))
        assert (checkpoint.step, checkpoint.size, checkpoint.created_at) == (5, 0, _MADE)
        _check_files(opened)
        # And they go on: the lease of the one that ran is over, the one that waited is taken.
        assert opened.upkeep.reclaim_expired(5) == [_old_id(JobState.RUNNING)]
        assert history(opened, _old_id(JobState.RUNNING))[-1] is EventType.RECOVERED
        assert opened.get(_old_id(JobState.CANCELING)).state is JobState.CANCELED
        taken = opened.leases.claim_next("worker", LEASE_S)
        assert taken is not None
        assert (taken.id, taken.attempt) == (_old_id(JobState.QUEUED), 1)
    finally:
        opened.close()


def _check_files(record: JobRecord) -> None:
    """Check the files of the jobs of `_fill_0001`, and that none of them is unused."""
    asset = StoredFile(key="assets/a", filename="a.glb", size=3, sha256="a" * 64)
    for state in JobState:
        target = {"target": StoredFile.model_validate(_TARGET)} if state is JobState.QUEUED else {}
        assert record.get(_old_id(state)).files == {"asset": asset, **target}
    record.files.unpin(["assets/b"])
    assert record.files.unused() == []


def _columns(connection: sa.Connection) -> dict[str, list[str]]:
    found = sa.inspect(connection)
    return {table: sorted(column["name"] for column in found.get_columns(table)) for table in found.get_table_names()}


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_postgresql_that_is_starting_or_out_of_connections_is_unavailable(database_url: str) -> None:
    database = Database(database_url)
    for state in ("57P03", "53300", "40P01"):
        with pytest.raises(UnavailableError), database.write() as connection:
            connection.exec_driver_sql(f"DO $$ BEGIN RAISE EXCEPTION 'no' USING ERRCODE = '{state}'; END $$")
    with pytest.raises(sa.exc.DBAPIError), database.write() as connection:
        connection.exec_driver_sql("SELECT nothing FROM nowhere")
    database.close()
