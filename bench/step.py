"""Measure the cost of a step, part by part: ``python bench/step.py [--subdivisions N] [--threads N] [--repeats N]``.

With ``--set name=value`` (a JSON value; repeatable), also measures the ratio of a whole step with changed parameters to
one without, alternating between them.

Prints each part's share of a step of the builtin prior and its ratio to the network's forward pass, all measured in one
run; milliseconds depend on the machine. The parts are timed one after the other on the same state and the whole step
separately, so the remainder is visible.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import torch

from meshdeform.deformation.jacobians import identity_jacobians
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.rendering.cameras import CameraRange, sample_orthogonal_cameras
from meshdeform.rendering.shading import Renderer, combine_views
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve


def median_ms(function: Callable[[], object], repeats: int) -> float:
    for _ in range(3):
        function()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        taken.append(time.perf_counter() - start)
    return sorted(taken)[repeats // 2] * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--subdivisions", type=int, default=4, help="icosphere of 20 * 4^n faces (4: 5,120)")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=31)
    parser.add_argument("--prompt", default="a mushroom")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="compare with this parameter")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    mesh = icosphere(arguments.subdivisions, 0.6)
    prior = load_prior("builtin", device="cpu")
    params = resolve(DeformParams(steps=50_000))
    guidance = ScoreDistillation(prior, arguments.prompt, guidance_scale=params.guidance_scale)
    generator = torch.Generator().manual_seed(0)
    cameras = sample_orthogonal_cameras(CameraRange(), generator)
    system, regularizers = PoissonSystem(mesh), Regularizers(mesh)
    renderer = Renderer(mesh.faces, mesh.verts.shape[0], prior.style)
    jacobians = identity_jacobians(mesh.faces.shape[0]).requires_grad_()

    def solve() -> None:
        system.solve(jacobians).sum().backward()

    def render() -> None:
        leaf = mesh.verts.clone().requires_grad_()
        combine_views(renderer.render(leaf, cameras)).square().sum().backward()

    def regularise() -> None:
        leaf = mesh.verts.clone().requires_grad_()
        (regularizers.jacobian(jacobians) + regularizers.laplacian(leaf) + regularizers.normal(leaf)).backward()

    image = combine_views(renderer.render(mesh.verts, cameras)).detach()
    embedding = prior.encode_texts(arguments.prompt, "")

    def network() -> None:
        prior.predict_noise(image, torch.tensor([500]), embedding, cameras)

    deformation = iter(Deformation(mesh, guidance, params))
    parts = {"solve": solve, "render": render, "regularise": regularise, "network": network}
    times = {name: median_ms(function, arguments.repeats) for name, function in parts.items()}
    whole = median_ms(lambda: next(deformation), arguments.repeats)
    times["the rest"] = max(whole - sum(times.values()), 0.0)
    print(f"{mesh.faces.shape[0]} faces, {arguments.threads} threads, median of {arguments.repeats}")
    print(f"{'part':<12}{'ms':>8}{'share':>8}{'/ network':>11}")
    for name, value in times.items():
        print(f"{name:<12}{value:>8.1f}{value / whole:>8.0%}{value / times['network']:>11.2f}")
    print(f"{'step':<12}{whole:>8.1f}{1:>8.0%}{whole / times['network']:>11.2f}")
    if arguments.set:
        named = dict(text.split("=", 1) for text in arguments.set)
        other = resolve(DeformParams(steps=50_000, **{name: json.loads(value) for name, value in named.items()}))
        print(f"a step with {' '.join(arguments.set)}: {ratio(mesh, guidance, params, other, arguments.repeats):.2f}")


def ratio(
    mesh: TriangleMesh, guidance: ScoreDistillation, plain: ResolvedParams, other: ResolvedParams, repeats: int
) -> float:
    """Return the ratio of step times with other parameters, alternating over the same first steps."""
    runs = [iter(Deformation(mesh, guidance, params)) for params in (plain, other)]
    taken = [0.0, 0.0]
    for _ in range(3 * repeats):
        for index, run in enumerate(runs):
            start = time.perf_counter()
            next(run)
            taken[index] += time.perf_counter() - start
    return taken[1] / taken[0]


if __name__ == "__main__":
    main()
