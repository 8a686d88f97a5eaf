"""The named choices of a job's document. Imports nothing: the command line offers them before it loads pydantic."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["GuidanceKind", "JobKind", "Preset", "Safeguard"]


class JobKind(StrEnum):
    """What a job does."""

    # `meshdeform.runs` describes each kind.

    TEXT_DEFORM = "text_deform"

    @classmethod
    def named(cls, name: str) -> JobKind:
        """Return the kind of this name; one that is not in the list above is known from then on."""
        if name not in cls._value2member_map_:
            member = str.__new__(cls, name)
            member._name_, member._value_ = name.upper(), name
            cls._value2member_map_[name] = member
        return cls(name)

    @classmethod
    def _missing_(cls, value: object) -> JobKind | None:
        # For pydantic, which keeps a list of its own and asks here for the rest.
        found = cls._value2member_map_.get(value) if isinstance(value, str) else None
        return found if isinstance(found, cls) else None


class Preset(StrEnum):
    """A named set of parameters."""

    PREVIEW = "preview"
    BALANCED = "balanced"
    PAPER = "paper"


class GuidanceKind(StrEnum):
    """What pulls the mesh."""

    SDS = "sds"
    TARGET = "target"


class Safeguard(StrEnum):
    """What a step must not do to the surface."""

    NONE = "none"
    FLIPS = "flips"
    INTERSECTIONS = "intersections"
