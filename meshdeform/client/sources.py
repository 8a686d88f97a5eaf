"""Open an asset given as a file, bytes, an open stream, or a reference to a file of the service."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

from meshdeform.client.documents import UploadView

__all__ = ["AssetLike", "LocalFile", "open_source"]

AssetLike = str | os.PathLike[str] | bytes | IO[bytes] | UploadView | Mapping[str, str]
"""A path; the bytes; a binary stream, read from its current position; an upload; or a reference such as
`{"job_id": "job_...", "artifact": "result.glb"}`."""

_IN_MEMORY = 2**20


@dataclass(frozen=True)
class LocalFile:
    """A local file, open and seekable.

    Attributes
    ----------
    filename : str
    file : binary file
    size : int
    sha256 : str
        SHA-256 of its bytes, hexadecimal.
    """

    filename: str
    file: IO[bytes]
    size: int
    sha256: str


def open_source(
    asset: AssetLike, files: contextlib.ExitStack, filename: str | None = None
) -> LocalFile | dict[str, str]:
    """Open a local asset, or return the reference to a file of the service.

    Parameters
    ----------
    asset : AssetLike
    files : ExitStack
        Closes the files opened here. The caller's own stream stays open.
    filename : str, optional
        The file name to send; its extension identifies OBJ, PLY and STL.

    Raises
    ------
    OSError
        The file cannot be read.
    TypeError
        The asset has another type.
    """
    if isinstance(asset, UploadView):
        return {"upload_id": asset.id}
    if isinstance(asset, Mapping):
        return dict(asset)
    if isinstance(asset, bytes | bytearray | memoryview):
        return _measured(BytesIO(asset), filename or "asset.glb")
    if isinstance(asset, str | os.PathLike):
        path = Path(asset)
        return _measured(files.enter_context(path.open("rb")), filename or path.name)
    if hasattr(asset, "read"):
        stream_name = getattr(asset, "name", None)
        name = filename or (Path(stream_name).name if isinstance(stream_name, str) else "asset.glb")
        return _measured(_copied(asset, files), name)
    raise TypeError(
        f"An asset must be a path, bytes, a binary stream, an upload or a reference, not {type(asset).__name__}."
    )


def _copied(stream: IO[bytes], files: contextlib.ExitStack) -> IO[bytes]:
    # A request may have to be retried, and the stream may not be seekable.
    copy = cast("IO[bytes]", files.enter_context(tempfile.SpooledTemporaryFile(_IN_MEMORY)))  # noqa: SIM115
    shutil.copyfileobj(cast("Any", stream), copy, 256 * 1024)
    return copy


def _measured(file: IO[bytes], filename: str) -> LocalFile:
    file.seek(0)
    digest, size = hashlib.sha256(), 0
    while part := file.read(256 * 1024):
        digest.update(part)
        size += len(part)
    file.seek(0)
    return LocalFile(filename, file, size, digest.hexdigest())
