"""Make the target mesh of a job from a drawing, and show it before the fit begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from meshdeform.requests.sketches import Sketch
from meshdeform.runs.base import ArtifactData, InputFile, RunInput
from meshdeform.sketch.guesses import Guess, guess
from meshdeform.sketch.members import member_glb

__all__ = ["guessed", "sketched_target"]


def guessed(drawing: bytes | None, sketch: Sketch | None) -> Guess:
    """Return the shape that a drawing, with corrections, or `params.sketch` alone describes.

    Parameters
    ----------
    drawing : bytes, optional
        PNG, JPEG or WebP.
    sketch : Sketch, optional
        The family to consider and the parameters to correct; required without a drawing.

    Raises
    ------
    DrawingError
        The picture is no line drawing.
    ModelError
        The package's weights are missing or damaged.
    """
    values: Mapping[str, Any] = sketch.values if sketch is not None else {}
    if drawing is None:
        assert sketch is not None
        return Guess.of(sketch.family, 1.0, values)
    first = guess(drawing, family=sketch.family if sketch is not None else "")[0]
    return Guess.of(first.family, first.probability, {**first.values, **values})


def sketched_target(drawing: bytes | None, sketch: Sketch | None, given: RunInput) -> tuple[InputFile, dict[str, Any]]:
    """Return the GLB of the shape that was drawn, and what `report.json` says about it.

    Raises
    ------
    DrawingError, ModelError
        As for `guessed`.
    """
    given.on_phase("target")
    found = guessed(drawing, sketch)
    data = member_glb(found.family, found.values)
    given.on_artifact("target.glb", ArtifactData(data, "model/gltf-binary"))
    about = {"family": found.family, "values": found.values}
    return InputFile(data, f"{found.family}.glb"), about if drawing is None else about | {
        "probability": found.probability
    }
