"""Who asks: the owner that a request's API key belongs to, and whether the key may ask now."""

from __future__ import annotations

import hashlib
import ipaddress
import math
import time
from dataclasses import dataclass
from typing import Annotated

from anyio import to_thread
from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from fastapi.security.http import HTTPAuthorizationCredentials

from meshdeform.errors import LimitError, UnauthorizedError
from meshdeform.record.keys import ApiKey, KeyRing
from meshdeform.requests.document import MAX_PRIORITY
from meshdeform.serving.access import is_foreign, needs_keys
from meshdeform.settings import Settings
from service.http.middleware import add_header
from service.http.rate import Buckets, Rate, RateLimiter, Verdict

__all__ = ["Gate", "Principal", "PrincipalDep", "principal"]

_KNOWN_FOR_S = 5.0
"""So long a revoked key may still be taken for valid."""

_MOST_KNOWN = 4096
_FAILURES = Rate(per_minute=20, burst=20)


@dataclass(frozen=True)
class Principal:
    """Who makes a request.

    Attributes
    ----------
    owner_id : str
        Whose jobs, uploads and webhooks they see and make. Empty where keys are off.
    key_id : str or None
        The API key; None where keys are off.
    max_active_jobs : int
        Unfinished jobs that they may have; 0: any number.
    requests_per_minute : int
        Requests that they may make; 0: any number.
    max_priority : int
        The highest priority of their jobs.
    """

    owner_id: str = ""
    key_id: str | None = None
    max_active_jobs: int = 0
    requests_per_minute: int = 0
    max_priority: int = MAX_PRIORITY


class Gate:
    """Lets requests in, or says why not.

    Parameters
    ----------
    settings : Settings
    keys : KeyRing
    """

    def __init__(self, settings: Settings, keys: KeyRing) -> None:
        self._settings, self._keys = settings, keys
        self._rates = RateLimiter(settings.redis_url, settings.queue)
        self._failures = Buckets()
        # By the hash of their text: until when a key is known to be valid. Those whose time is over stay for a while.
        self._known: dict[bytes, tuple[ApiKey, float]] = {}

    def close(self) -> None:
        """Give the connections back."""
        self._rates.close()

    async def admit(self, request: Request) -> Principal:
        """Return who makes a request, and count it.

        A key that is sent counts also where none is needed: its owner's jobs are its owner's everywhere.

        Raises
        ------
        UnauthorizedError
            There is no valid key where one is needed, or one was sent that is not valid.
        LimitError
            The key makes too many requests, or its sender sent too many that are not valid.
        UnavailableError
            The record does not answer.
        """
        scheme, _, text = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            server = request.scope.get("server")
            if needs_keys(self._settings.auth, server[0] if server else None):
                raise UnauthorizedError("This service needs an API key.")
            if self._settings.auth == "auto" and is_foreign(request.headers.get("host"), request.headers.get("origin")):
                raise UnauthorizedError(
                    "The request comes from a web page of another host.",
                    advice="Use the service by the name localhost or by its address, or send an API key.",
                )
            return Principal()
        key = await self._verified(text.strip(), _peer(request))
        await self._count(request, key)
        return Principal(
            owner_id=key.owner_id,
            key_id=key.id,
            max_active_jobs=_first(key.max_active_jobs, self._settings.max_active_jobs),
            requests_per_minute=_first(key.requests_per_minute, self._settings.requests_per_minute),
            max_priority=_first(key.max_priority, self._settings.max_priority),
        )

    async def _verified(self, text: str, peer: str) -> ApiKey:
        digest = hashlib.sha256(text.encode()).digest()
        known = self._known.get(digest)
        if known is not None and time.monotonic() < known[1]:
            return known[0]
        if known is None:
            # Counted ahead, so that many at once do not slip through. A key that was valid a moment ago is no guess:
            # who shares an address with a guesser goes on working.
            verdict = self._failures.take(peer, _FAILURES)
            if verdict.wait_s:
                raise _limit("Too many API keys from this address were not valid.", verdict)
        try:
            key = await to_thread.run_sync(self._keys.verify, text)
        except UnauthorizedError:
            self._known.pop(digest, None)
            raise
        except BaseException:
            self._failures.give_back(peer, _FAILURES)
            raise
        if known is None:
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
        add_header(request.scope, "RateLimit-Policy", f'"minute";q={per_minute};w=60')
        add_header(request.scope, "RateLimit", f'"minute";r={verdict.remaining};t={verdict.reset_s}')
        if verdict.wait_s:
            raise _limit(f"The key may make {per_minute} requests in a minute.", verdict)


_BEARER = HTTPBearer(
    scheme_name="apiKey",
    description="An API key, as `meshdeform keys create` gives it. None is needed where the API listens on loopback.",
    auto_error=False,
)


async def principal(
    request: Request, _documented: Annotated[HTTPAuthorizationCredentials | None, Depends(_BEARER)]
) -> Principal:
    """Return who makes the request; see `Gate.admit`."""
    gate: Gate = request.app.state.gate
    return await gate.admit(request)


PrincipalDep = Annotated[Principal, Depends(principal)]


def _first(own: int | None, general: int) -> int:
    return general if own is None else own


def _limit(detail: str, verdict: Verdict) -> LimitError:
    return LimitError(detail, retry_after_s=max(1, math.ceil(verdict.wait_s)))


def _peer(request: Request) -> str:
    """The address that guesses are counted for; of IPv6 the network, of which one sender has a whole one."""
    host = request.client.host if request.client else ""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if address.version == 4:
        return str(address)
    return str(address.ipv4_mapped or ipaddress.ip_network((address, 64), strict=False))
