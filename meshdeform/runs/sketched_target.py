"""Make the target mesh of a job from a drawing, and show it before the fit begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from meshdeform.requests.document import DeformParams
from meshdeform.requests.sketches import SKETCH_PART, Sketch
from meshdeform.requests.stages import TARGET_PARTS
from meshdeform.runs.base import ArtifactData, InputFile, RunInput
from meshdeform.sketch.guesses import Guess, guess
from meshdeform.sketch.members import member_glb

__all__ = ["guessed", "read_targets", "sketched_target"]


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


def read_targets(params: DeformParams, given: RunInput) -> tuple[Mapping[str, InputFile], dict[str, Any] | None]:
    """Return the target meshes of a job, among them that of its drawing, and what the report says about the drawing.

    Raises
    ------
    DrawingError, ModelError
        As for `guessed`.
    """
    drawing = given.files.get(SKETCH_PART)
    if drawing is None and params.sketch is None:
        return {part: file for part, file in given.files.items() if part in TARGET_PARTS}, None
    target, about = sketched_target(None if drawing is None else drawing.data, params.sketch, given)
    return {"target": target}, about
