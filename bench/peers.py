"""Compare the solve, the renderer, a step and a fit with peers, and measure how each grows: ``python -m bench.peers``.

* solve: our triangular solves on QDLDL's factor; QDLDL's own; SuperLU; conjugate gradients with an incomplete
  Cholesky factor, which begin at the result of the step before
* renderer: four views forward and backward; the same in plain torch, as on other devices; and Mitsuba 3 in an
  environment of its own (``--mitsuba PYTHON``, see `bench/peer_mitsuba.py`)
* step: `balanced`; the same drawn in plain torch, as the published code's structure would be without its CUDA kernels
* fit: a sphere to `examples/vase.glb`; `nricp_amberg` and `nricp_sumner` of trimesh

Prints tables in Markdown; ``--chart FILE`` draws the growth as an SVG. All figures are CPU times of one thread in one
run, the smallest of several, as ratios to ours.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np
import qdldl
import torch
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from trimesh.registration import nricp_amberg, nricp_sumner

from bench.fit import load, ours, peer
from bench.growth_chart import Series, draw, exponent
from bench.incomplete_cholesky import IncompleteCholesky
from meshdeform.deformation.differentiable import identity_jacobians, solve_linear
from meshdeform.deformation.factor import factorise
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.target_distance import measure_fit
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.alignment import aligned
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.rendering.cameras import CameraFrame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.requests.document import DeformParams, resolve

ROOT = Path(__file__).resolve().parents[1]
RADIUS = 0.6
CG_TOLERANCE = 1e-8
Floats = NDArray[np.float64]


def cpu_s(action: Callable[[], object], repeats: int) -> float:
    """Return the smallest CPU time of an action after one warm-up."""
    action()
    taken = []
    for _ in range(repeats):
        begun = time.process_time()
        action()
        taken.append(time.process_time() - begun)
    return min(taken)


def alternating(actions: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the smallest CPU time of each action, taken in turns after a warm-up of each."""
    taken: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats + 1):
        for name, action in actions.items():
            begun = time.process_time()
            action()
            taken[name].append(time.process_time() - begun)
    return {name: min(found[1:]) for name, found in taken.items()}


@contextmanager
def plain_torch() -> Iterator[None]:
    """Draw with torch's own operations instead of compiled kernels, as on other devices."""
    with mock.patch("meshdeform.rendering.rasterizer.is_compiled", return_value=False):
        yield


