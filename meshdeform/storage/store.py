"""The one class behind which folders and buckets are the same."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from meshdeform.errors import MeshdeformError, NotFoundError, UnavailableError
from meshdeform.storage.base import CHUNK, Backend, StoredObject, check_key, file_errors, measured, parts_of
from meshdeform.storage.bucket import Bucket
from meshdeform.storage.folder import Folder
from meshdeform.storage.uploads import UploadArea

__all__ = ["ObjectStore"]

PATIENCE_S = 60.0
# What Signature Version 4 allows.
_SIGNED_S = 7 * 86_400


class ObjectStore:
    """Bytes by key. Keys are slash-separated names of letters, digits, `.`, `_` and `-`.

    Parameters
    ----------
    location : str or Path
        A folder, or a URL: ``s3://BUCKET/PREFIX`` (credentials and endpoint from the usual ``AWS_*`` variables),
        ``gs://``, ``az://``, ``memory://`` for tests.
    patience_s : float
        How long a bucket's connection may stand still before the store counts as away.
    public_url : str
        Where those who get signed URLs reach an S3 store, if not where we do.

    Raises
    ------
    UnavailableError
        The location cannot be used. Every method raises it when the store does not answer.
    """

    def __init__(self, location: str | Path, *, patience_s: float = PATIENCE_S, public_url: str = "") -> None:
        text = str(location)
        self._backend: Backend
        self._uploads: UploadArea | None = None
        if "://" in text and not text.startswith("file://"):
            self._backend = Bucket(text, patience_s, public_url)
        else:
            self._backend = folder = Folder(Path(text.removeprefix("file://")))
            self._uploads = UploadArea(folder.root)

    def ping(self, timeout_s: float | None = None) -> None:
        """Return when the store answers. Not to be called on an event loop.

        Parameters
        ----------
        timeout_s : float, optional
            Seconds after which it counts as away; as patient as every other method unless given.
        """
        self._backend.ping(timeout_s)

    def put(
        self,
        key: str,
        data: bytes | Path,
        content_type: str = "application/octet-stream",
        *,
        known: StoredObject | None = None,
    ) -> StoredObject:
        """Store bytes, or the bytes of a file, in place of what was there. Durable when it returns.

        Parameters
        ----------
        key : str
        data : bytes or Path
            A file is streamed; it must not change meanwhile.
        content_type : str
            Kept where the store can.
        known : StoredObject, optional
            Size and digest, where they were measured before; the bytes are read once then.
        """
        check_key(key)
        with _opened(data) as source:
            found = known or measured(parts_of(source))
            source.seek(0)
            self._backend.put(key, source, content_type)
        return found

    def put_verified(
        self, key: str, data: bytes | Path, content_type: str = "application/octet-stream"
    ) -> StoredObject:
        """Store bytes and read them back before anything points at them.

        Raises
        ------
        UnavailableError
            The store gives back something else than was written; what it kept is removed.
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
                f"The object store did not keep {key} as it was written.",
                advice="Check the store's disk, and what stands between it and this machine.",
            )
        return stored

    def get(self, key: str) -> bytes:
        """All bytes of an object.

        Raises
        ------
        NotFoundError
            There is none.
        """
        return b"".join(self.stream(key))

    def size(self, key: str) -> int:
        """Bytes of an object.

        Raises
        ------
        NotFoundError
            There is none.
        """
        check_key(key)
        return self._backend.size(key)

    def exists(self, key: str) -> bool:
        """Whether there is an object."""
        try:
            self.size(key)
        except NotFoundError:
            return False
        return True

    def stream(self, key: str, start: int = 0, end: int | None = None, chunk: int = CHUNK) -> Iterator[bytes]:
        """Bytes [start, end) of an object, in parts of about `chunk` bytes.

        Raises
        ------
        NotFoundError
            There is none; raised here, before the first part is asked for.
        UnavailableError
            Also while it is read: what ends early is never taken for the whole.
        """
        check_key(key)
        return self._backend.stream(key, start, end, chunk)

    def measure(self, key: str) -> StoredObject:
        """Size and digest of an object, read from the store as it is now."""
        return measured(self.stream(key))

    def sha256_of(self, key: str) -> str:
        """Digest of an object, read from the store as it is now; hexadecimal."""
        return self.measure(key).sha256

    def fetch(self, key: str, path: Path, *, sha256: str | None = None) -> StoredObject:
        """Stream an object into a file, which is there whole or not at all (it is not synced to the disk).

        Parameters
        ----------
        key : str
        path : Path
            Replaced where it is there; its folder must be.
        sha256 : str, optional
            What the object should be.

        Raises
        ------
        UnavailableError
            The object is another one, or the local disk is full.
        """
        parts = self.stream(key)
        with file_errors(f"folder {path.parent.name}"):
            handle, aside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
            try:
                with os.fdopen(handle, "wb") as file:
                    found = measured(_written(parts, file))
                if sha256 is not None and sha256.lower() != found.sha256:
                    raise UnavailableError(f"The object store's {key} is not what was stored under that name.")
                Path(aside).replace(path)
            finally:
                Path(aside).unlink(missing_ok=True)
        return found

    def copy(self, source: str, destination: str) -> None:
        """Store an object once more under another key, within the store where it can.

        Raises
        ------
        NotFoundError
            There is no `source`.
        """
        check_key(source)
        check_key(destination)
        self._backend.copy(source, destination)

    def list(self, prefix: str = "") -> Iterator[tuple[str, int]]:
        """Key and size of every object below a prefix, which ends with a slash; of all without one."""
        if prefix:
            check_key(prefix.removesuffix("/"))
        return self._backend.list(prefix.removesuffix("/"))

    def delete(self, key: str) -> None:
        """Remove an object; nothing happens where there is none."""
        check_key(key)
        with suppress(NotFoundError):
            self._backend.delete(key)

    def delete_prefix(self, prefix: str) -> None:
        """Remove every object below a prefix, which ends with a slash: `jobs/ID/`."""
        check_key(prefix.removesuffix("/"))
        self._backend.delete_folder(prefix.removesuffix("/"))

    def presign_get(self, key: str, expires_s: int) -> str | None:
        """A URL that lets its bearer read an object, straight from the store.

        The answer carries what `put` stored beside the bytes: the type, and the last part of the key as the name.

        Parameters
        ----------
        key : str
            Not looked up.
        expires_s : int
            1 second to 7 days.

        Returns
        -------
        str or None
            None: the store has no URLs of its own (a folder); sign one with `sign_path`.
        """
        return self._presign("GET", key, expires_s)

    def presign_put(self, key: str, expires_s: int) -> str | None:
        """A URL that lets its bearer write an object, straight to the store.

        Whoever has it may send any number of bytes, any number of times until it expires: sign a key of its own
        (`uploads/ID`), look at the size and the digest afterwards, then `copy` it to where it belongs and `delete` it.
        Azure wants the header `x-ms-blob-type: BlockBlob` with it.

        Returns
        -------
        str or None
            As for `presign_get`.
        """
        return self._presign("PUT", key, expires_s)

    def _presign(self, method: str, key: str, expires_s: int) -> str | None:
        check_key(key)
        if not 1 <= expires_s <= _SIGNED_S:
            raise ValueError(f"a signed URL lives 1 to {_SIGNED_S} seconds, not {expires_s}")
        return self._backend.presign(method, key, expires_s)

    @property
    def appends(self) -> bool:
        """Whether uploads can go on where they broke off (`append`); where not, `presign_put` does it."""
        return self._uploads is not None

    def append(self, upload_id: str, offset: int, chunks: Iterable[bytes], max_bytes: int) -> int:
        """Add bytes to an upload; offset 0 begins one. They are on the disk when it returns.

        Parameters
        ----------
        upload_id : str
            One part of a key.
        offset : int
            Where the bytes belong, which must be where the upload ends now.
        chunks : iterable of bytes
            Where it raises, what came before stays, and the exception comes through.
        max_bytes : int
            What the whole upload may have.

        Returns
        -------
        int
            Bytes that have arrived altogether.

        Raises
        ------
        ConflictError
            The upload ends elsewhere (`extra["offset"]`), or another request writes to it.
        NotFoundError
            There is none, and the offset is not 0.
        AssetTooLargeError
            Over `max_bytes`; what came in this call is taken back.
        UnavailableError
            The disk is full, or worse; what came in this call is taken back.
        """
        return self._area().append(upload_id, offset, chunks, max_bytes)

    def appended_size(self, upload_id: str) -> int:
        """Bytes of an upload that have arrived; NotFoundError where there is none."""
        return self._area().size(upload_id)

    def appended(self, upload_id: str) -> StoredObject:
        """Size and digest of what has arrived; NotFoundError where there is no such upload."""
        return self._area().appended(upload_id)

    def commit_append(self, upload_id: str, key: str) -> StoredObject:
        """Make an upload an object. May be repeated: after a crash in between it finds the one or the other.

        Raises
        ------
        NotFoundError
            There is neither such an upload nor such an object.
        ConflictError
            Another request writes to the upload.
        """
        check_key(key)
        return self._area().commit(upload_id, key)

    def discard_append(self, upload_id: str) -> None:
        """Forget an upload; nothing happens where there is none."""
        self._area().discard(upload_id)

    def _area(self) -> UploadArea:
        if self._uploads is None:
            raise NotImplementedError(
                "a bucket cannot append: use presign_put on a key of its own, then copy and delete"
            )
        return self._uploads


@contextmanager
def _opened(data: bytes | Path) -> Iterator[BinaryIO]:
    if isinstance(data, Path):
        with data.open("rb") as file:
            yield file
    else:
        yield io.BytesIO(data)


def _written(parts: Iterator[bytes], file: BinaryIO) -> Iterator[bytes]:
    for part in parts:
        file.write(part)
        yield part
