"""Define the HTTP API's documents about files, models, limits, uploads and drawings, and what all documents share.

The service writes them and the client reads them; those of jobs are in `meshdeform.api.jobs`.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializeAsAny,
    SkipValidation,
    ValidationError,
    WrapValidator,
)

from meshdeform.requests.choices import member_of
from meshdeform.requests.document import ResolvedParams

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


def _closed(schema: dict[str, Any]) -> None:
    """Say nothing in a schema about members of newer servers."""
    schema.pop("additionalProperties", None)


class ApiDocument(BaseModel):
    """A document; what only a newer server says is in `model_extra`."""

    model_config = ConfigDict(frozen=True, extra="allow", protected_namespaces=(), json_schema_extra=_closed)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON document."""
        # Stored values of other versions are shown as they are, whatever this one declares.
        return self.model_dump(mode="json", warnings=False)


def or_new(names: type[StrEnum] | type[str]) -> WrapValidator:
    """Return a validator that keeps a name which only a newer server knows: as a member that has only a value."""

    def validate(value: Any, known: Callable[[Any], Any]) -> Any:
        try:
            return known(value)
        except ValidationError:
            if not isinstance(value, str):
                raise
            return member_of(names, value) if issubclass(names, StrEnum) else value

    return WrapValidator(validate)


_OrNew = or_new(str)


class PartFound(ApiDocument):
    """A node, material, mesh or joint of an asset, which `rigid` and `regions` can name."""

    index: int = Field(ge=0, description="Its index in the file.", examples=[2])
    name: str = Field(description="Its name; empty if it has none.", examples=["wheel-front-left"])


class AssetFound(ApiDocument):
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


class PictureFound(ApiDocument):
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


class JobEstimate(ApiDocument):
    """The estimated time of a job, based on finished jobs."""

    queue_s: float | None = Field(
        None, ge=0.0, description="Seconds until a worker takes it; null if unknown.", examples=[12.5]
    )
    run_s: float | None = Field(
        None, ge=0.0, description="Seconds from then until it finishes; null if unknown.", examples=[90.0]
    )
    not_resumable_s: float | None = Field(
        None,
        ge=0.0,
        description="Seconds of these before its first and after its last step, which begin anew when it is handed "
        "over to another worker; null if unknown.",
        examples=[4.5],
    )
    basis: str = Field(description="Basis of the estimate.", examples=["20 jobs of this kind and model"])
    steps: int = Field(0, ge=0, description="Its steps; 0 of a change in plain words.", examples=[200])


class Outlook(ApiDocument):
    """Whether an asset can become what it is to become."""

    doubtful: bool = Field(description="Whether the result will hardly show it, or be torn.", examples=[True])
    reasons: list[str] = Field(
        description="Why, in sentences.", examples=[["A castle has towers, and nothing of a house can become one."]]
    )
    suggestions: list[str] = Field(
        description="Prompts that would work better, the best first.", examples=[["a tall house", "a church"]]
    )


class Validation(ApiDocument):
    """A valid job."""

    valid: Literal[True] = Field(
        True, description="Always true: an invalid job is reported as a problem.", examples=[True]
    )
    files: dict[str, AssetFound] = Field(description="Its meshes by the names of their fields.")
    pictures: dict[str, PictureFound] = Field(
        default_factory=dict, description="Its pictures by the names of their fields."
    )
    asset: AssetFound = Field(description="The first of `files`: the asset to deform.")
    target: AssetFound | None = Field(None, description="`files.target`, the second mesh of `target` guidance.")
    # Other kinds than `text_deform` have other parameters.
    params: SkipValidation[SerializeAsAny[ResolvedParams]] = Field(
        description="Every parameter, with the value with which the job would run."
    )
    estimate: JobEstimate = Field(description="The time that it would take.")
    outlook: Outlook | None = Field(
        None,
        description="Whether the asset can become what the prompts name, with `exemplar` guidance; null of other jobs, "
        "and until the asset was read ([A word is a shape](exemplar.md#when-it-cannot-be)).",
    )


class PartChange(ApiDocument):
    """An operation that suits a part."""

    operation: str = Field(description="As in `changes` of the report.", examples=["long"])
    more: str = Field(description='Its word for more: "legs longer by 30 %".', examples=["longer"])
    less: str = Field(description="Its word for less.", examples=["shorter"])


