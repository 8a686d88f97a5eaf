# ruff: noqa: D102 - docs/parameters.md says what each value means
"""Declare the settings of the optimisation and their choices. Imports nothing.

`meshdeform.requests` makes these values of what a user wrote; any object with them will do.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol


class GuidanceKind(StrEnum):
    """What deforms the mesh: the source of a gradient, or, without one, an exemplar that it is fitted to."""

    SDS = "sds"
    TARGET = "target"
    SILHOUETTES = "silhouettes"
    EXEMPLAR = "exemplar"


class Carrier(StrEnum):
    """Carrier of the vertices."""

    AUTO = "auto"
    SURFACE = "surface"
    LATTICE = "lattice"


class OrientationMode(StrEnum):
    """How the front of an asset is chosen where no angle is given."""

    AUTO = "auto"
    KEEP = "keep"


class Safeguard(StrEnum):
    """Defects of the surface that no step may cause."""

    NONE = "none"
    FLIPS = "flips"
    INTERSECTIONS = "intersections"


class Rigidity(StrEnum):
    """Freedom of a part that keeps its shape."""

    SIMILARITY = "similarity"
    RIGID = "rigid"


class RunSettings(Protocol):
    """The values of a run; docs/parameters.md says what each means, and docs/method.md where it enters."""

    @property
    def guidance(self) -> GuidanceKind: ...
    @property
    def steps(self) -> int: ...
    @property
    def seed(self) -> int: ...
    @property
    def learning_rate(self) -> float: ...
    @property
    def carrier(self) -> Carrier: ...
    @property
    def keep_structure(self) -> bool: ...
    @property
    def orientation(self) -> OrientationMode | float: ...
    @property
    def safeguard(self) -> Safeguard: ...
    @property
    def guidance_weight(self) -> float: ...
    @property
    def jacobian_reg_weight(self) -> float: ...
    @property
    def laplacian_weight(self) -> float: ...
    @property
    def normal_weight(self) -> float: ...
    @property
    def dirichlet_weight(self) -> float: ...
    @property
    def stiffness(self) -> float: ...
    @property
    def framing(self) -> float: ...
    @property
    def framing_max(self) -> float: ...
    @property
    def elevation_min_deg(self) -> float: ...
    @property
    def elevation_max_deg(self) -> float: ...
    @property
    def fov_min_deg(self) -> float: ...
    @property
    def fov_max_deg(self) -> float: ...