def solves(levels: Sequence[int], repeats: int) -> None:
    print("\n| vertices | | ours | QDLDL | SuperLU | conjugate gradients |\n|---|---|---|---|---|---|")
    for level in levels:
        mesh = icosphere(level)
        laplacian = RestMesh.of(mesh).laplacian
        free = np.arange(1, len(mesh.verts))
        system = laplacian[free][:, free].tocsc()
        right = laplacian @ mesh.verts
        # What a step asks for: the sides of the step before, a little changed.
        change = 1e-3 * np.random.default_rng(0).standard_normal(right.shape)
        start = mesh.verts[1:] - mesh.verts[0]
        block = np.asfortranarray((right + laplacian @ change)[1:])
        lu = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        factoring: dict[str, Callable[[], object]] = {
            "ours": lambda laplacian=laplacian, free=free: factorise(laplacian, free),  # type: ignore[misc]
            "QDLDL": lambda system=system: qdldl.Solver(system),  # type: ignore[misc]
            "SuperLU": lambda system=system, lu=lu: splu(system, **lu),  # type: ignore[misc]
            "conjugate gradients": lambda system=system: IncompleteCholesky(system),  # type: ignore[misc]
        }
        own, theirs, superlu = factorise(laplacian, free), qdldl.Solver(system), splu(system, **lu)
        incomplete = IncompleteCholesky(system)
        assert own is not None
        whole = np.concatenate([np.zeros((1, 3)), block])
        columns = [np.ascontiguousarray(block[:, c]) for c in range(3)]
        solving: dict[str, Callable[[], object]] = {
            "ours": lambda own=own, whole=whole: own.solve(whole),  # type: ignore[misc]
            "QDLDL": lambda theirs=theirs, columns=columns: [theirs.solve(c) for c in columns],  # type: ignore[misc]
            "SuperLU": lambda superlu=superlu, block=block: superlu.solve(block),  # type: ignore[misc]
            "conjugate gradients": lambda it=incomplete, block=block, start=start: it.solve(block, start, CG_TOLERANCE),  # type: ignore[misc]
        }
        for what, actions, times in (("factor", factoring, max(3, repeats // 5)), ("solve", solving, repeats)):
            found = alternating(actions, times)
            cells = " | ".join(f"{seconds / found['ours']:.2f}" for seconds in found.values())
            print(f"| {len(mesh.verts):,} | {what} | {cells} |", flush=True)


def renderer_action(mesh: TriangleMesh, style: RenderStyle) -> Callable[[], None]:
    cameras = fixed_cameras(20.0, 15.0)
    renderer = Renderer(faces_of(mesh), len(mesh.verts), style)

    def both() -> None:
        leaf = verts_of(mesh).clone().requires_grad_()
        renderer.render(leaf, cameras).square().sum().backward()  # type: ignore[no-untyped-call]

    return both


def renderers(levels: Sequence[int], repeats: int, mitsuba: str) -> None:
    style = RenderStyle(view_size=128, supersample=1, shading="lambert")
    print("\n| faces | ours | plain torch | Mitsuba 3, 4 samples | 16 samples |\n|---|---|---|---|---|")
    for level in levels:
        mesh = icosphere(level, RADIUS)
        action = renderer_action(mesh, style)
        own = cpu_s(action, repeats)
        with plain_torch():
            plain = cpu_s(action, max(3, repeats // 5))
        cells = [f"{plain / own:.1f}"]
        for samples in (4, 16):
            cells.append(_mitsuba(mitsuba, level, samples, own))
        print(f"| {len(mesh.faces):,} | 1 | {' | '.join(cells)} |", flush=True)


def _mitsuba(python: str, level: int, samples: int, own: float) -> str:
    if not python:
        return "not installed"
    script = str(ROOT / "bench" / "peer_mitsuba.py")
    arguments = [python, script, str(level), str(RADIUS), "128", str(samples)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"failed: {(done.stderr.strip().splitlines() or ['no message'])[-1][:80]}"
    return f"{json.loads(done.stdout.splitlines()[-1])['cpu_s'] / own:.1f}"


def stepping(mesh: TriangleMesh, guidance: ScoreDistillation, steps: int) -> Callable[[], None]:
    """Return an action that makes further steps of one run."""
    run = iter(
        Deformation(
            mesh, guidance, resolve(DeformParams.model_validate({"steps": 50_000, "guidance": {"orientation": "keep"}}))
        )
    )

    def action() -> None:
        for _ in range(steps):
            next(run)

    return action


def steps_of(guidance: ScoreDistillation, repeats: int) -> None:
    print("\n| faces | ours | drawn in plain torch |\n|---|---|---|")
    for level in (3, 4):
        mesh = icosphere(level, RADIUS)
        own = cpu_s(stepping(mesh, guidance, 10), repeats)
        with plain_torch():
            plain = cpu_s(stepping(mesh, guidance, 10), 2)
        print(f"| {len(mesh.faces):,} | 1 | {plain / own:.1f} |", flush=True)


def fits() -> None:
    source, goal = icosphere(4), load(ROOT / "examples" / "vase.glb")
    rest = CameraFrame.around(source.verts).place(source)
    target = aligned(goal, rest).place_mesh(goal)
    methods: dict[str, Callable[[], Floats]] = {"ours": lambda: ours(rest, target, "balanced")}
    methods |= {
        name: lambda method=method: peer(method)(rest, target)  # type: ignore[misc]
        for name, method in (("Amberg", nricp_amberg), ("Sumner", nricp_sumner))
    }
    print(
        "\n| sphere to vase | CPU time | of the vase within 1 % | mean distance to it, from it (%) |\n|---|---|---|---|"
    )
    first = 0.0
    for name, method in methods.items():
        begun = time.process_time()
        verts = method()
        taken = time.process_time() - begun
        first = first or taken
        found = measure_fit(TriangleMesh(verts, rest.faces), target)
        distances = f"{100 * found.to_target:.2f}, {100 * found.from_target:.2f}"
        print(f"| {name} | {taken / first:.2f} | {found.within:.0%} | {distances} |", flush=True)


def spheres(count: int, level: int) -> TriangleMesh:
    """Return a row of spheres that do not touch: one component each."""
    each = icosphere(level, 0.9 * RADIUS / count)
    places = np.linspace(-RADIUS, RADIUS, 2 * count + 1)[1::2]
    verts = np.concatenate([each.verts + [x, 0.0, 0.0] for x in places])
    faces = np.concatenate([each.faces + len(each.verts) * i for i in range(count)])
    return TriangleMesh(verts, faces)


def growth(guidance: ScoreDistillation, repeats: int) -> list[Series]:
    found = []

    def over(what: str, unit: str, values: Sequence[float], action: Callable[[float], Callable[[], object]]) -> None:
        series = Series(what, unit, list(values), [cpu_s(action(value), repeats) for value in values])
        found.append(series)
        relative = ", ".join(f"{x:,.0f}: {y / series.y[0]:.2f}" for x, y in zip(series.x, series.y, strict=True))
        print(f"| {what} | {unit} | {relative} | {exponent(series):.2f} |", flush=True)

    def solve(faces: float) -> Callable[[], object]:
        mesh = sphere_of(faces)
        system, jacobians = PoissonSystem(mesh), identity_jacobians(len(mesh.faces)).requires_grad_()
        return lambda: solve_linear(system, jacobians).backward(verts_of(mesh))  # type: ignore[no-untyped-call]

    def sphere_of(faces: float) -> TriangleMesh:
        return icosphere(round(np.log(faces / 20) / np.log(4)), RADIUS)

    def factor(faces: float) -> Callable[[], object]:
        mesh = sphere_of(faces)
        return lambda: PoissonSystem(TriangleMesh(mesh.verts, mesh.faces))  # a new mesh, which has no cached operators

    def parts(count: float) -> TriangleMesh:
        return spheres(round(count), round(np.log(5120 / 20 / count) / np.log(4)))

    sizes = [20.0 * 4**n for n in (2, 3, 4, 5)]
    style = RenderStyle(view_size=128, supersample=1)
    print("\n| what | over | CPU time relative to the first | exponent |\n|---|---|---|---|")
    over("matrix and factor", "faces", sizes, factor)
    over("solve, forward and backward", "faces", sizes, solve)
    over("four views, forward and backward", "faces", sizes, lambda n: renderer_action(sphere_of(n), style))
    over(
        "four views of 5,120 faces",
        "pixels across a view",
        [32, 64, 128, 256],
        lambda n: renderer_action(icosphere(4, RADIUS), RenderStyle(view_size=round(n), supersample=1)),
    )
    over("a step", "faces", [*sizes, 20.0 * 4**6], lambda n: stepping(sphere_of(n), guidance, 5))
    over("a step of 5,120 faces", "components", [1, 4, 16, 64], lambda n: stepping(parts(n), guidance, 5))
    over("a run of 1,280 faces", "steps", [5, 10, 20, 40], lambda n: stepping(icosphere(3, RADIUS), guidance, round(n)))
    return found


def main() -> None:
    """Compare with the peers and measure growth."""
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", choices=["solve", "render", "step", "fit", "growth"])
    parser.add_argument("--mitsuba", default="", metavar="PYTHON", help="the Python of an environment with mitsuba")
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--chart", type=Path, help="an SVG of the growth")
    options = parser.parse_args()
    torch.set_num_threads(1)
    wanted = options.only or ["solve", "render", "step", "fit", "growth"]
    if "solve" in wanted:
        solves((3, 4, 5), options.repeats)
    if "render" in wanted:
        renderers((3, 4, 5), options.repeats, options.mitsuba)
    guidance = ScoreDistillation(load_prior("builtin", device="cpu"), "a mushroom", guidance_scale=7.5)
    if "step" in wanted:
        steps_of(guidance, options.repeats)
    if "fit" in wanted:
        fits()
    if "growth" in wanted:
        found = growth(guidance, options.repeats)
        if options.chart:
            options.chart.write_text(draw(found), encoding="utf-8")


if __name__ == "__main__":
    main()
