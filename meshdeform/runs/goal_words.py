"""Say in a few words what the result of a `text_deform` job is meant to be, for the names of downloads. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath

from meshdeform.requests.document import JobRequest
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS
from meshdeform.requests.sketches import SKETCH_PART
from meshdeform.requests.stages import Stage, prompt_words

__all__ = ["goal_of"]


def goal_of(request: JobRequest, filenames: Mapping[str, str]) -> str:
    """Return the prompt, or what the result is to look like; `filenames` are those of the files, by part."""
    if request.params.stages:
        return ", then ".join(_title(stage, filenames) for stage in request.params.stages)
    like = filenames.get("target") or filenames.get(SKETCH_PART) or filenames.get(SILHOUETTE_PARTS[0])
    generated = request.params.target.prompt if request.params.target else ""
    generated = f"like a {request.params.sketch.family}" if request.params.sketch else generated
    prompts = prompt_words(request.prompt, request.params)
    return prompts or generated or (f"like {PurePath(like).stem}" if like else "")


def _title(stage: Stage, filenames: Mapping[str, str]) -> str:
    part = stage.target if isinstance(stage.target, str) and not stage.name else None
    return f"like {PurePath(filenames[part]).stem}" if part and part in filenames else stage.title
