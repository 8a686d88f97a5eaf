"""A service that runs somewhere: does it answer, are its parts well, is the key good, are there workers."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from email.utils import parsedate_to_datetime

import httpx

import meshdeform
from meshdeform.cli.diagnosis.checks import Finding, Patient, fail, ok, skip, warn

__all__ = ["check_service"]

_ALIVE = re.compile(r"^meshdeform_workers_alive(?:\{[^}]*\})? ([0-9.e+]+)$", re.MULTILINE)


def check_service(patient: Patient) -> Iterator[Finding]:
    """What can be asked without changing anything."""
    if patient.url is None:
        yield skip("service", "not asked (--url)")
        return
    headers = {"Authorization": f"Bearer {patient.api_key}"} if patient.api_key else {}
    with httpx.Client(base_url=patient.url, timeout=patient.timeout_s, headers=headers) as http:
        try:
            answer = http.get("/healthz")
            version = str(answer.json()["version"])
        except httpx.HTTPError as error:
            reason = str(error) or type(error).__name__
            yield fail("service", f"{patient.url} does not answer: {reason}", "Check the address, and that it runs.")
            return
        except (ValueError, KeyError, TypeError):
            said = f"{patient.url} answers {answer.status_code}, but is no Meshdeform"
            yield fail("service", said, "Check the address, and what stands in front of the service.")
            return
        _note_clock(patient, answer)
        yield ok("service", f"Meshdeform {version} at {patient.url}")
        if version != meshdeform.__version__:
            yield warn("versions", f"here {meshdeform.__version__}, there {version}", "Install the same one here.")
        yield from _parts(http)
        yield from _key(http, has_key=bool(patient.api_key))
        yield from _workers(http)


def _note_clock(patient: Patient, answer: httpx.Response) -> None:
    try:
        # The header has whole seconds: half of one is its error.
        said = parsedate_to_datetime(answer.headers["Date"]).timestamp() + 0.5
    except (KeyError, TypeError, ValueError):
        return
    patient.skews_s["the service"] = said - time.time() + answer.elapsed.total_seconds() / 2


def _parts(http: httpx.Client) -> Iterator[Finding]:
    try:
        found = http.get("/readyz").json()
        parts = {name: found[name] for name in ("record", "redis", "store")}
        away = {name: part.get("detail") or part["status"] for name, part in parts.items() if part["status"] != "ok"}
    except (httpx.HTTPError, ValueError, KeyError, TypeError, AttributeError) as error:
        yield fail("its parts", f"/readyz does not tell: {type(error).__name__}", "See the service's log.")
        return
    if away:
        said = "; ".join(f"{name}: {detail}" for name, detail in away.items())
        yield fail("its parts", said, "Who runs the service starts them again; jobs that were accepted are not lost.")
    else:
        yield ok("its parts", f"{', '.join(parts)} answer")


def _key(http: httpx.Client, *, has_key: bool) -> Iterator[Finding]:
    try:
        status = http.get("/v1/limits").status_code
    except httpx.HTTPError as error:
        yield fail("api key", f"/v1/limits does not answer: {type(error).__name__}", "See the service's log.")
        return
    if status in (401, 403):
        said = "the service does not know the key" if has_key else "the service wants a key"
        yield fail("api key", said, "Set MESHDEFORM_API_KEY; who runs the service makes keys: meshdeform keys create.")
    elif status == 429:
        yield warn("api key", "over its limit of requests", "Wait a minute.")
    elif status != 200:
        yield fail("api key", f"/v1/limits answers {status}", "Check the address; is it an older service?")
    else:
        yield ok("api key", "accepted" if has_key else "none is needed")


def _workers(http: httpx.Client) -> Iterator[Finding]:
    try:
        answer = http.get("/metrics")
        match = _ALIVE.search(answer.text) if answer.status_code == 200 else None
    except httpx.HTTPError:
        match = None
    if match is None:
        yield skip("its workers", "the service does not tell (/metrics)")
    elif float(match[1]) < 1:
        yield warn("its workers", "none is alive: jobs wait", "Start one: meshdeform worker.")
    else:
        yield ok("its workers", f"{float(match[1]):g} alive")
