"""Rows are inserted with those that refer to them, by a statement that PostgreSQL's side builds once for each shape."""

from __future__ import annotations

import pytest
import sqlalchemy as sa

from meshdeform.record import database
from meshdeform.record.database import NewRow, insert
from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import discarded, files, job_texts, labels, outbox, secrets
from meshdeform.requests.document import JobRequest
from tests.integration.conftest import stored_file

pytestmark = pytest.mark.both_databases


def test_values_and_expressions_arrive_and_the_first_row_comes_back(record: JobRecord) -> None:
    now = record.database.now()
    with record.database.write() as connection:
        row = insert(
            connection,
            record.database,
            NewRow(files, {"key": "a", "pins": 2, "touched_at": now}),
            NewRow(secrets, {"name": "n'; --", "value": "%s :x $1"}),
            NewRow(discarded, {"prefix": "jobs/x/"}),
            NewRow(discarded, {"prefix": "jobs/y/"}),
        )
        assert (row.key, row.pins) == ("a", 2)
        assert abs((row.touched_at - record.database.clock()).total_seconds()) < 60
        assert connection.execute(sa.select(secrets)).all() == [("n'; --", "%s :x $1")]
        assert connection.scalars(sa.select(discarded.c.prefix).order_by("prefix")).all() == ["jobs/x/", "jobs/y/"]


def test_a_row_that_may_be_there_is_left_as_it_is(record: JobRecord) -> None:
    for value, expected in (("first", "first"), ("second", "first")):
        with record.database.write() as connection:
            other = NewRow(secrets, {"name": "n", "value": value}, unless_there=True)
            insert(connection, record.database, NewRow(discarded, {"prefix": value}), other)
            assert connection.scalar(sa.select(secrets.c.value)) == expected
    with pytest.raises(sa.exc.DBAPIError), record.database.write() as connection:
        insert(connection, record.database, NewRow(discarded, {"prefix": "first"}))


@pytest.mark.parametrize("labelled", [{}, {"shot": "1", "take": "2"}])
def test_jobs_of_one_shape_share_a_statement(record: JobRecord, labelled: dict[str, str]) -> None:
    def made(**more: object) -> str:
        request = JobRequest.model_validate({"prompt": "a vase", "metadata": labelled, **more})
        return record.create(NewJob(request, {"asset": stored_file()}, owner_id="ann")).id

    database._kept.cache_clear()
    ids = [made() for _ in range(3)]
    misses = database._kept.cache_info().misses
    assert misses == (0 if record.database.is_sqlite else 2), "one for jobs, one for events"
    # A deadline is an expression of its own each time, which is not kept.
    late = [made(deadline_s=60.0 + number) for number in range(3)]
    assert database._kept.cache_info().currsize == misses
    with record.database.read() as connection:
        for table, each in ((job_texts, 1), (outbox, 1), (labels, len(labelled))):
            count = sa.select(sa.func.count()).select_from(table).where(table.c.job_id.in_([*ids, *late]))
            assert connection.scalar(count) == 6 * each
    dues = [record.get(job).deadline_at for job in late]
    assert None not in dues
    assert record.get(ids[0]).deadline_at is None
