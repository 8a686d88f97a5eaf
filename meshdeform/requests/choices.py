"""Name the choices of a request: its enumerations, and by a model's name its kind, without a look at any file.

Needs no pydantic, so that the command line starts fast.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from meshdeform.deformation.settings import Carrier, GuidanceKind, OrientationMode, Rigidity, Safeguard

__all__ = [
    "BUILTIN_MODEL",
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
    "PartsAs",
    "Preset",
    "RegionAction",
    "RigMode",
    "Rigidity",
    "Safeguard",
    "StartMode",
    "Symmetry",
    "SynthesisMode",
    "is_builtin",
    "is_sent",
    "is_taught",
    "member_of",
    "model_of_job",
    "teaching_job",
]

E = TypeVar("E", bound=StrEnum)


BUILTIN_MODEL = "builtin"

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


class StartMode(StrEnum):
    """The shape from which a diffusion model starts."""

    ASSET = "asset"
    EXEMPLAR = "exemplar"


class RigMode(StrEnum):
    """Treatment of the morph targets and joints that an asset already has."""

    KEEP = "keep"
    FOLLOW = "follow"


class PartsAs(StrEnum):
    """Forms in which a GLB says which part its triangles belong to."""

    ATTRIBUTE = "attribute"
    MATERIALS = "materials"
    NODES = "nodes"


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
