"""Download files, which appear complete and with their SHA-256 verified, or not at all."""

from __future__ import annotations

import hashlib
import os
import re
import uuid
from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO

import httpx

from meshdeform.client.commands import Answer, Call, Operation, Pause, Read, Stream, Work
from meshdeform.client.documents import ArtifactView
from meshdeform.client.paths import JobLike, identity, job_path
from meshdeform.client.problems import error_of, unreachable
from meshdeform.client.reading import artifacts, got, made, succeeded
from meshdeform.client.retries import NOT_WORTH_A_RETRY, Patience, Policy, worth_a_retry
from meshdeform.errors import JobNotFinishedError, MeshdeformError, NotFoundError, RangeError, UnavailableError

__all__ = ["AFTERWARDS", "fetched", "loaded", "saved"]

AFTERWARDS = ("morph.glb", "result.stl")
"""The artifacts that the service can make of a job that has succeeded."""

_BATCH = 2**20
_SHA256 = re.compile(r'(?:W/)?"([0-9a-f]{64})"')


def loaded(url: str, policy: Policy, sha256: str | None = None) -> Operation[bytes]:
    """Download a file and return its bytes."""
    file = BytesIO()
    yield from _received(url, file, policy, sha256)
    return file.getvalue()


def saved(url: str, path: Path, policy: Policy, sha256: str | None = None) -> Operation[Path]:
    """Download a file to a path.

    Parameters
    ----------
    url : str
    path : Path
        Replaced if it exists.
    policy : Policy
    sha256 : str, optional
        Expected SHA-256, verified in addition to the one that the service sends.

    Raises
    ------
    UnavailableError
        The download failed too often, or the SHA-256 does not match.
    OSError
        The file cannot be written.
    """
    aside = path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex}.part")
    file: IO[bytes] = yield Work(partial(aside.open, "xb"))
    try:
        with file:
            yield from _received(url, file, policy, sha256)
            yield Work(partial(_to_disk, file))
        yield Work(partial(aside.replace, path))
    finally:
        aside.unlink(missing_ok=True)
    return path


def fetched(job: JobLike, folder: Path, names: Sequence[str] | None, policy: Policy) -> Operation[list[Path]]:
    """Save a job's artifacts; see `Client.fetch`."""
    there = {artifact.name: artifact for artifact in (yield from artifacts(job, policy))}
    if not there:
        found = yield from got(job, policy)
        if not found.state.terminal:
            detail = f"The job {found.id} is {found.state}: it has no artifacts yet."
            raise JobNotFinishedError(detail, advice="Wait until it has finished.", job_id=found.id)
        succeeded(found)
    wanted = list(there) if names is None else list(names)
    for name in wanted:
        if name not in there:
            if name not in AFTERWARDS:
                had = ", ".join(there) or "none"
                raise NotFoundError(f"The job {identity(job)} has no artifact {name!r}; it has: {had}.")
            there[name] = yield from made(job, name, policy)
        if not name or Path(name).name != name or name in (".", "..") or "\\" in name:
            raise UnavailableError(f"The artifact's name {name!r} is not a file name.", advice="Check the service.")
    yield Work(partial(folder.mkdir, parents=True, exist_ok=True))
    paths = []
    for name in wanted:
        path = folder / name
        if not (yield Work(partial(_is, path, there[name]))):
            yield from saved(job_path(job, "artifacts", name), path, policy, there[name].sha256)
        paths.append(path)
    return paths


def _received(url: str, file: IO[bytes], policy: Policy, sha256: str | None) -> Operation[None]:
    patience = Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    received = _PartialFile(file)
    while True:
        headers = {"Accept-Encoding": "identity", **received.headers()}
        error: MeshdeformError
        try:
            answer: Answer = yield Stream(Call("GET", url, headers=headers))
            if not answer.ok:
                raise error_of(answer)
            if answer.status != httpx.codes.PARTIAL_CONTENT:
                yield Work(received.begin)
            received.tag = answer.headers.get("etag", "")
            while data := (yield Read()):
                if received.tag:
                    patience.renew()  # a retry resumes after the received bytes
                if received.add(data):
                    yield Work(received.flush)
            yield Work(received.flush)
            break
        except httpx.HTTPError as failure:
            error = unreachable(failure, url)
            if isinstance(failure, NOT_WORTH_A_RETRY):
                raise error from failure
        except MeshdeformError as refused:
            error = refused
            if isinstance(refused, RangeError):
                received.tag = ""
            elif not worth_a_retry(refused):
                raise
        yield Work(received.flush)
        if not received.tag:
            yield Work(received.begin)
        yield Pause(patience.pause(error))
    sent = _SHA256.fullmatch(received.tag)
    for expected in (sent[1] if sent else None, sha256):
        if expected is not None and expected != received.digest:
            raise UnavailableError("The received bytes differ from what the service sent.", advice="Try again.")


class _PartialFile:
    """The received part of a file, and its digest."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.tag = file, ""
        self._hash, self._count = hashlib.sha256(), 0
        self._waiting, self._waiting_bytes = list[bytes](), 0

    @property
    def digest(self) -> str:
        return self._hash.hexdigest()

    def headers(self) -> dict[str, str]:
        return {"Range": f"bytes={self._count}-", "If-Range": self.tag} if self._count else {}

    def begin(self) -> None:
        self._file.seek(0)
        self._file.truncate()
        self._hash, self._count = hashlib.sha256(), 0
        self._waiting, self._waiting_bytes = [], 0

    def add(self, data: bytes) -> bool:
        """Buffer bytes and return whether there are enough to write."""
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        return self._waiting_bytes >= _BATCH

    def flush(self) -> None:
        for data in self._waiting:
            self._file.write(data)
            self._hash.update(data)
        self._count += self._waiting_bytes
        self._waiting, self._waiting_bytes = [], 0


def _to_disk(file: IO[bytes]) -> None:
    file.flush()
    os.fsync(file.fileno())


def _is(path: Path, artifact: ArtifactView) -> bool:
    """Return whether a file is identical to an artifact."""
    try:
        if path.stat().st_size != artifact.size:
            return False
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == artifact.sha256
    except OSError:
        return False
