"""Check that the drawing of a request and what it says about it belong together. Torch-free."""

from __future__ import annotations

from collections.abc import Collection

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import DeformParams, ResolvedParams
from meshdeform.requests.sketches import SKETCH_PART
from meshdeform.requests.stages import goal_guidance
from meshdeform.runs.base import FilePart
from meshdeform.runs.vocabulary import at_parameter

__all__ = ["SKETCH_FILE", "check_sketch", "drawn_parts"]

SKETCH_FILE = FilePart(
    SKETCH_PART,
    "A line drawing that becomes the target mesh of `target` guidance.",
    required=False,
    media_types=("image/png", "image/jpeg", "image/webp"),
    content="sketch",
)


def check_sketch(params: ResolvedParams, files: Collection[str]) -> bool:
    """Return whether the target mesh of a request is that of a drawing or of `params.sketch`.

    Parameters
    ----------
    params : ResolvedParams
    files : collection of str
        The parts that are target meshes or a drawing.

    Raises
    ------
    ParameterError
        There is a drawing, and the request does not use it; or a target mesh beside either.
    """
    drawn = SKETCH_PART in files
    what = f"the part `{SKETCH_PART}`" if drawn else "params.sketch"
    if drawn and (params.stages or params.target is not None):
        name = "stages" if params.stages else "target"
        raise _refusal(name, f"A drawing was sent, but params.{name} does not use it.", f"Omit {what}.")
    if drawn and params.guidance is not GuidanceKind.TARGET:
        detail = f"A drawing was sent, but the guidance is `{params.guidance}`, which does not use it."
        raise _refusal("guidance", detail, f"Set params.guidance to `target`, or omit {what}.")
    if not drawn and params.sketch is None:
        return False
    if meshes := sorted(set(files) - {SKETCH_PART}):
        detail = f"`{meshes[0]}` and {what} both say what the target is."
        raise _refusal("sketch", detail, "Leave out one of the two.")
    return True


def drawn_parts(params: DeformParams) -> tuple[str, ...]:
    """Return the part of the drawing if a request can use one, as written."""
    fits = goal_guidance(params) is GuidanceKind.TARGET and params.target is None and not params.stages
    return (SKETCH_PART,) if fits else ()


def _refusal(name: str, detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, **at_parameter(name, detail))