class FoundPart(ApiDocument):
    """A part of an asset that words can name."""

    name: str = Field(description="Its name in a prompt.", examples=["legs"])
    found_by: Annotated[Literal["given", "joints", "names", "shapes"], _OrNew] = Field(
        description="Evidence that it was found by: `given` by params.control.parts, `joints` or `names` of the file, "
        "or the `shapes` that its noun stands for.",
        examples=["joints"],
    )
    confidence: float | None = Field(
        None,
        ge=0.0,
        le=1.0,
        description="Mean probability of the part over its triangles, of what the shapes tell; else null.",
        examples=[0.87],
    )
    faces: list[int | list[int]] = Field(
        description="Its triangles, as `faces` of a region has them.", examples=[[[0, 143], 150]]
    )
    changes: list[PartChange] = Field(description="Changes that a prompt can ask of it.")


class LikelyNoun(ApiDocument):
    """A noun that an asset may be."""

    noun: str = Field(description="The noun.", examples=["elephant"])
    probability: float = Field(ge=0.0, le=1.0, description="That it is this one.", examples=[0.93])


class FoundReading(ApiDocument):
    """The noun that an asset was read as, and where its front is."""

    noun: str = Field(description="The noun.", examples=["elephant"])
    probability: float = Field(ge=0.0, le=1.0, description="That it is this one; 1 if it was given.", examples=[0.93])
    sure: bool = Field(description="Whether the noun can be told without a question.", examples=[True])
    nouns: list[LikelyNoun] = Field(description="The likeliest first: at most five, or the one that was given.")
    noun_given: bool = Field(description="Whether params.guidance.source_noun says it.", examples=[False])
    up: Literal["+Y", "+Z"] = Field(
        description="The axis that points up: +Y in glTF; found of formats that leave it open.", examples=["+Y"]
    )
    front_azimuth_deg: float = Field(
        description="Where it faces, from +Z (0) towards +X (90), -180 to 180; with +Z up, from -Y towards +X.",
        examples=[90.0],
    )
    front_sure: bool = Field(
        description="Whether the front can be told without a question; also of what is alike from all sides.",
        examples=[True],
    )
    front_given: bool = Field(description="Whether params.guidance.orientation says it, in degrees.", examples=[False])


class FoundParts(ApiDocument):
    """The parts of an asset, or those that a prompt names and what it makes of the asset."""

    reading: FoundReading | None = Field(
        None,
        description="What it was read as. Null if it cannot be read, or with a prompt that needs no reading.",
    )
    parts: list[FoundPart] = Field(description="Those that everybody knows come first.")
    result: str | None = Field(
        description="The asset as a prompt that is a change makes it: a GLB in base64, without `output.subdivide`; its "
        "rig stays where it is. Null without such a prompt, unless its parts were asked for by `glb`.",
        json_schema_extra={"contentEncoding": "base64"},
        examples=[None],
    )
    warnings: list[str] = Field(description="Ways in which it is less than was asked for, in sentences.", examples=[[]])

    @property
    def glb(self) -> bytes | None:
        """The asset as the prompt makes it."""
        return None if self.result is None else base64.b64decode(self.result)


class FileLimits(ApiDocument):
    """Limits on a file."""

    formats: list[str] = Field(description="Supported formats.", examples=[["glb", "obj", "ply", "stl", "3mf", "zip"]])
    max_bytes: int = Field(description="Bytes of a request's body, and of an upload.", examples=[104857600])
    max_json_bytes: int = Field(description="Bytes of a GLB's JSON chunk.", examples=[16777216])
    max_accessor_elements: int = Field(description="Elements of one accessor.", examples=[20000000])
    max_triangles: int = Field(description="Triangles to deform, counting every instance.", examples=[1000000])


class JobLimits(ApiDocument):
    """Limits on a job."""

    max_steps: int = Field(description="Optimiser steps.", examples=[50000])
    max_priority: int = Field(description="Highest priority.", examples=[100])
    max_run_s: float | None = Field(
        description="Seconds for which a job may run, and largest `max_run_s`; null: unlimited.", examples=[86400]
    )
    max_running_jobs: int | None = Field(
        description="Jobs of one owner that run at the same time; null: unlimited.", examples=[4]
    )
    max_stored_bytes: int | None = Field(
        description="Bytes of files, checkpoints and artifacts that the jobs of one owner keep; null: unlimited.",
        examples=[107374182400],
    )
    default_retention_s: float | None = Field(
        description="`retention_s` of a job that sets none; null: such a job is never deleted.", examples=[604800]
    )


