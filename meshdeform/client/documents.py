"""Define how the client reads the documents of `meshdeform.api`, accepting additions by newer services.

Unknown members are in `model_extra`; unknown names (of a state, an event, a kind of job) are members of their
enumeration that only have a `value`; unknown or out-of-range parameters are attributes of `params`.
"""

from __future__ import annotations

import base64
import hashlib
import html
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO, Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, SerializeAsAny, ValidationError, WrapValidator, model_serializer

from meshdeform.api import documents, jobs
from meshdeform.api.jobs import ArtifactView
from meshdeform.api.states import JobError, Progress
from meshdeform.errors import MeshdeformError, StoredFileError, UnavailableError
from meshdeform.requests.document import DeformParams, OutputParams, ResolvedParams
from meshdeform.requests.problems import reason

M = TypeVar("M", bound=BaseModel)
_OPEN = ConfigDict(frozen=True, extra="allow", protected_namespaces=())
GLB, REPORT, PREVIEW = "result.glb", "report.json", "preview.png"
AFTERWARDS = ("morph.glb", "map.safetensors", "result.usdz", "result.obj.zip", "result.3mf", "result.stl")
"""The artifacts that the service can make of a job that has succeeded."""
_BATCH = 2**20
_SHA256 = re.compile(r'(?:W/)?"([0-9a-f]{64})"')


def _else(wider: type[BaseModel]) -> WrapValidator:
    """Return a validator that keeps a value unvalidated, as an instance of `wider`, if the known model rejects it."""

    def validate(value: Any, known: Callable[[Any], Any]) -> Any:
        try:
            return known(value)
        except ValidationError:
            if not isinstance(value, dict):
                raise
            return wider.model_construct(**value)

    return WrapValidator(validate)


class _AsItCame(BaseModel):
    @model_serializer
    def _written(self) -> dict[str, Any]:
        return {**{name: getattr(self, name) for name in self.model_fields_set}, **(self.model_extra or {})}


class _Params(_AsItCame, DeformParams):  # type: ignore[misc]
    model_config = _OPEN


class _Resolved(_AsItCame, ResolvedParams):  # type: ignore[misc]
    model_config = _OPEN


class _Output(_AsItCame, OutputParams):
    model_config = _OPEN


class _Progress(Progress):
    model_config = _OPEN


class _JobError(JobError):
    model_config = _OPEN


class JobView(jobs.JobView):
    """A job."""

    params: Annotated[DeformParams, _else(_Params), SerializeAsAny()]
    output: Annotated[OutputParams, _else(_Output), SerializeAsAny()]
    error: _JobError | None = None
    progress: _Progress

    def as_json(self) -> dict[str, Any]:
        """Return the JSON document, with only those parameters that the request set."""
        params = self.params.model_dump(mode="json", exclude_unset=True)
        return {**super().as_json(), "params": params}


class JobList(jobs.JobList):
    """A page of jobs, newest first."""

    jobs: list[JobView]  # type: ignore[assignment]


class Validation(documents.Validation):
    """The result of checking a valid job."""

    params: Annotated[ResolvedParams, _else(_Resolved), SerializeAsAny()]


def read(model: type[M], document: Any, url: str) -> M:
    """Parse a document of the service."""
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        location = ".".join(str(step) for step in first["loc"])
        raise UnavailableError(
            f"{url} answered with a document that this client does not understand ({location}: {reason(first)}).",
            advice="Check the service's address, and that client and service have compatible versions.",
        ) from error


def shown(preview: Callable[[], bytes]) -> bytes | None:
    """Return a preview; None where it cannot be had, since showing must not fail if service or client is gone."""
    try:
        return preview()
    except (MeshdeformError, RuntimeError):
        return None


def label(job: JobView) -> str:
    """Return a job in a few words."""
    return f"{job.id}: {job.asset.filename}, {job.prompt or job.kind}"


def html_of(job: JobView, png: bytes | None) -> str:
    """Return a job and its preview as HTML."""
    words = html.escape(label(job))
    if png is None:
        return f"<p>{words}</p>"
    shown = base64.b64encode(png).decode()
    return f'<figure><img alt="{words}" src="data:image/png;base64,{shown}"><figcaption>{words}</figcaption></figure>'


class PartialFile:
    """What has been received of a file, and its digest."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.tag, self._resumed = file, "", False
        self._hash, self._count = hashlib.sha256(), 0
        self._waiting, self._waiting_bytes = list[bytes](), 0

    def headers(self) -> dict[str, str]:
        """Return the headers that request the rest."""
        self._resumed = bool(self._count)
        return {"Range": f"bytes={self._count}-", "If-Range": self.tag} if self._count else {}

    def begin(self) -> None:
        """Discard the bytes received so far."""
        self._resumed = False
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
        """Write the buffered bytes."""
        for data in self._waiting:
            self._file.write(data)
            self._hash.update(data)
        self._count += self._waiting_bytes
        self._waiting, self._waiting_bytes = [], 0

    def verify(self, sha256: str | None) -> None:
        """Compare the whole file with the SHA-256 that the service has sent, and with the artifact's, if known."""
        match = _SHA256.fullmatch(self.tag)
        for expected in (match[1] if match else None, sha256):
            if expected is not None and expected != self._hash.hexdigest():
                if self._resumed:
                    raise StoredFileError("The received bytes differ from what was stored.")
                raise UnavailableError("The received bytes differ from what the service sent.", advice="Try again.")


def to_disk(file: IO[bytes]) -> None:
    """Write a file through to the disk."""
    file.flush()
    os.fsync(file.fileno())


def is_same(path: Path, artifact: ArtifactView) -> bool:
    """Return whether a file is identical to an artifact."""
    try:
        if path.stat().st_size != artifact.size:
            return False
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == artifact.sha256
    except OSError:
        return False
