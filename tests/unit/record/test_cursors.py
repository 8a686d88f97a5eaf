from __future__ import annotations

import base64

import pytest

from meshdeform.errors import ParameterError
from meshdeform.record.ids import decode_cursor, encode_cursor, new_id, new_job_id
from tests.cases import each_case


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
