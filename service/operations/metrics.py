"""Export metrics to Prometheus: totals of the deployment from the record, and the requests of this process.

The record's totals are the same from every API process and survive restarts: scrape one process, or take the maximum.
No label contains an id or anything else that a caller chooses.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.routing import Match

from meshdeform.errors import UnavailableError
from meshdeform.record.counters import BUCKETS_S, statistics
from meshdeform.record.models import TERMINAL_STATES, JobState

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from meshdeform.record.repository import JobRecord

_HELP = {
    "job_seconds": "Seconds from a job's first start to its end.",
    "queue_wait_seconds": "Seconds from a job's creation to its first start.",
    "step_seconds": "Mean seconds of an optimiser step, one value for each job that ended with its worker.",
}
_METHODS = {"DELETE", "GET", "HEAD", "PATCH", "POST", "PUT"}
_OUTCOMES = ("delivered", "failed", "retried")


class _RecordCollector(Collector):
    """Read the record on each scrape. While it is unavailable, only `meshdeform_record_up` is exported."""

    def __init__(self, record: JobRecord, queue: str) -> None:
        self._record, self._queue = record, queue

    def describe(self) -> Iterable[Metric]:
        """Return nothing, so that registration does not read the record."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Yield every metric family."""
        up = GaugeMetricFamily("meshdeform_record_up", "Whether the record responds.")
        try:
            families = [*self._gauges(), *self._sums()]
        except UnavailableError:
            up.add_metric([], 0.0)
            yield up
            return
        up.add_metric([], 1.0)
        yield up
        yield from families

    def _gauges(self) -> Iterator[Metric]:
        seen = statistics(self._record.database)
        by_state = GaugeMetricFamily("meshdeform_jobs", "Unfinished jobs by state.", labels=["state"])
        for state, count in seen.jobs.items():
            by_state.add_metric([state.value], count)
        yield by_state
        for name, text, value in (
            ("queue_depth", "Jobs waiting for a worker.", seen.jobs[JobState.QUEUED]),
            ("queue_oldest_seconds", "Age of the oldest queued job.", seen.oldest_queued_s),
            (
                "workers_alive",
                "Workers with a recent heartbeat.",
                self._record.leases.alive(self._queue),
            ),
            ("webhook_deliveries_pending", "Messages to webhooks that are not delivered yet.", seen.pending_deliveries),
        ):
            yield GaugeMetricFamily(f"meshdeform_{name}", text, value=value)

    def _sums(self) -> Iterator[Metric]:
        sums = self._record.counters()
        ended = CounterMetricFamily("meshdeform_jobs_ended", "Jobs that ended, by final state.", labels=["state"])
        for state in sorted(TERMINAL_STATES):
            ended.add_metric([state.value], sums.get(("jobs_ended", state.value), 0.0))
        yield ended
        deliveries = CounterMetricFamily(
            "meshdeform_webhook_deliveries", "Outcomes of deliveries to webhooks.", labels=["outcome"]
        )
        for outcome in _OUTCOMES:
            deliveries.add_metric([outcome], sums.get(("webhook_deliveries", outcome), 0.0))
        yield deliveries
        for name, text in (
            ("lease_expirations", "Leases that expired, or whose worker was found dead."),
            ("recoveries", "Jobs that were requeued after the loss of their worker."),
            ("hand_overs", "Jobs that were requeued to make room for jobs that had waited for long."),
        ):
            yield CounterMetricFamily(f"meshdeform_{name}", text, value=sums.get((name, ""), 0.0))
        for name, bounds in BUCKETS_S.items():
            labels = [f"{bound:g}" for bound in bounds] + ["inf"]
            total, buckets = 0.0, []
            for label in labels:
                total += sums.get((f"{name}_bucket", label), 0.0)
                buckets.append(("+Inf" if label == "inf" else label, total))
            family = HistogramMetricFamily(f"meshdeform_{name}", _HELP[name])
            family.add_metric([], buckets, sum_value=sums.get((f"{name}_sum", ""), 0.0))
            yield family


class Metrics:
    """The metrics of one application, whose registry `/metrics` exports."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        labels = ["method", "route", "status"]
        self._requests = Counter("meshdeform_http_requests", "Requests.", labels, registry=self.registry)
        self._seconds = Histogram(
            "meshdeform_http_request_seconds",
            "Seconds until the response started.",
            ["method", "route"],
            registry=self.registry,
        )

    def watch(self, record: JobRecord, queue: str) -> None:
        """Export the record's totals too."""
        self.registry.register(_RecordCollector(record, queue))

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request."""
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)


class MetricsMiddleware:
    """Count requests by method, route and status."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve and count one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start, begun = time.perf_counter(), False

        async def counted(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start" and not begun:
                begun = True
                method = scope["method"] if scope["method"] in _METHODS else "other"
                seconds = time.perf_counter() - start
                self._metrics.answered(method, route_of(scope), message["status"], seconds)
            await send(message)

        await self._app(scope, receive, counted)


def route_of(scope: Scope) -> str:
    """Return the template of the matching route, such as `/v1/jobs/{id}`; `other` if none matches."""
    if route := scope.get("route"):
        return str(route.path)
    for route in getattr(scope.get("app"), "routes", []):
        # Requests that were refused before routing was complete, such as those with a wrong method.
        if route.matches(scope)[0] is not Match.NONE:
            return str(getattr(route, "path", "other"))
    return "other"
