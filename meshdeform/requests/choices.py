"""The named choices of a job's document. Imports nothing: the command line offers them before it loads pydantic."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["GuidanceKind", "JobKind", "Preset", "Safeguard"]


class JobKind(StrEnum):
    """What a job does; more kinds join this list."""

    TEXT_DEFORM = "text_deform"


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
