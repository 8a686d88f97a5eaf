"""Call the service over HTTP with the standard library, because Blender's Python has no httpx. Does not use bpy."""

from __future__ import annotations

import hashlib
import http.client
import json
import secrets
import threading
import urllib.error
import urllib.parse
import urllib.request
from typing import Any

from .errors import AddonError, Canceled

TRIES = 6
_AGAIN = {408, 425, 429, 500, 502, 503, 504}  # with an Idempotency-Key all of these may be retried
_IN_FLIGHT = "idempotency_in_flight"  # the first try is still being processed
_LONGEST_PAUSE_S = 30.0


def is_loopback(url: str) -> bool:
    """Return whether a URL names this machine."""
    host = urllib.parse.urlsplit(url.strip()).hostname or ""
    return host in {"localhost", "::1"} or host.startswith("127.")


class Client:
    """A client for one service.

    Parameters
    ----------
    url : str
        For example `http://127.0.0.1:8765`.
    api_key : str
        Empty if the service requires none.
    stop : threading.Event, optional
        Once it is set, waiting ends with `Canceled`.
    timeout_s : float
        How long one response may take.
    tries : int
        How often to try if the service is busy or unreachable.
    """

    def __init__(
        self,
        url: str,
        api_key: str = "",
        *,
        stop: threading.Event | None = None,
        timeout_s: float = 30.0,
        tries: int = TRIES,
    ) -> None:
        parts = urllib.parse.urlsplit(url.strip())
        if parts.scheme not in {"http", "https"} or not parts.hostname:
            raise AddonError(f"“{url}” is not the address of a service.", "Write for example http://127.0.0.1:8765.")
        self._url, self._key, self._timeout_s = url.strip().rstrip("/"), api_key.strip(), timeout_s
        self._tries = tries
        self._stop = stop or threading.Event()
        # To a proxy, localhost is another machine.
        handlers = [urllib.request.ProxyHandler({})] if is_loopback(url) else []
        self._opener = urllib.request.build_opener(*handlers)

    def version(self) -> str:
        """Return the service's version after checking that it accepts the key."""
        version = str(self._json("GET", "/healthz")["version"])
        self._json("GET", "/v1/jobs?limit=1")
        return version

    def submit(
        self, asset: bytes, filename: str, request: dict[str, Any], *, target: bytes | None = None, key: str = ""
    ) -> dict[str, Any]:
        """Submit a job; sending it again with the same `Idempotency-Key` creates no second job."""
        boundary = secrets.token_hex(16)
        parts = [_part(boundary, "request", json.dumps(request).encode(), kind="application/json")]
        parts.append(_part(boundary, "asset", asset, filename))
        if target is not None:
            parts.append(_part(boundary, "target", target, "target.glb"))
        body = b"".join([*parts, f"--{boundary}--\r\n".encode()])
        headers = {
            "Content-Type": f"multipart/form-data; boundary={boundary}",
            "Idempotency-Key": key or secrets.token_hex(16),
        }
        return self._json("POST", "/v1/jobs", body, headers)

    def job(self, job_id: str) -> tuple[dict[str, Any], float]:
        """Return a job, and the seconds after which to ask again."""
        answer, headers = self._call("GET", f"/v1/jobs/{job_id}")
        return _document(answer), _seconds(headers.get("Retry-After"), 1.0)

    def cancel(self, job_id: str) -> None:
        """Cancel a job. One that has ended stays as it is."""
        try:
            self._once("POST", f"/v1/jobs/{job_id}/cancel", b"", {})
        except AddonError as error:
            if error.code not in {"conflict", "not_found"}:
                raise

    def artifact(self, job_id: str, name: str) -> bytes:
        """Download an artifact and verify its SHA-256."""
        for left in reversed(range(self._tries)):
            data, headers = self._call("GET", f"/v1/jobs/{job_id}/artifacts/{name}")
            if hashlib.sha256(data).hexdigest() == headers.get("ETag", "").strip('"') or not headers.get("ETag"):
                return data
            self._pause(0.5 if left else 0.0)
        raise AddonError("The downloaded result is corrupt.", "Try again.")

    def _json(
        self, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> dict[str, Any]:
        return _document(self._call(method, path, body, headers)[0])

    def _call(
        self, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> tuple[bytes, http.client.HTTPMessage]:
        pause = 0.5
        for left in reversed(range(self._tries)):
            try:
                return self._once(method, path, body, headers or {})
            except _AgainError as again:
                if not left:
                    raise again.error from again.__cause__
                self._pause(again.after_s or pause)
                pause *= 2.0
        raise AssertionError("not reached")

    def _pause(self, seconds: float) -> None:
        if self._stop.wait(min(seconds, _LONGEST_PAUSE_S)):
            raise Canceled

    def _once(
        self, method: str, path: str, body: bytes | None, headers: dict[str, str]
    ) -> tuple[bytes, http.client.HTTPMessage]:
        request = urllib.request.Request(self._url + path, body, headers, method=method)  # noqa: S310 - http(s), see above
        if self._key:
            # A redirect must not carry the key to another host.
            request.add_unredirected_header("Authorization", f"Bearer {self._key}")
        try:
            with self._opener.open(request, timeout=self._timeout_s) as answer:
                return answer.read(), answer.headers
        except urllib.error.HTTPError as error:
            with error:
                problem = _problem(error)
                if error.code in _AGAIN or problem.code == _IN_FLIGHT:
                    raise _AgainError(problem, _seconds(error.headers.get("Retry-After"), 0.0)) from error
            raise problem from error
        except (OSError, http.client.HTTPException) as error:
            reason = getattr(error, "reason", error)
            silent = AddonError(
                f"{self._url} does not answer ({reason}).", "Check the server's address in the add-on's preferences."
            )
            raise _AgainError(silent, 0.0) from error


class _AgainError(AddonError):
    """A request failed in a way that may succeed later."""

    def __init__(self, error: AddonError, after_s: float) -> None:
        super().__init__(error.detail, error.advice, error.code)
        self.error, self.after_s = error, after_s


def _part(boundary: str, name: str, data: bytes, filename: str = "", kind: str = "application/octet-stream") -> bytes:
    # Escape characters that a quoted string cannot hold as browsers do.
    quoted = filename.replace('"', "%22").replace("\r", "%0D").replace("\n", "%0A")
    file = f'; filename="{quoted}"' if filename else ""
    head = f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"{file}\r\nContent-Type: {kind}\r\n\r\n'
    return head.encode() + data + b"\r\n"


def _document(data: bytes) -> dict[str, Any]:
    try:
        document = json.loads(data)
    except ValueError:
        document = None
    if not isinstance(document, dict):
        raise AddonError(
            "The server is not a Meshdeform service.", "Check the server's address in the add-on's preferences."
        )
    return document


def _problem(error: urllib.error.HTTPError) -> AddonError:
    try:
        problem = json.loads(error.read())
        return AddonError(str(problem["detail"]), str(problem["advice"]), str(problem["code"]))
    except (ValueError, KeyError, TypeError, OSError, http.client.HTTPException):
        return AddonError(
            f"{error.url} answered {error.code}.", "Check the server's address in the add-on's preferences."
        )


def _seconds(text: str | None, otherwise: float) -> float:
    try:
        return min(max(float(text or ""), 0.05), _LONGEST_PAUSE_S)
    except ValueError:
        return otherwise
