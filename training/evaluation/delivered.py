"""Evaluate items of real assets as they are delivered: the whole job, and what a viewer of its file shows.

Every figure is compared with two results that cost nothing: the source as it is, and the *best stretch*, the source
scaled along its axes by the factors of `_FACTORS` that the judge likes best. Whether an item is *worse than its source*
is decided as in a run (`meshdeform.runs.verdict`).
"""

from __future__ import annotations

import itertools
import json
import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.weld import weld
from meshdeform.priors.builtin.grammar import parse
from meshdeform.rendering.studio import Pose, preview_png
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.verdict import kept_structure, worse_than_source
from meshdeform.support.files import write_files
from training.evaluation.evaluator import Evaluator, item_folder
from training.evaluation.retrieval import ShapeJudge
from training.evaluation.suite import Item

Factors = tuple[float, float, float]

_FACTORS = (0.5, 2**-0.5, 1.0, 2**0.5, 2.0)


class DeliveredEvaluator(Evaluator):
    """Runs `text_deform` on the files of a suite, and measures `result.glb` in the pose that viewers show."""

    def _deform(self, item: Item) -> tuple[TriangleMesh, dict[int, TriangleMesh], dict[str, Any]]:
        path, plan = Path(item.source), self._plan
        params = plan.params.model_copy(update={"seed": item.seed})
        began = time.perf_counter()
        run = text_deform.start(
            job_input(
                asset=path.read_bytes(),
                filename=path.name,
                request=JobRequest(prompt=item.prompt),
                resolved=params,
                prior=self.prior,
                limits=Limits.unlimited(),
                device=plan.device,
            )
        )
        results, seconds = {}, []
        before = time.perf_counter()
        for step in run:
            seconds.append(time.perf_counter() - before)
            if step.step in plan.steps:
                results[step.step] = load_asset(run.snapshot().data, "result.glb", Limits.unlimited())
            before = time.perf_counter()
        artifacts = {name: artifact.data for name, artifact in run.finish().items()}
        total = time.perf_counter() - began
        # A change in plain words has no steps, views or forces.
        results = results or {max(plan.steps): load_asset(artifacts["result.glb"], "result.glb", Limits.unlimited())}
        report = {"orientation": {}, "pulls": {}, **json.loads(artifacts["report.json"])}
        source = load_asset(path.read_bytes(), path.name, Limits.unlimited())
        picture = _picture(source, results[max(results)])
        folder = item_folder(plan.folder, item)
        folder.mkdir(parents=True, exist_ok=True)
        files = {name: artifacts[name] for name in ("result.glb", "report.json")}
        write_files({folder / name: data for name, data in {**files, "preview.png": picture}.items()})
        facts = (statistics.median(seconds or [0.0]), total, 0.0, report["orientation"], report["pulls"])
        welded = weld(source.surface.positions, source.surface.triangles)
        moved = {steps: welded.gather(result.surface.positions) for steps, result in results.items()}
        return welded.mesh, moved, self._facts(facts)

    def _assess(self, item: Item, rest: TriangleMesh, shape: TriangleMesh) -> dict[str, Any]:
        assessed = super()._assess(item, rest, shape)
        quality, noun = assessed["quality"], parse(item.prompt).noun
        measures: dict[str, Any] = {"structure": kept_structure(rest, shape, quality)}
        if self.judge is not None:
            stretch = best_stretch(self.judge, item.source, noun)
            ranks = {"source": _rank(self.judge, rest, noun), "stretch": stretch.rank}
            ranks["result"] = assessed["judge"]["noun_rank"]
            measures |= {"noun_ranks": ranks, "stretch": stretch.factors}
            measures["worse_than_source"] = worse_than_source(ranks["source"], ranks["result"], measures["structure"])
        return {**assessed, "kept": measures}


@dataclass(frozen=True)
class Stretch:
    """The best stretch: its factors along the axes, and the rank of the noun among all of the judge."""

    factors: Factors
    rank: int


def best_stretch(judge: ShapeJudge, source: str, noun: str) -> Stretch:
    """Find the scaling of a file's mesh along its axes that the judge takes most for a noun."""
    tried: dict[Factors, dict[str, float]] = _stretched(judge, source)
    factors = max(tried, key=lambda each: tried[each][noun])
    return Stretch(factors, _place(tried[factors], noun))


def _stretched(judge: ShapeJudge, source: str) -> dict[Factors, dict[str, float]]:
    """Return the probabilities of all nouns for every stretch of a file's mesh, computed once for its prompts."""
    known = _tried.get(source)
    if known is None:
        surface = load_asset(Path(source).read_bytes(), Path(source).name, Limits.unlimited()).surface
        mesh = weld(surface.positions, surface.triangles).mesh
        # A uniform scale changes nothing, so one of the factors can be the least of all.
        factors = [(x, y, z) for x, y, z in itertools.product(_FACTORS, repeat=3) if min(x, y, z) == _FACTORS[0]]
        known = {each: judge.noun_probabilities(_scaled(mesh, each)) for each in factors}
        _tried.clear()
        _tried[source] = known
    return known


_tried: dict[str, dict[Factors, dict[str, float]]] = {}
"""Those of the last file."""


def _scaled(mesh: TriangleMesh, factors: Factors) -> TriangleMesh:
    return TriangleMesh(mesh.verts * torch.tensor(factors, dtype=torch.float64), mesh.faces)


def _rank(judge: ShapeJudge, mesh: TriangleMesh, noun: str) -> int:
    return _place(judge.noun_probabilities(mesh), noun)


def _place(nouns: dict[str, float], noun: str) -> int:
    return sum(share >= nouns[noun] for share in nouns.values())


def _picture(source: Asset, result: Asset) -> bytes:
    poses = [Pose(each.surface.positions, each.surface.normals) for each in (source, result)]
    return preview_png(source.appearance(), *poses)


def stretched_picture(source: str, factors: Factors) -> bytes:
    """Draw a file as it is and stretched, as `preview.png` does."""
    asset = load_asset(Path(source).read_bytes(), Path(source).name, Limits.unlimited())
    surface = asset.surface
    scale = np.array(factors) / np.cbrt(np.prod(factors))
    normals = surface.normals / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return preview_png(
        asset.appearance(), Pose(surface.positions, surface.normals), Pose(surface.positions * scale, normals)
    )
