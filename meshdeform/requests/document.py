"""Define the request document of a job. Torch-free.

Re-exports the parameters (`parameters`) and the enumerations (`choices`). `resolve` fills in what a request leaves out.

Bounds are checked at the door alone: `read_unbounded` reads stored documents without them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    Field,
    SerializeAsAny,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic_core import SchemaValidator

from meshdeform.errors import KindRetiredError, ParameterError, UnreadableJobError
from meshdeform.requests.choices import BUILTIN_MODEL as BUILTIN_MODEL
from meshdeform.requests.choices import RETIRED_KINDS, AppearanceMode, Carrier, Easing, RigMode, is_builtin
from meshdeform.requests.choices import GuidanceKind as GuidanceKind
from meshdeform.requests.choices import JobKind as JobKind
from meshdeform.requests.choices import Preset as Preset
from meshdeform.requests.choices import Safeguard as Safeguard
from meshdeform.requests.declaration import StrictModel
from meshdeform.requests.kind_folders import kind_table
from meshdeform.requests.parameters import MAX_PROMPT_LENGTH as MAX_PROMPT_LENGTH
from meshdeform.requests.parameters import MAX_STEPS as MAX_STEPS
from meshdeform.requests.parameters import DeformParams as DeformParams
from meshdeform.requests.parameters import ResolvedParams as ResolvedParams
from meshdeform.requests.parameters import active_prompts
from meshdeform.requests.presets import OVERRIDES, Family
from meshdeform.requests.problems import reason

M = TypeVar("M", bound=BaseModel)

_BOUNDS = frozenset({"ge", "gt", "le", "lt", "multiple_of", "ref"})

_LENGTHS = frozenset({"min_length", "max_length"})


MAX_FRAMES = 64

MAX_METADATA_ENTRIES = 32

MAX_METADATA_NAME = 64

MAX_METADATA_VALUE = 500

MAX_PRIORITY = 100

MAX_DEADLINE_S = 31 * 86_400.0

MAX_RETENTION_S = 10 * 366 * 86_400.0
_Prompt = Annotated[str, StringConstraints(strip_whitespace=True)]
_MetaKey = Annotated[str, StringConstraints(min_length=1, max_length=MAX_METADATA_NAME)]
_MetaValue = Annotated[str, StringConstraints(max_length=MAX_METADATA_VALUE)]
PARAMS_OF_KIND: dict[JobKind, type[BaseModel]] = {
    JobKind.TEXT_DEFORM: DeformParams,
    **{JobKind(kind): model for kind, model in kind_table("params", "PARAMS").items()},
}
"""The model of the parameters of each kind of job."""
_JOB_EVENT = r"^job\.(queued|started|recovered|canceling|succeeded|failed|canceled|expired)$"
_OF_OTHERS: Mapping[GuidanceKind, Family] = {
    GuidanceKind.TARGET: "target",
    GuidanceKind.SILHOUETTES: "silhouettes",
    GuidanceKind.EXEMPLAR: "exemplar",
}
"""What names the presets of each kind of guidance without a model."""


def read_unbounded(model: type[M], document: Mapping[str, Any]) -> M:
    """Read a document that was within the bounds of the edition that accepted it.

    Only the bounds of numbers and lengths are left out. Unknown members and values, wrong types, and members that
    contradict each other are refused as ever: nobody knows what they mean. `document`: of JSON, or of members that are
    read already.
    """
    read: M = _validator(model).validate_python(document)
    return read


def first_problem(error: ValidationError, *within: str) -> str:
    """Return the first problem of a document, which is itself `within` another one, after the location where it is."""
    problem = error.errors(include_url=False, include_context=False, include_input=False)[0]
    location = ".".join(map(str, (*within, *problem["loc"])))
    said = reason(problem).rstrip(".")
    return f"{location}: {said}" if location else said


@cache
def _validator(model: type[BaseModel]) -> SchemaValidator:
    return SchemaValidator(_without_bounds(model.__pydantic_core_schema__, {}))


def _without_bounds(node: Any, shared: dict[str, Any]) -> Any:
    """Return a part of pydantic's core schema, which is made of dicts and lists, without its bounds."""
    # `shared` has the parts that others refer to.
    if isinstance(node, list):
        return [_without_bounds(each, shared) for each in node]
    if not isinstance(node, dict):
        return node
    left_out: frozenset[str] = frozenset()
    # Other dicts have names of members for keys.
    if isinstance(kind := node.get("type"), str):
        if kind == "definitions":
            shared = {**shared, **{each["ref"]: each for each in node["definitions"]}}
            return _without_bounds(node["schema"], shared)
        if kind == "definition-ref":
            return _without_bounds(shared[node["schema_ref"]], shared)
        if kind == "model":
            return {"type": "function-plain", "function": {"type": "no-info", "function": _reader(node, shared)}}
        # A length that is fixed is a shape, and no bound.
        fixed = "min_length" in node and node["min_length"] == node.get("max_length")
        left_out = _BOUNDS if fixed else _BOUNDS | _LENGTHS
    return {name: _without_bounds(each, shared) for name, each in node.items() if name not in left_out}


