"""A newer service says more than this client knows: it is kept, and nothing breaks."""

from __future__ import annotations

import json
import warnings
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshdeform.api.documents import UploadLimits
from meshdeform.client import EventView, events
from meshdeform.client.documents import JobView, Validation, read
from meshdeform.client.events import Parser, ServerEvent
from meshdeform.client.retries import Policy
from meshdeform.errors import MeshdeformError, UnavailableError
from meshdeform.record.models import EventType, JobState
from meshdeform.requests.document import DeformParams, OutputParams
from tests.cases import each_case
from tests.unit.client.worlds import World, answer

JOB: dict[str, Any] = {
    "id": "job_1",
    "kind": "text_deform",
    "state": "queued",
    "prompt": "a mushroom",
    "params": {"preset": "preview", "seed": 7},
    "output": {"morph": True},
    "metadata": {},
    "asset": {"filename": "a.glb", "size": 1, "sha256": "0"},
    "created_at": "2026-01-31T12:00:00Z",
    "progress": {},
}
MORPH_PATH = {"frames": 12, "easing": "smooth", "ping_pong": True, "seconds": 2.0}
FUTURE = {
    **JOB,
    "kind": "image_deform",
    "state": "paused",
    "params": {"preset": "ultra", "seed": 7, "wobble": 3},
    "output": {
        "morph": True,
        "morph_path": MORPH_PATH,
        "hologram": True,
        "compact": False,
        "subdivide": False,
        "rig": "keep",
        "provenance": False,
    },
    "asset": {**JOB["asset"], "license": "CC0"},
    "progress": {"gpu": 3},
    "team": "a",
}


def event(seq: int, kind: str = "progress", **more: Any) -> bytes:
    document = {"seq": seq, "type": kind, "at": "2026-01-31T12:00:00Z", "attempt": 1, "data": {}, **more}
    return f"id: {seq}\nevent: {kind}\ndata: {json.dumps(document)}\n\n".encode()


def test_a_known_job_is_of_the_known_classes_and_what_is_new_is_kept() -> None:
    job = read(JobView, JOB, "u")
    assert type(job.params) is DeformParams
    assert type(job.output) is OutputParams
    assert job.state is JobState.QUEUED
    assert job.params.model_fields_set == {"preset", "seed"}
    job = read(JobView, FUTURE, "u")
    assert (job.kind, job.state, job.state.terminal) == ("image_deform", "paused", False)
    assert isinstance(job.state, JobState)
    assert job.state not in set(JobState)
    assert isinstance(job.params, DeformParams)
    assert (job.params.seed, job.params.preset) == (7, "ultra")
    assert "steps" not in job.params.model_fields_set
    assert job.params.model_extra == {"wobble": 3}
    assert job.output.morph
    assert job.model_extra == {"team": "a"}
    assert job.progress.model_extra == {"gpu": 3}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        written = job.as_json()
    assert {name: written[name] for name in ("kind", "state", "params", "output", "team")} == {
        name: FUTURE[name] for name in ("kind", "state", "params", "output", "team")
    }
    limits = {"max_bytes": 1, "max_uploads": None, "max_uploads_bytes": None, "ttl_s": 1, "signed_url_ttl_s": 1}
    assert read(UploadLimits, {**limits, "gpus": 3}, "u").model_extra == {"gpus": 3}
    asset = dict.fromkeys(("vertices", "triangles", "meshes", "size"), 1) | {"filename": "a", "sha256": "0"}
    asset |= {"format": "usd", "extensions": [], "skipped": [], "materials": [], "warnings": []}
    asset |= {"nodes": [{"index": 0, "name": "a", "depth": 2}], "mesh_names": [], "joints": [], "bones": 5}
    document = {"files": {}, "asset": asset, "params": {"steps": 3, "wobble": 1}, "estimate": {"basis": ""}, "score": 1}
    seen = read(Validation, document, "u")
    assert (seen.params.steps, seen.params.model_extra, seen.model_extra) == (3, {"wobble": 1}, {"score": 1})
    assert (seen.asset.model_extra, seen.asset.nodes[0].model_extra) == ({"bones": 5}, {"depth": 2})


@each_case("document", [None, [], {}, {**JOB, "asset": 3}, {**JOB, "state": 3}, {**JOB, "params": 3}])
def test_what_is_no_job_says_so(document: Any) -> None:
    with pytest.raises(UnavailableError, match="http://x answered"):
        read(JobView, document, "http://x")


# Streams


def watched(*replies: Any, after: int = 0, policy: Policy | None = None) -> tuple[list[EventView], World]:
    world = World(*replies, policy=policy or Policy(chance=lambda: 1.0))
    return world.watched(after), world


def test_unknown_events_are_given_and_strange_ones_passed_over() -> None:
    stream = [b"retry: 2000\n\n: hello\n\n", event(1, "queued"), event(2, "reshuffled", extra=1), b"data: {}\n\n"]
    events, _ = watched([*stream, b"event: ping\ndata: no JSON\n\n", event(3, "succeeded")])
    assert [str(found.type) for found in events] == ["queued", "reshuffled", "succeeded"]
    assert isinstance(events[1].type, EventType)
    assert (events[1].type.terminal, events[1].model_extra) == (False, {"extra": 1})
    assert events[0].job_id == "job_1"


def test_connections_go_on_after_the_last_event() -> None:
    cut = event(3)[:30]
    events, world = watched(
        [event(1), event(2), cut], [], answer(503, "", retry_after="4"), [event(2), event(3)], [event(4, "failed")]
    )
    assert [found.seq for found in events] == [1, 2, 3, 4]
    assert [sent.headers["Last-Event-ID"] for sent in world.requests] == ["0", "2", "2", "2", "3"]
    assert world.pauses[2] >= 4.0


def test_an_event_that_is_missing_is_asked_for() -> None:
    events, world = watched([event(1), event(3), event(4)], [event(2), event(3)], [event(4, "succeeded")])
    assert [found.seq for found in events] == [1, 2, 3, 4]
    assert [sent.headers["Last-Event-ID"] for sent in world.requests] == ["0", "1", "3"]
    # One that the service has no more holds nobody up.
    gone, _ = watched([event(1), event(3)], [event(3), event(4, "succeeded")])
    assert [found.seq for found in gone] == [1, 3, 4]


def test_what_is_no_stream_is_told() -> None:
    assert watched(answer(204), after=9)[0] == []  # nothing is left to come
    with pytest.raises(MeshdeformError, match="not a stream"):
        watched(answer(200, "<html>", content_type="text/html"))
    with pytest.raises(MeshdeformError):
        watched(answer(404, ""))
    with pytest.raises(UnavailableError):
        watched([event(1)], policy=Policy(max_retries=0))


def test_a_service_that_answers_and_ends_the_stream_is_asked_more_and_more_slowly() -> None:
    _, world = watched(*[[b": hello\n\n"]] * 8, [event(1, "succeeded")])
    assert world.pauses == [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0]


# The parser of server-sent events: the standard's own examples, and bytes that come in any pieces.


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
