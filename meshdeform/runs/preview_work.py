"""Make a preview in a child process: the result of a job with other seeds, without its report and its picture.

What was made is remembered, so that the file of a shape that was seen costs no second fit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.children.protocol import StoppedError
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.previews import MOST_LEVELS, PreviewShape, PreviewShapes, PrimitivePositions, pack
from meshdeform.runs import text_deform
from meshdeform.runs.base import InputFile, JobRun, RunInput
from meshdeform.runs.kept_readings import FolderReadings
from meshdeform.runs.reading import reading_document
from meshdeform.runs.shape_run import ShapeRun
from meshdeform.runs.word_pins import RunWithWords
from meshdeform.support.giving_way import stopped_by
from meshdeform.support.recent import Recent

__all__ = ["make_preview", "positions_of"]

_MOST, _MOST_BYTES = 64, 128 * 2**20
_recent: Recent[_Preview] = Recent(_MOST, _MOST_BYTES)


@dataclass(frozen=True)
class _Preview:
    """A result: its GLB, whether it is a change in plain words or a draft, its exemplar, losses, and the reading."""

    glb: bytes
    change: bool
    draft: bool
    member: dict[str, Any]
    warnings: list[str]
    reading: dict[str, Any] | None


def make_preview(task: dict[str, Any], stopped: Callable[[], bool]) -> dict[str, bool]:
    """Carry out a task: write the GLB of its only seed, or the positions of all its seeds, where it says.

    Returns `draft`: whether any of them is one.

    Raises what a job does, and StoppedError.
    """

    def check() -> None:
        if stopped():
            raise StoppedError

    with stopped_by(check):
        return _write_previews(task, check)


def _write_previews(task: dict[str, Any], check: Callable[[], None]) -> dict[str, bool]:
    files = {
        name: InputFile(Path(each["path"]).read_bytes(), each["filename"], each["sha256"])
        for name, each in task["files"].items()
    }
    readings = FolderReadings(Path(task["readings"]))
    readings.samples = None if task["samples"] is None else Path(task["samples"])
    made: list[_Preview] = []
    for seed in task["seeds"]:
        same = made and made[0].change and task["as"] != "glb"  # seeds are nothing to a change
        made.append(made[0] if same else _preview(task, seed, files, readings, check))
    target = Path(task["result"])
    if task["as"] == "glb":
        target.write_bytes(made[0].glb)
        return {"draft": made[0].draft}
    shapes = [
        PreviewShape(seed, positions_of(each.glb), each.member, each.warnings)
        for seed, each in zip(task["seeds"], made, strict=True)
    ]
    draft = any(each.draft for each in made)
    target.write_bytes(pack(PreviewShapes(files["asset"].digest, made[0].change, made[0].reading, shapes, draft)))
    return {"draft": draft}


def _preview(
    task: dict[str, Any], seed: int, files: dict[str, InputFile], readings: FolderReadings, check: Callable[[], None]
) -> _Preview:
    request, resolved = (json.loads(json.dumps(task[name])) for name in ("request", "resolved"))
    request.setdefault("params", {})["seed"] = resolved["seed"] = seed
    digests = {name: [file.digest, file.filename] for name, file in files.items()}
    told = json.dumps([request, resolved, digests, task["limits"]], sort_keys=True)
    key = hashlib.sha256(told.encode()).digest()
    known = _recent.get((key, False)) or (_recent.get((key, True)) if task["draft"] else None)
    if known is not None:
        return known
    given = RunInput(
        JobRequest.model_validate(request),
        files,
        resolved,
        default_model=task["default_model"],
        limits=Limits(**task["limits"]),
        readings=readings,
        draft=task["draft"],
    )
    run = text_deform.start(given)
    for _ in run:
        check()
    made = _preview_of(run, resolved)
    _recent.put((key, made.draft), made, len(made.glb))
    return made


def _preview_of(run: JobRun, resolved: dict[str, Any]) -> _Preview:
    """Return the result of a run."""
    own = run.run if isinstance(run, RunWithWords) else run
    assert isinstance(own, ShapeRun)
    reading = reading_document(own.reading, ResolvedParams.model_validate(resolved))
    member = own.members[0] if own.members else {}
    return _Preview(run.snapshot().data, run.total_steps == 0, own.is_draft, member, own.warnings, reading)


def positions_of(glb: bytes) -> list[PrimitivePositions]:
    """Return the positions of a GLB's vertices, quantised, in the order of its meshes and their primitives."""
    document = Document.parse(glb, Limits.unlimited(), glb=True)
    return [
        _positions(mesh, number, read_floats(document, primitive["attributes"]["POSITION"]).astype(np.float64))
        for mesh, each in enumerate(document.root.get("meshes", []))
        for number, primitive in enumerate(each["primitives"])
        if "POSITION" in primitive["attributes"]
    ]


def _positions(mesh: int, primitive: int, points: np.ndarray[Any, np.dtype[np.float64]]) -> PrimitivePositions:
    low, high = points.min(0), points.max(0)
    step = (high - low) / MOST_LEVELS
    values = np.rint((points - low) / np.where(step > 0, step, 1.0)).astype("<u2")
    return PrimitivePositions(mesh, primitive, tuple(low.tolist()), tuple(step.tolist()), values.tobytes())
