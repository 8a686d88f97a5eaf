"""Traces, sent to a real OTLP receiver on loopback."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

from meshdeform.support import telemetry
from tests.collector import Collector


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> Iterator[Collector]:
    receiver = Collector()
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", receiver.endpoint)
    # Compression is the default of nobody: the receiver reads plain bodies.
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_COMPRESSION", "none")
    yield receiver
    telemetry.stop_tracing()
    receiver.close()


def test_without_a_collector_nothing_is_loaded() -> None:
    code = (
        "import sys; from meshdeform.support import telemetry as t; assert not t.start_tracing('api')\n"
        "with t.span('x', {'a': 1}, traceparent='00-' + 'a' * 32 + '-' + 'b' * 16 + '-01'): pass\n"
        "assert t.current_traceparent() is None; assert not any('opentelemetry' in name for name in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_job_s_attempt_belongs_to_the_trace_of_its_request(collector: Collector) -> None:
    assert telemetry.start_tracing("api")
    with telemetry.span("POST /v1/jobs", {"http.request.method": "POST"}):
        kept = telemetry.current_traceparent()
    # As in another process, later: only the word that the job carries connects the two.
    with telemetry.span("attempt", {"job.attempt": 1}, traceparent=kept), telemetry.span("optimize"):
        pass
    telemetry.stop_tracing()
    spans = {span.name: span for span in collector.spans}
    assert set(spans) == {"POST /v1/jobs", "attempt", "optimize"}
    assert len({span.trace_id for span in spans.values()}) == 1
    assert spans["attempt"].parent_span_id == spans["POST /v1/jobs"].span_id
    assert spans["optimize"].parent_span_id == spans["attempt"].span_id
    assert set(collector.services.values()) == {"meshdeform-api"}


def test_a_span_tells_of_the_error_that_left_it(collector: Collector) -> None:
    telemetry.start_tracing("worker")
    with pytest.raises(ValueError, match="broke"), telemetry.span("attempt"):
        raise ValueError("it broke")
    telemetry.stop_tracing()
    (span,) = collector.spans
    assert span.status.code == 2
    assert span.events[0].name == "exception"
