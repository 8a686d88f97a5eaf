"""Measure what control costs and keeps: ``python bench/control.py [keep] [symmetry] [prompts] [strength] [alike]``.

The sources are shapes of `training/evaluation/sources.py`, so that no files are needed; the judge retrieves the prompt
among the twelve of the suite `small`, and its noun among all nouns, as there. Tables as printed:

``keep``: the legs and the trunk of the quadruped kept; the greatest motion of a kept vertex in the file, the root mean
square motion of the others, and what the judge says, beside the same runs without it. ``symmetry``: the greatest
difference between the motions of mirrored vertices with ``auto`` and ``none``. ``prompts``: a second prompt for the
upper half of the sphere, with weight 3 and, to compare, without (0); how far the surface moved within and outside of
it, and what the judge says of the region cut out, before and after. ``strength``: the distance from rest and the
judge's probability from 0 to 1.5. ``alike``: how far levels of detail of the quadruped, deformed by the map of its
result, lie from that. Lengths are shares of the diagonal.
"""

from __future__ import annotations

import argparse
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.deformation.edit_map import EditMap
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.places import NearestPlaces
from meshdeform.geometry.shapes import simplified
from meshdeform.geometry.weld import weld
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.strength import AssetPath
from meshdeform.runs.verdict import likeness
from training.evaluation.retrieval import ShapeJudge, judgement, load_judge
from training.evaluation.sources import source_mesh
from training.evaluation.suite import SUITES

Floats = NDArray[np.float64]
ALL = SUITES["small"].prompts
BODY = {"box": {"min": [-2, -2, -2], "max": [2, 2, 0.3]}, "action": "keep"}
UPPER = {"box": {"min": [-2, 0, -2], "max": [2, 2, 2]}}
STRENGTHS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)


@dataclass(frozen=True)
class Result:
    """A finished job: its asset, its result and its report."""

    source: Asset
    result: Asset
    report: dict[str, Any]

    @property
    def moved(self) -> Floats:
        """Motion (V, 3) of every vertex, in shares of the diagonal."""
        before = self.source.surface.positions
        return np.asarray((self.result.surface.positions - before) / np.linalg.norm(np.ptp(before, axis=0)))


@functools.cache
def prior() -> Prior:
    return load_prior("builtin", device="cpu")


@functools.cache
def judge() -> ShapeJudge:
    found = load_judge("builtin")
    assert found is not None
    return found


def run(source: str, prompt: str, arguments: argparse.Namespace, **params: Any) -> Result:
    """Run a job to its end."""
    mesh = source_mesh(source)
    asset = build_glb(mesh.verts.numpy(), mesh.faces.numpy())
    given = {"preset": arguments.preset, "seed": arguments.seed, **params}
    request = JobRequest.model_validate({"prompt": prompt, "params": given})
    job = text_deform.start(job_input(asset=asset, filename=f"{source}.glb", request=request, prior=prior()))
    for _ in job:
        pass
    made = job.finish()
    report = json.loads(made["report.json"].data)
    return Result(load_asset(asset), load_asset(made["result.glb"].data), report)


def judged(positions: Floats, asset: Asset, prompt: str) -> str:
    """Return the rank among the suite's prompts, and the rank and probability of the noun among all nouns."""
    faces = torch.from_numpy(asset.surface.triangles.astype(np.int64))
    found = judgement(judge(), TriangleMesh(torch.from_numpy(positions), faces), ALL, prompt)
    return f"{found['rank']} | {found['noun_rank']}, {found['noun_probability']:.0%}"


def rms(moved: Floats) -> str:
    return f"{np.sqrt((moved**2).sum(1).mean()):.3f}"


def faults(report: dict[str, Any]) -> str:
    return f"{report['quality']['flipped_faces']}, {report['quality']['self_intersections_added']}"


def keep(arguments: argparse.Namespace) -> None:
    print("| quadruped to | kept | greatest motion of a kept vertex | others (rms) | rank of 12 | noun | faults |")
    print("|---|---|---|---|---|---|---|")
    for prompt in ("a giraffe", "a rabbit with big ears", "a dinosaur with a long neck"):
        for regions in ((), (BODY,)):
            found = run("quadruped", prompt, arguments, regions=regions)
            corners = found.source.surface.triangles
            places = found.source.surface.positions
            inside = (places[corners][:, :, 2] <= BODY["box"]["max"][2]).all(1)  # type: ignore[index]
            kept = np.unique(corners[inside]) if regions else np.zeros(0, int)
            others = np.setdiff1d(np.unique(corners), kept)
            most = f"{np.abs(found.moved[kept]).max():.1e}" if regions else ""
            share = f"{len(kept) / len(places):.0%}"
            said = judged(found.result.surface.positions, found.source, prompt)
            print(f"| {prompt} | {share} | {most} | {rms(found.moved[others])} | {said} | {faults(found.report)} |")


