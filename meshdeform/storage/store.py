"""Provide one class for object stores in folders and in buckets."""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from meshdeform.errors import MeshdeformError, NotFoundError, StoredFileError, UnavailableError
from meshdeform.storage.base import CHUNK, Backend, StoredObject, check_key, chunks_of, file_errors, measured
from meshdeform.storage.bucket import Bucket
from meshdeform.storage.folder import Folder
from meshdeform.storage.uploads import UploadArea

PATIENCE_S = 60.0
# The limit of Signature Version 4.
_SIGNED_S = 7 * 86_400


class ObjectStore:
    """Bytes by key. Keys are slash-separated names of letters, digits, `.`, `_` and `-`.

    `location`: a folder, or a URL: ``s3://BUCKET/PREFIX`` (credentials and endpoint from the usual ``AWS_*``
    variables), ``gs://``, ``az://``, ``memory://`` for tests; `patience_s`: seconds for which a bucket's connection may
    stall before the store counts as unavailable; `public_url`: base of signed URLs to an S3 store, if clients reach it
    at another address than this process. `create`: whether a missing or empty folder becomes a new store. False if a
    record refers to objects: then the store is away, for example not mounted. Buckets are never created. Raises
    UnavailableError: the location cannot be used. Every method raises this while the store is away or does not answer.
    Raises NotFoundError: by every method that reads: there is no such object.
    """

    def __init__(
        self, location: str | Path, *, patience_s: float = PATIENCE_S, public_url: str = "", create: bool = True
    ) -> None:
        text = str(location)
        self._backend: Backend
        self._uploads: UploadArea | None = None
        if "://" in text and not text.startswith("file://"):
            self._backend = Bucket(text, patience_s, public_url)
        else:
            self._backend = folder = Folder(Path(text.removeprefix("file://")), create=create)
            self._uploads = UploadArea(folder)

    def ping(self, timeout_s: float | None = None) -> None:
        """Return once the store answers, within `timeout_s` seconds if given. Must not be called on an event loop."""
        self._backend.ping(timeout_s)

    def put(
        self,
        key: str,
        data: bytes | Path,
        content_type: str = "application/octet-stream",
        *,
        known: StoredObject | None = None,
    ) -> StoredObject:
        """Store bytes, or the bytes of a file, durably, replacing any object under the key.

        A file is streamed and must not change meanwhile. Its size and digest, if already `known`, are not measured
        again. The content type is stored if the backend supports it.
        """
        check_key(key)
        with _opened(data) as source:
            measured_file = known or measured(chunks_of(source))
            source.seek(0)
            self._backend.put(key, source, content_type)
        return measured_file

    def put_verified(
        self, key: str, data: bytes | Path, content_type: str = "application/octet-stream"
    ) -> StoredObject:
        """Store bytes and read them back to verify them.

        `UnavailableError`: the store returned other bytes than were written; the object is removed.
        """
        stored = self.put(key, data, content_type)
        try:
            kept = self.measure(key)
        except NotFoundError:
            kept = None
        if kept != stored:
            with suppress(MeshdeformError):
                self.delete(key)
            raise UnavailableError(
                f"The object store did not store {key} correctly.",
                advice="Check the store's disk and the connection to it.",
            )
        return stored

    def get(self, key: str, *, sha256: str | None = None) -> bytes:
        """Return all bytes of an object; `StoredFileError`: it has another SHA-256 than the expected one."""
        data = b"".join(self.stream(key))
        if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
            raise _damaged(key)
        return data

    def size(self, key: str) -> int:
        """Return the size of an object in bytes."""
        check_key(key)
        return self._backend.size(key)

    def exists(self, key: str) -> bool:
        """Return whether an object exists."""
        try:
            self.size(key)
        except NotFoundError:
            return False
        return True

    def holds(self, key: str, sha256: str) -> bool:
        """Read an object, and return whether it exists with this SHA-256 and survives a power cut."""
        try:
            if self.sha256_of(key) != sha256:
                return False
            self._backend.sync(key)
        except NotFoundError:
            return False
        return True

    def stream(self, key: str, start: int = 0, end: int | None = None, chunk: int = CHUNK) -> Iterator[bytes]:
        """Return an iterator over bytes [start, end) of an object, in chunks of about `chunk` bytes.

        `NotFoundError` is raised by this call, before the first chunk is read; `UnavailableError` also while reading,
        if the object ends early.
        """
        check_key(key)
        return self._backend.stream(key, start, end, chunk)

    def measure(self, key: str) -> StoredObject:
        """Read an object and return its size and digest."""
        return measured(self.stream(key))

    def sha256_of(self, key: str) -> str:
        """Read an object and return its SHA-256, hexadecimal."""
        return self.measure(key).sha256

    def fetch(self, key: str, path: Path, *, sha256: str | None = None) -> StoredObject:
        """Stream an object into a file, which appears complete or not at all (it is not synced to the disk).

        The path is replaced if it exists; its folder must exist. Raises StoredFileError: the object has another SHA-256
        than the expected one. Raises UnavailableError: the local disk is full.
        """
        chunks = self.stream(key)
        with file_errors():
            handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
            try:
                with os.fdopen(handle, "wb") as file:
                    measured_file = measured(_written(chunks, file))
                if sha256 is not None and sha256.lower() != measured_file.sha256:
                    raise _damaged(key)
                Path(temporary).replace(path)
            finally:
                Path(temporary).unlink(missing_ok=True)
        return measured_file

    def copy(self, source: str, destination: str) -> None:
        """Copy an object to another key, within the store if it can."""
        check_key(source)
        check_key(destination)
        self._backend.copy(source, destination)

    def list(self, prefix: str = "") -> Iterator[tuple[str, int]]:
        """Yield the key and size of every object below a prefix ending with a slash, or of all objects."""
        if prefix:
            check_key(prefix.removesuffix("/"))
        return self._backend.list(prefix.removesuffix("/"))

    def delete(self, key: str) -> None:
        """Remove an object if it exists."""
        check_key(key)
        with suppress(NotFoundError):
            self._backend.delete(key)

    def delete_prefix(self, prefix: str) -> None:
        """Remove every object below a prefix ending with a slash, such as `jobs/ID/`."""
        check_key(prefix.removesuffix("/"))
        self._backend.delete_folder(prefix.removesuffix("/"))

    def presign_get(self, key: str, expires_s: int) -> str | None:
        """Return a URL that permits reading an object directly from the store for 1 second to 7 days.

        The response has the content type given to `put`, and the last name in the key as the file name. The key is not
        checked for existence. None if the store has no URLs of its own (a folder): sign one with `sign_path`.
        """
        return self._presign("GET", key, expires_s)

    def presign_put(self, key: str, expires_s: int) -> str | None:
        """Return a URL that permits writing an object directly to the store; None as for `presign_get`.

        Its holder may send any number of bytes, any number of times until it expires. Therefore use a separate key
        (`uploads/ID`), check the size and the digest afterwards, then `copy` it to its final key and `delete` it. Azure
        also requires the header `x-ms-blob-type: BlockBlob`.
        """
        return self._presign("PUT", key, expires_s)

    def _presign(self, method: str, key: str, expires_s: int) -> str | None:
        check_key(key)
        if not 1 <= expires_s <= _SIGNED_S:
            raise ValueError(f"a signed URL must live 1 to {_SIGNED_S} seconds, not {expires_s}")
        return self._backend.presign(method, key, expires_s)

    @property
    def appends(self) -> bool:
        """Whether the store supports resumable uploads with `append`; otherwise use `presign_put`."""
        return self._uploads is not None

    def append(self, upload_id: str, offset: int, chunks: Iterable[bytes], max_bytes: int) -> int:
        """Append bytes to an upload durably; offset 0 begins one. Return the total bytes received for it.

        `upload_id`: a name that a key may have; `offset`: position of the bytes, which must be the current size of the
        upload; `chunks`: if iterating raises, the bytes received so far are kept and the exception propagates;
        `max_bytes`: largest size of the whole upload. Raises ConflictError: the upload has another size
        (`extra["offset"]`), or another request is writing to it. Raises NotFoundError: there is no such upload, and the
        offset is not 0. Raises AssetTooLargeError, UnavailableError: the upload would exceed `max_bytes`, or the disk
        is full or fails; the bytes of this call are discarded.
        """
        return self._area().append(upload_id, offset, chunks, max_bytes)

    def appended_size(self, upload_id: str) -> int:
        """Return the bytes received for an upload; raise NotFoundError if there is none."""
        return self._area().size(upload_id)

    def appended(self, upload_id: str) -> StoredObject:
        """Return the size and digest of an upload so far; raise NotFoundError if there is none."""
        return self._area().appended(upload_id)

    def commit_append(self, upload_id: str, key: str) -> StoredObject:
        """Turn an upload into an object. Safe to repeat after a crash.

        `NotFoundError`: there is neither such an upload nor such an object; `ConflictError`: another request is writing
        to it.
        """
        check_key(key)
        return self._area().commit(upload_id, key)

    def discard_append(self, upload_id: str) -> None:
        """Remove an upload if it exists."""
        self._area().discard(upload_id)

    def _area(self) -> UploadArea:
        if self._uploads is None:
            raise NotImplementedError(
                "a bucket cannot append: use presign_put with a separate key, then copy and delete"
            )
        return self._uploads


def _damaged(key: str) -> StoredFileError:
    return StoredFileError(f"The object store's {key} differs from what was stored.")


@contextmanager
def _opened(data: bytes | Path) -> Iterator[BinaryIO]:
    if isinstance(data, Path):
        with data.open("rb") as file:
            yield file
    else:
        yield io.BytesIO(data)


def _written(chunks: Iterator[bytes], file: BinaryIO) -> Iterator[bytes]:
    for chunk in chunks:
        file.write(chunk)
        yield chunk
