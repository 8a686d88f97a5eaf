"""The object store in a bucket: whatever obstore can open (S3 and what speaks like it, Google, Azure)."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, BinaryIO

from meshdeform.errors import DependencyError, NotFoundError, UnavailableError
from meshdeform.storage.base import is_key

__all__ = ["Bucket"]

# obstore's own defaults try for three minutes: longer than a request, or a worker's lease, can wait.
_CONNECT = timedelta(seconds=3)
_RETRY: Any = {"max_retries": 3, "retry_timeout": timedelta(seconds=10)}
# From connecting to the last byte: a large object to a slow reader. What stands still is ended much sooner.
_WHOLE = timedelta(hours=1)
# A part must be through within the patience; four at a time keep the memory at 32 MiB, whatever the object's size.
_PART, _AT_A_TIME = 8 << 20, 4
_NO_SUCH_RANGE = ("416 ", "range")


class Bucket:
    """A bucket, or a part of one.

    Parameters
    ----------
    url : str
        As obstore reads it; the path is put before every key.
    patience_s : float
        How long nothing may move before the store counts as away.
    public_url : str
        Where those who get signed URLs reach an S3 store, if not where we do.
    """

    def __init__(self, url: str, patience_s: float, public_url: str = "") -> None:
        # Loaded here, so that a deployment on a folder keeps the megabytes.
        try:
            import obstore
            import obstore.store
        except ModuleNotFoundError as error:
            raise DependencyError(
                "The package obstore is not installed.", advice='Run: pip install "meshdeform[stack]".'
            ) from error
        self._api: Any = obstore
        patience = {"connect_timeout": _CONNECT, "read_timeout": timedelta(seconds=patience_s), "timeout": _WHOLE}
        client: Any = {**_client_settings(url, os.environ), **patience}
        try:
            if url.startswith("memory:"):
                self._store: Any = obstore.store.MemoryStore()
            else:
                self._store = obstore.store.from_url(url, client_options=client, retry_config=_RETRY)
            # A signature covers the host's name: a URL that is to be used under another one is signed for that one.
            self._signing: Any = self._store
            if public_url and isinstance(self._store, obstore.store.S3Store):
                known: Any = {**client, "allow_http": public_url.startswith("http://")}
                self._signing = obstore.store.from_url(url, endpoint=public_url, client_options=known)
        except (obstore.exceptions.BaseError, OSError, ValueError) as error:
            reason = str(error).partition("\n")[0]
            raise UnavailableError(
                f"The object store cannot be opened ({reason}).",
                advice="Correct MESHDEFORM_STORAGE_URL or what it needs.",
            ) from error

    def ping(self, timeout_s: float | None = None) -> None:
        """Return when the bucket can be listed."""
        found = self._api.list(self._store, prefix="ping", chunk_size=1)
        with self._errors("the bucket", absent=UnavailableError):
            if timeout_s is None:
                next(iter(found), None)
                return
            # The store's own limits hold for every request; a shorter one for this request needs a loop.
            asyncio.run(asyncio.wait_for(_first(found), timeout_s))

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:
        """In one request, or from 8 MiB on in parts, which become the object all at once.

        Whoever reads the object by a signed URL gets the name with it: signed URLs carry no headers of our choice.
        """
        # A key holds nothing that would have to be escaped here.
        disposition = f'attachment; filename="{key.rpartition("/")[2]}"'
        with self._errors(key, absent=UnavailableError):
            self._api.put(
                self._store,
                key,
                source,
                attributes={"Content-Type": content_type, "Content-Disposition": disposition},
                chunk_size=_PART,
                max_concurrency=_AT_A_TIME,
            )

    def size(self, key: str) -> int:
        """Bytes of an object."""
        try:
            with self._errors(key):
                return int(self._api.head(self._store, key)["size"])
        except NotFoundError:
            # The answer to HEAD has no body: it does not say whether the object is missing or the bucket.
            self.ping()
            raise

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """One request; where the connection breaks, obstore asks for the rest a few times."""
        if end is not None and start >= end:
            self.size(key)
            return iter(())
        # An empty object has no range to ask for.
        options: Any = (
            {} if start == 0 and end is None else {"range": {"offset": start} if end is None else (start, end)}
        )
        try:
            with self._errors(key):
                found = self._api.get(self._store, key, options=options)
                first, last = found.range
        except UnavailableError as error:
            # A range that begins at the end or past it is an error to a bucket, and no bytes to us.
            if any(words in str(error.__cause__) for words in _NO_SUCH_RANGE) and start >= self.size(key):
                return iter(())
            raise
        return self._parts(key, found, last - first, chunk)

    def _parts(self, key: str, found: Any, left: int, chunk: int) -> Iterator[bytes]:
        with self._errors(key):
            for part in found.stream(min_chunk_size=chunk):
                left -= len(part)
                yield bytes(part)
        if left:
            raise UnavailableError(f"The object store's {key} ends {left} bytes early.")

    def copy(self, source: str, destination: str) -> None:
        """Within the store; the bytes do not come here."""
        with self._errors(source):
            self._api.copy(self._store, source, destination)
        # A store may say 200 first and fail afterwards.
        if self.size(source) != self.size(destination):
            raise UnavailableError(f"The object store did not copy {source} whole.")

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Every object below a prefix that could be one of ours."""
        with self._errors(folder, absent=UnavailableError):
            for batch in self._api.list(self._store, prefix=folder or None):
                yield from ((entry["path"], int(entry["size"])) for entry in batch if is_key(entry["path"]))

    def delete(self, key: str) -> None:
        """Remove an object."""
        with self._errors(key):
            self._api.delete(self._store, key)

    def delete_folder(self, folder: str) -> None:
        """Remove every object below a prefix."""
        with self._errors(folder):
            for batch in self._api.list(self._store, prefix=folder):
                if paths := [entry["path"] for entry in batch]:
                    self._api.delete(self._store, paths)

    def presign(self, method: str, key: str, expires_s: int) -> str | None:
        """A URL that the store itself honours; none from the memory."""
        if isinstance(self._store, self._api.store.MemoryStore | self._api.store.HTTPStore):
            return None
        with self._errors(key):
            return str(self._api.sign(self._signing, method, key, timedelta(seconds=expires_s)))

    @contextmanager
    def _errors(self, what: str, absent: type[NotFoundError | UnavailableError] = NotFoundError) -> Iterator[None]:
        refused = (self._api.exceptions.PermissionDeniedError, self._api.exceptions.UnauthenticatedError)
        try:
            yield
        except (self._api.exceptions.NotFoundError, FileNotFoundError) as error:
            # An object that is gone is one thing, a bucket that is gone another: nothing may be given up for lost then.
            if absent is UnavailableError or "NoSuchBucket" in str(error):
                raise UnavailableError(
                    "The object store's bucket does not exist.",
                    advice="Make the bucket that MESHDEFORM_STORAGE_URL names.",
                ) from error
            raise NotFoundError(f"The object store has no {what}.") from error
        except refused as error:
            raise UnavailableError(
                "The object store refuses the credentials.",
                advice="Check the AWS_* variables (or those of your store), the bucket's policy and the clock.",
            ) from error
        except (self._api.exceptions.BaseError, OSError, ValueError) as error:
            raise UnavailableError(f"The object store does not answer ({type(error).__name__}).") from error


async def _first(found: Any) -> None:
    async for _ in found:
        return


def _client_settings(url: str, environment: Mapping[str, str]) -> dict[str, Any]:
    """What the environment says of the connection: where options are given, obstore does not look there itself."""
    prefix = {"gs": "GOOGLE", "az": "AZURE", "ab": "AZURE"}.get(url[:2], "AWS")
    found: dict[str, Any] = {}
    for name in ("allow_http", "allow_invalid_certificates"):
        if value := environment.get(f"{prefix}_{name.upper()}"):
            found[name] = value.lower() in ("1", "true", "yes", "on")
    for name in ("proxy_url", "proxy_ca_certificate", "proxy_excludes"):
        if value := environment.get(f"{prefix}_{name.upper()}"):
            found[name] = value
    if bundle := environment.get("AWS_CA_BUNDLE"):
        try:
            found["root_certificate"] = Path(bundle).read_bytes()
        except OSError as error:
            raise UnavailableError(f"The certificates of AWS_CA_BUNDLE cannot be read ({error.strerror}).") from error
    return found
