"""`meshdeform doctor`: check the installation and say what to do about each problem."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, read_key, service_url
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import DataDirOption, JsonOption, Where, option
from meshdeform.cli.output import emit, plain
from meshdeform.serving import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from meshdeform.cli.checks import Finding

_COLOURS = {"ok": "green", "skip": None, "warn": "yellow", "fail": "red"}


@clean_errors
def doctor(
    data_dir: DataDirOption = None,
    host: Annotated[str, option("Address that `serve` would listen on.")] = DEFAULT_HOST,
    port: Annotated[int, option("Port that `serve` would listen on.", min=1, max=65535)] = DEFAULT_PORT,
    timeout: Annotated[float, option("Seconds that one server may take to respond.", min=0.1)] = 5.0,
    *,
    where: Where,
    as_json: JsonOption = False,
) -> None:
    """Check the installation.

    Exit code 0 if everything works, 4 if something does not; each problem comes with advice. Nothing is changed or
    downloaded.

    meshdeform doctor

    meshdeform doctor --url http://127.0.0.1:8765 --json
    """
    from meshdeform.cli.checks import Subject, all_findings

    subject = Subject(
        settings=load_settings(data_dir=data_dir),
        host=host,
        port=port,
        url=service_url(where.url) if where.url else None,
        api_key=read_key(where.api_key, where.api_key_file),
        timeout_s=timeout,
    )
    findings = []
    for finding in all_findings(subject):
        findings.append(finding)
        if not as_json:
            _print(finding)
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


def _print(finding: Finding) -> None:
    mark = typer.style(f"{finding.status.value:<5}", fg=_COLOURS[finding.status.value])
    typer.echo(f"{mark} {finding.name:<14} {plain(finding.detail)}")
    if finding.advice:
        typer.echo(f"{'':<21}-> {plain(finding.advice)}")
