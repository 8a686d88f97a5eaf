"""The database under the record: its schema, migrations with data in them, and URLs that mean nothing."""

from __future__ import annotations

import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import sqlalchemy as sa

from meshdeform.errors import DependencyError, RecordVersionError, UnavailableError
from meshdeform.record.database import Database
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import HEAD, metadata
from tests.cases import each_case

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
    assert opened[0].upkeep.queued_ids(9) == []
    for each in opened:
        each.close()


def test_a_record_of_a_newer_version_is_refused(database_url: str, record: JobRecord) -> None:
    def say(version: str) -> None:
        with record._database.write() as connection:
            connection.execute(sa.text("UPDATE alembic_version SET version_num = :version"), {"version": version})

    say("9999")
    try:
        with pytest.raises(RecordVersionError, match="newer"):
            JobRecord(database_url)
    finally:
        say(HEAD)


@each_case("url", ["nonsense", "sqlite://", "sqlite:///:memory:", "postgresql+nodriver://host/x", "oracle9://x"])
def test_a_url_that_means_nothing_is_refused_with_advice(url: str) -> None:
    with pytest.raises(DependencyError) as caught:
        Database(url)
    assert "sqlite" in caught.value.advice_text


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


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_postgresql_that_is_starting_or_out_of_connections_is_unavailable(database_url: str) -> None:
    database = Database(database_url)
    for state in ("57P03", "53300", "40P01"):
        with pytest.raises(UnavailableError), database.write() as connection:
            connection.exec_driver_sql(f"DO $$ BEGIN RAISE EXCEPTION 'no' USING ERRCODE = '{state}'; END $$")
    with pytest.raises(sa.exc.DBAPIError), database.write() as connection:
        connection.exec_driver_sql("SELECT nothing FROM nowhere")
    database.close()
