"""Define the documents of the HTTP API that the client does not share; those of jobs are in `meshdeform.api.jobs`."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, SkipValidation

from meshdeform.requests.document import ResolvedParams

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


class Problem(BaseModel):
    """An error in the form of RFC 9457. Programs should compare `code`, which is stable; other members may be added."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="A URN with the code.", examples=["urn:meshdeform:problem:parameter_invalid"])
    title: str = Field(
        description="The same sentence for every error with this code.",
        examples=["A parameter is unknown or out of range"],
    )
    status: int = Field(ge=400, le=599, description="The HTTP status.", examples=[422])
    detail: str = Field(
        description="What is wrong with this request.", examples=["params.steps: Input should be at least 1"]
    )
    code: str = Field(description="A stable name of the error.", examples=["parameter_invalid"])
    advice: str = Field(description="What to do.", examples=["Fix the members that `errors` names."])
    instance: str = Field(description="The path of the request.", examples=["/v1/jobs"])
    request_id: str | None = Field(
        None,
        description="The request's id, also in the header `X-Request-ID` and in the server's log.",
        examples=["req_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    errors: list[dict[str, Any]] | None = Field(
        None,
        description="Invalid members: their place (`loc`), what is wrong (`msg`), and the kind of error (`type`).",
        examples=[[{"loc": ["params", "steps"], "msg": "Input should be at least 1", "type": "greater_than_equal"}]],
    )


class Health(BaseModel):
    """The liveness of the process."""

    status: Literal["ok"] = Field("ok", description="Always `ok`.", examples=["ok"])
    version: str = Field(description="Version of Meshdeform.", examples=["0.1.0"])


class PartHealth(BaseModel):
    """The availability of one dependency."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` if it responds.", examples=["ok"])
    detail: str = Field("", description="What is wrong; empty if nothing is.", examples=["Redis does not respond."])


class Readiness(BaseModel):
    """The availability of everything that the service needs."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` if all of them are.", examples=["ok"])
    record: PartHealth = Field(description="The database.")
    redis: PartHealth = Field(description="The queue.")
    store: PartHealth = Field(description="The object store.")


class PartFound(BaseModel):
    """A node, material, mesh or joint of an asset, which `rigid` and `regions` can name."""

    index: int = Field(ge=0, description="Its index in the file.", examples=[2])
    name: str = Field(description="Its name; empty if it has none.", examples=["wheel-front-left"])


class AssetFound(BaseModel):
    """The contents of an asset file."""

    filename: str = Field(description="Its name, as sent.", examples=["sphere.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])
    format: str = Field(description="`glb`, `gltf`, `obj`, `ply`, `stl` or `zip`.", examples=["glb"])
    vertices: int = Field(ge=0, description="Vertices in the default scene, counting every instance.", examples=[642])
    triangles: int = Field(
        ge=0, description="Triangles in the default scene, counting every instance.", examples=[1280]
    )
    meshes: int = Field(ge=0, description="Mesh instances in the default scene.", examples=[1])
    extensions: list[str] = Field(description="The glTF extensions that it uses.", examples=[["KHR_materials_unlit"]])
    skipped: list[dict[str, Any]] = Field(description="Parts that would not be deformed, and why.", examples=[[]])
    nodes: list[PartFound] = Field(
        description="The first 200 nodes with triangles in or below them; a node without a name has that of its mesh."
    )
    materials: list[PartFound] = Field(description="The first 200 materials in use.")
    mesh_names: list[PartFound] = Field(description="The first 200 meshes in use.")
    joints: list[PartFound] = Field(description="The first 200 joints of the skins in use.")
    warnings: list[str] = Field(
        description="Sentences about anything in the file that may surprise or get in the way.", examples=[[]]
    )


class PictureFound(BaseModel):
    """The silhouette in a picture."""

    filename: str = Field(description="Its name, as sent.", examples=["front.png"])
    size: int = Field(ge=0, description="Bytes.", examples=[20480])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])
    format: str = Field(description="`png`, `jpeg` or `webp`.", examples=["png"])
    width: int = Field(ge=1, description="Pixels.", examples=[1024])
    height: int = Field(ge=1, description="Pixels.", examples=[768])
    box: list[float] = Field(
        min_length=4,
        max_length=4,
        description="Left, top, right and bottom of the silhouette, as shares of the width and height.",
        examples=[[0.1, 0.05, 0.9, 0.95]],
    )
    share: float = Field(ge=0.0, le=1.0, description="Share of the picture that the silhouette covers.", examples=[0.4])


