"""Check a running service: its address, its dependencies, the key and its workers."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from email.utils import parsedate_to_datetime

import httpx

import meshdeform
from meshdeform.cli.diagnosis.checks import Finding, Subject, fail, ok, skip, warn

__all__ = ["check_service"]

_ALIVE = re.compile(r"^meshdeform_workers_alive(?:\{[^}]*\})? ([0-9.e+]+)$", re.MULTILINE)


def check_service(subject: Subject) -> Iterator[Finding]:
    """Check the service without changing anything."""
    if subject.url is None:
        yield skip("service", "not checked (no --url)")
        return
    headers = {"Authorization": f"Bearer {subject.api_key}"} if subject.api_key else {}
    with httpx.Client(base_url=subject.url, timeout=subject.timeout_s, headers=headers) as http:
        try:
            answer = http.get("/healthz")
            version = str(answer.json()["version"])
        except httpx.HTTPError as error:
            reason = str(error) or type(error).__name__
            yield fail(
                "service", f"{subject.url} does not respond: {reason}", "Check the address, and that the service runs."
            )
            return
        except (ValueError, KeyError, TypeError):
            detail = f"{subject.url} returns {answer.status_code}, but is not Meshdeform"
            yield fail("service", detail, "Check the address, and any proxy in front of the service.")
            return
        _note_clock(subject, answer)
        yield ok("service", f"Meshdeform {version} at {subject.url}")
        if version != meshdeform.__version__:
            yield warn("versions", f"here {meshdeform.__version__}, there {version}", "Install the same version here.")
        yield from _dependencies(http)
        yield from _key(http, has_key=bool(subject.api_key))
        yield from _workers(http)


def _note_clock(subject: Subject, answer: httpx.Response) -> None:
    try:
        # The header has whole seconds: add their mean error.
        moment = parsedate_to_datetime(answer.headers["Date"]).timestamp() + 0.5
    except (KeyError, TypeError, ValueError):
        return
    subject.skews_s["the service"] = moment - time.time() + answer.elapsed.total_seconds() / 2


def _dependencies(http: httpx.Client) -> Iterator[Finding]:
    try:
        found = http.get("/readyz").json()
        parts = {name: found[name] for name in ("record", "redis", "store")}
        away = {name: part.get("detail") or part["status"] for name, part in parts.items() if part["status"] != "ok"}
    except (httpx.HTTPError, ValueError, KeyError, TypeError, AttributeError) as error:
        yield fail("dependencies", f"/readyz does not respond: {type(error).__name__}", "See the service's log.")
        return
    if away:
        found_away = "; ".join(f"{name}: {detail}" for name, detail in away.items())
        yield fail("dependencies", found_away, "The administrator has to restart them; accepted jobs are not lost.")
    else:
        yield ok("dependencies", f"{', '.join(parts)} respond")


def _key(http: httpx.Client, *, has_key: bool) -> Iterator[Finding]:
    try:
        status = http.get("/v1/limits").status_code
    except httpx.HTTPError as error:
        yield fail("api key", f"/v1/limits does not respond: {type(error).__name__}", "See the service's log.")
        return
    if status in (401, 403):
        detail = "the service refuses the key" if has_key else "the service requires a key"
        yield fail(
            "api key", detail, "Set MESHDEFORM_API_KEY to a key; administrators create them: meshdeform keys create."
        )
    elif status == 429:
        yield warn("api key", "over its request limit", "Wait a minute.")
    elif status != 200:
        yield fail("api key", f"/v1/limits returns {status}", "Check the address; the service may be older.")
    else:
        yield ok("api key", "accepted" if has_key else "none required")


def _workers(http: httpx.Client) -> Iterator[Finding]:
    try:
        answer = http.get("/metrics")
        match = _ALIVE.search(answer.text) if answer.status_code == 200 else None
    except httpx.HTTPError:
        match = None
    if match is None:
        yield skip("service workers", "unknown: /metrics is not readable")
    elif float(match[1]) < 1:
        yield warn("service workers", "none is alive, so jobs stay queued", "Start one: meshdeform worker.")
    else:
        yield ok("service workers", f"{float(match[1]):g} alive")
