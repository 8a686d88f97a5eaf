"""The index of a search's texts on PostgreSQL: made by whoever may, done without by whoever may not, and made later."""

from __future__ import annotations

import logging
import re
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from meshdeform.errors import UnavailableError
from meshdeform.record import database
from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import HEAD
from meshdeform.requests.document import JobRequest
from tests.integration.conftest import stored_file

pytestmark = pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
INDEX = sa.text("SELECT count(*) FROM pg_indexes WHERE indexname = 'ix_job_texts_text' AND indexdef LIKE '%USING gin%'")


@pytest.fixture
def administrator(database_url: str) -> Iterator[sa.Engine]:
    """Connections of the superuser, to the module's database."""
    engine = sa.create_engine(database_url.replace("://", "+pg8000://"), isolation_level="AUTOCOMMIT")
    yield engine
    engine.dispose()


@pytest.fixture
def restricted_url(database_url: str, administrator: sa.Engine) -> Iterator[str]:
    """The database for a user who may create tables in it, but no extension."""
    name = f"user_{uuid.uuid4().hex}"
    with administrator.connect() as connection:
        connection.exec_driver_sql(f"CREATE ROLE {name} LOGIN")
        connection.exec_driver_sql(f"GRANT CREATE, USAGE ON SCHEMA public TO {name}")
    yield database_url.replace("meshdeform@", f"{name}@")
    with administrator.connect() as connection:
        connection.exec_driver_sql(f"DROP OWNED BY {name}")
        connection.exec_driver_sql(f"DROP ROLE {name}")


def documented() -> list[str]:
    """The statements that docs/operations.md gives an administrator."""
    page = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
    (block,) = re.findall(r"```sql\n(.*?)```", page, re.DOTALL)
    return [statement.strip() for statement in block.split(";") if statement.strip()]


def found(record: JobRecord, words: str) -> list[str]:
    return [job.prompt for job in record.list_jobs(words=words).jobs]


def test_without_the_right_to_it_searches_work_and_an_administrator_can_add_it(
    restricted_url: str, administrator: sa.Engine, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        record = JobRecord(restricted_url)
        JobRecord(restricted_url).close()  # says nothing: there is nothing to migrate any more
    (said,) = caplog.messages
    assert "pg_trgm" in said
    assert "docs/operations.md#search" in said
    try:
        record.create(NewJob(JobRequest(prompt="a tall vase"), {"asset": stored_file()}))
        assert (found(record, "VASE"), found(record, "giraffe")) == (["a tall vase"], [])
        with administrator.connect() as connection:
            assert connection.scalar(sa.text("SELECT version_num FROM alembic_version")) == HEAD
            assert connection.scalar(INDEX) == 0
            for statement in documented():
                connection.exec_driver_sql(statement)
            assert connection.scalar(INDEX) == 1
        record.create(NewJob(JobRequest(prompt="a vase"), {"asset": stored_file()}))
        assert (found(record, "VASE"), found(record, "giraffe")) == (["a vase", "a tall vase"], [])
    finally:
        record.close()


def test_a_migration_may_take_longer_than_other_statements(
    database_url: str, administrator: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    JobRecord(database_url).close()
    monkeypatch.setattr(database, "_upgrade", lambda connection: connection.exec_driver_sql("SELECT pg_sleep(1.0)"))
    with administrator.connect() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0008'")
        record = JobRecord(database_url, patience=database.DatabasePatience(30.0, 0.5, 30.0))
        connection.exec_driver_sql(f"UPDATE alembic_version SET version_num = '{HEAD}'")
    # Afterwards the limit holds again.
    with pytest.raises(UnavailableError), record.database.read() as connection:
        connection.exec_driver_sql("SELECT pg_sleep(1.0)")
    record.close()
