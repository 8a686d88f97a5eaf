"""Name the choices of a request: its enumerations, and by a model's name its kind, without a look at any file.

Needs no pydantic, so that the command line starts fast.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from meshdeform.deformation.settings import Carrier as Carrier
from meshdeform.deformation.settings import GuidanceKind as GuidanceKind
from meshdeform.deformation.settings import OrientationMode as OrientationMode
from meshdeform.deformation.settings import Rigidity as Rigidity
from meshdeform.deformation.settings import Safeguard as Safeguard
from meshdeform.requests.kind_folders import kind_names

E = TypeVar("E", bound=StrEnum)


BUILTIN_MODEL = "builtin"

_WEIGHTS_SUFFIX = ".safetensors"

RETIRED_KINDS = frozenset({"prior_teach"})
"""Kinds of job that are no longer made. Those in the record are shown, and end without a run."""

RETIRED_FIELDS = frozenset({"meshes", "weights"})
"""Parts of jobs that taught the builtin prior, or used what it was taught."""


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

    # The others are those that the folders of kinds bring.
    _ignore_ = "members kind"
    TEXT_DEFORM = "text_deform"
    members = vars()
    for kind in kind_names():
        members[kind.upper()] = kind


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


def is_weights_file(model: str) -> bool:
    """Return whether a model is a file of weights of the builtin prior."""
    return model.endswith(_WEIGHTS_SUFFIX)


def is_retired(model: str) -> bool:
    """Return whether a model is taught weights: those sent with the job, or the result of another one."""
    return model == "weights" or model.startswith("job:")


def is_builtin(model: str) -> bool:
    """Return whether a model is the builtin prior, with the weights of the package or those of a file."""
    return model == BUILTIN_MODEL or is_weights_file(model)


class UpAxis(StrEnum):
    """The axis of a file that points up."""

    AUTO = "auto"
    Y = "y"
    Z = "z"


class LengthUnit(StrEnum):
    """The unit of a file's numbers."""

    AUTO = "auto"
    METRE = "m"
    CENTIMETRE = "cm"
    MILLIMETRE = "mm"
    INCH = "in"
    FOOT = "ft"


METRES = {
    LengthUnit.METRE: 1.0,
    LengthUnit.CENTIMETRE: 0.01,
    LengthUnit.MILLIMETRE: 0.001,
    LengthUnit.INCH: 0.0254,
    LengthUnit.FOOT: 0.3048,
}
"""Metres of each unit."""