class JobEstimate(BaseModel):
    """The estimated time of a job, based on finished jobs."""

    queue_s: float | None = Field(
        None, ge=0.0, description="Seconds until a worker takes it; null if unknown.", examples=[12.5]
    )
    run_s: float | None = Field(
        None, ge=0.0, description="Seconds from then until it finishes; null if unknown.", examples=[90.0]
    )
    basis: str = Field(description="What the estimate is based on.", examples=["20 jobs of this kind and model"])
    steps: int = Field(0, ge=0, description="Its steps; 0 of a change in plain words.", examples=[200])


class Validation(BaseModel):
    """A valid job."""

    valid: Literal[True] = Field(
        True, description="Always true: an invalid job is reported as a problem.", examples=[True]
    )
    files: dict[str, AssetFound] = Field(description="Its meshes by the names of their parts.")
    pictures: dict[str, PictureFound] = Field(
        default_factory=dict, description="Its pictures by the names of their parts."
    )
    asset: AssetFound = Field(description="The first of `files`: the asset to deform.")
    target: AssetFound | None = Field(None, description="`files.target`, the second mesh of `target` guidance.")
    # Other kinds than `text_deform` have other parameters.
    params: SkipValidation[SerializeAsAny[ResolvedParams]] = Field(
        description="Every parameter, with the value with which the job would run."
    )
    estimate: JobEstimate = Field(description="The time that it would take.")


class FoundOrientation(BaseModel):
    """The side of an asset that a job would make the front."""

    turn_deg: float = Field(
        description="Azimuth of that side, from +Z (0) towards +X (90), -180 to 180.", examples=[-165.0]
    )
    source: Literal["found", "undecided", "unrecognised"] = Field(
        description="`undecided`: no side is clearly the front; `unrecognised`: nothing says what the asset is, so "
        "that +Z stays the front.",
        examples=["found"],
    )
    margin: float | None = Field(
        description="By how much the best turn predicts the pictures better than none or, of two sides, than the "
        "other, relatively.",
        examples=[0.44],
    )
    grades: list[list[float]] = Field(
        description="Pairs of a turn and its grade from the first draws; lower is better.",
        examples=[[[0.0, 0.0561], [180.0, 0.0392]]],
    )
    notice: str | None = Field(description="What to do if no side was found.", examples=[None])


class PartChange(BaseModel):
    """An operation that suits a part."""

    operation: str = Field(description="As in `changes` of the report.", examples=["long"])
    more: str = Field(description='Its word for more: "legs longer by 30 %".', examples=["longer"])
    less: str = Field(description="Its word for less.", examples=["shorter"])


class FoundPart(BaseModel):
    """A part of an asset that words can name."""

    name: str = Field(description="What a prompt calls it.", examples=["legs"])
    found_by: Literal["joints", "names", "components", "geometry"] = Field(
        description="What it was found by.", examples=["joints"]
    )
    faces: list[int | list[int]] = Field(
        description="Its triangles, as `faces` of a region has them.", examples=[[[0, 143], 150]]
    )
    changes: list[PartChange] = Field(description="What can be asked of it.")


class FoundParts(BaseModel):
    """The parts of an asset, or those that a prompt names and what it makes of the asset."""

    parts: list[FoundPart] = Field(description="Those that everybody knows come first.")
    result: str | None = Field(
        description="The asset as a prompt that is a change makes it: a GLB in base64, without `output.subdivide`; its "
        "rig stays where it is. Null without such a prompt.",
        json_schema_extra={"contentEncoding": "base64"},
        examples=[None],
    )
    warnings: list[str] = Field(description="What of it is less than was asked for, in sentences.", examples=[[]])


class FileLimits(BaseModel):
    """Limits on a file."""

    formats: list[str] = Field(description="Supported formats.", examples=[["glb", "obj", "ply", "stl", "zip"]])
    max_bytes: int = Field(description="Bytes of a request's body, and of an upload.", examples=[104857600])
    max_json_bytes: int = Field(description="Bytes of a GLB's JSON chunk.", examples=[16777216])
    max_json_values: int = Field(description="Values in that JSON.", examples=[500000])
    max_json_depth: int = Field(description="Nesting depth of that JSON.", examples=[128])
    max_accessor_elements: int = Field(description="Elements of one accessor.", examples=[20000000])
    max_triangles: int = Field(description="Triangles to deform, counting every instance.", examples=[1000000])
    max_vertices: int = Field(description="Vertices to deform, counting every instance.", examples=[2000000])
    max_primitives: int = Field(description="Primitives and morph targets, counting every instance.", examples=[50000])
    max_check_bytes: int = Field(
        description="Bytes of memory for checking the largest file; less for smaller files.", examples=[2214592512]
    )
    max_check_s: float = Field(description="Seconds for checking a file.", examples=[60.0])


