"""Jobs and what belongs to them, as frozen values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.api.states import TERMINAL_STATES as TERMINAL_STATES
from meshdeform.api.states import EventType as EventType
from meshdeform.api.states import JobError as JobError
from meshdeform.api.states import JobState as JobState
from meshdeform.api.states import OriginMode as OriginMode
from meshdeform.api.states import Progress as Progress
from meshdeform.api.states import WebhookEvent as WebhookEvent
from meshdeform.errors import UnreadableJobError
from meshdeform.requests.document import MAX_PRIORITY, JobKind, JobRequest, read_stored


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True)


class StoredFile(_Frozen):
    """An uploaded file in the object store."""

    key: str
    filename: str
    size: int
    sha256: str


class Artifact(_Frozen):
    """A stored result of a job."""

    name: str
    content_type: str
    size: int
    sha256: str
    key: str
    created_at: datetime = Field(default_factory=lambda: datetime.now(UTC))
    warnings: list[str] | None = None
    """Sentences about what its format cannot hold; None if there are none."""


class Origin(_Frozen):
    """The job that another job continues, which may have been deleted since."""

    job_id: str
    step: int
    mode: OriginMode
    """`retry`: the same request resumes as if never interrupted. `branch`: a different request starts with that shape.
    """
    # The object with the copy of its checkpoint; empty for a retry that starts from the beginning
    key: str = ""
    sha256: str = ""
    size: int = 0  # bytes of that object; 0 if unknown
    made_by: str = ""  # the versions that computed it, in order; empty if unknown


class Event(_Frozen):
    """An event of a job."""

    job_id: str
    seq: int
    type: EventType
    at: datetime
    attempt: int
    data: dict[str, Any]


@dataclass(frozen=True)
class CheckpointRef:
    """A stored checkpoint, and the mesh of that step if it was stored."""

    key: str
    step: int
    attempt: int
    sha256: str
    size: int = 0
    mesh_key: str | None = None
    mesh_sha256: str | None = None
    mesh_size: int | None = None
    created_at: datetime | None = None
    made_by: str | None = None  # the versions that computed it, in order; None if unknown


class Job(_Frozen):
    """One request, as recorded, by this version or any other one."""

    id: str
    kind: JobKind = JobKind.TEXT_DEFORM
    """The kind of the job, which this version need not know."""
    state: JobState
    document: dict[str, Any]
    """The request, as stored."""
    priority: int = 0
    resolved: dict[str, Any] | None = None
    """The values of all parameters; None for jobs of older versions."""
    files: dict[str, StoredFile]
    """Its files by the names of the fields of its kind."""
    error: JobError | None = None
    created_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    progress: Progress = Field(default_factory=Progress)
    attempt: int = 0
    version: int = 1
    owner_id: str = ""
    origin: Origin | None = None
    deadline_at: datetime | None = None
    retain_until: datetime | None = None
    retry_at: datetime | None = None
    """When a job that waits after a failure is tried again."""
    oom_attempts: int = 0
    ran_s: float = 0.0
    """Seconds for which its attempts ran, without one that runs now."""
    event_seq: int = 0
    request_id: str | None = None
    traceparent: str | None = None
    artifacts: tuple[Artifact, ...] = ()
    """The results of a job that has succeeded, by name; read by `JobRecord.get` and `list_jobs` only."""
    faces: int | None = None
    meshes: int | None = None
    """The triangles and meshes of its asset; None if unknown."""
    made_by: str | None = None
    """The versions that computed its results, in order; None if unknown, or there are none."""
    damaged: bool = False
    """Whether its row has other content than any version writes, which is left out here."""

    @cached_property
    def request(self) -> JobRequest:
        """The request; `UnreadableJobError`: it cannot be read in this process, while the rest of the job can."""
        if self.damaged:
            raise UnreadableJobError("The stored request cannot be read here: no version writes such a row.")
        return read_stored(self.document)

    @property
    def unreadable(self) -> str | None:
        """Why `request` cannot be read; None if it can."""
        try:
            _ = self.request
        except UnreadableJobError as error:
            return error.detail
        return None

    @property
    def source(self) -> StoredFile:
        """Its first file, which every kind of job requires that this version knows; else one without a name."""
        return next(iter(self.files.values()), StoredFile(key="", filename="", size=0, sha256=""))

    @property
    def prompt(self) -> str:
        """The text that describes the result."""
        return str(self.document.get("prompt", ""))


@dataclass(frozen=True)
class Claim:
    """An idempotency key held by a request."""

    owner_id: str
    key: str
    token: str


@dataclass(frozen=True)
class NewJob:
    """The content of a new job."""

    request: JobRequest
    files: Mapping[str, StoredFile]  # its files by the names of the fields of its kind; already stored
    fetching: bool = False  # whether its files are still to come (`record.fetching`)
    owner_id: str = ""  # empty if keys are off
    origin: Origin | None = None
    retention_s: float | None = None  # the retention if the request has none
    # Maximum numbers of unfinished jobs of the owner and of bytes that the jobs keep, with this one; 0: no limit
    max_active: int = 0
    max_stored_bytes: int = 0
    max_priority: int = MAX_PRIORITY
    # The HTTP request that created it, for logs and traces
    request_id: str | None = None
    traceparent: str | None = None
    resolved: BaseModel | None = None  # the values of all parameters, as the check of the request returned them
    # The triangles and meshes of its asset, if known
    faces: int | None = None
    meshes: int | None = None
    # The idempotency key of the HTTP request, and what returns the answer from the new job; written with the job
    claim: Claim | None = None
    answer: Callable[[Job], dict[str, Any]] | None = None

    @property
    def sizes(self) -> dict[str, int]:
        """The bytes of the stored files that the job needs, with the checkpoint of its origin, by key; sorted."""
        sizes = {file.key: file.size for file in self.files.values()}
        if self.origin is not None and self.origin.key:
            sizes[self.origin.key] = self.origin.size
        return dict(sorted(sizes.items()))


@dataclass(frozen=True)
class Page:
    """A page of jobs, newest first, and the cursor of the next page; None at the end."""

    jobs: list[Job]
    next_cursor: str | None
