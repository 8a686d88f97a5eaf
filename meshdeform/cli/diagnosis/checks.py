"""Define checks and findings, and run all checks so that one that hangs does not block the rest."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.errors import MeshdeformError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["Check", "Finding", "Status", "Subject", "fail", "ok", "run_checks", "skip", "warn"]


class Status(StrEnum):
    """Result of a check."""

    OK = "ok"
    SKIP = "skip"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """One finding of a check.

    Attributes
    ----------
    name : str
        What was checked.
    status : Status
    detail : str
    advice : str
        What to do; empty if nothing.
    """

    name: str
    status: Status
    detail: str
    advice: str = ""


def ok(name: str, detail: str) -> Finding:
    """Return a finding that everything works."""
    return Finding(name, Status.OK, detail)


def skip(name: str, detail: str) -> Finding:
    """Return a finding that there was nothing to check."""
    return Finding(name, Status.SKIP, detail)


def warn(name: str, detail: str, advice: str) -> Finding:
    """Return a finding that it works, with a caveat."""
    return Finding(name, Status.WARN, detail, advice)


def fail(name: str, detail: str, advice: str) -> Finding:
    """Return a finding that it does not work."""
    return Finding(name, Status.FAIL, detail, advice)


@dataclass
class Subject:
    """What the checks examine.

    Attributes
    ----------
    settings : Settings
    host, port : str, int
        The address that `serve` would listen on.
    url, api_key : str, optional
        A service to check, and its key.
    data_dir : Path
    timeout_s : float
        Timeout of one request over a network, in seconds.
    skews_s : dict
        Seconds that the clocks of servers are ahead of ours, by server; filled in by the checks.
    """

    settings: Settings
    host: str
    port: int
    url: str | None
    api_key: str | None
    timeout_s: float
    skews_s: dict[str, float] = field(default_factory=dict)

    @property
    def data_dir(self) -> Path:
        """The folder of `serve`."""
        return self.settings.data_dir


@dataclass(frozen=True)
class Check:
    """A check and its timeout.

    Attributes
    ----------
    name : str
    ask : callable
        Returns the findings.
    timeout_s : float
    """

    name: str
    ask: Callable[[], Iterable[Finding]]
    timeout_s: float


def run_checks(checks: Sequence[Check]) -> Iterator[Finding]:
    """Run all checks at once and yield their findings in order; a check that times out is abandoned."""
    answers = [_start(check) for check in checks]
    start = time.monotonic()
    for check, answer in zip(checks, answers, strict=True):
        try:
            yield from answer.get(timeout=max(0.0, start + check.timeout_s - time.monotonic()))
        except queue.Empty:
            advice = "A server does not respond: check whether it hangs or is behind a firewall."
            yield fail(check.name, f"no response within {check.timeout_s:g} s", advice)


def _start(check: Check) -> queue.SimpleQueue[list[Finding]]:
    answer: queue.SimpleQueue[list[Finding]] = queue.SimpleQueue()

    def work() -> None:
        try:
            answer.put(list(check.ask()))
        except MeshdeformError as error:
            answer.put([fail(check.name, error.detail, error.advice_text)])
        except Exception as error:  # any other error is a finding as well
            answer.put([fail(check.name, f"{type(error).__name__}: {error}", "Check that it is set up as documented.")])

    # A daemon thread, so that one that hangs cannot keep the process alive.
    threading.Thread(target=work, name=check.name, daemon=True).start()
    return answer
