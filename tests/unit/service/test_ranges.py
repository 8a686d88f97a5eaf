from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshdeform.errors import RangeError
from service.downloads.responses import ByteRange, matches, requested_range
from tests.cases import each_case

TAG = '"abc"'


@given(st.text(max_size=40), st.integers(0, 1000))
def test_whatever_is_asked_for_lies_within_the_file(header: str, size: int) -> None:
    try:
        part = requested_range(f"bytes={header}", None, TAG, size)
    except RangeError:
        return
    assert part is None or 0 <= part.start < part.end <= size


@given(st.integers(0, 99), st.integers(0, 200))
def test_a_range_names_its_first_and_last_byte(first: int, last: int) -> None:
    part = requested_range(f"bytes={first}-{last}", None, TAG, 100)
    assert part == (None if last < first else ByteRange(first, min(last + 1, 100)))


@each_case(
    ("header", "condition", "part"),
    [
        (None, None, None),
        ("bytes=0-", None, ByteRange(0, 100)),
        ("BYTES = 5 - 9 ", None, ByteRange(5, 10)),
        ("bytes=-5", None, ByteRange(95, 100)),
        ("bytes=-500", None, ByteRange(0, 100)),
        ("bytes=0-1,3-4", None, None),
        ("seconds=1-2", None, None),
        ("bytes=٣-٤", None, None),
        ("bytes=1-2", TAG, ByteRange(1, 3)),
        ("bytes=1-2", '"other"', None),
        ("bytes=1-2", f"W/{TAG}", None),
        ("bytes=1-2", "Sat, 31 Jan 2026 12:00:00 GMT", None),
    ],
)
def test_what_is_not_understood_or_of_another_version_is_the_whole(
    header: str | None, condition: str | None, part: ByteRange | None
) -> None:
    assert requested_range(header, condition, TAG, 100) == part


@each_case(("header", "size"), [("bytes=100-", 100), ("bytes=-0", 100), ("bytes=0-", 0), ("bytes=-5", 0)])
def test_a_range_past_the_end_cannot_be_satisfied(header: str, size: int) -> None:
    with pytest.raises(RangeError) as caught:
        requested_range(header, None, TAG, size)
    assert caught.value.extra == {"size": size}


@each_case(
    ("header", "expected"),
    [
        (None, False),
        ("*", True),
        (TAG, True),
        (f"W/{TAG}", True),
        (f'"x", {TAG}', True),
        ('"x"', False),
        ("abc", False),
    ],
)
def test_tags_are_compared_weakly(header: str | None, expected: bool) -> None:
    assert matches(header, TAG) is expected
    assert matches(header, f"W/{TAG}") is expected