def symmetry(arguments: argparse.Namespace) -> None:
    print("| source | prompt | symmetry | mirrored motions differ by | rank of 12 | noun | faults |")
    print("|---|---|---|---|---|---|---|")
    for source, prompt in (("quadruped", "a giraffe"), ("vase", "a mushroom"), ("armchair", "a chair")):
        for mode in ("none", "auto"):
            found = run(source, prompt, arguments, symmetry=mode)
            said = judged(found.result.surface.positions, found.source, prompt)
            print(f"| {source} | {prompt} | {mode} | {_residual(found):.1e} | {said} | {faults(found.report)} |")


def _residual(found: Result) -> float:
    """Return the greatest difference between the motions of vertices that mirror each other across x = 0."""
    from scipy.spatial import cKDTree

    places = found.source.surface.positions
    middle = (places[:, 0].min() + places[:, 0].max()) / 2
    flip = np.array([-1.0, 1.0, 1.0])
    apart, partner = cKDTree(places).query(places * flip + [2 * middle, 0, 0])
    assert apart.max() < 1e-4 * np.linalg.norm(np.ptp(places, axis=0)), "the source is not symmetric"
    return float(np.linalg.norm(found.moved - found.moved[partner] * flip, axis=1).max())


def prompts(arguments: argparse.Namespace) -> None:
    print("| upper half | weight | moved within | outside | whole: rank of 12 | noun | region before | after |")
    print("|---|---|---|---|---|---|---|---|")
    alone = run("sphere", "a tall vase", arguments)
    for second in ("a mushroom", "a rabbit"):
        local = [{"prompt": second, "weight": 3, "regions": [UPPER]}]
        # The same without the second prompt: what the judge finds there anyway.
        for weight, found in ((0, alone), (3, run("sphere", "a tall vase", arguments, prompts=local))):
            above = found.source.surface.positions[:, 1] > 0
            said = judged(found.result.surface.positions, found.source, "a tall vase")
            shares = " | ".join(_upper_half(found, each, second) for each in (found.source, found.result))
            moved = f"{rms(found.moved[above])} | {rms(found.moved[~above])}"
            print(f"| {second} | {weight} | {moved} | {said} | {shares} |", flush=True)


def _upper_half(found: Result, asset: Asset, prompt: str) -> str:
    """Return the probability of the prompt's noun for the faces of UPPER alone."""
    surface = found.source.surface
    inside = (surface.positions[surface.triangles][:, :, 1] >= UPPER["box"]["min"][1]).all(1)
    used, corners = np.unique(surface.triangles[inside], return_inverse=True)
    faces = torch.from_numpy(corners.reshape(-1, 3).astype(np.int64))
    compared = likeness(TriangleMesh(torch.from_numpy(asset.surface.positions[used]), faces), prompt)
    assert compared is not None
    return f"{compared['probability']:.0%}"


def strength(arguments: argparse.Namespace) -> None:
    print("| strength | distance from rest (rms) | rank of 12 | noun |\n|---|---|---|---|")
    found = run("quadruped", "a giraffe", arguments)
    path = AssetPath(found.source, found.result.surface.positions)
    size = np.linalg.norm(np.ptp(found.source.surface.positions, axis=0))
    for share in STRENGTHS:
        positions = path.at(share).positions
        moved = (positions - found.source.surface.positions) / size
        print(f"| {share:g} | {rms(moved)} | {judged(positions, found.source, 'a giraffe')} |")


def alike(arguments: argparse.Namespace) -> None:
    found = run("quadruped", "a giraffe", arguments)
    before, after = (weld(each.surface.positions, each.surface.triangles).mesh for each in (found.source, found.result))
    edit = EditMap.between(before, after.verts)
    diagonal = float(np.linalg.norm(np.subtract(*before.box)))
    print(
        f"A map of {len(edit.rest.faces):,} triangles, {len(edit.to_bytes()):,} bytes; 99 % within {edit.error:.2%}\n"
    )
    print("| | at rest: mean | 99 % | deformed: mean | 99 % |\n|---|---|---|---|---|")
    for count in (len(before.faces) // 2, len(before.faces) // 4, len(before.faces) // 10):
        level = RestMesh.of(simplified(before, count))
        cells = []
        for mesh, whole in ((level, before), (RestMesh(edit.move(level), level.faces), after)):
            points = mesh.verts[mesh.faces].mean(1).numpy()
            apart = NearestPlaces(whole, points, mesh.normals.numpy()).distances(points) / diagonal
            cells += [f"{apart.mean():.2%}", f"{np.percentile(apart, 99):.2%}"]
        print(f"| {len(level.faces):,} of {len(before.faces):,} triangles | {' | '.join(cells)} |")


SUBJECTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "keep": keep,
    "symmetry": symmetry,
    "prompts": prompts,
    "strength": strength,
    "alike": alike,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("subjects", nargs="*", help=", ".join(SUBJECTS))
    parser.add_argument("--preset", default="preview")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if unknown := set(arguments.subjects) - set(SUBJECTS):
        parser.error(f"there is no {', '.join(unknown)}")
    torch.set_num_threads(1)
    for name in arguments.subjects or SUBJECTS:
        SUBJECTS[name](arguments)
        print(flush=True)


if __name__ == "__main__":
    main()