def _reader(node: dict[str, Any], shared: dict[str, Any]) -> Callable[[Any], Any]:
    """Return a function that reads a model by its members, since pydantic would use the model's own validator."""
    members = SchemaValidator(_without_bounds(node["schema"], shared), node.get("config"))
    model: type[BaseModel] = node["cls"]

    def read(value: Any) -> Any:
        if isinstance(value, model):
            return value
        values, _, written = members.validate_python(value)
        return model.model_construct(written, **values)

    return read


class MorphParams(StrictModel):
    """The frames and the timing of a morph."""

    frames: int = Field(
        8,
        ge=1,
        le=MAX_FRAMES,
        description="Number of morph targets from the source, exclusive, to the result, inclusive. More are closer to "
        "the path and take more space; 1 moves every vertex on a straight line.",
        examples=[8],
    )
    easing: Easing = Field(
        Easing.LINEAR,
        description="`linear`: at constant speed. `smooth`: slowly away from the source and slowly into the result.",
        examples=["smooth"],
    )
    ping_pong: bool = Field(False, description="Also animate the way back.", examples=[True])
    seconds: float = Field(1.0, ge=0.1, le=60.0, description="Duration of one way, in seconds.", examples=[2.0])

    def shares(self) -> list[float]:
        """Return the shares of the way at which there is a frame, from above 0 to 1."""
        return [k / self.frames for k in range(1, self.frames + 1)]

    def times(self) -> list[float]:
        """Return the times in seconds at which the source and the frames are shown, and those on the way back."""
        forth = [0.0, *(self._eased(share) * self.seconds for share in self.shares())]
        back = [2 * self.seconds - time for time in reversed(forth[:-1])] if self.ping_pong else []
        return [*forth, *back]

    def weights(self) -> list[list[float]]:
        """Return the weights of the frames at these times: one frame at a time, or none for the source."""
        rows = [[float(frame == shown) for frame in range(self.frames)] for shown in range(-1, self.frames)]
        return [*rows, *(reversed(rows[:-1]) if self.ping_pong else [])]

    def _eased(self, share: float) -> float:
        """Return the share of the time at which a share of the way is done: the inverse of 3 u^2 - 2 u^3."""
        if self.easing is Easing.LINEAR or share in (0.0, 1.0):
            return share
        return 0.5 - math.sin(math.asin(1 - 2 * share) / 3)


class OutputParams(StrictModel):
    """Options for what the job writes besides `result.glb`, `report.json` and `preview.png`."""

    morph: bool = Field(
        False,
        description="Also write `morph.glb`: the source with the way to the result as morph targets and an animation.",
        examples=[True],
    )
    morph_path: MorphParams = Field(
        MorphParams(),
        description="The frames and the timing of `morph.glb` ([Control](control.md#morph)).",
        examples=[{"frames": 12}],
    )
    compact: bool = Field(
        False,
        description="Drop the data that the new shape made unused, such as the old positions. "
        "[What stays](assets.md#compact-results).",
        examples=[False],
    )
    subdivide: bool = Field(
        False,
        description="Split edges that are longer than a tenth of the asset before the first step, so that surfaces of "
        "few large triangles can bend. [What changes](assets.md#subdivision).",
        examples=[False],
    )
    rig: RigMode = Field(
        RigMode.FOLLOW,
        description="Treatment of the joints, morph targets, animations and nodes that the asset already has: `follow` "
        "the surface, so that it plays as before; or `keep`, byte for byte ([Assets](assets.md#rigs)).",
        examples=["keep"],
    )
    provenance: bool = Field(
        False,
        description="Store in the file, as `asset.extras.meshdeform`, where it comes from. "
        "[How](assets.md#provenance).",
        examples=[False],
    )


