"""Read drawings, and make the shapes that they show, in a child process, for a process without numpy and torch.

The child has no secrets in its environment, and bounded memory and time. Importing this loads neither numpy nor torch.
"""

from __future__ import annotations

import argparse
import base64
import json
from pathlib import Path
from typing import Any

from meshdeform.assets.isolation import bound_memory, error_from, error_to_json, run_child
from meshdeform.errors import DependencyError, MeshdeformError, ModelError, UnavailableError
from meshdeform.requests.sketches import Sketch, sketch_family

__all__ = ["guesses_of", "main", "shape_of"]

_MEMORY_BYTES = 16 * 2**30
"""Address space; torch alone maps several gigabytes of it."""

_INSTEAD = "Send the drawing with its job, or run `meshdeform sketch DRAWING`."


def guesses_of(drawing: Path, *, family: str = "", timeout_s: float) -> dict[str, Any]:
    """Return what a drawing may show.

    Parameters
    ----------
    drawing : Path
        A PNG, JPEG or WebP. The child's temporary files lie beside it.
    family : str
        The only family to consider. Default: all.
    timeout_s : float

    Returns
    -------
    dict
        `guesses`, the likeliest first, each with `family`, `probability`, `values` and the `mesh` as a GLB in base64;
        and whether the first one is `unsure`.

    Raises
    ------
    ParameterError
        There is no such family.
    DrawingError
        The picture is no line drawing.
    ModelError
        The package's weights are missing or damaged.
    DependencyError
        Torch is not installed here.
    UnavailableError
        It took too long or too much memory, or no process can be started.
    """
    if family:
        sketch_family(family)
    return _asked(["guess", str(drawing.absolute()), family], drawing.absolute().parent, timeout_s)


def shape_of(sketch: Sketch, folder: Path, *, timeout_s: float) -> bytes:
    """Return a shape of a family as a GLB; the child's temporary files lie in the folder.

    Raises
    ------
    DependencyError
        Numpy is not installed here.
    UnavailableError
        It took too long, or no process can be started.
    """
    found = _asked(["shape", sketch.model_dump_json()], folder.absolute(), timeout_s)
    return base64.b64decode(found["mesh"])


def _asked(arguments: list[str], folder: Path, timeout_s: float) -> dict[str, Any]:
    try:
        child = run_child(__name__, arguments, timeout_s=timeout_s, temporary=folder)
    except TimeoutError as error:
        raise _too_much(f"It takes longer than {timeout_s:g} s.") from error
    if child.verdict is None:
        raise _too_much(f"The process ended with status {child.returncode}.")
    if not child.verdict["ok"]:
        raise _error(child.verdict["error"])
    found: dict[str, Any] = child.verdict["found"]
    return found


def main(arguments: list[str] | None = None) -> int:
    """Carry out a task, and print a JSON verdict with what was found or what went wrong."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("task", choices=["guess", "shape"])
    parser.add_argument("subject")
    parser.add_argument("family", nargs="?", default="")
    options = parser.parse_args(arguments)
    bound_memory(_MEMORY_BYTES)
    try:
        found = _guessed(options.subject, options.family) if options.task == "guess" else _shaped(options.subject)
        verdict: dict[str, Any] = {"ok": True, "found": found}
    except MeshdeformError as error:
        verdict = {"ok": False, "error": error_to_json(error)}
    except ModuleNotFoundError as error:
        missing = DependencyError(f"{error.name} is not installed.")
        verdict = {"ok": False, "error": error_to_json(missing)}
    print(json.dumps(verdict))
    return 0 if verdict["ok"] else 1


def _guessed(path: str, family: str) -> dict[str, Any]:
    from meshdeform.runs.devices import use_threads
    from meshdeform.sketch.guesses import UNSURE, guess

    use_threads(1)
    found = guess(Path(path).read_bytes(), family=family)
    guesses = [
        {
            "family": each.family,
            "probability": each.probability,
            "values": each.values,
            "mesh": base64.b64encode(each.glb()).decode(),
        }
        for each in found
    ]
    return {"guesses": guesses, "unsure": found[0].probability < UNSURE}


def _shaped(document: str) -> dict[str, Any]:
    from meshdeform.sketch.members import member_glb

    sketch = Sketch.model_validate_json(document)
    return {"mesh": base64.b64encode(member_glb(sketch.family, sketch.values)).decode()}


def _error(found: dict[str, Any]) -> MeshdeformError:
    if found["code"] == DependencyError.code:
        return DependencyError(
            f"Drawings are read with the extra `deform`, which the API of this server lacks: {found['detail']}",
            advice=_INSTEAD,
        )
    if found["code"] == ModelError.code:
        return ModelError(found["detail"], advice=found["advice"], **found["extra"])
    return error_from(found)


def _too_much(reason: str) -> UnavailableError:
    return UnavailableError(f"The drawing cannot be read on this server. {reason}", advice=_INSTEAD)
