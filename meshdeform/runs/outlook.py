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
from meshdeform.runs.questions import Question, answer_task
from meshdeform.runs.read_questions import ask_about, is_read, loaded, samples_of

__all__ = ["outlook_of"]

_QUESTION = Question(
    __name__,
    cannot="Whether the asset can become that is not known on this server.",
    lacks="That is found with the extra `deform`, which the API of this server lacks",
    instead="Send the job.",
)


def outlook_of(
    asset: Path, filename: str, request: JobRequest, params: ResolvedParams, limits: Limits, readings: Readings
) -> list[str]:
    """Return sentences about what will not come out well, and what would; none of an asset that was not read."""
    if not is_read(asset, filename, params, readings):
        return []
    prompts = [each.prompt for each in active_prompts(request.prompt, params.prompts)]
    try:
        answer = ask_about(_QUESTION, asset, filename, params, limits, readings, prompts=prompts)
    except (DependencyError, UnavailableError):
        return []  # the run delivers its best, and says what that is worth
    sentences: list[str] = answer["warnings"]
    return sentences


def main(arguments: list[str] | None = None) -> int:
    """Carry out the task in a file of JSON: print the sentences."""
    return answer_task(_answer, arguments)


def _answer(task: dict[str, Any]) -> dict[str, Any]:
    from meshdeform.exemplar.outlook import outlook
    from meshdeform.exemplar.shapes import Shape, Wish, frame_of
    from meshdeform.plain.read_parts import ReadParts
    from meshdeform.priors.builtin.grammar import parse

    _, body, _ = loaded(task)
    reading = body.reader.reading
    frame = frame_of(body.points, body.faces, reading)
    noun = "" if reading is None else reading.noun
    source = Shape(noun, frame.enter(body.points), body.faces, ReadParts(body).labels)
    found = []
    for prompt in task["prompts"]:
        asked = parse(prompt)
        found += outlook(source, Wish(asked.noun, asked.attributes), cache=samples_of(task)).warnings
    return {"warnings": list(dict.fromkeys(found))}