class WebhookParams(StrictModel):
    """A webhook for the messages about one job."""

    url: str = Field(
        min_length=1,
        max_length=2000,
        description="Where to send messages: an https URL whose host has only public addresses.",
        examples=["https://example.com/meshdeform"],
    )
    events: tuple[Annotated[str, StringConstraints(pattern=_JOB_EVENT)], ...] = Field(
        (), max_length=8, description="Event types to send. Default: all.", examples=[["job.succeeded", "job.failed"]]
    )


class JobRequest(StrictModel):
    """The JSON document that requests one job."""

    kind: JobKind = Field(JobKind.TEXT_DEFORM, description="Kind of the job.", examples=["text_deform"])
    prompt: _Prompt = Field(
        "",
        max_length=MAX_PROMPT_LENGTH,
        description="New shape of the asset, or a change in plain words, such as longer legs (docs/plain.md). "
        "Required if the guidance is `sds`, without further `prompts`; of `exemplar`, unless a target is sent.",
        examples=["a mushroom"],
    )
    params: SerializeAsAny[DeformParams] = Field(
        default_factory=DeformParams,
        validate_default=True,
        description="Parameters of this kind of job.",
        examples=[{"seed": 7}],
    )
    output: OutputParams = Field(default_factory=OutputParams, description="Files that the job writes, and how.")
    metadata: dict[_MetaKey, _MetaValue] = Field(
        default_factory=dict,
        max_length=MAX_METADATA_ENTRIES,
        description="Your own labels, returned with the job: at most 32, keys up to 64 and values up to 500 "
        "characters.",
        examples=[{"shot": "sc010"}],
    )
    priority: int = Field(
        0,
        ge=-MAX_PRIORITY,
        le=MAX_PRIORITY,
        description="Jobs with a higher priority run first; among equal ones, owners take turns. API keys have a "
        "limit.",
        examples=[0],
    )
    deadline_s: float | None = Field(
        None,
        ge=1.0,
        le=MAX_DEADLINE_S,
        description="Seconds from its creation after which an unfinished job becomes `expired`. Default: none.",
        examples=[3600],
    )
    max_run_s: float | None = Field(
        None,
        ge=1.0,
        le=MAX_DEADLINE_S,
        description="Seconds for which the job may run, all its attempts together and without its waits; it then fails "
        "with `run_time_exceeded`. Default and maximum: the server's MESHDEFORM_MAX_RUN_S.",
        examples=[3600],
    )
    retention_s: float | None = Field(
        None,
        ge=60.0,
        le=MAX_RETENTION_S,
        description="Seconds after its end until the job is deleted with all its artifacts. Default: the server's "
        "MESHDEFORM_RETENTION_S.",
        examples=[604800],
    )
    webhook: WebhookParams | None = Field(
        None,
        description="Where to send messages about this job, beside your webhooks ([Webhooks](webhooks.md#one-job)). "
        "Default: nowhere.",
        examples=[None],
    )

    @field_validator("kind", mode="before")
    @classmethod
    def _not_retired(cls, value: Any) -> Any:
        """Refuse a kind that is gone by its own error, which is none of the document's form."""
        _refuse_retired(value)
        return value

    @field_validator("params", mode="wrap")
    @classmethod
    def _of_the_kind(cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        """Validate the parameters with the model of the kind of job."""
        model = PARAMS_OF_KIND[info.data.get("kind", JobKind.TEXT_DEFORM)]
        if model is DeformParams:
            return handler(value)
        if isinstance(value, DeformParams):  # the default
            return model()
        return value if isinstance(value, model) else model.model_validate(value)

    @property
    def workload(self) -> str:
        """Name of the workload: estimates assume that its jobs take about equally long per step."""
        params: Any = self.params
        if not isinstance(params, DeformParams):
            return f"{self.kind}/{getattr(params, 'guidance', '')}/{getattr(params, 'model', '')}"
        own = f"{self.kind}/{params.kind}/{params.model or ''}"
        pulling = active_prompts(self.prompt, params.prompts)
        # Each prompt is one more prediction of the model, each one with a region also one more gradient of the picture.
        local = sum(bool(each.regions) for each in pulling)
        return f"{own}/{len(pulling)} prompts, {local} regions" if params.prompts else own


def read_stored(document: Mapping[str, Any]) -> JobRequest:
    """Read a stored request, without bounds, since another version may have had others.

    `document`: as stored in the record. Raises UnreadableJobError: another version's; or KindRetiredError.
    """
    if not isinstance(document, Mapping):
        raise UnreadableJobError("The stored request cannot be read here: it is no object.")
    kind, params = document.get("kind", JobKind.TEXT_DEFORM), document.get("params", {})
    _refuse_retired(kind)
    if kind == JobKind.TEXT_DEFORM:
        params = _with_guidance_of_its_time(params)
    if isinstance(params, Mapping):
        retired = kind_table("params", "RETIRED").get(str(kind), ())
        params = {name: value for name, value in params.items() if name not in retired}
    model = next((known for name, known in PARAMS_OF_KIND.items() if name == kind), None)
    if model is None:
        raise UnreadableJobError(f"The stored request cannot be read here: there is no kind of job {kind!r}.")
    try:
        read = {"params": read_unbounded(model, params)}
    except ValidationError as error:
        raise UnreadableJobError(
            f"The stored request cannot be read here: {first_problem(error, 'params')}."
        ) from error
    try:
        return _with_rig_of_its_time(read_unbounded(JobRequest, {**document, **read}), document)
    except ValidationError as error:
        raise UnreadableJobError(f"The stored request cannot be read here: {first_problem(error)}.") from error


def _refuse_retired(kind: Any) -> None:
    if isinstance(kind, str) and kind in RETIRED_KINDS:
        raise KindRetiredError(f"Jobs of the kind {str(kind)!r} are no longer run.")


def _with_guidance_of_its_time(params: Any) -> Any:
    """Return stored parameters with a kind of guidance.

    Requests name it when they are stored. Those without it are older, and it was `sds` then.
    """
    guidance = params.get("guidance", {}) if isinstance(params, Mapping) else None
    if not isinstance(guidance, Mapping) or "kind" in guidance:
        return params
    return {**params, "guidance": {"kind": GuidanceKind.SDS.value, **guidance}}


def _with_rig_of_its_time(request: JobRequest, document: Mapping[str, Any]) -> JobRequest:
    """Return a stored request with the rig that it was accepted with.

    Requests name it when they are stored. Those without it are older: a prompt kept the rig then, and a change in plain
    words, for which the option was not set, moved it.
    """
    if request.kind is not JobKind.TEXT_DEFORM or "rig" in (document.get("output") or {}):
        return request
    values = {**dict(request.output), "rig": RigMode.KEEP}
    output = OutputParams.model_construct(request.output.model_fields_set, **values)
    return request.model_copy(update={"output": output})


def resolve(params: DeformParams, *, default_model: str = BUILTIN_MODEL) -> ResolvedParams:
    """Return every parameter: the user's value, else the preset's for this kind of guidance, else the paper's.

    `params`: what the user wrote; `default_model`: the model if the user named none (the setting MESHDEFORM_MODEL).
    """
    model = params.model or default_model
    family: Family = "builtin" if is_builtin(model) else "sd"
    if params.kind is not GuidanceKind.SDS:
        family = _OF_OTHERS[params.kind]
    paper = {name: field.default for name, field in ResolvedParams.model_fields.items()}
    written = params.flat()
    values = {**paper, **OVERRIDES[family, params.preset], **written, "guidance": params.kind, "model": model}
    highest = min(values["timestep_max"], values["timestep_max_end"])
    if values["timestep_min"] > highest:
        detail = f"timestep_min is {values['timestep_min']}, and this preset draws no timestep above {highest}."
        raise ParameterError.at(["params", "guidance", "timestep_min"], detail, f"Set it to at most {highest}.")
    if family != "exemplar" and values["rigid"] and values["carrier"] is Carrier.SURFACE:
        whose = "set" if "carrier" in written else "the preset's"
        detail = f"Rigid parts need the lattice, and carrier is `surface` ({whose})."
        raise ParameterError.at(["params", "control", "rigid"], detail, "Set params.carrier to auto or lattice.")
    if family == "builtin" and values["appearance"] != AppearanceMode.NORMALS:
        detail = f"The built-in model was trained on pictures of normals, and appearance is `{values['appearance']}`."
        advice = "Leave params.guidance.appearance out, or use a Stable Diffusion model."
        raise ParameterError.at(["params", "guidance", "appearance"], detail, advice)
    return read_unbounded(ResolvedParams, values)
