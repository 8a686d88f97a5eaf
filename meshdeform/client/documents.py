"""Define the documents that the client reads, accepting additions by newer services.

The documents of jobs are those of `meshdeform.api.jobs`. Unknown members are in `model_extra`; unknown names (of a
state, an event, a kind of job) are members of their enumeration that only have a `value`; unknown or out-of-range
parameters are attributes of `params`.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidationError,
    WrapValidator,
    model_serializer,
)

from meshdeform.api import jobs as views
from meshdeform.api.states import EventType, JobError, JobState, OriginMode, Progress
from meshdeform.errors import UnavailableError
from meshdeform.requests.choices import member_of
from meshdeform.requests.document import DeformParams, JobKind, OutputOptions, ResolvedParams

M = TypeVar("M", bound=BaseModel)
_OPEN = ConfigDict(frozen=True, extra="allow", protected_namespaces=())


class _Open(BaseModel):
    model_config = _OPEN


def _named(names: type[StrEnum]) -> WrapValidator:
    def validate(value: Any, known: Callable[[Any], Any]) -> Any:
        try:
            return known(value)
        except ValidationError:
            if not isinstance(value, str):
                raise
            return member_of(names, value)

    return WrapValidator(validate)


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


class _Output(_AsItCame, OutputOptions):
    model_config = _OPEN


class _Progress(Progress):
    model_config = _OPEN


class _JobError(JobError):
    model_config = _OPEN


class _FileView(views.FileView):
    model_config = _OPEN


class _OriginView(views.OriginView):
    model_config = _OPEN

    mode: Annotated[OriginMode, _named(OriginMode)]


class ArtifactView(views.ArtifactView):
    """A result of a job."""

    model_config = _OPEN


class JobView(views.JobView):
    """A job."""

    model_config = _OPEN

    kind: Annotated[JobKind, _named(JobKind)]
    state: Annotated[JobState, _named(JobState)]
    params: Annotated[DeformParams, _else(_Params), SerializeAsAny()]
    output: Annotated[OutputOptions, _else(_Output), SerializeAsAny()]
    files: dict[str, _FileView] = Field(default_factory=dict)  # type: ignore[assignment]
    asset: _FileView
    target: _FileView | None = None
    origin: _OriginView | None = None
    error: _JobError | None = None
    progress: _Progress
    artifacts: list[ArtifactView] = Field(default_factory=list)  # type: ignore[assignment]

    def as_json(self) -> dict[str, Any]:
        """Return the JSON document, with only those parameters that the request set."""
        params = self.params.model_dump(mode="json", exclude_unset=True)
        return {**super().as_json(), "params": params}


class JobList(_Open):
    """A page of jobs, newest first."""

    jobs: list[JobView]
    next_cursor: str | None = None


class RetriedJob(views.RetriedJob):
    """A failed job, and what became of its retry."""

    model_config = _OPEN


class RetriedJobs(_Open):
    """A page of failed jobs, newest first."""

    jobs: list[RetriedJob]
    next_cursor: str | None = None


class EventView(views.EventView):
    """Something that happened to a job."""

    model_config = _OPEN

    type: Annotated[EventType, _named(EventType)]


class ArtifactList(_Open):
    """The results of a job, sorted by name."""

    artifacts: list[ArtifactView]


class SignedUrl(views.SignedUrl):
    """An absolute URL that needs no API key."""

    model_config = _OPEN


class CheckpointView(views.CheckpointView):
    """A checkpoint from which a job can continue or be branched."""

    model_config = _OPEN


class CheckpointList(_Open):
    """The checkpoints of a job, sorted by step."""

    checkpoints: list[CheckpointView]


class AssetFound(_Open):
    """The contents of an asset file."""

    filename: str
    size: int
    sha256: str
    format: str
    vertices: int
    triangles: int
    meshes: int
    extensions: list[str]
    skipped: list[dict[str, Any]]
    nodes: list[dict[str, Any]] = Field(default_factory=list)
    materials: list[dict[str, Any]] = Field(default_factory=list)
    mesh_names: list[dict[str, Any]] = Field(default_factory=list)
    joints: list[dict[str, Any]] = Field(default_factory=list)
    warnings: list[str] = Field(default_factory=list)


class PictureFound(_Open):
    """The silhouette in a picture."""

    filename: str
    size: int
    sha256: str
    format: str
    width: int
    height: int
    box: list[float]
    share: float


class JobEstimate(_Open):
    """The estimated time of a job in seconds; None if unknown."""

    queue_s: float | None = None
    run_s: float | None = None
    basis: str = ""
    steps: int = 0


class Validation(_Open):
    """The result of checking a valid job."""

    valid: bool = True
    files: dict[str, AssetFound] = Field(default_factory=dict)
    pictures: dict[str, PictureFound] = Field(default_factory=dict)
    asset: AssetFound
    target: AssetFound | None = None
    params: Annotated[ResolvedParams, _else(_Resolved), SerializeAsAny()]
    estimate: JobEstimate


class FileLimits(_Open):
    """Limits on a file."""

    formats: list[str]
    max_bytes: int
    max_triangles: int
    max_vertices: int


class JobLimits(_Open):
    """Limits on a job."""

    max_steps: int
    max_prompt_characters: int
    max_stored_bytes: int | None = None


class RequestLimits(_Open):
    """Limits on requests; None means unlimited."""

    requests_per_minute: int | None = None
    max_active_jobs: int | None = None
    max_page: int
    max_wait_s: int


class UploadLimits(_Open):
    """Limits on uploads."""

    max_bytes: int
    max_uploads: int | None = None
    max_uploads_bytes: int | None = None
    ttl_s: float


class KindInfo(_Open):
    """A kind of job: its files, the JSON schema of its parameters, and its artifacts."""

    name: str
    summary: str = ""
    reads: list[dict[str, Any]] = Field(default_factory=list)
    params: dict[str, Any] = Field(default_factory=dict)
    artifacts: list[dict[str, Any]] = Field(default_factory=list)


class Limits(_Open):
    """All limits of a service. Those without a field here are in `model_extra`."""

    files: FileLimits
    jobs: JobLimits
    requests: RequestLimits
    uploads: UploadLimits
    kinds: list[KindInfo] = Field(default_factory=list)


class Vocabulary(_Open):
    """The words that a model knows."""

    nouns: list[str]
    attributes: list[str]
    examples: list[str] = Field(default_factory=list)
    groups: dict[str, list[str]] = Field(default_factory=dict)


class Lesson(_Open):
    """What the builtin model was taught."""

    noun: str
    synonyms: list[str] = Field(default_factory=list)
    attributes: list[str] = Field(default_factory=list)
    meshes: list[str] = Field(default_factory=list)
    licence: str = ""
    date: str = ""
    steps: int = 0
    seed: int = 0


class ModelView(_Open):
    """A model that jobs may use in `params.guidance.model`."""

    id: str
    title: str = ""
    description: str = ""
    available: bool = True
    vocabulary: Vocabulary | None = None
    licence: str = ""
    lessons: list[Lesson] = Field(default_factory=list)


class ModelList(_Open):
    """The models, and the default one."""

    default: str
    models: list[ModelView]


class FoundOrientation(_Open):
    """The side of an asset that a job would make the front: its azimuth, from +Z (0) towards +X (90)."""

    turn_deg: float
    source: str
    margin: float | None = None
    grades: list[list[float]] = Field(default_factory=list)
    notice: str | None = None


class PartChange(_Open):
    """An operation that suits a part, with the words for more and for less of it: "legs longer by 30 %"."""

    operation: str
    more: str
    less: str


class FoundPart(_Open):
    """A part that words can name; its triangles are as `faces` of a region has them."""

    name: str
    found_by: str
    faces: list[int | list[int]]
    changes: list[PartChange] = Field(default_factory=list)


class FoundParts(_Open):
    """The parts of an asset, or those that a prompt names and what it makes of the asset, a GLB in base64."""

    parts: list[FoundPart]
    result: str | None = None
    warnings: list[str] = Field(default_factory=list)

    @property
    def glb(self) -> bytes | None:
        """What the prompt makes of the asset."""
        return None if self.result is None else base64.b64decode(self.result)


class UploadView(_Open):
    """A file uploaded separately, for use in jobs."""

    id: str
    filename: str
    size: int
    state: str
    offset: int
    sha256: str | None = None
    created_at: datetime
    expires_at: datetime
    method: str | None = None
    url: str | None = None
    url_expires_at: datetime | None = None
    headers: dict[str, str] = Field(default_factory=dict)
    resumable: bool = False


class SketchParameter(_Open):
    """A parameter of a family of shapes: a number from `minimum` to `maximum`, or one of `options`."""

    name: str
    value: float | str
    default: float | str
    minimum: float | None = None
    maximum: float | None = None
    options: list[str] | None = None


class SketchGuess(_Open):
    """One reading of a drawing; `mesh` is its shape as a GLB in base64."""

    family: str
    probability: float
    parameters: list[SketchParameter]
    mesh: str

    @property
    def values(self) -> dict[str, float | str]:
        """The parameters by name."""
        return {each.name: each.value for each in self.parameters}

    @property
    def glb(self) -> bytes:
        """The shape."""
        return base64.b64decode(self.mesh)


class SketchGuesses(_Open):
    """What a drawing may show, the likeliest first."""

    guesses: list[SketchGuess]
    unsure: bool = False


def read(model: type[M], document: Any, url: str) -> M:
    """Parse a document of the service."""
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UnavailableError(
            f"{url} answered with a document that this client does not understand ({place}: {first['msg']}).",
            advice="Check the service's address, and that client and service have compatible versions.",
        ) from error