class RequestLimits(ApiDocument):
    """Limits on requests."""

    requests_per_minute: int | None = Field(
        description="Requests per minute with this API key; null: unlimited.", examples=[600]
    )
    max_active_jobs: int | None = Field(
        description="Unfinished jobs of this API key; null: unlimited.", examples=[1000]
    )


class UploadLimits(ApiDocument):
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


class FilePartView(ApiDocument):
    """A file that a kind of job reads."""

    name: str = Field(description="Its field in a form, or its member in `files` of a document.", examples=["asset"])
    summary: str = Field(description="Its content.", examples=["The file to deform: GLB, OBJ, PLY, STL or ZIP."])
    required: bool = Field(description="Whether every job of this kind needs it.", examples=[True])
    media_types: list[str] = Field(description="Its media types.", examples=[["model/gltf-binary"]])


class ArtifactKindView(ApiDocument):
    """A result that a kind of job may write."""

    name: str = Field(description="Its name within the job.", examples=["result.glb"])
    media_type: str = Field(description="Its media type.", examples=["model/gltf-binary"])
    summary: str = Field(description="Its content.", examples=["The asset with its new shape."])


class KindView(ApiDocument):
    """A kind of job."""

    name: str = Field(description="The value for `kind`.", examples=["text_deform"])
    summary: str = Field(
        description="Its effect.",
        examples=["Deforms an asset until its pictures show what a prompt says, or until it looks like a second mesh."],
    )
    reads: list[FilePartView] = Field(description="The files that it reads.")
    params: dict[str, Any] = Field(
        description="JSON schema of its `params`.", examples=[{"type": "object", "properties": {}}]
    )
    artifacts: list[ArtifactKindView] = Field(description="The results that it may write.")


class WordLimits(ApiDocument):
    """Limits on words of one's own."""

    max_words: int = Field(description="Words of one owner.", examples=[200])
    max_words_bytes: int | None = Field(
        description="Bytes of these altogether; null: unlimited.", examples=[1073741824]
    )
    max_meshes: int = Field(description="Meshes of a word.", examples=[200])
    max_faces: int = Field(description="Faces of a mesh as it is kept; what is sent may have more.", examples=[4000])
    max_bytes: int = Field(description="Bytes of a word's file.", examples=[16777216])


class LimitList(ApiDocument):
    """All limits on requests."""

    files: FileLimits = Field(description="Limits on the files of jobs.")
    jobs: JobLimits = Field(description="Limits on the request document.")
    requests: RequestLimits = Field(description="Limits on HTTP requests.")
    uploads: UploadLimits = Field(description="Limits on `POST /v1/uploads`.")
    words: WordLimits | None = Field(None, description="Limits on `POST /v1/words`; null of servers without words.")
    kinds: list[KindView] = Field(description="The kinds of job.")


class UsageMonth(ApiDocument):
    """What was used in a month."""

    month: str = Field(description="Year and month, in UTC.", examples=["2026-11"])
    jobs: int = Field(ge=0, description="Jobs that ended, in whichever state.", examples=[120])
    seconds: float = Field(
        ge=0.0,
        description="Seconds for which workers had jobs, all attempts together; an attempt counts when it ends.",
        examples=[913.5],
    )
    bytes: int = Field(ge=0, description="Bytes of the artifacts that were made.", examples=[73400320])


class UsageList(ApiDocument):
    """What was used, by month."""

    months: list[UsageMonth] = Field(description="Newest first; months without use are left out.")


