"""Deform the eight sources of the suite `full` by a taught noun, and say which noun each result looks like.

    meshdeform teach "a gnome" gnome.glb -o mine.safetensors
    python -m bench.taught_retrieval mine.safetensors "a gnome" gnome.glb --picture sheet.png
    python -m bench.taught_retrieval mine.safetensors "a gnome" gnome.glb --sources --control eval-small

The judge knows the shipped nouns only. So results are classified in the space of its features: the
mean over eight views of its last layer but one. Every known noun is a normal distribution there, around the mean of
held-out members that neither judge nor prior was trained on; the taught noun is one around the mean of members of its
meshes; all share one covariance (linear discriminant analysis). The accuracy on further members, printed first, says
how far this can be trusted. The prior takes no part in it.

Sources: Fisher 1936 (linear discriminant analysis); Ledoit & Wolf 2004 (shrinkage of the covariance); Mensink et al.
2013, Distance-based image classification (a class that was added without training, by its mean).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.weld import weld
from meshdeform.judge.scoring import JudgeNetwork, draw_views, judging_cameras, read_judge
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.priors.builtin.teaching.pictures import Shape, member, shape_of
from meshdeform.priors.builtin.teaching.teacher import interval
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.requests.document import resolve
from meshdeform.requests.parameters import DeformParams
from meshdeform.runs.devices import use_threads
from meshdeform.runs.goals import score_distillation
from training.evaluation.ablations import deformation_of
from training.evaluation.measures import measures
from training.evaluation.mesh_file import read_ply
from training.evaluation.picture import SIZE, draw
from training.evaluation.sources import source_mesh
from training.evaluation.suite import find_suite
from training.judge.members import roughened
from training.prior.families import Part
from training.prior.families import member as member_of_family

_SEED = 0x7461756768
"""First word of the seeds of all members drawn here ("taugh")."""


class Classifier:
    """Linear discriminant analysis on the judge's features, with the taught noun as one more class.

    Parameters
    ----------
    noun : str
        The taught noun.
    shapes : sequence of Shape
        Its meshes.
    members : int
        Of each noun, for the means and the covariance.
    """

    def __init__(self, noun: str, shapes: Sequence[Shape], members: int) -> None:
        self._network, _ = read_judge()
        self._shapes = shapes
        self.nouns = [*(known for known in NOUNS if known != noun), noun]
        drawn = [np.stack([self._features(self._drawn(name, k)) for k in range(members)]) for name in self.nouns]
        self._means = np.stack([each.mean(0) for each in drawn])
        apart = np.concatenate([each - each.mean(0) for each in drawn])
        covariance = apart.T @ apart / (len(apart) - len(drawn))
        # Shrunk towards a multiple of the identity, as there are few members for so many features.
        level = np.trace(covariance) / len(covariance)
        self._inverse = np.linalg.inv(0.8 * covariance + 0.2 * level * np.eye(len(covariance)))
        right = [self.noun_of(self._drawn(name, members + k)) == name for name in self.nouns for k in range(2)]
        self.accuracy, self.tested = sum(right) / len(right), len(right)

    def noun_of(self, mesh: TriangleMesh) -> str:
        """Return the noun whose mean is nearest in Mahalanobis' distance."""
        apart = self._features(mesh) - self._means
        return self.nouns[int(((apart @ self._inverse) * apart).sum(1).argmin())]

    def _drawn(self, noun: str, number: int) -> TriangleMesh:
        index = list(NOUNS).index(noun) if noun in NOUNS and noun != self.nouns[-1] else len(NOUNS)
        rng = np.random.default_rng([_SEED, index, number])
        if noun == self.nouns[-1]:
            part, _ = member(self._shapes[number % len(self._shapes)], rng)
        else:
            part = member_of_family(noun, (), rng)
        return _mesh(roughened(part, rng))

    @torch.no_grad()
    def _features(self, mesh: TriangleMesh) -> NDArray[np.float64]:
        return _pooled(self._network, draw_views(mesh, *judging_cameras()))


