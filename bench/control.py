"""Measure other strengths of a result, and other files deformed alike: ``python -m bench.control``.

The quadruped of `training/evaluation/sources.py` becomes a giraffe by the preset `preview`. First table: the distance
from rest and what the judge says at strengths from 0 to 1.5 (rank of the prompt among the twelve of the suite `small`,
rank and probability of its noun among all nouns). Second: how far levels of detail, deformed by the map of the result,
lie from it. Lengths are shares of the diagonal.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from bench.jobs import deformed
from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.deformation.edit_map import EditMap
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.shapes import simplified
from meshdeform.geometry.weld import weld
from meshdeform.runs.strength import AssetPath
from training.evaluation.retrieval import judgement, load_judge
from training.evaluation.sources import source_mesh
from training.evaluation.suite import SUITES

Floats = NDArray[np.float64]
PROMPT = "a giraffe"
STRENGTHS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)


def strength(source: Asset, result: Asset) -> None:
    judge = load_judge("builtin")
    assert judge is not None
    print("| strength | distance from rest (rms) | rank of 12 | noun |\n|---|---|---|---|")
    path = AssetPath(source, result.surface.positions)
    rest, faces = source.surface.positions, source.surface.triangles.astype(np.int64)
    for share in STRENGTHS:
        positions: Floats = path.at(share).positions
        moved = (positions - rest) / np.linalg.norm(np.ptp(rest, axis=0))
        found = judgement(judge, TriangleMesh(positions, faces), SUITES["small"].prompts, PROMPT)
        rms = np.sqrt((moved**2).sum(1).mean())
        noun = f"{found['noun_rank']}, {found['noun_probability']:.0%}"
        print(f"| {share:g} | {rms:.3f} | {found['rank']} | {noun} |")


def alike(source: Asset, result: Asset) -> None:
    before, after = (weld(each.surface.positions, each.surface.triangles).mesh for each in (source, result))
    edit = EditMap.between(before, after.verts)
    diagonal = float(np.linalg.norm(np.subtract(*before.box)))
    size = f"{len(edit.rest.faces):,} triangles, {len(edit.to_bytes()):,} bytes"
    print(f"\nA map of {size}; 99 % within {edit.error:.2%}\n")
    print("| | at rest: mean | 99 % | deformed: mean | 99 % |\n|---|---|---|---|---|")
    for count in (len(before.faces) // 2, len(before.faces) // 4, len(before.faces) // 10):
        level = RestMesh.of(simplified(before, count))
        cells = []
        for mesh, whole in ((level, before), (RestMesh(edit.move(level), level.faces), after)):
            points = mesh.verts[mesh.faces].mean(1)
            apart = NearestPoints(whole, points, mesh.normals).distances(points) / diagonal
            cells += [f"{apart.mean():.2%}", f"{np.percentile(apart, 99):.2%}"]
        print(f"| {len(level.faces):,} of {len(before.faces):,} triangles | {' | '.join(cells)} |")


if __name__ == "__main__":
    torch.set_num_threads(1)
    mesh = source_mesh("quadruped")
    data = build_glb(mesh.verts, mesh.faces)
    made = deformed(data, "quadruped.glb", PROMPT, preset="preview")
    both = load_asset(data), load_asset(made["result.glb"])
    strength(*both)
    alike(*both)
