"""One trace for a job: what its caller, the API and a worker, each a process of its own, tell a collector."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.acceptance.cluster import Cluster, deployed
from tests.collector import Collector

pytestmark = pytest.mark.acceptance

STEPS = 12
TRACE, CALLER = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"


@pytest.fixture
def collector() -> Iterator[Collector]:
    receiver = Collector()
    yield receiver
    receiver.close()


@pytest.fixture
def cluster(tmp_path: Path, collector: Collector) -> Iterator[Cluster]:
    environment = {"OTEL_EXPORTER_OTLP_ENDPOINT": collector.endpoint, "OTEL_EXPORTER_OTLP_COMPRESSION": "none"}
    with deployed(tmp_path, environment=environment) as made:
        yield made


def traced_job(cluster: Cluster) -> str:
    """Post a job as a caller that is within a trace, beside others that are not."""
    cluster.http.headers["traceparent"] = f"00-{TRACE}-{CALLER}-01"
    answer = cluster.post(STEPS)
    assert answer.status_code == 202, answer.text
    del cluster.http.headers["traceparent"]
    job_id = str(answer.json()["id"])
    for method, path in [("GET", f"/v1/jobs/{job_id}"), ("PUT", f"/v1/jobs/{job_id}"), ("GET", f"/nothing/{job_id}")]:
        cluster.http.request(method, path)
    return job_id


def spans_of_the_trace(cluster: Cluster, collector: Collector) -> list[Any]:
    """End every process, with which it sends what it still has, and return the spans of the caller's trace."""
    for part in cluster.parts.values():
        assert part.stop() == 0, part.log
    assert "opentelemetry" not in cluster.logs, cluster.logs
    return [span for span in collector.spans if span.trace_id.hex() == TRACE]


def attributes(span: Any) -> dict[str, Any]:
    return {item.key: getattr(item.value, item.value.WhichOneof("value")) for item in span.attributes}


def test_a_job_is_one_trace_through_api_and_worker(cluster: Cluster, collector: Collector) -> None:
    cluster.start_api()
    cluster.start_worker()
    job_id = traced_job(cluster)
    cluster.check(job_id, steps=STEPS)
    spans = spans_of_the_trace(cluster, collector)
    found = {span.name: span for span in spans}
    request, attempt = found["POST /v1/jobs"], found["attempt"]
    assert request.parent_span_id.hex() == CALLER
    assert attempt.parent_span_id == request.span_id
    assert {found[name].parent_span_id for name in ("start", "optimize", "upload")} == {attempt.span_id}
    assert collector.services[request.span_id] == "meshdeform-api"
    for name in ("attempt", "start", "optimize", "upload"):
        assert collector.services[found[name].span_id] == "meshdeform-worker"
    assert attributes(request) == {"http.request.method": "POST", "http.route": "/v1/jobs"}
    assert attributes(attempt) == {"job.id": job_id, "job.kind": "text_deform", "job.attempt": 1}
    in_order = sorted(spans, key=lambda span: span.start_time_unix_nano)
    assert [span.name for span in in_order] == ["POST /v1/jobs", "attempt", "start", "optimize", "upload"]
    # The requests that came without a trace began others.
    others = [span for span in collector.spans if span.trace_id.hex() != TRACE]
    assert {span.name for span in others} == {"GET /v1/jobs/{id}", "PUT /v1/jobs/{id}", "GET other"}
