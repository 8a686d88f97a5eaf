"""Read drawings, and make the shapes that they show, in a child process, for a process without numpy.

The child has no secrets in its environment, and bounded memory and time. Importing this loads no
numpy, and the child no torch, whose start would take longer than all else.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from meshdeform.kinds.sketch.sliders import Sketch
from meshdeform.runs.questions import Question
from meshdeform.runs.read_questions import with_words
from meshdeform.words import Word
from meshdeform.words.file import SUFFIX

_READING = Question(
    "drawing",
    cannot="The drawing cannot be read on this server.",
    lacks="Drawings are read with the extra `deform`, which the API of this server lacks",
    instead="Send the drawing with its job, or run `meshdeform sketch DRAWING`.",
)
_SHAPING = replace(_READING, task="sketch")


def guesses_of(drawing: Path, *, noun: str = "", words: Sequence[Word] = (), timeout_s: float) -> dict[str, Any]:
    """Return the nouns that a drawing may show.

    `drawing`: a PNG, JPEG or WebP. The child's temporary files lie beside it. `noun`: the only one to consider.
    Default: all, and `words` of somebody's own. Returns dict: `guesses`, the likeliest first, each with `noun`,
    `probability`, `parameters` and the `mesh` as a GLB in base64; and whether the first one is `unsure`.

    Raises ParameterError: there is no such noun. Raises DrawingError: the picture is no line drawing. Raises
    ModelError: the package's weights are missing or damaged. Raises DependencyError: a package is not installed here.
    Raises UnavailableError: it took too long or too much memory, or no process can be started.
    """
    task = {"drawing": str(drawing.absolute()), "noun": noun}
    return _asked(_READING, task, drawing.absolute().parent, words, timeout_s)


def shape_of(sketch: Sketch, folder: Path, *, words: Sequence[Word] = (), timeout_s: float) -> bytes:
    """Return a shape of a noun as a GLB; the child's temporary files lie in the folder.

    Raises ParameterError: there is no such noun or slider, or a value is out of range. Raises DependencyError: a
    package is not installed here. Raises UnavailableError: it took too long, or no process can be started.
    """
    task = {"sketch": sketch.model_dump(mode="json")}
    answer = _asked(_SHAPING, task, folder.absolute(), words, timeout_s)
    return base64.b64decode(answer["mesh"])


def _asked(
    question: Question, task: dict[str, Any], folder: Path, words: Sequence[Word], timeout_s: float
) -> dict[str, Any]:
    files = {folder / f"{word.sha256}{SUFFIX}": word.data for word in words}
    for path, content in files.items():
        path.write_bytes(content)
    found: dict[str, Any] = question.ask({**task, "words": [str(each) for each in files]}, folder, timeout_s)
    return found


def read_drawing(task: dict[str, Any]) -> dict[str, Any]:
    """Return what `guesses_of` does, in the child."""
    with with_words(task):
        return _guessed(Path(task["drawing"]), task["noun"])


def make_shape(task: dict[str, Any]) -> dict[str, Any]:
    """Return the mesh of `shape_of`, in base64, in the child."""
    with with_words(task):
        return _shaped(Sketch.model_validate(task["sketch"]))


def _guessed(drawing: Path, noun: str) -> dict[str, Any]:
    from meshdeform.kinds.sketch.guessing import guess, is_unsure
    from meshdeform.kinds.sketch.shapes import described

    answer = guess(drawing.read_bytes(), noun=noun)
    guesses = [
        {
            "noun": each.noun,
            "probability": each.probability,
            "parameters": described(each.noun, each.values),
            "mesh": base64.b64encode(each.glb()).decode(),
        }
        for each in answer
    ]
    return {"guesses": guesses, "unsure": is_unsure(answer, noun=noun)}


def _shaped(sketch: Sketch) -> dict[str, Any]:
    from meshdeform.kinds.sketch.shapes import known_noun, shape_glb

    return {"mesh": base64.b64encode(shape_glb(known_noun(sketch.noun), sketch.values)).decode()}
