"""The parser of server-sent events: the standard's own examples, and bytes that come in any pieces."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshdeform.client import events
from meshdeform.client.events import Parser, ServerEvent
from meshdeform.errors import UnavailableError
from tests.cases import each_case

# (stream, events): the examples of the HTML standard, 9.2.6, and the corners of its grammar.
KNOWN = [
    (b"data: YHOO\ndata: +2\ndata: 10\n\n", [("message", "YHOO\n+2\n10", "")]),
    (
        b": test stream\n\ndata: first event\nid: 1\n\ndata:second event\nid\n\ndata:  third event\n",
        [("message", "first event", "1"), ("message", "second event", "")],
    ),
    (b"data\n\ndata\ndata\n\ndata:\n", [("message", "", ""), ("message", "\n", "")]),
    (b"data:test\n\ndata: test\n\n", [("message", "test", "")] * 2),
    (b"event: add\ndata: 73857293\n\nevent: remove\n\ndata: x\n\n", [("add", "73857293", ""), ("message", "x", "")]),
    (b"\xef\xbb\xbfid: 7\r\nevent: a\r\ndata: \xc3\xa4\r\n\r\n", [("a", "ä", "7")]),
    (b"id: 1\rdata: a\r\rdata: b\r\r", [("message", "a", "1"), ("message", "b", "1")]),
    (b"retry: 2000\n\nid: 3\n\nid: a\0b\ndata: x\nunknown: y\n\n", [("message", "x", "3")]),
    (b"data: cut off\n", []),
]


def fed(*parts: bytes) -> list[tuple[str, str, str]]:
    parser = Parser()
    return [(event.type, event.data, event.id) for part in parts for event in parser.feed(part)]


@each_case(("stream", "events"), KNOWN)
def test_a_stream_gives_its_events_however_it_is_cut(stream: bytes, events: list[tuple[str, str, str]]) -> None:
    assert fed(stream) == events
    assert fed(*(bytes([byte]) for byte in stream)) == events
    for cut in range(len(stream)):
        assert fed(stream[:cut], stream[cut:]) == events


@given(st.binary(max_size=200), st.lists(st.integers(0, 200), max_size=5))
def test_any_bytes_give_the_same_in_any_pieces(stream: bytes, cuts: list[int]) -> None:
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    assert fed(*(stream[a:b] for a, b in pairwise(edges))) == fed(stream)


def test_an_event_without_an_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "_LONGEST", 1000)
    parser = Parser()
    assert list(parser.feed(b"data: " + b"x" * 900 + b"\n\n")) == [ServerEvent("message", "x" * 900, "")]
    assert fed(b"data: x\n" * 100) == []
    with pytest.raises(UnavailableError, match="without an end"):
        list(parser.feed((b"data: " + b"x" * 100 + b"\n") * 11))
