"""Say before a job whether its asset can become what the prompts name, in a child process. Torch-free, numpy-free.

Only an asset that was read before is asked about: a reading takes seconds, and whoever cares has listed its parts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from meshdeform.assets.limits import Limits
from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import active_prompts
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.questions import Question
from meshdeform.runs.read_questions import ask_about, is_read, loaded, samples_of, with_words

__all__ = ["outlook_of"]

_QUESTION = Question(
    "outlook",
    cannot="Whether the asset can become that is not known on this server.",
    lacks="That is found with the extra `deform`, which the API of this server lacks",
    instead="Send the job.",
)


def outlook_of(
    asset: Path, filename: str, request: JobRequest, params: ResolvedParams, limits: Limits, readings: Readings
) -> dict[str, Any] | None:
    """Return whether what the prompts name is `doubtful`, `reasons` and `suggestions`; None if nobody knows."""
    if not is_read(asset, filename, params, readings):
        return None
    prompts = [each.prompt for each in active_prompts(request.prompt, params.prompts)]
    try:
        return ask_about(_QUESTION, asset, filename, params, limits, readings, prompts=prompts)
    except (DependencyError, UnavailableError):
        return None  # the run delivers its best, and says what that is worth


def find_outlook(task: dict[str, Any]) -> dict[str, Any]:
    """Return the outlook of a task of `ask_about`, in the child."""
    with with_words(task):
        return _answer(task)


def _answer(task: dict[str, Any]) -> dict[str, Any]:
    from meshdeform.exemplar.outlook import outlook
    from meshdeform.exemplar.shapes import Shape, Wish, frame_of
    from meshdeform.plain.read_parts import ReadParts
    from meshdeform.vocabulary.grammar import parse

    _, body, _ = loaded(task)
    reading = body.reader.reading
    frame = frame_of(body.points, body.faces, reading)
    noun = "" if reading is None else reading.noun
    source = Shape(noun, frame.enter(body.points), body.faces, ReadParts(body).labels)
    asked = [parse(prompt) for prompt in task["prompts"]]
    found = [outlook(source, Wish(each.noun, each.attributes), cache=samples_of(task)) for each in asked]
    return {
        "doubtful": any(each.doubtful for each in found),
        "reasons": list(dict.fromkeys(reason for each in found for reason in each.reasons)),
        "suggestions": list(dict.fromkeys(prompt for each in found for prompt in each.suggestions)),
    }
