"""Say which side of a source is its front, for guidance that sees the azimuth."""

from __future__ import annotations

from meshdeform.deformation.orientation import AHEAD, Orientation, OrientationSource
from meshdeform.reading import Reading
from meshdeform.requests.choices import GuidanceKind, OrientationMode, is_builtin
from meshdeform.requests.document import ResolvedParams


def asks_source(params: ResolvedParams) -> bool:
    """Return whether anything depends on what the source is: the front, of a model that sees the azimuth."""
    of_prompt = params.guidance is GuidanceKind.SDS and is_builtin(params.model)
    return of_prompt and params.orientation is OrientationMode.AUTO


def front_of(reading: Reading | None, params: ResolvedParams) -> Orientation:
    """Return the front of a source for `params.guidance.orientation` = `auto`, by its reading if it has one."""
    if params.guidance is not GuidanceKind.SDS:
        return AHEAD
    if not is_builtin(params.model):
        return Orientation(source=OrientationSource.UNCONDITIONED)
    if reading is None:
        return Orientation(source=OrientationSource.UNRECOGNISED)
    source = OrientationSource.FOUND if reading.front_sure else OrientationSource.UNDECIDED
    return Orientation(reading.front_azimuth_deg, source)
