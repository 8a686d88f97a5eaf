"""What Prometheus is told: sums of the whole deployment from the record, and the requests of this process.

What the record counts is the same from every API process and outlives all of them: scrape one, or take the maximum.
No label holds an id, a path with one, or anything else that a caller chooses.
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

__all__ = ["Metrics", "MetricsMiddleware"]

_HELP = {
    "job_seconds": "Seconds from a job's first start to its end.",
    "queue_wait_seconds": "Seconds from a job's creation to its first start.",
    "step_seconds": "Mean seconds of an optimiser step, one value for each job that ended with its worker.",
}
_METHODS = {"DELETE", "GET", "HEAD", "PATCH", "POST", "PUT"}
_OUTCOMES = ("delivered", "failed", "retried")


class _RecordCollector(Collector):
    """Reads the record when it is asked. While the record is away, everything but that is missing."""

    def __init__(self, record: JobRecord, queue: str) -> None:
        self._record, self._queue = record, queue

    def describe(self) -> Iterable[Metric]:
        """Say nothing: the record is not asked at registration."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Return every family."""
        up = GaugeMetricFamily("meshdeform_record_up", "Whether the record answers.")
        try:
            found = [*self._gauges(), *self._sums()]
        except UnavailableError:
            up.add_metric([], 0.0)
            yield up
            return
        up.add_metric([], 1.0)
        yield up
        yield from found

    def _gauges(self) -> Iterator[Metric]:
        seen = statistics(self._record.database)
        by_state = GaugeMetricFamily("meshdeform_jobs", "Jobs by state.", labels=["state"])
        for state, count in seen.jobs.items():
            by_state.add_metric([state.value], count)
        yield by_state
        for name, text, value in (
            ("queue_depth", "Jobs that wait for a worker.", seen.jobs[JobState.QUEUED]),
            ("queue_oldest_seconds", "How long the oldest queued job has been there.", seen.oldest_queued_s),
            (
                "workers_alive",
                "Workers that were heard of lately.",
                self._record.leases.alive(self._queue),
            ),
            ("webhook_deliveries_pending", "Messages to webhooks not delivered yet.", seen.pending_deliveries),
        ):
            yield GaugeMetricFamily(f"meshdeform_{name}", text, value=value)

    def _sums(self) -> Iterator[Metric]:
        sums = self._record.counters()
        ended = CounterMetricFamily("meshdeform_jobs_ended", "Jobs that ended, by how.", labels=["state"])
        for state in sorted(TERMINAL_STATES):
            ended.add_metric([state.value], sums.get(("jobs_ended", state.value), 0.0))
        yield ended
        sent = CounterMetricFamily(
            "meshdeform_webhook_deliveries", "Outcomes of deliveries to webhooks.", labels=["outcome"]
        )
        for outcome in _OUTCOMES:
            sent.add_metric([outcome], sums.get(("webhook_deliveries", outcome), 0.0))
        yield sent
        for name, text in (
            ("lease_expirations", "Leases that ran out, or whose worker was found dead."),
            ("recoveries", "Jobs that were queued again after their worker was lost."),
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
    """The metrics of one application.

    Attributes
    ----------
    registry : CollectorRegistry
        What `/metrics` shows.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        labels = ["method", "route", "status"]
        self._requests = Counter("meshdeform_http_requests", "Requests answered.", labels, registry=self.registry)
        self._seconds = Histogram(
            "meshdeform_http_request_seconds",
            "Seconds until the answer began.",
            ["method", "route"],
            registry=self.registry,
        )

    def watch(self, record: JobRecord, queue: str) -> None:
        """Show what the record counts, too."""
        self.registry.register(_RecordCollector(record, queue))

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request."""
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)


class MetricsMiddleware:
    """Counts requests by method, route and status."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, and count."""
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
    """Return the pattern of the route that answers, `/v1/jobs/{id}`; `other` where none does."""
    if route := scope.get("route"):
        return str(route.path)
    for route in getattr(scope.get("app"), "routes", []):
        # Requests that a handler refused before routing was done, such as a wrong method.
        if route.matches(scope)[0] is not Match.NONE:
            return str(getattr(route, "path", "other"))
    return "other"
