"""Deform a creased mesh and say how much of its creases is left, and how distorted it is.

    python bench/creases.py cow.obj --prompt "a giraffe" --prompt "a rabbit with big ears" [--steps 200]

The crease is the mean 1 - n_i . n_j of neighbouring faces. Preset `balanced`, builtin prior, seed 0, one thread.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.assets import load_asset
from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.mesh import face_normals
from meshdeform.geometry.quality import measure
from meshdeform.geometry.weld import weld
from meshdeform.priors import load_prior
from meshdeform.rendering.cameras import Frame
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.goals import score_distillation


def main() -> None:
    """Print a row for each prompt."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--prompt", action="append", required=True)
    parser.add_argument("--steps", type=int, default=200)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    surface = load_asset(arguments.mesh.read_bytes(), arguments.mesh.name).surface
    welded = weld(surface.positions, surface.triangles).mesh
    rest = Frame.around(welded.verts).place(welded)
    pairs = welded.edges.faces[welded.edges.counts == 2]

    def crease(verts: Tensor) -> float:
        first, second = face_normals(verts, rest.faces)[pairs].unbind(1)
        return float((1 - (first * second).sum(1)).mean())

    prior = load_prior("builtin", device="cpu")
    print(f"{'prompt':32} crease {crease(rest.verts):.4f} at rest, after; distortion mean, 99th percentile; flipped")
    for prompt in arguments.prompt:
        params = resolve(DeformParams(steps=arguments.steps))
        run = Deformation(rest, score_distillation(prior, prompt, params), params)
        for _ in run:
            pass
        found = measure(rest.verts.numpy(), rest.faces.numpy(), run.verts().numpy())
        print(
            f"{prompt:32} {crease(run.verts()):.4f}  {found.symmetric_dirichlet_mean:.2f}  "
            f"{found.symmetric_dirichlet_p99:.1f}  {found.flipped_faces}",
            flush=True,
        )


if __name__ == "__main__":
    main()
