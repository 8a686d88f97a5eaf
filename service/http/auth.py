"""Authenticate requests by API key, and enforce the rate limits of keys."""

from __future__ import annotations

import hashlib
import ipaddress
import math
import time
from dataclasses import dataclass
from typing import Annotated

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from fastapi.security.http import HTTPAuthorizationCredentials

from meshdeform.errors import LimitError, UnauthorizedError, UnavailableError
from meshdeform.record.keys import ApiKey, KeyRing
from meshdeform.requests.document import MAX_PRIORITY
from meshdeform.serving.access import is_foreign, is_forwarded, is_loopback, needs_keys
from meshdeform.settings import Settings
from service.http.limits import Buckets, BucketState, Rate, RateLimiter
from service.http.middleware import add_header

LINK_PREFIX = "link."
"""Prefix of the token of a link to a job (`service.http.links`), which no API key has."""

_KNOWN_FOR_S = 5.0
"""How long a revoked key may still be accepted."""

_MOST_KNOWN = 4096
_FAILURES = Rate(per_minute=20, burst=20)
_SUSPECTS_AT_ONCE = 2
BEARER = HTTPBearer(
    scheme_name="apiKey",
    description="An API key from `meshdeform keys create`. Not required if the API listens only on loopback.",
    auto_error=False,
)


@dataclass(frozen=True)
class Principal:
    """The caller of a request, who sees and creates the jobs, uploads and webhooks of the owner. Limits of 0 mean none.

    Without a key the owner is empty, and the key's id None.
    """

    owner_id: str = ""
    key_id: str | None = None
    max_active_jobs: int = 0
    requests_per_minute: int = 0
    max_priority: int = MAX_PRIORITY


