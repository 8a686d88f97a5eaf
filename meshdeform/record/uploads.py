"""Uploads: files that are sent before the jobs that use them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

import sqlalchemy as sa

from meshdeform.errors import NotFoundError, TooManyUploadsError
from meshdeform.record.database import Database
from meshdeform.record.files import FileLedger
from meshdeform.record.ids import new_id
from meshdeform.record.rows import read
from meshdeform.record.schema import job_files, uploads


@dataclass(frozen=True)
class Upload:
    """A file that is being received or has been received, of `size` bytes when complete.

    The SHA-256 is as announced while it is open, as verified once it is complete; `key` names the stored file then.
    """

    id: str
    owner_id: str
    filename: str
    size: int
    sha256: str | None
    key: str | None
    created_at: datetime
    expires_at: datetime

    @property
    def complete(self) -> bool:
        """Whether all bytes have been received and verified."""
        return self.key is not None


class UploadLedger:
    """Every upload, from its announcement to its expiry.

    A complete upload keeps its file (`files.py`) until then; jobs that use the file keep it independently.
    """

    def __init__(self, database: Database, files: FileLedger) -> None:
        self._database, self._files = database, files

    def create(
        self,
        owner_id: str,
        filename: str,
        size: int,
        ttl_s: float,
        *,
        sha256: str | None = None,
        max_uploads: int = 0,
        max_bytes: int = 0,
        also: Callable[[sa.Connection, Upload], None] | None = None,
    ) -> Upload:
        """Announce an upload of a size in bytes.

        `also` is called in the same transaction, which its exceptions roll back.

        `max_uploads` and `max_bytes` limit the owner's unused uploads with this one (`TooManyUploadsError`); 0:
        unlimited.
        """
        values = {
            "id": new_id("upl"),
            "owner_id": owner_id,
            "filename": filename,
            "size": size,
            "sha256": sha256,
            "created_at": self._database.now(),
            "expires_at": self._database.now(ttl_s),
        }
        with self._database.write() as connection:
            if max_uploads or max_bytes:
                self._check_limits(connection, owner_id, size, max_uploads, max_bytes)
            upload = read(Upload, connection.execute(sa.insert(uploads).values(values).returning(uploads)).one())
            if also is not None:
                also(connection, upload)
        return upload

    def _check_limits(
        self, connection: sa.Connection, owner_id: str, size: int, max_uploads: int, max_bytes: int
    ) -> None:
        """Count the uploads of an owner that no job uses, and refuse one more if it exceeds a limit."""
        self._database.serialise(connection, f"uploads {owner_id}")
        used = sa.exists().where(job_files.c.key == uploads.c.key)
        mine = sa.and_(uploads.c.owner_id == owner_id, uploads.c.expires_at > self._database.now(), sa.not_(used))
        counts = sa.select(sa.func.count(), sa.func.coalesce(sa.func.sum(uploads.c.size), 0)).where(mine)
        count, stored = (int(value) for value in connection.execute(counts).one())
        if max_uploads and count >= max_uploads:
            raise TooManyUploadsError(
                f"{count} uploads of this key are unused; it may have {max_uploads}.", limit=max_uploads, stored=count
            )
        if max_bytes and stored + size > max_bytes:
            raise TooManyUploadsError(
                f"The unused uploads of this key have {stored} bytes; with this one they may have {max_bytes}.",
                limit=max_bytes,
                stored=stored,
            )

    def get(self, upload_id: str, owner: str | None = None) -> Upload:
        """Return an upload; with an owner, only one of theirs. `NotFoundError`: there is none, or it has expired."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(uploads).where(self._is(upload_id, owner))).one_or_none()
        if row is None:
            raise NotFoundError(f"There is no upload {upload_id!r}.", advice="Announce it again: POST /v1/uploads.")
        return read(Upload, row)

    def complete(self, upload_id: str, sha256: str, key: str) -> Upload:
        """Record the stored and pinned file; its pin is released. Repeating this is not an error."""
        change = sa.update(uploads).where(self._is(upload_id, None)).values(sha256=sha256, key=key)
        with self._database.write() as connection:
            row = connection.execute(change.returning(uploads)).one_or_none()
            if row is None:
                raise NotFoundError(f"There is no upload {upload_id!r}.")
            self._files.unpin([key], connection)
        return read(Upload, row)

    def delete(self, upload_id: str, owner: str | None = None) -> None:
        """Delete an upload; its file stays while a job needs it. `NotFoundError`: there is no such upload."""
        where = uploads.c.id == upload_id
        if owner is not None:
            where = sa.and_(where, uploads.c.owner_id == owner)
        with self._database.write() as connection:
            if connection.execute(sa.delete(uploads).where(where).returning(uploads.c.id)).first() is None:
                raise NotFoundError(f"There is no upload {upload_id!r}.")

    def _is(self, upload_id: str, owner: str | None) -> sa.ColumnElement[bool]:
        alive = sa.and_(uploads.c.id == upload_id, uploads.c.expires_at > self._database.now())
        return alive if owner is None else sa.and_(alive, uploads.c.owner_id == owner)
