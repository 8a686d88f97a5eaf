"""Describe a job to post, and open what is sent: a file, bytes, an open stream, a stored file, or a folder of meshes.

Each request has its own idempotency key, so that a retry does not create a second job.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple, TypedDict, cast

from pydantic import BaseModel

from meshdeform.api.documents import UploadView
from meshdeform.requests.choices import JobKind
from meshdeform.requests.document import DeformParams, OutputParams

AssetLike = str | os.PathLike[str] | bytes | IO[bytes] | UploadView | Mapping[str, str]
"""A path; the bytes; a binary stream, read from its current position; an upload; or a reference such as
`{"job_id": "job_...", "artifact": "result.glb"}`."""

_IN_MEMORY = 2**20
_ENDINGS = frozenset({".glb", ".obj", ".ply", ".stl"})

Params = DeformParams | Mapping[str, Any]
Output = OutputParams | Mapping[str, Any]


class JobOptions(TypedDict, total=False):
    """What may be said of a job beside its asset and prompt; for what is missing or None the service chooses."""

    params: Params | None
    """`DeformParams` or a mapping, for example `{"seed": 7}`."""
    output: Output | None
    target: AssetLike | None
    """A second mesh, in place of a prompt."""
    files: Mapping[str, AssetLike] | None
    """Other files by the names of their fields, such as `silhouette_1`: a picture. `limits().kinds` lists them."""
    metadata: Mapping[str, str] | None
    """Your own labels."""
    priority: int | None
    """Jobs with higher priority run first."""
    deadline_s: float | None
    """Seconds until the job expires unless it has finished."""
    max_run_s: float | None
    """Seconds for which it may run."""
    retention_s: float | None
    """Seconds from its end until it is deleted."""
    kind: JobKind | str | None
    """What the job does."""


@dataclass(frozen=True)
class Order:
    """A prompt with `JobOptions`, and what only some requests have; for members that are None the service chooses."""

    prompt: str = ""
    params: Params | None = None
    output: Output | None = None
    target: AssetLike | None = None
    files: Mapping[str, AssetLike] | None = None
    metadata: Mapping[str, str] | None = None
    priority: int | None = None
    deadline_s: float | None = None
    max_run_s: float | None = None
    retention_s: float | None = None
    kind: str | None = None
    webhook: str | Mapping[str, Any] | None = None
    seeds: Sequence[int] | None = None  # of a preview

    def by_field(self, **named: AssetLike | None) -> dict[str, AssetLike]:
        """Return the files by field: those named here, the target, and the others."""
        found = {name: file for name, file in {**named, "target": self.target}.items() if file is not None}
        if twice := sorted(found.keys() & (self.files or {}).keys()):
            raise ValueError(f"Give {', '.join(twice)} once, as an argument or in `files`.")
        return {**found, **(self.files or {})}

    def document(self) -> dict[str, Any]:
        """Return the JSON document."""
        members = {
            "kind": self.kind,
            "prompt": self.prompt,
            "params": self.params,
            "output": self.output,
            "metadata": self.metadata,
            "priority": self.priority,
            "deadline_s": self.deadline_s,
            "max_run_s": self.max_run_s,
            "retention_s": self.retention_s,
            "seeds": None if self.seeds is None else list(self.seeds),
            "webhook": {"url": self.webhook} if isinstance(self.webhook, str) else self.webhook,
        }
        values = {name: value for name, value in members.items() if value is not None}
        # Not validated here: the service validates and reports all errors.
        document: dict[str, Any] = json.loads(json.dumps(values, default=_plain, allow_nan=False))
        return document


@dataclass(frozen=True)
class Files:
    """The files of a job, and how to send them. See `Client.submit`."""

    by_field: Mapping[str, AssetLike]
    filename: str | None = None
    upload: bool | None = None
    key: str = ""

    @classmethod
    def of(
        cls,
        asset: AssetLike | None,
        order: Order,
        filename: str | None,
        upload: bool | None = None,
        key: str | None = None,
    ) -> Files:
        """Return the files by field with the given key, or a new one."""
        return cls(order.by_field(asset=asset), filename, upload, checked_key(key))


def checked_key(key: str | None) -> str:
    """Return the given key for a request, or a new one."""
    if key is None:
        return uuid.uuid4().hex
    if not re.fullmatch(r"[\x21-\x7e]{1,255}", key):
        raise ValueError("An idempotency key must have 1 to 255 visible ASCII characters.")
    return key


def refer(document: dict[str, Any], name: str, reference: Mapping[str, str]) -> None:
    """Name a stored file in a document."""
    document.setdefault("files", {})[name] = reference


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


@dataclass(frozen=True)
class LocalFile:
    """A local file, open and seekable, its size in bytes and its SHA-256 (hexadecimal)."""

    filename: str
    file: IO[bytes]
    size: int
    sha256: str


class UploadProgress(NamedTuple):
    """How much of a file has arrived at the service, in bytes."""

    filename: str
    sent: int
    size: int


def open_source(
    asset: AssetLike, files: contextlib.ExitStack, filename: str | None = None
) -> LocalFile | dict[str, str]:
    """Open a local asset, or return the reference to a file of the service.

    The stack closes the files opened here; the caller's own stream stays open.
    """
    if isinstance(asset, UploadView):
        return {"upload_id": asset.id}
    if isinstance(asset, Mapping):
        return dict(asset)
    if isinstance(asset, bytes | bytearray | memoryview):
        return _measured(io.BytesIO(asset), filename or "asset.glb")
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
    while chunk := file.read(256 * 1024):
        digest.update(chunk)
        size += len(chunk)
    file.seek(0)
    return LocalFile(filename, file, size, digest.hexdigest())


def files_in(paths: Sequence[Path]) -> dict[str, Path]:
    """Return meshes, and those in folders, by their names in a ZIP; with them the labels of a collection.

    Raises ValueError: there is no mesh, or two have one name.
    """
    files: dict[str, Path] = {}
    for path in paths:
        for name, file in _files_of(path):
            if name in files:
                raise ValueError(f"Two meshes are called {name}; rename one of them.")
            files[name] = file
    if not files:
        raise ValueError("There is no mesh: give GLB, OBJ, PLY or STL files, or folders with some.")
    return files


def _files_of(path: Path) -> list[tuple[str, Path]]:
    """Return the meshes of a folder by their names in it, or the file itself."""
    if not path.is_dir():
        return [(path.name, path)]
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in _ENDINGS and file.is_file())
    within = [(file.relative_to(path), file) for file in files]
    meshes = [(name.as_posix(), file) for name, file in within if not any(each.startswith(".") for each in name.parts)]
    labels = path / "labels.json"
    return [*meshes, (labels.name, labels)] if meshes and labels.is_file() else meshes
