"""Store objects in a bucket, through obstore (S3 and compatible stores, Google, Azure)."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, BinaryIO

from meshdeform.errors import DependencyError, MeshdeformError, NotFoundError, UnavailableError, install_command
from meshdeform.storage.base import is_key

# obstore's defaults retry for three minutes, which is longer than a request or a worker's lease can wait.
_CONNECT = timedelta(seconds=3)
_RETRY: Any = {"max_retries": 3, "retry_timeout": timedelta(seconds=10)}
# From connecting to the last byte, for a large object and a slow reader. A stalled connection ends much sooner.
_WHOLE = timedelta(hours=1)
# A part must be sent within the patience. Four at a time limit the memory to 32 MiB for any object size.
_PART, _AT_A_TIME = 8 << 20, 4
_NO_SUCH_RANGE = ("416 ", "range")
# The codes in the body of a 404: S3 and Google, Azure. Without one, not the store has answered but a gateway before it.
_NO_OBJECT = ("<Code>NoSuchKey</Code>", "<Code>BlobNotFound</Code>")
_NO_BUCKET = ("<Code>NoSuchBucket</Code>", "<Code>ContainerNotFound</Code>")


class Bucket:
    """A bucket, or a prefix of one: the path of the URL, which obstore reads, is the prefix of every key.

    After `patience_s` seconds without any progress the store counts as unavailable. `public_url` is the base of signed
    URLs to an S3 store, if clients reach it at another address than this process.
    """

    def __init__(self, url: str, patience_s: float, public_url: str = "") -> None:
        # Imported here to save memory in deployments on a folder.
        try:
            import obstore
            import obstore.store
        except ModuleNotFoundError as error:
            raise DependencyError(
                "The package obstore is not installed.", advice=f"Run: {install_command('stack')}."
            ) from error
        self._api: Any = obstore
        patience = {"connect_timeout": _CONNECT, "read_timeout": timedelta(seconds=patience_s), "timeout": _WHOLE}
        client: Any = {**_client_settings(url, os.environ), **patience}
        try:
            if url.startswith("memory:"):
                self._store: Any = obstore.store.MemoryStore()
            else:
                self._store = obstore.store.from_url(url, client_options=client, retry_config=_RETRY)
            # A signature covers the host name, so that URLs for another host must be signed for that host.
            self._signing: Any = self._store
            if public_url and isinstance(self._store, obstore.store.S3Store):
                known: Any = {**client, "allow_http": public_url.startswith("http://")}
                self._signing = obstore.store.from_url(url, endpoint=public_url, client_options=known)
        except (obstore.exceptions.BaseError, OSError, ValueError) as error:
            reason = str(error).partition("\n")[0]
            raise UnavailableError(
                f"The object store cannot be opened ({reason}).",
                advice="Correct MESHDEFORM_STORAGE_URL, or the credentials and variables that it needs.",
            ) from error

    def ping(self, timeout_s: float | None = None) -> None:
        """Return once the bucket can be listed."""
        listing = self._api.list(self._store, prefix="ping", chunk_size=1)
        with self._errors("the bucket"):
            if timeout_s is None:
                next(iter(listing), None)
                return
            # The client's timeouts apply to every request; a shorter one for this request needs an event loop.
            asyncio.run(asyncio.wait_for(_first(listing), timeout_s))

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:
        """Store a file in one request, or from 8 MiB on in parts that are combined atomically.

        The file name is stored with the object, since signed URLs cannot set headers when they are read.
        """
        # No character allowed in a key needs escaping here.
        disposition = f'attachment; filename="{key.rpartition("/")[2]}"'
        with self._errors(key):
            self._api.put(
                self._store,
                key,
                source,
                attributes={"Content-Type": content_type, "Content-Disposition": disposition},
                chunk_size=_PART,
                max_concurrency=_AT_A_TIME,
            )

    def size(self, key: str) -> int:
        """Return the size of an object in bytes."""
        with self._errors(key):
            try:
                return int(self._api.head(self._store, key)["size"])
            except FileNotFoundError:
                # The response to HEAD has no body that says what is missing.
                return int(self._api.get(self._store, key).meta["size"])

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """Yield the bytes of one request; if the connection breaks, obstore retries the rest a few times."""
        if end is not None and start >= end:
            self.size(key)
            return iter(())
        # An empty object has no valid range.
        options: Any = (
            {} if start == 0 and end is None else {"range": {"offset": start} if end is None else (start, end)}
        )
        try:
            with self._errors(key):
                response = self._api.get(self._store, key, options=options)
                first, last = response.range
        except UnavailableError as error:
            # A bucket refuses a range that begins at or past the end; here it means no bytes.
            if any(words in str(error.__cause__) for words in _NO_SUCH_RANGE) and start >= self.size(key):
                return iter(())
            raise
        return self._chunks(key, response, last - first, chunk)

    def _chunks(self, key: str, response: Any, left: int, chunk: int) -> Iterator[bytes]:
        with self._errors(key):
            for data in response.stream(min_chunk_size=chunk):
                left -= len(data)
                yield bytes(data)
        if left:
            raise UnavailableError(f"The object store's {key} ends {left} bytes early.")

    def copy(self, source: str, destination: str) -> None:
        """Copy an object within the store, without transferring its bytes here."""
        with self._errors(source):
            self._api.copy(self._store, source, destination)
        # A store may answer 200 first and fail afterwards.
        if self.size(source) != self.size(destination):
            raise UnavailableError(f"The object store did not copy all of {source}.")

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Yield every object below a prefix that has a valid key."""
        with self._errors(folder):
            for batch in self._api.list(self._store, prefix=folder or None):
                yield from ((entry["path"], int(entry["size"])) for entry in batch if is_key(entry["path"]))

    def sync(self, key: str) -> None:
        """Do nothing: a bucket stores an object durably before it lists it."""

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
        """Return a URL signed for the store, or None for an in-memory store."""
        if isinstance(self._store, self._api.store.MemoryStore | self._api.store.HTTPStore):
            return None
        with self._errors(key):
            return str(self._api.sign(self._signing, method, key, timedelta(seconds=expires_s)))

    @contextmanager
    def _errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except (self._api.exceptions.BaseError, OSError, ValueError) as error:
            raise self._translated(error, what) from error

    def _translated(self, error: Exception, what: str) -> MeshdeformError:
        """Return our error for obstore's; an object is missing only if the store itself says so."""
        text = str(error)
        if any(code in text for code in _NO_BUCKET):
            return UnavailableError(
                "The object store's bucket does not exist.",
                advice="Create the bucket that MESHDEFORM_STORAGE_URL names.",
            )
        if isinstance(error, FileNotFoundError | self._api.exceptions.NotFoundError):
            if any(code in text for code in _NO_OBJECT) or isinstance(self._store, self._api.store.MemoryStore):
                return NotFoundError(f"The object store has no {what}.")
            return UnavailableError(
                "The object store's address answers 404, but not as an object store does.",
                advice="Check the gateway in front of the store, MESHDEFORM_STORAGE_URL and the endpoint's address.",
            )
        if isinstance(error, self._api.exceptions.PermissionDeniedError | self._api.exceptions.UnauthenticatedError):
            return UnavailableError(
                "The object store refuses the credentials.",
                advice="Check the AWS_* variables (or those of your store), the bucket's policy and the clock.",
            )
        return UnavailableError(f"The object store does not answer ({type(error).__name__}).")


async def _first(response: Any) -> None:
    async for _ in response:
        return


def _client_settings(url: str, environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the connection options from the environment, which obstore ignores if any options are given."""
    prefix = {"gs": "GOOGLE", "az": "AZURE", "ab": "AZURE"}.get(url[:2], "AWS")
    settings: dict[str, Any] = {}
    for name in ("allow_http", "allow_invalid_certificates"):
        if value := environment.get(f"{prefix}_{name.upper()}"):
            settings[name] = value.lower() in ("1", "true", "yes", "on")
    for name in ("proxy_url", "proxy_ca_certificate", "proxy_excludes"):
        if value := environment.get(f"{prefix}_{name.upper()}"):
            settings[name] = value
    if bundle := environment.get("AWS_CA_BUNDLE"):
        try:
            settings["root_certificate"] = Path(bundle).read_bytes()
        except OSError as error:
            raise UnavailableError(f"The certificates of AWS_CA_BUNDLE cannot be read ({error.strerror}).") from error
    return settings