class Gate:
    """Admit requests, or refuse them with a reason."""

    def __init__(self, settings: Settings, keys: KeyRing) -> None:
        self._settings, self._keys = settings, keys
        self._rates = RateLimiter(settings.redis_url, settings.queue)
        self._failures = Buckets()
        self._suspects = CapacityLimiter(_SUSPECTS_AT_ONCE)
        # Verified keys by the hash of their text, each with the time until which it is accepted without another check.
        # Stale entries are kept for a while; see `_verified`.
        self._known: dict[bytes, tuple[ApiKey, float]] = {}

    def close(self) -> None:
        """Close the connections."""
        self._rates.close()

    async def admit(self, request: Request) -> Principal:
        """Authenticate a request, count it against its key's rate limit, and return its caller.

        A key is verified even where none is required, so that its owner sees the same jobs everywhere.
        """
        text = sent_key(request)
        if text is None:
            self._check_without_key(request)
            return Principal()
        if text.startswith(LINK_PREFIX):
            raise UnauthorizedError("A link to a job opens only what shows that job.", advice="Send an API key.")
        key = await self._verified(text, _peer(request))
        await self._count(request, key)
        return Principal(
            owner_id=key.owner_id,
            key_id=key.id,
            max_active_jobs=_first(key.max_active_jobs, self._settings.max_active_jobs),
            requests_per_minute=_first(key.requests_per_minute, self._settings.requests_per_minute),
            max_priority=_first(key.max_priority, self._settings.max_priority),
        )

    async def is_still_valid(self, request: Request) -> bool:
        """Return whether the key of an admitted request is still valid, for requests that last. Counts nothing."""
        text = sent_key(request)
        if text is None:
            return True
        try:
            await self._verified(text, _peer(request))
        except UnavailableError:
            return True
        except (UnauthorizedError, LimitError):
            return False
        return True

    def _check_without_key(self, request: Request) -> None:
        auth, server = self._settings.auth, request.scope.get("server")
        address = server[0] if server else None
        if needs_keys(auth, address):
            raise UnauthorizedError("This server requires an API key.")
        if not is_loopback(address):
            return  # keys are off, and the operator has opened the service to a network
        if auth == "auto" and is_forwarded(request.headers):
            raise UnauthorizedError(
                "The request came through a proxy, so it requires an API key.",
                advice="Send an API key. If the proxy decides who may use the service, the operator can set --no-auth.",
            )
        headers, settings = request.headers, self._settings
        if is_foreign(headers.get("host"), headers.get("origin"), settings.allowed_hosts, settings.cors_origins):
            raise UnauthorizedError(
                "The request was sent by a web page from another host.",
                advice="Open the service as localhost or by its IP address, or send an API key. The server's operator "
                "can allow other names in MESHDEFORM_ALLOWED_HOSTS, and pages in MESHDEFORM_CORS_ORIGINS.",
            )

    async def _verified(self, text: str, peer: str) -> ApiKey:
        digest = hashlib.sha256(text.encode()).digest()
        known = self._known.get(digest)
        if known is not None and time.monotonic() < known[1]:
            return known[0]
        # Counted before the check, so that simultaneous guesses cannot exceed the limit. A recently valid key is none.
        verdict = self._failures.take(peer, _FAILURES) if known is None else None
        suspect = verdict is not None and verdict.wait_s > 0
        counted = verdict is not None and not suspect
        try:
            # Behind a proxy or a gateway a guesser shares its address with others, whose keys must keep working. So
            # keys from a suspect address are verified too, but in threads of their own.
            limiter = self._suspects if suspect else None
            key = await to_thread.run_sync(self._keys.verify, text, limiter=limiter)
        except UnauthorizedError:
            self._known.pop(digest, None)
            if verdict is not None and suspect:
                raise _limit("This address has sent too many invalid API keys.", verdict) from None
            raise
        except BaseException:
            if counted:
                self._failures.give_back(peer, _FAILURES)
            raise
        if counted:
            self._failures.give_back(peer, _FAILURES)
        if len(self._known) >= _MOST_KNOWN:
            self._known.clear()
        self._known[digest] = key, time.monotonic() + _KNOWN_FOR_S
        return key

    async def _count(self, request: Request, key: ApiKey) -> None:
        per_minute = _first(key.requests_per_minute, self._settings.requests_per_minute)
        if not per_minute:
            return
        verdict = await to_thread.run_sync(self._rates.take, key.id, per_minute)
        rate = Rate.of(per_minute)
        window_s = math.ceil(rate.burst * rate.interval_s)
        add_header(request.scope, "RateLimit-Policy", f'"burst";q={rate.burst};w={window_s}')
        add_header(request.scope, "RateLimit", f'"burst";r={verdict.remaining};t={verdict.reset_s}')
        if verdict.wait_s:
            at_once = f", {rate.burst} of them at once" if rate.burst < per_minute else ""
            raise _limit(f"This API key is limited to {per_minute} requests per minute{at_once}.", verdict)


async def principal(
    request: Request, _documented: Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)]
) -> Principal:
    """Authenticate the request and return its caller; see `Gate.admit`."""
    gate: Gate = request.app.state.gate
    return await gate.admit(request)


PrincipalDep = Annotated[Principal, Depends(principal)]


def sent_key(request: Request) -> str | None:
    """Return the bearer token of a request, or None if it has none."""
    scheme, _, text = request.headers.get("authorization", "").partition(" ")
    return text.strip() if scheme.lower() == "bearer" else None


def _first(own: int | None, general: int) -> int:
    return general if own is None else own


def _limit(detail: str, verdict: BucketState) -> LimitError:
    seconds = max(1, math.ceil(verdict.wait_s))
    advice = f"Try again in {seconds} second{'s' if seconds > 1 else ''}."
    return LimitError(detail, advice=advice, retry_after_s=seconds)


def _peer(request: Request) -> str:
    """Return the address to count invalid keys for: with IPv6 the /64 network, since one sender controls all of it."""
    host = request.client.host if request.client else ""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if address.version == 4:
        return str(address)
    return str(address.ipv4_mapped or ipaddress.ip_network((address, 64), strict=False))
