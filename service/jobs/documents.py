"""Define the JSON documents in the bodies of requests."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from meshdeform.api.limits import MAX_FILENAME, MAX_INLINE_BYTES, MAX_PREVIEWED
from meshdeform.outgoing.addresses import MAX_URL
from meshdeform.record.ids import JOB_ID_PATTERN, id_pattern
from meshdeform.requests.document import MAX_DEADLINE_S, JobRequest
from meshdeform.requests.parameters import MAX_SEED

UPLOAD_ID_PATTERN = id_pattern("upl")
SHA256_PATTERN = r"^[0-9a-fA-F]{64}$"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_Field = Annotated[str, StringConstraints(min_length=1, max_length=64)]
_Sha256 = Annotated[str, StringConstraints(to_lower=True, pattern=SHA256_PATTERN)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Reference(_Strict):
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
        every = ("upload_id", "job_id", "url", "data", "sha256")
        ways = [name for name in every if name in type(self).model_fields]
        named = [name for name in ways if getattr(self, name) is not None]
        if len(named) != 1:
            raise ValueError(f"name {'either ' if len(ways) == 2 else 'one of '}{', '.join(ways[:-1])} or {ways[-1]}")
        if named != ["job_id"] and "artifact" in self.model_fields_set:
            raise ValueError(f"artifact goes with job_id, not with {named[0]}")
        return self


class FileReference(_Reference):
    """A stored file: a complete upload, or an artifact of a job that has succeeded."""


class FileSource(_Reference):
    """A file that is not sent along: stored, to be fetched from a URL, or in the document itself as base64."""

    url: str | None = Field(
        None,
        max_length=MAX_URL,
        description="An `https` URL on the public internet that answers with the file, without redirects.",
        examples=["https://example.org/models/sphere.glb"],
    )
    data: str | None = Field(
        None,
        description=f"The file as base64, or a `data:` URI of it. The whole document may have {MAX_INLINE_BYTES >> 20} "
        "MiB.",
        json_schema_extra={"contentEncoding": "base64"},
        examples=["Z2xURgIAAAA..."],
    )
    filename: str = Field(
        "",
        max_length=MAX_FILENAME,
        description="The file's name, with `url` and `data`; its extension distinguishes OBJ, PLY and STL. Default: "
        "the last part of the URL.",
        examples=["sphere.glb"],
    )

    @property
    def is_own(self) -> bool:
        """Whether the file is not stored yet."""
        return self.url is not None or self.data is not None


class _WithFiles(JobRequest):
    files: Mapping[_Field, FileReference | FileSource] = Field(default_factory=dict)
    # The members that name a file of their own, beside those in `files`.
    _named: ClassVar[tuple[str, ...]] = ()

    @property
    def references(self) -> dict[str, tuple[FileReference | FileSource, list[str]]]:
        """The files that the document names by field, each with its location in the document."""
        own = {name: getattr(self, name) for name in self._named}
        return {
            **{name: (reference, ["files", name]) for name, reference in self.files.items()},
            **{name: (reference, [name]) for name, reference in own.items() if reference is not None},
        }

    @model_validator(mode="after")
    def _once(self) -> Self:
        for name in self._named:
            if getattr(self, name) is not None and name in self.files:
                raise ValueError(f"{name} is also in files; leave one of the two out")
        return self


class JobDocument(_WithFiles):
    """A job request, with references to the files that are not sent along."""

    files: dict[_Field, FileSource] = Field(
        default_factory=dict,
        description="The files that are not sent along, by the names of their fields; `GET /v1/limits` lists the "
        "fields of each kind of job. Default: none.",
        examples=[{"asset": {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}}],
    )
    asset: FileSource | None = Field(
        None,
        description="The file to deform, unless it is sent as the field `asset`. The same as `files.asset`.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )
    target: FileSource | None = Field(
        None,
        description="The second mesh of `target` guidance, unless it is sent as the field `target`. The same as "
        "`files.target`.",
        examples=[{"job_id": "job_01kg9zqk2xf3v8c5m7n9p1r4t6", "artifact": "result.glb"}],
    )

    _named = ("asset", "target")

    @property
    def sources(self) -> dict[str, tuple[FileSource, list[str]]]:
        """The files that are to be fetched from a URL, or that the document holds; as in `references`."""
        every = self.references.items()
        return {name: (each, at) for name, (each, at) in every if isinstance(each, FileSource) and each.is_own}

    def without(self, fields: Collection[str]) -> Self:
        """Return the document without the references of these fields, as if they had been sent along."""
        members = {name for name in self._named if name in fields}
        kept = {name: each for name, each in self.files.items() if name not in fields}
        bare = self.model_copy(update={**dict.fromkeys(members), "files": kept})
        bare.__pydantic_fields_set__.difference_update(members if kept else {*members, "files"})
        return bare


class PreviewSource(FileSource):
    """A file that is not sent along: as for a job, or one of an earlier preview that is still kept."""

    sha256: _Sha256 | None = Field(
        None,
        description="SHA-256 of the asset of an earlier preview of yours, hexadecimal, as long as that is kept.",
        examples=[_SHA256],
    )

    @property
    def is_own(self) -> bool:
        """Whether the file is not stored."""
        return super().is_own or self.sha256 is not None


class PreviewDocument(JobDocument):
    """A request for a job, and the seeds whose results are to be seen before it is sent."""

    asset: PreviewSource | None = Field(
        None,
        description="The file to deform, unless it is sent as the field `asset`.",
        examples=[{"sha256": _SHA256}],
    )
    seeds: list[Annotated[int, Field(ge=0, le=MAX_SEED)]] = Field(
        default_factory=list,
        max_length=MAX_PREVIEWED,
        description="The seeds whose shapes are wanted, instead of `params.seed`. Default: that.",
        examples=[[0, 1, 2, 3, 4, 5]],
    )


class BranchDocument(_WithFiles):
    """A request for a job that starts from a checkpoint of another job and has the same required files."""

    files: dict[_Field, FileReference] = Field(
        default_factory=dict,
        description="Optional files by the names of their fields. Default: those of the other job that the request "
        "uses.",
        examples=[{"target": {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}}],
    )
    target: FileReference | None = Field(
        None,
        description="The second mesh of `target` guidance, the same as `files.target`. Default: that of the job.",
        examples=[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}],
    )

    _named = ("target",)


class RetryDocument(_Strict):
    """What a retry changes in the request of its job."""

    max_run_s: float | None = Field(
        None,
        ge=1.0,
        le=MAX_DEADLINE_S,
        description="Seconds for which the new job may run. Default: as for the job that is retried.",
        examples=[7200],
    )


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
