"""Documents that only HTTP knows; those about jobs are `meshdeform.api.jobs`."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, SkipValidation

from meshdeform.requests.document import ResolvedParams

__all__ = [
    "AssetFound",
    "FileLimits",
    "Health",
    "JobEstimate",
    "JobLimits",
    "LimitList",
    "ModelList",
    "ModelView",
    "PartHealth",
    "Problem",
    "Readiness",
    "RequestLimits",
    "UploadLimits",
    "UploadView",
    "Validation",
    "VocabularyView",
]

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


class Problem(BaseModel):
    """An error, as RFC 9457 has it. Programs compare `code`, which is stable; more members may follow."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="A URN with the code.", examples=["urn:meshdeform:problem:parameter_invalid"])
    title: str = Field(
        description="The same sentence for every occurrence.", examples=["A parameter is unknown or out of range"]
    )
    status: int = Field(ge=400, le=599, description="The HTTP status.", examples=[422])
    detail: str = Field(description="About this occurrence.", examples=["params.steps: Input should be at least 1"])
    code: str = Field(description="What happened, in a word that never changes.", examples=["parameter_invalid"])
    advice: str = Field(description="What to do.", examples=["Fix the members that `errors` names."])
    instance: str = Field(description="The path that was asked for.", examples=["/v1/jobs"])
    request_id: str | None = Field(
        None,
        description="The request's id, as the header `X-Request-ID` and the server's log have it.",
        examples=["req_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    errors: list[dict[str, Any]] | None = Field(
        None,
        description="Where parameters are wrong: the place (`loc`), what is wrong (`msg`) and its kind (`type`).",
        examples=[[{"loc": ["params", "steps"], "msg": "Input should be at least 1", "type": "greater_than_equal"}]],
    )


class Health(BaseModel):
    """The process lives."""

    status: Literal["ok"] = Field("ok", description="Always `ok`.", examples=["ok"])
    version: str = Field(description="Version of Meshdeform.", examples=["0.1.0"])


class PartHealth(BaseModel):
    """Whether one part answers."""

    status: Literal["ok", "unavailable"] = Field(description="Whether it answers.", examples=["ok"])
    detail: str = Field("", description="What is wrong, where something is.", examples=["Redis does not answer."])


class Readiness(BaseModel):
    """Whether every part answers that the service needs."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` when every part is.", examples=["ok"])
    record: PartHealth = Field(description="The database.")
    redis: PartHealth = Field(description="The queue.")
    store: PartHealth = Field(description="The object store.")


class AssetFound(BaseModel):
    """What there is to deform in a file."""

    filename: str = Field(description="Its name, as it was sent.", examples=["sphere.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])
    format: str = Field(description="`glb`, `gltf`, `obj`, `ply` or `stl`.", examples=["glb"])
    vertices: int = Field(ge=0, description="Vertices in the default scene, every instance counted.", examples=[642])
    triangles: int = Field(ge=0, description="Triangles in the default scene, likewise.", examples=[1280])
    meshes: int = Field(ge=0, description="Instances of meshes in the default scene.", examples=[1])
    extensions: list[str] = Field(description="Extensions of glTF that it uses.", examples=[["KHR_materials_unlit"]])
    skipped: list[dict[str, Any]] = Field(description="What is left as it is, and why.", examples=[[]])


class JobEstimate(BaseModel):
    """How long a job would take, by what the record knows of others."""

    queue_s: float | None = Field(
        None, ge=0.0, description="Seconds until a worker takes it; null where that is not known.", examples=[12.5]
    )
    run_s: float | None = Field(
        None, ge=0.0, description="Seconds from then to its end; null where that is not known.", examples=[90.0]
    )
    basis: str = Field(description="What that is told from.", examples=["20 jobs of this kind and model"])


class Validation(BaseModel):
    """A job that would be accepted."""

    valid: Literal[True] = Field(True, description="Always true: anything else is a problem.", examples=[True])
    asset: AssetFound = Field(description="What there is to deform.")
    target: AssetFound | None = Field(None, description="The second mesh of `target` guidance.")
    # Of the job's kind: only those of `text_deform` are `ResolvedParams`.
    params: SkipValidation[SerializeAsAny[ResolvedParams]] = Field(
        description="Every parameter with the value that it would have."
    )
    estimate: JobEstimate = Field(description="How long it would take.")


class FileLimits(BaseModel):
    """What one file may cost."""

    formats: list[str] = Field(description="Formats that are read.", examples=[["glb", "obj", "ply", "stl"]])
    max_bytes: int = Field(description="Size of a request's body, and of an upload.", examples=[104857600])
    max_json_bytes: int = Field(description="Size of a GLB's JSON chunk.", examples=[16777216])
    max_json_values: int = Field(description="Values in that JSON.", examples=[500000])
    max_json_depth: int = Field(description="How deep they nest.", examples=[128])
    max_accessor_elements: int = Field(description="Elements of one accessor.", examples=[20000000])
    max_triangles: int = Field(description="Triangles to deform, every instance counted.", examples=[500000])
    max_vertices: int = Field(description="Vertices to deform, likewise.", examples=[2000000])
    max_primitives: int = Field(description="Primitives and morph targets, likewise.", examples=[100000])
    max_check_bytes: int = Field(
        description="Memory that the check of the largest file may take; less for smaller ones.", examples=[2214592512]
    )
    max_check_s: float = Field(description="Seconds that the check of a file may take.", examples=[30.0])


class JobLimits(BaseModel):
    """What a job may ask for."""

    max_document_bytes: int = Field(description="Size of the JSON document.", examples=[262144])
    max_steps: int = Field(description="Optimiser steps.", examples=[50000])
    max_prompt_characters: int = Field(description="Length of the prompt.", examples=[1000])
    max_filename_characters: int = Field(
        description="Length of a file's name; of a longer one the end is kept.", examples=[200]
    )
    max_metadata_entries: int = Field(description="Labels.", examples=[32])
    max_metadata_name_characters: int = Field(description="Length of a label's name.", examples=[64])
    max_metadata_value_characters: int = Field(description="Length of a label's value.", examples=[500])
    min_priority: int = Field(description="Lowest priority.", examples=[-100])
    max_priority: int = Field(description="Greatest priority.", examples=[100])
    max_deadline_s: float = Field(description="Longest `deadline_s`.", examples=[2678400])
    max_retention_s: float = Field(description="Longest `retention_s`.", examples=[316224000])
    default_retention_s: float | None = Field(
        description="`retention_s` of a job that says nothing; null: it is kept.", examples=[604800]
    )


class RequestLimits(BaseModel):
    """What requests may do."""

    requests_per_minute: int | None = Field(description="Requests of this API key; null: any.", examples=[600])
    max_active_jobs: int | None = Field(description="Unfinished jobs of this API key; null: any.", examples=[1000])
    max_page: int = Field(description="Length of a page of a list.", examples=[200])
    max_wait_s: int = Field(description="Longest `Prefer: wait`.", examples=[60])
    max_idempotency_key_characters: int = Field(description="Length of an `Idempotency-Key`.", examples=[255])
    idempotency_kept_s: float = Field(description="How long such a key is known.", examples=[86400])
    max_bodies_at_once: int = Field(
        description="Bodies with files that one process of the server receives at the same time.", examples=[16]
    )
    max_own_bodies_at_once: int = Field(description="How many of these may be one owner's.", examples=[8])
    max_body_idle_s: float = Field(
        description="Seconds after which a body that does not come is given up.", examples=[60]
    )
    min_body_rate: int = Field(
        description="Bytes per second at which a body must arrive on average, after that time.", examples=[32768]
    )


class UploadLimits(BaseModel):
    """What uploads may do."""

    max_bytes: int = Field(description="Size.", examples=[104857600])
    max_uploads: int | None = Field(
        description="Uploads of one owner that no job has used; null: any.", examples=[1000]
    )
    max_uploads_bytes: int | None = Field(description="Bytes of these altogether; null: any.", examples=[21474836480])
    ttl_s: float = Field(description="How long one is kept that no job has used.", examples=[86400])
    signed_url_ttl_s: float = Field(description="How long its signed URL is valid.", examples=[3600])


class LimitList(BaseModel):
    """Everything that a caller controls, with its limit."""

    files: FileLimits = Field(description="Assets and targets.")
    jobs: JobLimits = Field(description="The request document.")
    requests: RequestLimits = Field(description="HTTP.")
    uploads: UploadLimits = Field(description="`POST /v1/uploads`.")


class VocabularyView(BaseModel):
    """All that a model understands."""

    nouns: list[str] = Field(description="The things that it makes; a prompt names one.", examples=[["giraffe"]])
    attributes: list[str] = Field(
        description="What a thing, or a part of it, can be.", examples=[["tall", "long neck", "short neck"]]
    )
    parts: dict[str, list[str]] = Field(
        description="By noun: the parts that it has.", examples=[{"giraffe": ["head", "legs", "neck"]}]
    )
    max_attributes: int = Field(ge=0, description="Attributes of one prompt.", examples=[3])
    examples: list[str] = Field(
        description="Prompts that it understands.", examples=[["a giraffe with a long neck", "a tall vase"]]
    )


class ModelView(BaseModel):
    """A model that jobs may name."""

    id: str = Field(description="What `params.model` says.", examples=["builtin"])
    title: str = Field(description="Its name, for people.", examples=["Builtin"])
    description: str = Field(
        description="What it is for, for people.", examples=["The small demonstration model that comes along."]
    )
    available: bool | None = Field(
        description="Whether it can be loaded; null where only the workers' machines know.", examples=[True]
    )
    problem: str | None = Field(description="Why it is not available, and what to do; else null.", examples=[None])
    vocabulary: VocabularyView | None = Field(description="All that it understands; null: any prompt.")


class ModelList(BaseModel):
    """The models of this server."""

    default: str = Field(description="The one that jobs get that name none.", examples=["builtin"])
    models: list[ModelView] = Field(description="The default one first.")


class UploadView(BaseModel):
    """A file that is uploaded by itself, to be named by jobs."""

    id: str = Field(description="To name it in `asset` or `target`.", examples=["upl_01kg9zqk2xf3v8c5m7n9p1r4t6"])
    filename: str = Field(description="Its name.", examples=["knight.glb"])
    size: int = Field(ge=1, description="Bytes that it will have.", examples=[30720])
    state: Literal["open", "complete"] = Field(
        description="`open`: bytes may come. `complete`: jobs may name it.", examples=["open"]
    )
    offset: int = Field(ge=0, description="Bytes that have come.", examples=[0])
    sha256: str | None = Field(
        None,
        description="SHA-256 of its bytes: as announced while it is open, as verified once it is complete.",
        examples=[_SHA256],
    )
    created_at: datetime = Field(description="UTC.", examples=["2026-01-31T12:00:00Z"])
    expires_at: datetime = Field(
        description="When it is deleted unless a job has used it, UTC.", examples=["2026-02-01T12:00:00Z"]
    )
    method: str | None = Field(None, description="How to send the bytes; null once it is complete.", examples=["PUT"])
    url: str | None = Field(
        None,
        description="Where to send them: absolute, or a path of this server. The signature in it is the permission; "
        "no API key goes along. Null once it is complete.",
        examples=["/v1/uploads/upl_01kg9zqk2xf3v8c5m7n9p1r4t6/content?expires=1769950800&signature=3b1f"],
    )
    url_expires_at: datetime | None = Field(
        None, description="Until when the URL is valid, UTC; `GET` gives a new one.", examples=["2026-01-31T13:00:00Z"]
    )
    headers: dict[str, str] = Field(
        default_factory=dict,
        description="Headers to send with the bytes.",
        examples=[{"Content-Type": "application/octet-stream"}],
    )
    resumable: bool = Field(
        False,
        description="Whether the bytes may come in several requests, each with `Content-Range`.",
        examples=[True],
    )
