"""Send traces with OpenTelemetry if its usual variables name a collector; otherwise import nothing.

``OTEL_EXPORTER_OTLP_ENDPOINT=http://collector:4318`` enables them in the API and in workers; the extra `otel` installs
the packages. A job stores its request's trace (`traceparent`, W3C Trace Context), so that one trace shows the request,
the wait, every attempt and its phases, on any hosts.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from meshdeform.errors import DependencyError

if TYPE_CHECKING:
    from opentelemetry.trace import Tracer

__all__ = ["current_traceparent", "rename_span", "span", "start_tracing", "stop_tracing"]

_ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
_tracer: Tracer | None = None
_provider: Any = None


def start_tracing(part: str) -> bool:
    """Send spans to the collector that the environment names.

    Parameters
    ----------
    part : str
        The part of the service that this process is: `api` or `worker`. Its `service.name` is `meshdeform-PART` unless
        OTEL_SERVICE_NAME is set.

    Returns
    -------
    bool
        Whether the environment names a collector.

    Raises
    ------
    DependencyError
        It names one, but the packages are not installed.
    """
    global _tracer, _provider
    if _tracer is not None or not any(os.environ.get(name) for name in _ENDPOINTS):
        return _tracer is not None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ModuleNotFoundError as error:
        raise DependencyError(
            "OTEL_EXPORTER_OTLP_ENDPOINT is set, but OpenTelemetry is not installed.",
            advice='Run: pip install "meshdeform[otel]", or unset the variable.',
        ) from error
    from meshdeform import __version__

    name = os.environ.get("OTEL_SERVICE_NAME") or f"meshdeform-{part}"
    resource = Resource.create({"service.name": name, "service.version": __version__})
    _provider = TracerProvider(resource=resource)
    _provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    _tracer = _provider.get_tracer("meshdeform", __version__)
    return True


def stop_tracing() -> None:
    """Send the remaining spans and stop."""
    global _tracer, _provider
    if _provider is not None:
        _provider.shutdown()
    _tracer = _provider = None


@contextmanager
def span(
    name: str, attributes: Mapping[str, str | int | float] | None = None, *, traceparent: str | None = None
) -> Iterator[None]:
    """Record a span around a block, with any exception that leaves the block.

    Parameters
    ----------
    name : str
    attributes : mapping, optional
    traceparent : str, optional
        The parent span in another process. Default: the innermost span of this context.
    """
    if _tracer is None:
        yield
        return
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

    context = TraceContextTextMapPropagator().extract({"traceparent": traceparent}) if traceparent else None
    with _tracer.start_as_current_span(name, context=context, attributes=dict(attributes or {})):
        yield


def rename_span(name: str, attributes: Mapping[str, str | int | float] | None = None) -> None:
    """Set the name, and optionally attributes, of the innermost span."""
    if _tracer is None:
        return
    from opentelemetry.trace import get_current_span

    innermost = get_current_span()
    innermost.update_name(name)
    innermost.set_attributes(dict(attributes or {}))


def current_traceparent() -> str | None:
    """Return the innermost span in W3C Trace Context form, to store with a job, or None without tracing."""
    if _tracer is None:
        return None
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

    carrier: dict[str, str] = {}
    TraceContextTextMapPropagator().inject(carrier)
    return carrier.get("traceparent")
