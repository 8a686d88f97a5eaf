from __future__ import annotations

import base64
import re
import threading
import time
import uuid

import pytest

from meshdeform.errors import ParameterError
from meshdeform.record import ids
from meshdeform.record.ids import JOB_ID_PATTERN, decode_cursor, encode_cursor, new_id, new_job_id
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


def test_ids_rise_strictly_across_threads() -> None:
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


def test_ids_rise_when_the_clock_is_set_back_and_when_the_counter_runs_over(monkeypatch) -> None:
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


@each_case("word", ["", "=", "a", "\0", "é", "job_", "job_" + "u" * 26, "%2e%2e", "AAAA", " "])
def test_what_no_cursor_says_is_refused(word: str) -> None:
    for cursor in (word, base64.urlsafe_b64encode(word.encode()).decode()):
        with pytest.raises(ParameterError, match="cursor"):
            decode_cursor(cursor)


def test_a_cursor_of_one_list_is_none_of_another() -> None:
    with pytest.raises(ParameterError):
        decode_cursor(encode_cursor(new_job_id()), "msg")