def _pooled(network: JudgeNetwork, views: torch.Tensor) -> NDArray[np.float64]:
    """Return the mean (C,) of the last layer but one over views and pixels."""
    found: NDArray[np.float64] = network.blocks(network.stem(views * 2.0 - 1.0)).mean((0, 2, 3)).double().numpy()
    return found


def _mesh(part: Part) -> TriangleMesh:
    return TriangleMesh(torch.from_numpy(part.verts), torch.from_numpy(part.faces))


def deformed(prior: Prior, source: TriangleMesh, prompt: str, params: DeformParams) -> TriangleMesh:
    """Return the result of a job of these parameters, in the source's frame."""
    frame = Frame.around(source.verts)
    resolved = resolve(params)
    run = deformation_of(None, frame.place(source), score_distillation(prior, prompt, resolved), resolved, device="cpu")
    for _ in run:
        pass
    return TriangleMesh(frame.leave(run.verts()), source.faces)


def pictures(meshes: Sequence[TriangleMesh]) -> Image.Image:
    """Draw each mesh from two sides, one column each."""
    columns = [
        np.concatenate([draw(mesh, fixed_cameras((azimuth,), 15.0), SIZE)[0].numpy() for azimuth in (30.0, 120.0)])
        for mesh in meshes
    ]
    return Image.fromarray((np.concatenate(columns, 1) * 255).round().astype(np.uint8), "RGB")


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.taught_retrieval", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("weights", type=Path)
    parser.add_argument("prompt", help="a prompt of the taught noun alone, such as 'a gnome'")
    parser.add_argument("meshes", type=Path, nargs="+", help="what it was taught from")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--members", type=int, default=8)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--sources", nargs="*", default=find_suite("full").sources, help="by default those of `full`")
    parser.add_argument("--control", type=Path, help="folder of a finished run of python -m training.evaluation")
    options = parser.parse_args()
    use_threads(options.threads)
    noun = options.prompt.removeprefix("a ").removeprefix("an ").strip()
    surfaces = [load_asset(path.read_bytes(), path.name).surface for path in options.meshes]
    shapes = [
        shape_of(weld(surface.positions, surface.triangles).mesh, path.name)
        for surface, path in zip(surfaces, options.meshes, strict=True)
    ]
    classifier = Classifier(noun, shapes, options.members)
    print(f"of {classifier.tested} further members, {classifier.accuracy:.1%} are classified correctly", flush=True)
    if options.control:
        shapes_there = sorted(options.control.glob(f"items/*/steps-{options.steps:06d}.ply"))
        others = [classifier.noun_of(read_ply(path.read_bytes())) for path in shapes_there]
        print(
            f"of {len(others)} shapes of {options.control.name}, {others.count(noun)} are taken for the noun",
            flush=True,
        )
    prior = load_prior(str(options.weights), device="cpu")
    results, hits = [], 0
    for name in options.sources:
        for seed in options.seeds:
            source = source_mesh(name)
            params = DeformParams.model_validate(
                {
                    "preset": "balanced",
                    "steps": options.steps,
                    "seed": seed,
                    "guidance": {"model": str(options.weights)},
                }
            )
            result = deformed(prior, source, options.prompt, params)
            found, quality = classifier.noun_of(result), measures(source, result)
            hits += found == noun
            results.append(result)
            print(
                f"{name:<12} seed {seed}  {found:<16} {quality['flipped_faces']} flipped, "
                f"{quality['self_intersections_added']} cut, "
                f"distortion {quality['symmetric_dirichlet_mean']:.2f}",
                flush=True,
            )
    if not results:
        return
    low, high = interval(hits, len(results))
    print(f"{hits} of {len(results)} look like the noun: {hits / len(results):.0%} ({low:.0%} to {high:.0%})")
    if options.picture:
        pictures(results).save(options.picture)


if __name__ == "__main__":
    main()
