"""Enumerations of the request document. Needs no pydantic, so that the command line starts fast."""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from meshdeform.deformation.settings import Carrier, GuidanceKind, OrientationMode, Rigidity, Safeguard

__all__ = [
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
    "Symmetry",
    "SynthesisMode",
    "member_of",
]

E = TypeVar("E", bound=StrEnum)


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

    @classmethod
    def named(cls, name: str) -> JobKind:
        """Return the kind of this name, after adding it if it is new."""
        if name not in cls._value2member_map_:
            member = str.__new__(cls, name)
            member._name_, member._value_ = name.upper(), name
            cls._value2member_map_[name] = member
        return cls(name)

    @classmethod
    def _missing_(cls, value: object) -> JobKind | None:
        # pydantic keeps its own list of members and falls back to this method.
        found = cls._value2member_map_.get(value) if isinstance(value, str) else None
        return found if isinstance(found, cls) else None


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
    """What the pictures for a diffusion model show."""

    NORMALS = "normals"
    CLAY = "clay"
    TEXTURED = "textured"
    MIXED = "mixed"


class BackdropMode(StrEnum):
    """What happens to a ground plane or backdrop beside which everything else is small."""

    LEAVE = "leave"
    DEFORM = "deform"


class RegionAction(StrEnum):
    """What a region of the surface does."""

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
    """What becomes of the morph targets and joints that an asset already has."""

    KEEP = "keep"
    FOLLOW = "follow"


class Easing(StrEnum):
    """How a morph gains and loses speed."""

    LINEAR = "linear"
    SMOOTH = "smooth"


class SynthesisMode(StrEnum):
    """What a synthesis makes of a family."""

    SAMPLE = "sample"
    INTERPOLATE = "interpolate"
    COMPLETE = "complete"
    SEARCH = "search"
