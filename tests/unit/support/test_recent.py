"""The last values of a process: how many, and how many bytes they may take."""

from __future__ import annotations

from meshdeform.support.recent import Recent


def test_the_value_that_was_used_least_recently_is_forgotten() -> None:
    recent = Recent[int](2)
    recent.put("a", 1)
    recent.put("b", 2)
    assert recent.get("a") == 1
    recent.put("c", 3)
    assert (recent.get("a"), recent.get("b"), recent.get("c")) == (1, None, 3)


def test_values_take_no_more_bytes_than_they_may() -> None:
    recent = Recent[str](10, most_bytes=100)
    recent.put("a", "a", 60)
    recent.put("b", "b", 40)
    assert recent.get("a") == "a"
    recent.put("c", "c", 30)  # b goes
    assert (recent.get("a"), recent.get("b"), recent.get("c")) == ("a", None, "c")
    recent.put("a", "A", 10)  # in its own place
    recent.put("d", "d", 60)
    assert (recent.get("a"), recent.get("c"), recent.get("d")) == ("A", "c", "d")


def test_a_value_that_takes_more_than_all_may_is_not_kept() -> None:
    recent = Recent[str](10, most_bytes=100)
    recent.put("a", "a", 101)
    assert recent.get("a") is None
    recent.put("b", "b", 100)
    assert recent.get("b") == "b"