class JobLimits(BaseModel):
    """Limits on a job."""

    max_document_bytes: int = Field(description="Bytes of the JSON document.", examples=[262144])
    max_steps: int = Field(description="Optimiser steps.", examples=[50000])
    max_prompt_characters: int = Field(description="Characters of the prompt.", examples=[1000])
    max_filename_characters: int = Field(
        description="Characters of a file name; only the end of a longer one is kept.", examples=[200]
    )
    max_metadata_entries: int = Field(description="Number of labels.", examples=[32])
    max_metadata_name_characters: int = Field(description="Characters of a label's name.", examples=[64])
    max_metadata_value_characters: int = Field(description="Characters of a label's value.", examples=[500])
    min_priority: int = Field(description="Lowest priority.", examples=[-100])
    max_priority: int = Field(description="Highest priority.", examples=[100])
    max_deadline_s: float = Field(description="Longest `deadline_s`.", examples=[2678400])
    max_run_s: float | None = Field(
        description="Seconds for which a job may run, and largest `max_run_s`; null: unlimited.", examples=[86400]
    )
    max_running_jobs: int | None = Field(
        description="Jobs of one owner that run at the same time; null: unlimited.", examples=[4]
    )
    max_retention_s: float = Field(description="Longest `retention_s`.", examples=[316224000])
    max_stored_bytes: int | None = Field(
        description="Bytes of files, checkpoints and artifacts that the jobs of one owner keep; null: unlimited.",
        examples=[107374182400],
    )
    default_retention_s: float | None = Field(
        description="`retention_s` of a job that sets none; null: such a job is never deleted.", examples=[604800]
    )


class RequestLimits(BaseModel):
    """Limits on requests."""

    requests_per_minute: int | None = Field(
        description="Requests per minute with this API key; null: unlimited.", examples=[600]
    )
    max_active_jobs: int | None = Field(
        description="Unfinished jobs of this API key; null: unlimited.", examples=[1000]
    )
    max_page: int = Field(description="Entries on a page of a list.", examples=[200])
    max_wait_s: int = Field(description="Longest `Prefer: wait`, in seconds.", examples=[60])
    max_idempotency_key_characters: int = Field(description="Characters of an `Idempotency-Key`.", examples=[255])
    idempotency_kept_s: float = Field(description="Seconds for which such a key is remembered.", examples=[86400])
    max_bodies_at_once: int = Field(
        description="Bodies with files that one server process receives at the same time.", examples=[16]
    )
    max_own_bodies_at_once: int = Field(description="How many of these may be one owner's.", examples=[8])
    max_body_idle_s: float = Field(
        description="Seconds without data after which a request's body is abandoned.", examples=[60]
    )
    min_body_rate: int = Field(
        description="Bytes per second at which a body must arrive on average, after that time.", examples=[32768]
    )


class UploadLimits(BaseModel):
    """Limits on uploads."""

    max_bytes: int = Field(description="Bytes.", examples=[104857600])
    max_uploads: int | None = Field(
        description="Uploads of one owner that no job has used; null: unlimited.", examples=[1000]
    )
    max_uploads_bytes: int | None = Field(
        description="Bytes of these altogether; null: unlimited.", examples=[21474836480]
    )
    ttl_s: float = Field(description="Seconds for which an upload that no job uses is kept.", examples=[86400])
    signed_url_ttl_s: float = Field(description="Seconds for which a signed URL is valid.", examples=[3600])


class FilePartView(BaseModel):
    """A file that a kind of job reads."""

    name: str = Field(description="Its part in a form, or its member in `files` of a document.", examples=["asset"])
    summary: str = Field(description="What it is.", examples=["The file to deform: GLB, OBJ, PLY, STL or ZIP."])
    required: bool = Field(description="Whether every job of this kind needs it.", examples=[True])
    media_types: list[str] = Field(description="Its media types.", examples=[["model/gltf-binary"]])


class ArtifactKindView(BaseModel):
    """A result that a kind of job may write."""

    name: str = Field(description="Its name within the job.", examples=["result.glb"])
    media_type: str = Field(description="Its media type.", examples=["model/gltf-binary"])
    summary: str = Field(description="What it is.", examples=["The asset with its new shape."])


class KindView(BaseModel):
    """A kind of job."""

    name: str = Field(description="The value for `kind`.", examples=["text_deform"])
    summary: str = Field(
        description="What it does.",
        examples=["Deforms an asset until its pictures show what a prompt says, or until it looks like a second mesh."],
    )
    reads: list[FilePartView] = Field(description="The files that it reads.")
    params: dict[str, Any] = Field(
        description="JSON schema of its `params`.", examples=[{"type": "object", "properties": {}}]
    )
    artifacts: list[ArtifactKindView] = Field(description="The results that it may write.")


class LimitList(BaseModel):
    """All limits on requests."""

    files: FileLimits = Field(description="Limits on the files of jobs.")
    jobs: JobLimits = Field(description="Limits on the request document.")
    requests: RequestLimits = Field(description="Limits on HTTP requests.")
    uploads: UploadLimits = Field(description="Limits on `POST /v1/uploads`.")
    kinds: list[KindView] = Field(description="The kinds of job.")


