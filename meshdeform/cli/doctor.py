"""`meshdeform doctor`: check the installation and say what to do about each problem."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, service_url
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import ApiKeyFileOption, ApiKeyOption, JsonOption, UrlOption
from meshdeform.cli.output import emit, plain
from meshdeform.serving.defaults import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from meshdeform.cli.diagnosis.checks import Check, Finding, Subject

__all__ = ["doctor"]

_COLOURS = {"ok": "green", "skip": None, "warn": "yellow", "fail": "red"}


@clean_errors
def doctor(
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of the service (MESHDEFORM_DATA_DIR; default: meshdeform-data).")
    ] = None,
    host: Annotated[str, typer.Option(help="Address that `serve` would listen on.")] = DEFAULT_HOST,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port that `serve` would listen on.")] = DEFAULT_PORT,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds that one server may take to respond.")] = 5.0,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check the installation.

    Exit code 0 if everything works, 4 if something does not; each problem comes with advice. Nothing is changed or
    downloaded.

    meshdeform doctor

    meshdeform doctor --url http://127.0.0.1:8765 --json
    """
    from meshdeform.cli.diagnosis.checks import Subject
    from meshdeform.cli.environment import read_key

    subject = Subject(
        settings=load_settings(data_dir=data_dir),
        host=host,
        port=port,
        url=service_url(url) if url else None,
        api_key=read_key(api_key, api_key_file),
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


def _findings(subject: Subject, on_finding: Callable[[Finding], None]) -> list[Finding]:
    from meshdeform.cli.diagnosis import machine
    from meshdeform.cli.diagnosis.checks import run_checks

    found = []
    for finding in run_checks(_checks(subject)):
        found.append(finding)
        on_finding(finding)
    # After the others, which read the clocks of servers.
    for finding in machine.check_clock(subject):
        found.append(finding)
        on_finding(finding)
    return found


def _checks(subject: Subject) -> Sequence[Check]:
    from meshdeform.cli.diagnosis import machine, models, packages, servers, service
    from meshdeform.cli.diagnosis.checks import Check

    def check(name: str, ask: Callable[..., Iterable[Finding]], *arguments: object, takes_s: float = 0.0) -> Check:
        return Check(name, partial(ask, *arguments), takes_s or 3 * subject.timeout_s)

    return [
        check("python", packages.check_python),
        check("packages", packages.check_packages),
        check("settings", packages.check_variables, set(type(subject.settings).model_fields)),
        check("gpu", machine.check_gpu, subject, takes_s=machine.GPU_TIMEOUT_S),
        check("builtin prior", models.check_builtin),
        check("model", models.check_model, subject),
        check("disk", machine.check_disk, subject),
        check("data directory", machine.check_data_dir, subject),
        check("port", machine.check_port, subject),
        check("redis", servers.check_redis, subject),
        check("database", servers.check_database, subject),
        check("object store", servers.check_store, subject),
        check("workers", servers.check_workers, subject),
        check("service", service.check_service, subject, takes_s=5 * subject.timeout_s),
    ]


def _print(finding: Finding) -> None:
    mark = typer.style(f"{finding.status.value:<5}", fg=_COLOURS[finding.status.value])
    typer.echo(f"{mark} {finding.name:<14} {plain(finding.detail)}")
    if finding.advice:
        typer.echo(f"{'':<21}-> {plain(finding.advice)}")
