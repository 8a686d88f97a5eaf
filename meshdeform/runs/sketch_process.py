"""Read drawings, and make the shapes that they show, in a child process, for a process without numpy.

The child has no secrets in its environment, and bounded memory and time. Importing this loads no
numpy, and the child no torch, whose start would take longer than all else.
"""

from __future__ import annotations

import argparse
import base64
from functools import partial
from pathlib import Path
from typing import Any

from meshdeform.requests.sketches import Sketch, sketch_family
from meshdeform.runs.questions import Question, answer

_QUESTION = Question(
    __name__,
    cannot="The drawing cannot be read on this server.",
    lacks="Drawings are read with the extra `asset`, which the API of this server lacks",
    instead="Send the drawing with its job, or run `meshdeform sketch DRAWING`.",
)


def guesses_of(drawing: Path, *, family: str = "", timeout_s: float) -> dict[str, Any]:
    """Return the families that a drawing may show.

    `drawing`: a PNG, JPEG or WebP. The child's temporary files lie beside it. `family`: the only family to consider.
    Default: all. Returns dict: `guesses`, the likeliest first, each with `family`, `probability`, `values` and the
    `mesh` as a GLB in base64; and whether the first one is `unsure`. Raises ParameterError: there is no such family.
    Raises DrawingError: the picture is no line drawing. Raises ModelError: the package's weights are missing or
    damaged. Raises DependencyError: Numpy, Pillow or safetensors is not installed here. Raises UnavailableError: it
    took too long or too much memory, or no process can be started.
    """
    if family:
        sketch_family(family)
    return _asked(["guess", str(drawing.absolute()), family], drawing.absolute().parent, timeout_s)


def shape_of(sketch: Sketch, folder: Path, *, timeout_s: float) -> bytes:
    """Return a shape of a family as a GLB; the child's temporary files lie in the folder.

    Raises DependencyError: Numpy is not installed here. Raises UnavailableError: it took too long, or no process can be
    started.
    """
    answer = _asked(["shape", sketch.model_dump_json()], folder.absolute(), timeout_s)
    return base64.b64decode(answer["mesh"])


def _asked(arguments: list[str], folder: Path, timeout_s: float) -> dict[str, Any]:
    answer: dict[str, Any] = _QUESTION.ask(arguments, folder, timeout_s)
    return answer


def main(arguments: list[str] | None = None) -> int:
    """Carry out a task, and print a JSON verdict with what was found or what went wrong."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("task", choices=["guess", "shape"])
    parser.add_argument("subject")
    parser.add_argument("family", nargs="?", default="")
    options = parser.parse_args(arguments)
    if options.task == "guess":
        return answer(partial(_guessed, options.subject, options.family))
    return answer(partial(_shaped, options.subject))


def _guessed(path: str, family: str) -> dict[str, Any]:
    from meshdeform.kinds.sketch.looking import guess, is_unsure

    answer = guess(Path(path).read_bytes(), family=family)
    guesses = [
        {
            "family": each.family,
            "probability": each.probability,
            "values": each.values,
            "mesh": base64.b64encode(each.glb()).decode(),
        }
        for each in answer
    ]
    return {"guesses": guesses, "unsure": is_unsure(answer, family=family)}


def _shaped(document: str) -> dict[str, Any]:
    from meshdeform.kinds.sketch.families import member_glb

    sketch = Sketch.model_validate_json(document)
    return {"mesh": base64.b64encode(member_glb(sketch.family, sketch.values)).decode()}
