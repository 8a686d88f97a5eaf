"""Compare three factorisations for the Poisson solve: ``python bench/poisson.py [--subdivisions N ...] [--repeats N]``.

* ours: QDLDL's factor, and triangular solves compiled for three right-hand sides at once (as in `PoissonSystem`)
* qdldl: QDLDL's factor and its own solve, once per coordinate
* splu: SuperLU in its symmetric mode

All three factor the same grounded Laplacian alternately in one run, so other load affects them equally; compare the
ratios. Then it measures the differentiable solve as in an optimisation step, forward and with its backward pass.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
import qdldl
import torch
from scipy.sparse.linalg import splu

from meshdeform.deformation.poisson import PoissonSystem, factorise, identity_jacobians
from meshdeform.geometry.mesh import cotangent_laplacian
from meshdeform.geometry.shapes import icosphere


def medians_ms(actions: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median milliseconds of each action, measured alternately after one warm-up."""
    times: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats + 1):
        for name, action in actions.items():
            start = time.perf_counter()
            action()
            times[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(found[1:]) for name, found in times.items()}


def report(title: str, found: dict[str, float]) -> None:
    base = found["ours"]
    print(f"  {title:<22}" + "   ".join(f"{name} {ms:8.2f} ms ({ms / base:4.2f}x)" for name, ms in found.items()))


def compare(subdivisions: int, repeats: int) -> None:
    mesh = icosphere(subdivisions)
    n = len(mesh.verts)
    laplacian = cotangent_laplacian(mesh)
    free = np.arange(1, n)
    system = laplacian[free][:, free].tocsc()
    right = laplacian @ mesh.verts.numpy()
    lu = dict(permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})  # noqa: C408
    print(f"\nicosphere({subdivisions}): {n:,} vertices, {len(mesh.faces):,} faces")
    factoring = {
        "ours": lambda: factorise(laplacian, free),
        "qdldl": lambda: qdldl.Solver(system),
        "splu": lambda: splu(system, **lu),
    }
    report("factor", medians_ms(factoring, max(3, repeats // 10)))
    ours, theirs, superlu = factorise(laplacian, free), qdldl.Solver(system), splu(system, **lu)
    assert ours is not None
    columns = [np.ascontiguousarray(right[1:, c]) for c in range(3)]
    block = np.asfortranarray(right[1:])
    solving = {
        "ours": lambda: ours.solve(right),
        "qdldl": lambda: [theirs.solve(column) for column in columns],
        "splu": lambda: superlu.solve(block),
    }
    report("solve, 3 coordinates", medians_ms(solving, repeats))
    for name, solution in (
        ("ours", ours.solve(right)[1:]),
        ("qdldl", np.stack([theirs.solve(column) for column in columns], 1)),
        ("splu", superlu.solve(block)),
    ):
        error = np.abs(solution - (mesh.verts[1:] - mesh.verts[0]).numpy()).max()
        print(f"  {'error of ' + name:<22}{error:.1e}")
    poisson = PoissonSystem(mesh)
    jacobians = identity_jacobians(len(mesh.faces)).requires_grad_()

    def both() -> None:
        poisson.solve(jacobians).backward(mesh.verts)

    step = medians_ms({"forward": lambda: poisson.solve(jacobians), "forward and backward": both}, repeats)
    for name, ms in step.items():
        print(f"  {'PoissonSystem ' + name:<36}{ms:8.2f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 4, 5], help="icosphere levels")
    parser.add_argument("--repeats", type=int, default=50)
    options = parser.parse_args()
    torch.set_num_threads(1)
    for subdivisions in options.subdivisions:
        compare(subdivisions, options.repeats)


if __name__ == "__main__":
    main()
