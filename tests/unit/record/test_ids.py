from __future__ import annotations

import base64
import re
import threading
import time
import uuid
from datetime import UTC, datetime, timedelta, timezone

import pytest
from pydantic import ValidationError
from sqlalchemy.dialects import postgresql, sqlite

from meshdeform.errors import ParameterError, WorkerLostError
from meshdeform.record import ids
from meshdeform.record.columns import UtcDateTime
from meshdeform.record.ids import JOB_ID_PATTERN, decode_cursor, encode_cursor, new_id, new_job_id
from meshdeform.record.models import TERMINAL_STATES, EventType, JobError, JobState, Progress
from meshdeform.record.schema import metadata
from tests.cases import each_case


def as_uuid(job_id: str) -> uuid.UUID:
    number = 0
    for letter in job_id.removeprefix("job_"):
        number = number << 5 | ids._ALPHABET.index(letter)
    return uuid.UUID(int=number)


def test_an_id_is_a_uuid_version_7_of_this_millisecond() -> None:
    before = time.time_ns() // 1_000_000
    job_id = new_job_id()
    after = time.time_ns() // 1_000_000
    number = as_uuid(job_id)
    assert re.fullmatch(JOB_ID_PATTERN, job_id)
    assert number.version == 7
    assert number.variant == uuid.RFC_4122
    assert before <= number.int >> 80 <= after + 1


def test_ids_rise_strictly_across_threads_a_clock_that_is_set_back_and_a_counter_that_runs_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[list[str]] = [[] for _ in range(4)]

    def make(into: list[str]) -> None:
        into += [new_job_id() for _ in range(500)]

    threads = [threading.Thread(target=make, args=(into,)) for into in made]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(ours == sorted(ours) for ours in made)
    assert len({job_id for ours in made for job_id in ours}) == 2000
    first = new_job_id()
    monkeypatch.setattr(time, "time_ns", lambda: 1_000_000_000)
    later = [new_job_id() for _ in range(5000)]
    assert [first, *later] == sorted({first, *later})
    assert {as_uuid(job_id).version for job_id in later} == {7}
    assert {as_uuid(job_id).variant for job_id in later} == {uuid.RFC_4122}


def test_a_cursor_names_the_id_that_it_was_made_of_and_fits_into_a_url() -> None:
    for prefix in ("job", "whk", "msg"):
        last_id = new_id(prefix)
        cursor = encode_cursor(last_id)
        assert decode_cursor(cursor, prefix) == last_id
        assert cursor.replace("-", "").replace("_", "").isalnum()
        with pytest.raises(ParameterError):  # of another list
            decode_cursor(cursor, "key")


@each_case("word", ["", "=", "a", "\0", "é", "job_", "job_" + "u" * 26, "%2e%2e", "AAAA", " "])
def test_what_no_cursor_says_is_refused(word: str) -> None:
    for cursor in (word, base64.urlsafe_b64encode(word.encode()).decode()):
        with pytest.raises(ParameterError, match="cursor"):
            decode_cursor(cursor)


def test_every_state_but_running_is_an_event() -> None:
    """A worker's `started` makes a job run; every other state comes with an event of its name."""
    assert {happened.value for happened in EventType if happened.terminal} == {state.value for state in TERMINAL_STATES}
    assert {state for state in JobState if state.terminal} == TERMINAL_STATES
    assert {state.value for state in JobState} - {happened.value for happened in EventType} == {"running"}


def test_an_error_is_kept_with_all_that_a_user_needs() -> None:
    error = WorkerLostError("The workers of 3 attempts died.")
    kept = JobError.of(error)
    assert (kept.code, kept.detail, kept.status) == (error.code, "The workers of 3 attempts died.", error.status)
    assert kept.title
    assert kept.advice
    assert JobError.model_validate(kept.model_dump()) == kept


@each_case("wrong", [{"step": -1}, {"fraction": 1.5}, {"fraction": -0.1}, {"eta_s": -1.0}])
def test_progress_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Progress.model_validate(wrong)


DIALECTS = [sqlite.dialect(), postgresql.dialect()]
MOMENT = datetime(2026, 3, 4, 5, 6, 7, 890, tzinfo=UTC)


@each_case("dialect", DIALECTS, ids=lambda dialect: str(dialect.name))
def test_an_instant_is_stored_and_read_in_utc_whatever_zone_it_was_said_in(dialect: object) -> None:
    kind = UtcDateTime()
    for hours in (-11, 0, 5.5, 14):
        said = MOMENT.astimezone(timezone(timedelta(hours=hours)))
        stored = kind.process_bind_param(said, dialect)  # type: ignore[arg-type]
        assert stored == MOMENT
        assert stored is not None
        assert stored.utcoffset() == timedelta(0)
        # SQLite gives it back without a zone, PostgreSQL in that of its session.
        for given in (stored.replace(tzinfo=None), said):
            read = kind.process_result_value(given, dialect)  # type: ignore[arg-type]
            assert read == MOMENT
            assert read is not None
            assert read.utcoffset() == timedelta(0)


def test_a_time_without_a_zone_is_no_instant() -> None:
    with pytest.raises(ValueError, match="zone"):
        UtcDateTime().process_bind_param(MOMENT.replace(tzinfo=None), DIALECTS[0])
    assert UtcDateTime().process_bind_param(None, DIALECTS[0]) is None
    assert UtcDateTime().process_result_value(None, DIALECTS[0]) is None


def test_what_belongs_to_a_job_goes_with_it() -> None:
    belonging = {
        table.name
        for table in metadata.tables.values()
        for key in table.foreign_keys
        if key.column.table.name == "jobs" and key.ondelete == "CASCADE"
    }
    assert belonging == {"labels", "events", "outbox", "artifacts", "checkpoints", "job_files", "job_texts"}
