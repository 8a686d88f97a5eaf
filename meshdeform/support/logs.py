"""Logs of every part in one form: lines for people, or one JSON object a line for programs.

What a line is about (a job, a request) is not in its message alone: `bound` says it once, and every line that is logged
inside carries it. Context variables hold it, so tasks and threads of anyio carry it along; a thread that is started by
hand does not: start it with `carried`.
"""

from __future__ import annotations

import contextvars
import json
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

from meshdeform.settings import Settings

__all__ = ["ACCESS_LOG", "PART", "bound", "carried", "configure_logging", "job_id", "json_line", "request_id"]

P = ParamSpec("P")
T = TypeVar("T")

ACCESS_LOG = "service.access"
"""The logger that gets a line for each HTTP request; above INFO none is written."""

PART = "MESHDEFORM_PART"
"""The variable that tells a child of `serve` its name. No setting: nobody else sets it."""

job_id: contextvars.ContextVar[str] = contextvars.ContextVar("job_id", default="")
request_id: contextvars.ContextVar[str] = contextvars.ContextVar("request_id", default="")
_WORKER_ID = "MESHDEFORM_WORKER_ID"
_TEXT = "%(asctime)s %(levelname)-7s %(message)s"
# What every record has; anything else came with `extra`. `color_message` is uvicorn's.
_STANDARD = {*vars(logging.makeLogRecord({})), "message", "asctime", "color_message"}
_CONTROLS = {code: repr(chr(code))[1:-1] for code in (*range(32), 127) if code != ord("\t")}


def configure_logging(settings: Settings) -> None:
    """Write this process's logs to standard error as the settings say, and nothing in any other form.

    Parameters
    ----------
    settings : Settings
        `log_format` counts.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_JsonLines() if settings.log_format == "json" else _TextLines(_TEXT, "%H:%M:%S"))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.INFO)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.captureWarnings(capture=True)
    if settings.log_format == "json":
        sys.excepthook = _log_the_end
        threading.excepthook = _log_a_threads_end


@contextmanager
def bound(**values: str) -> Iterator[None]:
    """Let every line that is logged inside carry a `job_id` or a `request_id`."""
    variables = {"job_id": job_id, "request_id": request_id}
    tokens = [(variables[name], variables[name].set(value)) for name, value in values.items()]
    try:
        yield
    finally:
        for variable, token in reversed(tokens):
            variable.reset(token)


def carried(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function with what is bound here and now, for a thread that is to call it once."""
    context = contextvars.copy_context()

    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        return context.run(function, *args, **kwargs)

    return run


def json_line(line: str, part: str, logger: str = "output") -> str:
    """Return a line of a part's output as one JSON object.

    What it logged is one already and stays as it is; what something else printed there becomes one.
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
    """`12:00:00 INFO    message job=... request=...`; an id that the message names itself is not said twice."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        """Return the first line; a traceback follows it."""
        # One line, whatever a user's text holds that the message quotes.
        text = super().formatMessage(record).translate(_CONTROLS)
        for name, value in (("job", job_id.get()), ("request", request_id.get())):
            if value and value not in text:
                text += f" {name}={value}"
        return text


class _JsonLines(logging.Formatter):
    """One object a line; members that are not known are left out."""

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
    # ASCII: a line stays a line whatever the terminal or the collector takes for a line's end.
    return json.dumps(members, default=str)


def _instant(seconds: float | None = None) -> str:
    moment = datetime.now(UTC) if seconds is None else datetime.fromtimestamp(seconds, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _log_the_end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    logging.getLogger(__name__).critical("the process ends", exc_info=(kind, error, trace))


def _log_a_threads_end(arguments: threading.ExceptHookArgs) -> None:
    if arguments.exc_value is not None and not isinstance(arguments.exc_value, SystemExit):
        found = (arguments.exc_type, arguments.exc_value, arguments.exc_traceback)
        logging.getLogger(__name__).error("a thread ends", exc_info=found)