class UploadView(BaseModel):
    """A file uploaded separately, for use in jobs."""

    id: str = Field(
        description="Use it in `files`, `asset` or `target` of a job.",
        examples=["upl_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    filename: str = Field(description="Its name.", examples=["knight.glb"])
    size: int = Field(ge=1, description="Bytes of the complete file.", examples=[30720])
    state: Literal["open", "complete"] = Field(
        description="`open`: it accepts bytes. `complete`: jobs may use it.", examples=["open"]
    )
    offset: int = Field(ge=0, description="Bytes received so far.", examples=[0])
    sha256: str | None = Field(
        None,
        description="SHA-256 of its bytes: announced while it is open, verified once it is complete.",
        examples=[_SHA256],
    )
    created_at: datetime = Field(description="UTC.", examples=["2026-01-31T12:00:00Z"])
    expires_at: datetime = Field(
        description="When it is deleted unless a job uses it, UTC.", examples=["2026-02-01T12:00:00Z"]
    )
    method: str | None = Field(
        None, description="HTTP method for sending the bytes; null once it is complete.", examples=["PUT"]
    )
    url: str | None = Field(
        None,
        description="Where to send the bytes: absolute, or a path of this server. It is signed and needs no API key. "
        "Null once the upload is complete.",
        examples=["/v1/uploads/upl_01kg9zqk2xf3v8c5m7n9p1r4t6/content?expires=1769950800&signature=3b1f"],
    )
    url_expires_at: datetime | None = Field(
        None, description="When the URL expires, UTC; `GET` returns a new one.", examples=["2026-01-31T13:00:00Z"]
    )
    headers: dict[str, str] = Field(
        default_factory=dict,
        description="Headers to send with the bytes.",
        examples=[{"Content-Type": "application/octet-stream"}],
    )
    resumable: bool = Field(
        False,
        description="Whether the bytes may be sent in several requests, each with `Content-Range`.",
        examples=[True],
    )


class VocabularyView(BaseModel):
    """The vocabulary of a model."""

    nouns: list[str] = Field(
        description="The objects that it can make; a prompt names one of them.", examples=[["giraffe"]]
    )
    attributes: list[str] = Field(
        description="Properties of an object or of its parts.", examples=[["tall", "long neck", "short neck"]]
    )
    parts: dict[str, list[str]] = Field(
        description="The parts of each noun's object.", examples=[{"giraffe": ["head", "legs", "neck"]}]
    )
    max_attributes: int = Field(ge=0, description="Attributes allowed in one prompt.", examples=[3])
    examples: list[str] = Field(
        description="Examples of prompts.", examples=[["a giraffe with a long neck", "a tall vase"]]
    )
    groups: dict[str, list[str]] = Field(
        default_factory=dict, description="The nouns by kind.", examples=[{"animals": ["giraffe"]}]
    )


class LessonView(BaseModel):
    """What the builtin model was taught by `meshdeform teach`."""

    noun: str = Field(description="The noun.", examples=["gnome"])
    synonyms: list[str] = Field(description="Other names of it.", examples=[["dwarf"]])
    attributes: list[str] = Field(description="Attributes that its meshes were labelled with.", examples=[["tall"]])
    meshes: list[str] = Field(description="The names of its meshes.", examples=[["round.glb", "tall/garden.obj"]])
    licence: str = Field(description="What was said about the licence of the meshes.", examples=["CC0-1.0"])
    date: str = Field(description="The day of the lesson.", examples=["2026-11-22"])
    steps: int = Field(ge=0, description="Steps of the training.", examples=[600])
    seed: int = Field(description="Its seed.", examples=[0])


class ModelView(BaseModel):
    """A model that jobs may use."""

    id: str = Field(description="The value for `params.guidance.model`.", examples=["builtin"])
    title: str = Field(description="Its display name.", examples=["Builtin"])
    description: str = Field(
        description="Its description.", examples=["The small demonstration model that comes with Meshdeform."]
    )
    available: bool | None = Field(
        description="Whether it can be loaded; null if this server cannot check that.", examples=[True]
    )
    problem: str | None = Field(description="Why it is not available and what to do, else null.", examples=[None])
    vocabulary: VocabularyView | None = Field(description="The words that it understands; null: any prompt.")
    licence: str = Field("", description="What its model card states; empty: unknown.", examples=["mit"])
    lessons: list[LessonView] = Field(
        default_factory=list,
        description="What the builtin model was taught; empty for every other model.",
    )


class ModelList(BaseModel):
    """The models of this server."""

    default: str = Field(description="The model of jobs that name none.", examples=["builtin"])
    models: list[ModelView] = Field(description="The models, the default first.")
