"""Log and trace every process of the service.

Logs are lines for people, or one JSON object per line for programs. `bound` sets the job or request id of every line
that is logged inside it. The ids are context variables, which tasks and threads of anyio inherit; start any other
thread with `carried`.

Traces are sent with OpenTelemetry if its usual variables name a collector; otherwise nothing of it is imported.
``OTEL_EXPORTER_OTLP_ENDPOINT=http://collector:4318`` enables them in the API and in workers; the extra `otel` installs
the packages. A job stores its request's trace (`traceparent`, W3C Trace Context), so that one trace shows the request,
the wait, every attempt and its phases, on any hosts.
"""

from __future__ import annotations

import contextvars
import json
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from types import TracebackType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from meshdeform.errors import DependencyError, install_command
from meshdeform.settings import Settings

if TYPE_CHECKING:
    from opentelemetry.trace import Tracer

P = ParamSpec("P")
T = TypeVar("T")

ACCESS_LOG = "service.access"
"""The logger that writes a line for each HTTP request; none above INFO."""

PART = "MESHDEFORM_PART"
"""The environment variable with the name of a child of `serve`. Only `serve` sets it; it is not a setting."""

job_id: contextvars.ContextVar[str] = contextvars.ContextVar("job_id", default="")
request_id: contextvars.ContextVar[str] = contextvars.ContextVar("request_id", default="")
_WORKER_ID = "MESHDEFORM_WORKER_ID"
_TEXT = "%(asctime)s %(levelname)-7s %(message)s"
# The attributes of every record; others come from `extra`. `color_message` is uvicorn's.
_STANDARD = {*vars(logging.makeLogRecord({})), "message", "asctime", "color_message"}
_CONTROLS = {code: repr(chr(code))[1:-1] for code in (*range(32), 127) if code != ord("\t")}
_ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
_tracer: Tracer | None = None
_provider: Any = None


def configure_logging(settings: Settings) -> None:
    """Write all logs of this process to standard error in the configured format."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_JsonLines() if settings.log_format == "json" else _TextLines(_TEXT, "%H:%M:%S"))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.INFO)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.captureWarnings(capture=True)
    if settings.log_format == "json":
        sys.excepthook = _log_crash
        threading.excepthook = _log_thread_crash


@contextmanager
def bound(**values: str) -> Iterator[None]:
    """Add a `job_id` or a `request_id` to every line that is logged inside this context."""
    variables = {"job_id": job_id, "request_id": request_id}
    tokens = [(variables[name], variables[name].set(value)) for name, value in values.items()]
    try:
        yield
    finally:
        for variable, token in reversed(tokens):
            variable.reset(token)


def carried(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function bound to a copy of the current context, for one call in another thread."""
    context = contextvars.copy_context()

    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        return context.run(function, *args, **kwargs)

    return run


def json_line(line: str, part: str, logger: str = "output") -> str:
    """Return a line of a process's output as one JSON object.

    A line that is JSON already, from the process's own log, is returned unchanged.
    """
    if line.startswith("{"):
        try:
            json.loads(line)
        except ValueError:
            pass
        else:
            return line
    return _dump({"time": _instant(), "level": "info", "logger": logger, "message": line, "part": part})


class _TextLines(logging.Formatter):
    """`12:00:00 INFO    message job=... request=...`. An id that the message contains is not repeated."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        """Return the first line, which a traceback may follow."""
        # Escape control characters: quoted user text must not break the line.
        text = super().formatMessage(record).translate(_CONTROLS)
        for name, value in (("job", job_id.get()), ("request", request_id.get())):
            if value and value not in text:
                text += f" {name}={value}"
        return text


class _JsonLines(logging.Formatter):
    """One JSON object per line, without members whose value is None."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        members: dict[str, Any] = {
            "time": _instant(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            "part": os.environ.get(PART),
            "job_id": job_id.get() or None,
            "request_id": request_id.get() or None,
            "worker": os.environ.get(_WORKER_ID),
            **{name: value for name, value in vars(record).items() if name not in _STANDARD},
        }
        if record.exc_info:
            members["exception"] = self.formatException(record.exc_info)
        return _dump({name: value for name, value in members.items() if value is not None})


def _dump(members: dict[str, Any]) -> str:
    # ASCII only, since terminals and collectors may treat other characters as line ends.
    return json.dumps(members, default=str)


def _instant(seconds: float | None = None) -> str:
    moment = datetime.now(UTC) if seconds is None else datetime.fromtimestamp(seconds, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _log_crash(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    logging.getLogger(__name__).critical("the process ends", exc_info=(kind, error, trace))


def _log_thread_crash(arguments: threading.ExceptHookArgs) -> None:
    if arguments.exc_value is not None and not isinstance(arguments.exc_value, SystemExit):
        error = (arguments.exc_type, arguments.exc_value, arguments.exc_traceback)
        logging.getLogger(__name__).error("a thread ends", exc_info=error)


def start_tracing(part: str) -> bool:
    """Send spans to the collector that the environment names, if it names one; return whether it does.

    `part`: `api` or `worker`. Its `service.name` is `meshdeform-PART` unless OTEL_SERVICE_NAME is
    set. `DependencyError`: a collector is named, but the packages are not installed.
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
            advice=f"Unset the variable, or run: {install_command('otel')}.",
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

    `traceparent` is a parent span in another process; without it, the parent is the innermost span of this context.
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

    headers: dict[str, str] = {}
    TraceContextTextMapPropagator().inject(headers)
    return headers.get("traceparent")
