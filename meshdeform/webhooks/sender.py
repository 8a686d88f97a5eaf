"""Send one signed message to one webhook, only to its checked addresses and in at most 15 seconds.

There are no redirects, proxies, cookies or second connections: an `httpcore` connection is used whose network is a
list of addresses. TLS still verifies the host's name.

Source: the Standard Webhooks specification 1.0.0 (https://www.standardwebhooks.com).
"""

from __future__ import annotations

import json
import ssl
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any

import httpcore
import httpx

from meshdeform import __version__
from meshdeform.errors import WebhookAddressError
from meshdeform.outgoing.addresses import Destination, Lookup, Networks, find_destination, system_lookup
from meshdeform.outgoing.network import CONNECT_S, PinnedNetwork, network_error

TOTAL_S = 15.0
_MAX_ANSWER = 64 * 1024


@dataclass(frozen=True)
class SendOutcome:
    """The result of an attempt: the status of the response, if there was one, and the seconds that it asks to wait.

    `error` says why the message does not count as delivered, and is empty if it does. It contains no text of the
    response.
    """

    at: datetime
    seconds: float
    status: int | None = None
    error: str = ""
    retry_after_s: float = 0.0

    @property
    def delivered(self) -> bool:
        """Whether the receiver accepted the message."""
        return not self.error


class Sender:
    """Sends messages. Safe to share between threads.

    Networks are allowed besides the public internet. The trusted authorities of TLS are the system's usual list, if
    none are given (SSL_CERT_FILE sets another). A message has `connect_s` seconds to connect, and `total_s` from
    resolving the host to the end of the response.
    """

    def __init__(
        self,
        networks: Networks = (),
        *,
        lookup: Lookup = system_lookup,
        tls: ssl.SSLContext | None = None,
        connect_s: float = CONNECT_S,
        total_s: float = TOTAL_S,
    ) -> None:
        self._networks, self._lookup = networks, lookup
        self._tls = tls or httpx.create_ssl_context()
        self._connect_s, self._total_s = connect_s, total_s
        self._open: set[httpcore.NetworkStream] = set()
        self._lock = threading.Lock()
        self.closed = False

    def send(self, url: str, message_id: str, payload: dict[str, Any], secrets: Iterable[str]) -> SendOutcome:
        """Send a message once and return the outcome. Errors of the network or the receiver are not raised."""
        at, began = datetime.now(UTC), time.monotonic()
        status, error, retry_after_s = None, "", 0.0
        try:
            destination = find_destination(url, self._networks, WebhookAddressError, self._lookup)
            body = json.dumps(payload, separators=(",", ":"))
            headers = signed_headers(message_id, body, secrets, at)
            status, retry_after_s = self._post(destination, body.encode(), headers, began + self._total_s)
            error = _judge(status)
        except WebhookAddressError as refused:
            error = refused.detail
        except httpcore.TimeoutException:
            error = "The receiver did not answer in time."
        except httpcore.ProtocolError:
            error = "The response is not HTTP."
        except (httpcore.NetworkError, OSError) as failed:
            error = network_error(failed, "receiver")
        return SendOutcome(at, time.monotonic() - began, status, error, retry_after_s)

    def close(self) -> None:
        """Close all open connections; nothing is sent after this."""
        with self._lock:
            self.closed = True
            streams = list(self._open)
        for stream in streams:
            with suppress(OSError):
                stream.get_extra_info("socket").shutdown(2)

    def _post(
        self, destination: Destination, body: bytes, headers: dict[str, str], deadline: float
    ) -> tuple[int, float]:
        network = PinnedNetwork(destination.addresses, self._connect_s, deadline, self._track)
        url = httpcore.URL(
            scheme=destination.url.raw_scheme,
            host=destination.host.encode("ascii"),
            port=destination.url.port,
            target=destination.url.raw_path,
        )
        lines = [("Host", destination.url.netloc.decode("ascii")), ("Content-Length", str(len(body)))]
        lines += headers.items()
        timeouts = {"timeout": dict.fromkeys(("connect", "read", "write", "pool"), self._total_s)}
        try:
            with (
                httpcore.ConnectionPool(ssl_context=self._tls, network_backend=network, http2=False) as pool,
                pool.stream("POST", url, headers=lines, content=body, extensions=timeouts) as answer,
            ):
                status, retry_after_s = answer.status, _retry_after(dict(answer.headers))
                # Only the status matters. Read the rest, so that the receiver sees an orderly end.
                with suppress(httpcore.TimeoutException, httpcore.NetworkError, httpcore.ProtocolError):
                    _read_some(answer)
        finally:
            self._track(network.stream, None)
        return status, retry_after_s

    def _track(self, before: httpcore.NetworkStream | None, now: httpcore.NetworkStream | None) -> None:
        """Record which connections are open, so that `close` can close them."""
        with self._lock:
            if now is not None and self.closed:
                raise httpcore.ConnectError("The server is stopping.")
            self._open = (self._open - {before}) | ({now} if now else set())


def signed_headers(message_id: str, body: str, secrets: Iterable[str], at: datetime) -> dict[str, str]:
    """Return the headers of a message, with one signature per secret.

    The body is the exact text to send; each secret is `whsec_` followed by base64; `at` is the time of this attempt in
    UTC.
    """
    from standardwebhooks import Webhook

    signatures = [Webhook(secret).sign(message_id, at, body) for secret in secrets]
    return {
        "Content-Type": "application/json",
        "User-Agent": f"Meshdeform/{__version__}",
        "webhook-id": message_id,
        "webhook-timestamp": str(int(at.timestamp())),
        "webhook-signature": " ".join(signatures),
    }


def _judge(status: int) -> str:
    if 200 <= status < 300:
        return ""
    if 300 <= status < 400:
        return f"The receiver answered {status}; redirects are not followed."
    return f"The receiver answered {status}."


def _retry_after(headers: dict[bytes, bytes]) -> float:
    value = next((text.decode("latin-1") for name, text in headers.items() if name.lower() == b"retry-after"), "")
    if value.isascii() and value.isdigit():
        return float(value[:9])
    with suppress(ValueError, TypeError):
        date = parsedate_to_datetime(value)
        return max(0.0, (date - datetime.now(date.tzinfo)).total_seconds())
    return 0.0


def _read_some(answer: httpcore.Response) -> None:
    read = 0
    for part in answer.iter_stream():
        read += len(part)
        if read > _MAX_ANSWER:
            return