class UploadView(ApiDocument):
    """A file uploaded separately, for use in jobs."""

    id: str = Field(
        description="Use it in `files`, `asset` or `target` of a job.",
        examples=["upl_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    filename: str = Field(description="Its name.", examples=["knight.glb"])
    size: int = Field(ge=1, description="Bytes of the complete file.", examples=[30720])
    state: Annotated[Literal["open", "complete"], _OrNew] = Field(
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


class VocabularyView(ApiDocument):
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
    examples: list[str] = Field(
        description="Examples of prompts.", examples=[["a giraffe with a long neck", "a tall vase"]]
    )
    groups: dict[str, list[str]] = Field(
        default_factory=dict, description="The nouns by kind.", examples=[{"animals": ["giraffe"]}]
    )


class ModelView(ApiDocument):
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
    licence: str = Field("", description="Licence that its model card states; empty: unknown.", examples=["mit"])


class ModelList(ApiDocument):
    """The models of this server."""

    default: str = Field(description="The model of jobs that name none.", examples=["builtin"])
    shapes: VocabularyView | None = Field(
        None,
        description="What there are shapes of, which prompts name where no model is asked: your words first. Null of "
        "older servers.",
    )
    models: list[ModelView] = Field(description="The models, the default first.")


class SketchParameter(ApiDocument):
    """A slider of a noun: a number in a range, or one of several options."""

    name: str = Field(description="Its name.", examples=["neck"])
    value: float | str = Field(description="Value in the drawing.", examples=[0.5])
    default: float | str = Field(description="Its value where nothing is known.", examples=[0.0])
    minimum: float | None = Field(None, description="Of a number: the least value.", examples=[-1.0])
    maximum: float | None = Field(None, description="Of a number: the greatest value.", examples=[1.0])
    options: list[str] | None = Field(None, description="Of a choice: its values.", examples=[None])


class SketchGuess(ApiDocument):
    """One reading of a drawing."""

    noun: str = Field(description="What the drawing shows.", examples=["vase"])
    probability: float = Field(ge=0.0, le=1.0, description="That it shows this and nothing else.", examples=[0.98])
    parameters: list[SketchParameter] = Field(description="All sliders of the noun.")
    mesh: str = Field(
        description="The shape as a GLB, in base64.",
        examples=["Z2xURgIAAAA="],
        json_schema_extra={"contentEncoding": "base64", "contentMediaType": "model/gltf-binary"},
    )

    @property
    def values(self) -> dict[str, float | str]:
        """The sliders by name."""
        return {each.name: each.value for each in self.parameters}

    @property
    def glb(self) -> bytes:
        """The shape."""
        return base64.b64decode(self.mesh)


class SketchGuesses(ApiDocument):
    """The nouns that a drawing may show."""

    guesses: list[SketchGuess] = Field(description="The likeliest first: three, or one if the noun is named.")
    unsure: bool = Field(
        description="Whether the drawing may be of something else: the first guess has a probability below 0.95, "
        "and no noun was named.",
        examples=[False],
    )


class WordView(ApiDocument):
    """A word of one's own."""

    noun: str = Field(description="The noun.", examples=["dragonfruit"])
    synonyms: list[str] = Field(description="Its other names.", examples=[["pitaya"]])
    like: str = Field(
        description="The noun of ours as whose parts its were read; empty without one.", examples=["apple"]
    )
    parts: list[str] = Field(description="The names of its parts.", examples=[["body", "leaves"]])
    meshes: int = Field(ge=1, description="Number of its meshes.", examples=[5])
    faces: int = Field(ge=1, description="Faces of all of them, as they are kept.", examples=[18200])
    size: int = Field(ge=0, description="Bytes of its file.", examples=[430080])
    sha256: str = Field(description="SHA-256 of its file, hexadecimal, by which jobs pin it.", examples=[_SHA256])
    created_at: datetime = Field(description="When it was added, UTC.", examples=["2026-01-31T12:00:00Z"])


class WordMesh(ApiDocument):
    """A mesh of a word."""

    source: str = Field(description="The name of its file.", examples=["dragonfruit.glb"])
    sha256: str = Field(description="SHA-256 of that file, hexadecimal; empty if unknown.", examples=[_SHA256])
    licence: str = Field(description="Its licence, as it was given.", examples=["CC0"])
    faces: int = Field(ge=1, description="Its faces, as they are kept.", examples=[3640])


class WordDetail(WordView):
    """A word of one's own, with its meshes."""

    sources: list[WordMesh] = Field(description="Its meshes, in their order.")


class WordList(ApiDocument):
    """Words of one's own."""

    words: list[WordView] = Field(description="By the alphabet.")
