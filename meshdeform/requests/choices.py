"""Enumerations of the request document. Imports nothing, so that the command line starts without pydantic."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Carrier", "GuidanceKind", "JobKind", "Preset", "Safeguard"]


class JobKind(StrEnum):
    """Kind of a job; `meshdeform.runs` describes each one."""

    TEXT_DEFORM = "text_deform"

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


class GuidanceKind(StrEnum):
    """Source of the gradient that deforms the mesh."""

    SDS = "sds"
    TARGET = "target"


class Safeguard(StrEnum):
    """Defects of the surface that no step may cause."""

    NONE = "none"
    FLIPS = "flips"
    INTERSECTIONS = "intersections"


class Carrier(StrEnum):
    """What carries the vertices."""

    AUTO = "auto"
    SURFACE = "surface"
    LATTICE = "lattice"
