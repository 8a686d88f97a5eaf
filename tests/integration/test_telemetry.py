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


def test_a_span_tells_of_the_error_that_left_it(collector: Collector) -> None:
    telemetry.start_tracing("worker")
    with pytest.raises(ValueError, match="broke"), telemetry.span("attempt"):
        raise ValueError("it broke")
    telemetry.stop_tracing()
    (span,) = collector.spans
    assert span.status.code == 2
    assert span.events[0].name == "exception"
