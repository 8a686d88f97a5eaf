"""Define the JSON documents in the bodies of requests."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from meshdeform.api.limits import MAX_FILENAME
from meshdeform.record.ids import JOB_ID_PATTERN, id_pattern
from meshdeform.requests.document import JobRequest

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
        pattern=r"^[\w.-]{1,128}$",
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


class JobDocument(JobRequest):
    """A job request, with references to the files that are not sent along."""

    asset: FileReference | None = Field(
        None,
        description="The file to deform, unless it is sent as the part `asset`.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )
    target: FileReference | None = Field(
        None,
        description="The second mesh of `target` guidance, unless it is sent as the part `target`.",
        examples=[{"job_id": "job_01kg9zqk2xf3v8c5m7n9p1r4t6", "artifact": "result.glb"}],
    )


class BranchDocument(JobRequest):
    """A request for a job that starts from a checkpoint of another job and deforms the same asset."""

    target: FileReference | None = Field(
        None,
        description="The second mesh of `target` guidance. Default: the other job's target.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )


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
