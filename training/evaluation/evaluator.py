"""Evaluate one item of the benchmark: deform, measure, judge, draw, and save the results in its folder.

::

    items/sphere--a-giraffe--seed0/
        steps-000600.ply    the shape, in the source's own frame
        steps-000600.png    its picture
        record.json         all results; written last, so an item with a record is complete
"""

from __future__ import annotations

import json
import math
import statistics
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.rendering.cameras import Frame
from meshdeform.runs.goals import score_distillation
from meshdeform.runs.recognition import front_of, known_source
from meshdeform.support.files import write_files
from training.evaluation.ablations import deformation_of
from training.evaluation.clip_judge import ClipJudge
from training.evaluation.measures import measures
from training.evaluation.mesh_file import read_ply, read_texels, write_ply
from training.evaluation.picture import picture_png
from training.evaluation.plan import Plan
from training.evaluation.retrieval import ShapeJudge, judgement, load_judge
from training.evaluation.suite import Item

_RECORD = "record.json"
_RUN = ("step_s_median", "seconds", "turned_deg", "orientation", "pulls")
"""Facts about the deformation, for information: seconds per step and in total, the angle by which the source was
turned, the orientation that the run chose, and how hard each regulariser pulled against the guidance."""


def item_folder(folder: Path, item: Item) -> Path:
    """Return the folder of an item's files."""
    return folder / "items" / item.name


def source_path(folder: Path, name: str) -> Path:
    """Return the path of a source's mesh; `name` is the name of a source or the path of a mesh."""
    return folder / "sources" / f"{Path(name).stem}.ply"


def texels_path(folder: Path, name: str) -> Path:
    """Return the path of the corners of a source's faces in its textures; there is no file if it has no texture."""
    return source_path(folder, name).with_suffix(".texels.npy")


def read_record(folder: Path, item: Item) -> dict[str, Any] | None:
    """Read the record of an item; return None if the item is not done."""
    try:
        record: dict[str, Any] = json.loads((item_folder(folder, item) / _RECORD).read_text())
    except FileNotFoundError:
        return None
    return record


def failed_record(folder: Path, item: Item, error: str, detail: str) -> dict[str, Any]:
    """Record why an item failed; the next run tries it again."""
    place = item_folder(folder, item)
    place.mkdir(parents=True, exist_ok=True)
    record = {**_head(item), "failed": {"error": error, "detail": detail}, "states": []}
    write_files({place / _RECORD: _json(record)})
    return record


