"""`meshdeform doctor`: check the installation and say what to do about each problem."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, read_key, service_url
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import JsonOption, Place
from meshdeform.cli.output import emit, plain
from meshdeform.errors import MeshdeformError
from meshdeform.serving.defaults import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from meshdeform.cli.checks import Finding, Subject

__all__ = ["Check", "doctor", "run_checks"]

_COLOURS = {"ok": "green", "skip": None, "warn": "yellow", "fail": "red"}


@clean_errors
def doctor(
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of the service (MESHDEFORM_DATA_DIR; default: meshdeform-data).")
    ] = None,
    host: Annotated[str, typer.Option(help="Address that `serve` would listen on.")] = DEFAULT_HOST,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port that `serve` would listen on.")] = DEFAULT_PORT,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds that one server may take to respond.")] = 5.0,
    *,
    place: Place,
    as_json: JsonOption = False,
) -> None:
    """Check the installation.

    Exit code 0 if everything works, 4 if something does not; each problem comes with advice. Nothing is changed or
    downloaded.

    meshdeform doctor

    meshdeform doctor --url http://127.0.0.1:8765 --json
    """
    from meshdeform.cli.checks import Subject

    subject = Subject(
        settings=load_settings(data_dir=data_dir),
        host=host,
        port=port,
        url=service_url(place.url) if place.url else None,
        api_key=read_key(place.api_key, place.api_key_file),
        timeout_s=timeout,
    )
    findings = _findings(subject, (lambda _: None) if as_json else _print)
    count = {status: sum(finding.status == status for finding in findings) for status in _COLOURS}
    if as_json:
        members = [
            {"name": each.name, "status": each.status.value, "detail": each.detail, "advice": each.advice or None}
            for each in findings
        ]
        emit({"healthy": not count["fail"], "counts": count, "checks": members})
    if count["fail"]:
        names = ", ".join(finding.name for finding in findings if finding.status == "fail")
        detail = f"{count['fail']} of {len(findings)} checks failed: {names}."
        raise OutcomeError(ExitCode.UNAVAILABLE, "unhealthy", detail, "See the advice below each failed check.")
    if not as_json:
        typer.echo(f"All checks passed{', with warnings' if count['warn'] else ''}.")


@dataclass(frozen=True)
class Check:
    """A check, which returns its findings, and the seconds that it may take."""

    name: str
    ask: Callable[[], Iterable[Finding]]
    timeout_s: float


def _findings(subject: Subject, on_finding: Callable[[Finding], None]) -> list[Finding]:
    from meshdeform.cli import checks

    limit_s = 3 * subject.timeout_s
    asked = [
        Check("packages", checks.check_packages, limit_s),
        Check("settings", partial(checks.check_variables, set(type(subject.settings).model_fields)), limit_s),
        Check("gpu", partial(checks.check_gpu, subject), checks.GPU_TIMEOUT_S),
        Check("builtin prior", checks.check_builtin, limit_s),
        Check("model", partial(checks.check_model, subject), limit_s),
        Check("data directory", partial(checks.check_folders, subject), limit_s),
        Check("port", partial(checks.check_port, subject), limit_s),
        Check("redis", partial(checks.check_redis, subject), limit_s),
        Check("database", partial(checks.check_database, subject), limit_s),
        Check("object store", partial(checks.check_store, subject), limit_s),
        Check("workers", partial(checks.check_workers, subject), limit_s),
        Check("service", partial(checks.check_service, subject), 5 * subject.timeout_s),
    ]
    findings = []
    for finding in run_checks(asked):
        findings.append(finding)
        on_finding(finding)
    for finding in checks.check_clock(subject):  # after the others, which read the clocks of servers
        findings.append(finding)
        on_finding(finding)
    return findings


def run_checks(checks: Sequence[Check]) -> Iterator[Finding]:
    """Run all checks at once and yield their findings in order; a check that times out is abandoned."""
    from meshdeform.cli.checks import fail

    answers = [_start(check) for check in checks]
    start = time.monotonic()
    for check, answer in zip(checks, answers, strict=True):
        try:
            yield from answer.get(timeout=max(0.0, start + check.timeout_s - time.monotonic()))
        except queue.Empty:
            advice = "A server does not respond: check whether it hangs or is behind a firewall."
            yield fail(check.name, f"no response within {check.timeout_s:g} s", advice)


def _start(check: Check) -> queue.SimpleQueue[list[Finding]]:
    from meshdeform.cli.checks import fail

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


def _print(finding: Finding) -> None:
    mark = typer.style(f"{finding.status.value:<5}", fg=_COLOURS[finding.status.value])
    typer.echo(f"{mark} {finding.name:<14} {plain(finding.detail)}")
    if finding.advice:
        typer.echo(f"{'':<21}-> {plain(finding.advice)}")
