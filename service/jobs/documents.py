"""Define the JSON documents in the bodies of requests."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from meshdeform.api.limits import MAX_FILENAME
from meshdeform.record.ids import JOB_ID_PATTERN, id_pattern
from meshdeform.requests.document import DeformParams, JobRequest
from meshdeform.requests.models import WEIGHTS_PART, teaching_job
from meshdeform.runs.sent_weights import WEIGHTS_ARTIFACT

__all__ = [
    "SHA256_PATTERN",
    "UPLOAD_ID_PATTERN",
    "BranchDocument",
    "FileReference",
    "JobDocument",
    "UploadCompletion",
    "UploadDocument",
]

UPLOAD_ID_PATTERN = id_pattern("upl")
SHA256_PATTERN = r"^[0-9a-fA-F]{64}$"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FileReference(_Strict):
    """A stored file: a complete upload, or an artifact of a job that has succeeded."""

    upload_id: str | None = Field(
        None,
        pattern=UPLOAD_ID_PATTERN,
        description="The id of a complete upload. Give either this or `job_id`.",
        examples=["upl_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    job_id: str | None = Field(
        None,
        pattern=JOB_ID_PATTERN,
        description="The id of a job that has succeeded. Give either this or `upload_id`.",
        examples=["job_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    artifact: str = Field(
        "result.glb",
        # Not `{1,128}` in the expression: all letters of Unicode would be in memory 128 times.
        max_length=128,
        pattern=r"^[\w.-]+$",
        description="The name of the job's artifact.",
        examples=["result.glb"],
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.upload_id is None) == (self.job_id is None):
            raise ValueError("name either upload_id or job_id")
        if self.upload_id is not None and "artifact" in self.model_fields_set:
            raise ValueError("artifact goes with job_id, not with upload_id")
        return self


_Files = dict[Annotated[str, StringConstraints(min_length=1, max_length=64)], FileReference]


class _WithFiles(JobRequest):
    files: _Files = Field(default_factory=dict)
    # The members that name a file of their own, beside those in `files`.
    _named: ClassVar[tuple[str, ...]] = ()

    @property
    def _place_of_model(self) -> list[str]:
        params: Any = self.params  # of any kind of job
        return ["params", *(["guidance"] if isinstance(params, DeformParams) else []), "model"]

    @property
    def references(self) -> dict[str, tuple[FileReference, list[str]]]:
        """The files that the document names by part, each with its place in the document."""
        own = {name: getattr(self, name) for name in self._named}
        teacher = teaching_job(getattr(self.params, "model", None) or "")
        taught = {} if teacher is None else {WEIGHTS_PART: (_result_of(teacher), self._place_of_model)}
        return {
            **taught,
            **{name: (reference, ["files", name]) for name, reference in self.files.items()},
            **{name: (reference, [name]) for name, reference in own.items() if reference is not None},
        }

    @model_validator(mode="after")
    def _once(self) -> Self:
        for name in self._named:
            if getattr(self, name) is not None and name in self.files:
                raise ValueError(f"{name} is also in files; leave one of the two out")
        model: str = getattr(self.params, "model", None) or ""
        place = ".".join(self._place_of_model)
        if (teacher := teaching_job(model)) is not None:
            if not re.fullmatch(JOB_ID_PATTERN, teacher):
                raise ValueError(f"{place} is {model!r}; after `job:` stands the id of a job")
            if WEIGHTS_PART in self.files:
                raise ValueError(f"files.{WEIGHTS_PART} is also {place}; leave one of the two out")
        return self


def _result_of(job_id: str) -> FileReference:
    return FileReference(job_id=job_id, artifact=WEIGHTS_ARTIFACT)


class JobDocument(_WithFiles):
    """A job request, with references to the files that are not sent along."""

    files: _Files = Field(
        default_factory=dict,
        description="The files that are not sent along, by the names of their parts; `GET /v1/limits` lists the "
        "parts of each kind of job. Default: none.",
        examples=[{"asset": {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}}],
    )
    asset: FileReference | None = Field(
        None,
        description="The file to deform, unless it is sent as the part `asset`. The same as `files.asset`.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )
    target: FileReference | None = Field(
        None,
        description="The second mesh of `target` guidance, unless it is sent as the part `target`. The same as "
        "`files.target`.",
        examples=[{"job_id": "job_01kg9zqk2xf3v8c5m7n9p1r4t6", "artifact": "result.glb"}],
    )

    _named = ("asset", "target")


class BranchDocument(_WithFiles):
    """A request for a job that starts from a checkpoint of another job and has the same required files."""

    files: _Files = Field(
        default_factory=dict,
        description="Optional files by the names of their parts. Default: those of the other job that the request "
        "uses.",
        examples=[{"target": {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}}],
    )
    target: FileReference | None = Field(
        None,
        description="The second mesh of `target` guidance, the same as `files.target`. Default: that of the job.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )

    _named = ("target",)


_Sha256 = Annotated[str, StringConstraints(to_lower=True, pattern=SHA256_PATTERN)]


class UploadDocument(_Strict):
    """A file to be uploaded."""

    filename: str = Field(
        min_length=1,
        max_length=MAX_FILENAME,
        description="The file's name. Its extension distinguishes OBJ, PLY and STL.",
        examples=["knight.glb"],
    )
    size: int = Field(ge=1, description="The file's size in bytes.", examples=[30720])
    sha256: _Sha256 | None = Field(
        None, description="SHA-256 of the file, hexadecimal. Default: given on completion.", examples=[_SHA256]
    )


class UploadCompletion(_Strict):
    """The completion of an upload."""

    sha256: _Sha256 = Field(description="SHA-256 of the file, hexadecimal.", examples=[_SHA256])
