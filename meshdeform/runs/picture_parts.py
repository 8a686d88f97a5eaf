"""Describe the pictures of a request, and check that they and their directions belong together. Torch-free."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from meshdeform.errors import ParameterError
from meshdeform.requests.document import GuidanceKind, JobRequest
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS, Silhouette
from meshdeform.runs.base import FilePart

__all__ = ["PICTURE_FILES", "check_pictures"]

PICTURE_FILES = tuple(
    FilePart(
        name,
        f"Picture {number} of `params.silhouettes`: a mask, or an object in front of a plain background.",
        required=False,
        media_types=("image/png", "image/jpeg", "image/webp"),
        content="silhouette",
    )
    for number, name in enumerate(SILHOUETTE_PARTS, 1)
)

_SAME_DEG = 1.0


def check_pictures(request: JobRequest, present: Collection[str]) -> None:
    """Refuse pictures without a direction, directions without a picture, and directions that are the same.

    Parameters
    ----------
    request : JobRequest
    present : collection of str
        The names of the parts with pictures.

    Raises
    ------
    ParameterError
        They do not belong together, or the guidance cannot use them.
    """
    params = request.params
    views = params.silhouettes
    if params.guidance is GuidanceKind.TARGET and (views or present):
        detail = "Pictures cannot guide beside a second mesh, which has all its silhouettes."
        raise _refusal(detail, "Leave out params.silhouettes, or set params.guidance to sds or silhouettes.")
    if params.guidance is GuidanceKind.SILHOUETTES:
        if not views:
            detail = "`silhouettes` guidance needs at least one picture."
            raise _refusal(detail, "Send it as the part `silhouette_1`, with its azimuth in params.silhouettes.")
        if request.prompt:
            detail = "There is a prompt, and `silhouettes` guidance does not use it."
            raise _refusal(detail, "Set params.guidance to sds to use both, or leave the prompt out.", "guidance")
    wanted = SILHOUETTE_PARTS[: len(views)]
    for number, name in enumerate(wanted):
        if name not in present:
            detail = f"params.silhouettes has {len(views)} entries, and the part `{name}` is missing."
            raise _refusal(detail, f"Send the picture as the part `{name}`.", number)
    for name in sorted(set(present) - set(wanted)):
        detail = f"The part `{name}` was sent, and params.silhouettes has {len(views)} entries."
        raise _refusal(detail, "Give each picture an entry with its azimuth, in the order of the parts.")
    for number, view in enumerate(views):
        for other in range(number):
            if _same(view, views[other]):
                detail = f"`{wanted[other]}` and `{wanted[number]}` have the same azimuth and elevation."
                raise _refusal(detail, "Correct one of the azimuths, or leave one of the pictures out.", number)


def _same(one: Silhouette, other: Silhouette) -> bool:
    apart = abs((one.azimuth - other.azimuth + 180.0) % 360.0 - 180.0)
    return apart < _SAME_DEG and abs(one.elevation - other.elevation) < _SAME_DEG


def _refusal(detail: str, advice: str, *place: Any) -> ParameterError:
    loc = ["params", *place] if place == ("guidance",) else ["params", "silhouettes", *place]
    return ParameterError(detail, advice=advice, errors=[{"loc": loc, "msg": detail, "type": "value_error"}])
