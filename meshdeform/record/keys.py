"""API keys and their limits. A key is shown once, when it is created; the record keeps a hash of its secret."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import sqlalchemy as sa

from meshdeform.errors import NotFoundError, ParameterError, UnauthorizedError, UnavailableError
from meshdeform.record.database import Database
from meshdeform.record.ids import id_pattern, new_id
from meshdeform.record.rows import read
from meshdeform.record.schema import api_keys
from meshdeform.requests.document import MAX_PRIORITY

_PREFIX = "mdk"
_SECRET_BYTES = 32
_TEXT = re.compile(rf"({id_pattern(_PREFIX)[1:-1]})\.([A-Za-z0-9_-]{{43}})")
_OWNER = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")
_MAX_NAME = 100
_MAX_LIMIT = 1_000_000
_USE_RECORDED_EVERY = timedelta(minutes=1)
_NO_DIGEST = "0" * 64


@dataclass(frozen=True)
class ApiKey:
    """A key, without its secret. None in a limit means the deployment's setting; 0 means no limit.

    `id` is the part of its text before the dot, and `name` a label for people. An owner may have several keys.
    `last_used_at` is accurate to a minute.
    """

    id: str
    owner_id: str
    name: str
    created_at: datetime
    last_used_at: datetime | None = None
    revoked_at: datetime | None = None
    requests_per_minute: int | None = None
    max_active_jobs: int | None = None
    max_priority: int | None = None


class KeyRing:
    """The keys of a record. Every method raises UnavailableError if the database does not answer."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(
        self,
        owner_id: str,
        name: str = "",
        requests_per_minute: int | None = None,
        max_active_jobs: int | None = None,
        max_priority: int | None = None,
    ) -> tuple[ApiKey, str]:
        """Create a key, and return it with the text that requests send, which cannot be retrieved again.

        The owner's id has at most 63 lower-case letters, digits, `-` and `_`, the first one a letter or a digit; the
        name has at most 100 characters. Limits as of `ApiKey`; priorities are from -100 to 100. Raises ParameterError:
        a value is invalid.
        """
        if not _OWNER.fullmatch(owner_id):
            raise ParameterError(
                f"{owner_id!r} cannot be an owner.",
                advice="Write lower-case letters, digits, - and _: at most 63, the first one a letter or a digit.",
            )
        if len(name) > _MAX_NAME:
            raise ParameterError("The name of the key is too long.", advice=f"Write at most {_MAX_NAME} characters.")
        for limit in (requests_per_minute, max_active_jobs):
            if limit is not None and not 0 <= limit <= _MAX_LIMIT:
                raise ParameterError(
                    f"{limit} cannot be a limit.", advice=f"Give a number from 0 (no limit) to {_MAX_LIMIT}."
                )
        if max_priority is not None and abs(max_priority) > MAX_PRIORITY:
            raise ParameterError(
                f"{max_priority} cannot be a priority.", advice=f"Give a number from -{MAX_PRIORITY} to {MAX_PRIORITY}."
            )
        key_id, secret = new_id(_PREFIX), secrets.token_urlsafe(_SECRET_BYTES)
        values = {
            "id": key_id,
            "owner_id": owner_id,
            "name": name,
            "secret_hash": _digest(secret),
            "created_at": self._database.now(),
            "requests_per_minute": requests_per_minute,
            "max_active_jobs": max_active_jobs,
            "max_priority": max_priority,
        }
        with self._database.write() as connection:
            row = connection.execute(sa.insert(api_keys).values(values).returning(api_keys)).one()
        return read(ApiKey, row), f"{key_id}.{secret}"

    def list(self, owner: str | None = None) -> list[ApiKey]:
        """Return all keys or those of one owner, including revoked ones, oldest first."""
        query = sa.select(api_keys).order_by(api_keys.c.id)
        if owner is not None:
            query = query.where(api_keys.c.owner_id == owner)
        with self._database.read() as connection:
            return [read(ApiKey, row) for row in connection.execute(query)]

    def revoke(self, key_id: str) -> ApiKey:
        """Revoke a key permanently; revoking it again changes nothing. `NotFoundError`: there is no such key."""
        revoked_at = sa.func.coalesce(api_keys.c.revoked_at, self._database.now())
        revoke = sa.update(api_keys).where(api_keys.c.id == key_id).values(revoked_at=revoked_at).returning(api_keys)
        with self._database.write() as connection:
            row = connection.execute(revoke).one_or_none()
        if row is None:
            raise NotFoundError(f"There is no key {key_id}.", advice="See: meshdeform keys list.")
        return read(ApiKey, row)

    def verify(self, text: str) -> ApiKey:
        """Return the key of a text sent by a request.

        `UnauthorizedError` does not say which part is wrong or whether the key was revoked.
        """
        match = _TEXT.fullmatch(text)
        key_id, secret = match.groups() if match else ("", "")
        with self._database.read() as connection:
            row = connection.execute(sa.select(api_keys).where(api_keys.c.id == key_id)).one_or_none()
        # Do the same work whether or not the key exists, so that the response time does not reveal it.
        same = hmac.compare_digest(_digest(secret), row.secret_hash if row is not None else _NO_DIGEST)
        if row is None or not same or row.revoked_at is not None:
            raise UnauthorizedError("The API key is not valid.")
        key = read(ApiKey, row)
        self._record_use(key)
        return key

    def any_active(self) -> bool:
        """Return whether there is a key that has not been revoked."""
        query = sa.select(api_keys.c.id).where(api_keys.c.revoked_at.is_(None)).limit(1)
        with self._database.read() as connection:
            return connection.execute(query).first() is not None

    def is_active(self, key_id: str) -> bool:
        """Return whether a key exists and has not been revoked."""
        query = sa.select(api_keys.c.id).where(api_keys.c.id == key_id, api_keys.c.revoked_at.is_(None))
        with self._database.read() as connection:
            return connection.execute(query).first() is not None

    def _record_use(self, key: ApiKey) -> None:
        if key.last_used_at is not None and datetime.now(UTC) - key.last_used_at < _USE_RECORDED_EVERY:
            return
        used = sa.update(api_keys).where(api_keys.c.id == key.id).values(last_used_at=self._database.now())
        try:
            with self._database.write() as connection:
                connection.execute(used)
        except UnavailableError:
            # The key was read a moment ago: a failed write is no reason to refuse the request.
            return


def _digest(secret: str) -> str:
    # A fast hash suffices, because the secret has 256 random bits.
    return hashlib.sha256(secret.encode()).hexdigest()