class Evaluator:
    """Evaluates the items of a plan in this process, with one torch thread; models are loaded once.

    Parameters
    ----------
    plan : Plan
    deforms : bool
        Whether items will be deformed; judging alone needs no prior.

    Attributes
    ----------
    prior, judge, clip
        The loaded models; None for those that are not used.

    Raises
    ------
    ModelError, ParameterError, DependencyError
        A model is not available.
    """

    def __init__(self, plan: Plan, *, deforms: bool = True) -> None:
        torch.set_num_threads(1)
        self._plan = plan
        self.prior: Prior | None = None
        if deforms:
            model = plan.params.model
            self.prior = load_prior(model, device=plan.device, revision=plan.revision, dtype=plan.dtype)
        self.judge: ShapeJudge | None = load_judge(plan.judge)
        self.clip = ClipJudge(Path(plan.clip), device=plan.device) if plan.clip else None

    def evaluate(self, item: Item) -> dict[str, Any]:
        """Deform and assess one item, and save its files or the record of its failure."""
        try:
            rest, shapes, facts = self._deform(item)
            return self._save(item, rest, shapes, facts)
        except Exception as error:  # one failed item must not stop the others
            return failed_record(self._plan.folder, item, type(error).__name__, traceback.format_exc())

    def rejudge(self, item: Item) -> dict[str, Any] | None:
        """Assess an item's saved shapes again; return None if it has none."""
        old = read_record(self._plan.folder, item)
        if old is None or old["failed"]:
            return old
        place = item_folder(self._plan.folder, item)
        shapes = {s["steps"]: read_ply((place / _file(s["steps"], "ply")).read_bytes()) for s in old["states"]}
        return self._save(item, self._source(item), shapes, {name: old[name] for name in _RUN if name in old})

    def _source(self, item: Item) -> TriangleMesh:
        return read_ply(source_path(self._plan.folder, item.source).read_bytes())

    def _texels(self, item: Item) -> NDArray[np.float64] | None:
        path = texels_path(self._plan.folder, item.source)
        return read_texels(path.read_bytes()) if path.exists() else None

    def _deform(self, item: Item) -> tuple[TriangleMesh, dict[int, TriangleMesh], dict[str, Any]]:
        """Return the source, its shape after each of the plan's steps, and the facts of the run (`_RUN`)."""
        assert self.prior is not None
        params = self._plan.params.model_copy(update={"seed": item.seed})
        rest = self._source(item)
        angle = self._plan.suite.turn_of(item)
        turned = _turned(rest, angle)
        frame = Frame.around(turned.verts)
        guidance = score_distillation(self.prior, item.prompt, params)
        front = front_of(known_source(turned, self.prior, params), self.prior, params, item.prompt)
        placed = frame.place(turned)
        run = deformation_of(self._plan.ablation, placed, guidance, params, front=front, device=self._plan.device)
        shapes, seconds = {}, []
        before = time.perf_counter()
        for step in run:
            seconds.append(time.perf_counter() - before)
            if step.step in self._plan.steps:
                shapes[step.step] = _turned(TriangleMesh(frame.leave(run.verts()), rest.faces), -angle)
            before = time.perf_counter()
        times = statistics.median(seconds), math.fsum(seconds)
        return rest, shapes, self._facts((*times, round(angle, 2), run.orientation.to_dict(), run.pulls.to_dict()))

    def _facts(self, values: tuple[Any, ...]) -> dict[str, Any]:
        """Name the facts of a run."""
        return dict(zip(_RUN, values, strict=True))

    def _save(
        self, item: Item, rest: TriangleMesh, shapes: dict[int, TriangleMesh], facts: dict[str, Any]
    ) -> dict[str, Any]:
        place = item_folder(self._plan.folder, item)
        place.mkdir(parents=True, exist_ok=True)
        states = [{"steps": steps, **self._assess(item, rest, shape)} for steps, shape in sorted(shapes.items())]
        record = {**_head(item), "failed": None, "states": states, **facts}
        files = {place / _file(steps, "ply"): write_ply(shape) for steps, shape in shapes.items()}
        files |= {place / _file(steps, "png"): picture_png(shape) for steps, shape in shapes.items()}
        # The record is written last: if it exists, so do the other files.
        write_files({**files, place / _RECORD: _json(record)})
        return record

    def _assess(self, item: Item, rest: TriangleMesh, shape: TriangleMesh) -> dict[str, Any]:
        prompts = self._plan.suite.prompts
        return {
            "quality": measures(rest, shape, self._texels(item)),
            "judge": judgement(self.judge, shape, prompts, item.prompt) if self.judge else None,
            "clip": self.clip.judgement(shape, prompts, item.prompt) if self.clip else None,
        }


def _turned(mesh: TriangleMesh, degrees: float) -> TriangleMesh:
    """Return the mesh turned about the up axis, from +Z towards +X; the same mesh for 0."""
    if not degrees:
        return mesh
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    matrix = torch.tensor([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]], dtype=torch.float64)
    return TriangleMesh(mesh.verts @ matrix.T, mesh.faces)


def _head(item: Item) -> dict[str, Any]:
    return {"source": item.source, "prompt": item.prompt, "seed": item.seed}


def _file(steps: int, kind: str) -> str:
    return f"steps-{steps:06d}.{kind}"


def _json(record: dict[str, Any]) -> bytes:
    return (json.dumps(record, indent=1) + "\n").encode()
