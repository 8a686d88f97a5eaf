"""A check, what it finds, and how all of them are run such that none can hang the rest."""

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

__all__ = ["Check", "Finding", "Patient", "Status", "fail", "ok", "run_checks", "skip", "warn"]


class Status(StrEnum):
    """How well something is."""

    OK = "ok"
    SKIP = "skip"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes
    ----------
    name : str
        What was looked at.
    status : Status
    detail : str
    advice : str
        What to do; empty where there is nothing to do.
    """

    name: str
    status: Status
    detail: str
    advice: str = ""


def ok(name: str, detail: str) -> Finding:
    """All is well."""
    return Finding(name, Status.OK, detail)


def skip(name: str, detail: str) -> Finding:
    """There was nothing to look at."""
    return Finding(name, Status.SKIP, detail)


def warn(name: str, detail: str, advice: str) -> Finding:
    """It works, but not as one may think."""
    return Finding(name, Status.WARN, detail, advice)


def fail(name: str, detail: str, advice: str) -> Finding:
    """It does not work."""
    return Finding(name, Status.FAIL, detail, advice)


@dataclass
class Patient:
    """What is looked at.

    Attributes
    ----------
    settings : Settings
    host, port : str, int
        Where `serve` would listen.
    url, api_key : str, optional
        A service.
    data_dir : Path
    timeout_s : float
        What one question over a network may take.
    skews_s : dict
        How far other clocks are ahead of ours, in seconds, by whose they are; filled by the checks.
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
        """Where `serve` keeps everything."""
        return self.settings.data_dir


@dataclass(frozen=True)
class Check:
    """A question and how long it may take.

    Attributes
    ----------
    name : str
    ask : callable
        Gives findings.
    timeout_s : float
    """

    name: str
    ask: Callable[[], Iterable[Finding]]
    timeout_s: float


def run_checks(checks: Sequence[Check]) -> Iterator[Finding]:
    """Findings in the order of the checks, which all run at once; one that takes too long is left behind."""
    answers = [_begun(check) for check in checks]
    start = time.monotonic()
    for check, answer in zip(checks, answers, strict=True):
        try:
            yield from answer.get(timeout=max(0.0, start + check.timeout_s - time.monotonic()))
        except queue.Empty:
            advice = "Something there does not answer: see whether it hangs, or is behind a firewall."
            yield fail(check.name, f"no answer within {check.timeout_s:g} s", advice)


def _begun(check: Check) -> queue.SimpleQueue[list[Finding]]:
    answer: queue.SimpleQueue[list[Finding]] = queue.SimpleQueue()

    def work() -> None:
        try:
            answer.put(list(check.ask()))
        except MeshdeformError as error:
            answer.put([fail(check.name, error.detail, error.advice_text)])
        except Exception as error:  # what else is wrong is a finding as well
            answer.put(
                [fail(check.name, f"{type(error).__name__}: {error}", "See whether it is set up as documented.")]
            )

    # A daemon: one that hangs must not hold the process.
    threading.Thread(target=work, name=check.name, daemon=True).start()
    return answer
