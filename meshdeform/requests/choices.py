"""The named choices of a job's document: torch-free, one place for every enumeration."""

from __future__ import annotations

from enum import StrEnum

__all__ = [
    "Annealing",
    "Distillation",
    "GuidanceKind",
    "JobKind",
    "NegativePrompt",
    "Optimizer",
    "Parametrization",
    "Preset",
    "Rigidity",
    "Safeguard",
    "ViewMode",
]


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
        found = cls._value2member_map_.get(value)
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


class Parametrization(StrEnum):
    """What the optimiser moves."""

    JACOBIANS = "jacobians"
    VERTICES = "vertices"


class ViewMode(StrEnum):
    """Which views a step shows to the guidance, and how."""

    ORTHOGONAL_GRID = "orthogonal_grid"
    ORTHOGONAL_BATCH = "orthogonal_batch"
    RANDOM_BATCH = "random_batch"
    RANDOM_SINGLE = "random_single"


class Distillation(StrEnum):
    """Which direction of the diffusion prior pulls."""

    SDS = "sds"
    CSD = "csd"
    NFSD = "nfsd"
    ISM = "ism"


class NegativePrompt(StrEnum):
    """What becomes of the negative prompt."""

    UNCONDITIONAL = "unconditional"
    PERPENDICULAR = "perpendicular"


class Rigidity(StrEnum):
    """What a Jacobian is compared with."""

    IDENTITY = "identity"
    ROTATION = "rotation"


class Optimizer(StrEnum):
    """How gradients become steps."""

    ADAM = "adam"
    ADAM_UNIFORM = "adam_uniform"


class Safeguard(StrEnum):
    """What a step must not do to the surface."""

    NONE = "none"
    FLIPS = "flips"
    INTERSECTIONS = "intersections"


class Annealing(StrEnum):
    """How a value goes from the first step to the last."""

    LINEAR = "linear"
    COSINE = "cosine"
