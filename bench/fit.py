"""Fit meshes to meshes, ours and two peers on the same pairs: ``python -m bench.fit ASSETS SHEET [--only WORD]``.

ASSETS is a folder with spot.obj, cow.obj, Duck.glb, CesiumMilkTruck.glb and further files that we read. The pairs are a
sphere to each file, spot to cow and back, Duck to monkey.glb (if it is there), the truck to a box, spot to a scan of
itself turned (noise, holes, floaters), and a sphere of 20,480 faces to the cow. Ours are `target` and `exemplar`
guidance; the peers are `trimesh.registration.nricp_amberg` and `nricp_sumner` with their own settings. All methods get
the target where our alignment puts it; the peers search the vertices of a target subdivided to 1 % of its diagonal. For
each result: the share of the target within 1 % of its diagonal, the mean distances to and from the target (% of the
diagonal), the mean and the 99th percentile of the symmetric Dirichlet energy (1: a similarity), flipped faces, and CPU
time relative to `target` guidance.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.registration import nricp_amberg, nricp_sumner

from meshdeform.assets import load_asset
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.stand_in import stand_in_of
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.shapes import Shape, Wish, frame_of
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.target_distance import measure_fit
from meshdeform.geometry.weld import weld
from meshdeform.guidance.alignment import aligned
from meshdeform.guidance.target import TargetGuide
from meshdeform.reading import NO_PART
from meshdeform.rendering.cameras import CameraFrame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from training.shapes import box

Floats = NDArray[np.float64]
SUFFIXES = (".glb", ".obj", ".ply", ".stl")
STYLE = RenderStyle(view_size=256, supersample=2, shading="lambert", background=(1.0, 1.0, 1.0))


def load(path: Path) -> TriangleMesh:
    surface = load_asset(path.read_bytes(), path.name).surface
    return weld(surface.positions, surface.triangles).mesh


def scanned(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh as a scanner might see it: turned, noisy, with holes and floaters."""
    random = np.random.default_rng(0)
    verts, faces = mesh.verts.copy(), mesh.faces
    size = np.linalg.norm(np.ptp(verts, axis=0))
    middles = verts[faces].mean(1)
    holes = middles[random.choice(len(faces), 6)]
    faces = faces[(np.linalg.norm(middles[:, None] - holes, axis=2) > 0.06 * size).all(1)]
    verts += random.normal(0, 0.002 * size, verts.shape)
    speck = icosphere(0)
    for place in random.uniform(verts.min(0) - 0.2 * size, verts.max(0) + 0.2 * size, (12, 3)):
        faces = np.concatenate([faces, speck.faces + len(verts)])
        verts = np.concatenate([verts, 0.01 * size * speck.verts + place])
    turn = np.radians(140)
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    return TriangleMesh(12.0 * verts @ about_y.T, faces)


def pairs(assets: Path) -> dict[str, tuple[TriangleMesh, TriangleMesh]]:
    named = {path.stem: load(path) for path in sorted(assets.iterdir()) if path.suffix.lower() in SUFFIXES}
    sphere = icosphere(4)
    found = {f"sphere to {name}": (sphere, mesh) for name, mesh in named.items()}
    found["spot to cow"] = named["spot"], named["cow"]
    found["cow to spot"] = named["cow"], named["spot"]
    if "monkey" in named:
        found["Duck to monkey"] = named["Duck"], named["monkey"]
    found["truck to box"] = named["CesiumMilkTruck"], box()
    found["spot to its scan"] = named["spot"], scanned(named["spot"])
    found["large sphere to cow"] = icosphere(5), named["cow"]
    return found


def ours(rest: TriangleMesh, target: TriangleMesh, preset: str = "balanced") -> Floats:
    params = resolve(DeformParams.model_validate({"preset": preset, "guidance": {"kind": "target"}}))
    guidance = TargetGuide(stand_in_of(target), point_weight=params.point_weight)
    run = Deformation(rest, guidance, params)
    for _ in run:
        pass
    return run.verts().numpy()


def by_exemplar(rest: TriangleMesh, target: TriangleMesh) -> Floats:
    """Return what `exemplar` guidance makes of a mesh with a target."""
    faces = target.faces
    frame = frame_of(rest.verts, rest.faces, None)
    goal = Shape("", frame.enter(target.verts), faces, np.full(len(faces), NO_PART))
    run = ExemplarFit(rest.verts, rest.faces, None, Wish(targets=(goal,)))
    for _ in run:
        pass
    return run.frame.leave(run.result.verts)


def peer(method: Callable[..., Floats]) -> Callable[[TriangleMesh, TriangleMesh], Floats]:
    def run(rest: TriangleMesh, target: TriangleMesh) -> Floats:
        source = trimesh.Trimesh(rest.verts, rest.faces, process=False)
        goal = trimesh.Trimesh(target.verts, target.faces, process=False)
        goal = goal.subdivide_to_size(0.01 * goal.scale, max_iter=20)
        return np.asarray(method(source, goal, use_faces=False))

    return run


def row(verts: list[Floats], faces: list[NDArray[np.int64]]) -> Floats:
    """Draw meshes side by side, from their front and a little from the side and above."""
    drawn = []
    for points, corners in zip(verts, faces, strict=True):
        renderer = Renderer(torch.from_numpy(corners), len(points), STYLE)
        drawn.append(renderer.render(torch.from_numpy(np.ascontiguousarray(points)), fixed_cameras(30.0, 15.0))[0])
    return np.concatenate([image.numpy() for image in drawn], 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("assets", type=Path)
    parser.add_argument("sheet", type=Path, help="a picture: the goal, then what each method makes of it of each pair")
    parser.add_argument("--only", action="append", help="pairs whose name contains this")
    arguments = parser.parse_args()
    drawn: list[Floats] = []
    torch.set_num_threads(1)
    methods = {"target": ours, "exemplar": by_exemplar, "Amberg": peer(nricp_amberg), "Sumner": peer(nricp_sumner)}
    warm_up = CameraFrame.around(icosphere(1).verts).place(icosphere(1))
    ours(warm_up, warm_up, "preview")
    print("| pair | method | within 1 % | to | from | distortion | p99 | flips | time |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, (source, goal) in pairs(arguments.assets).items():
        if arguments.only and not any(word in name for word in arguments.only):
            continue
        rest = CameraFrame.around(source.verts).place(source)
        target = aligned(goal, rest).place_mesh(goal)
        shapes, first = [target.verts], 0.0
        for method, fit in methods.items():
            began = time.process_time()
            try:
                verts = fit(rest, target)
            except Exception as error:
                print(f"| {name} | {method} | failed: {type(error).__name__} |||||||", flush=True)
                continue
            spent = time.process_time() - began
            first = first or spent
            fitted = measure_fit(TriangleMesh(verts, rest.faces), target)
            quality = measure(rest.verts, rest.faces, verts)
            cells = (
                f"{fitted.within:.1%}",
                f"{100 * fitted.to_target:.2f}",
                f"{100 * fitted.from_target:.2f}",
                f"{quality.symmetric_dirichlet_mean:.2f}",
                f"{quality.symmetric_dirichlet_p99:.1f}",
                f"{quality.flipped_faces}",
                f"{spent / first:.2f}",
            )
            print(f"| {name} | {method} | {' | '.join(cells)} |", flush=True)
            shapes.append(verts)
        drawn.append(row(shapes, [target.faces, *[rest.faces] * (len(shapes) - 1)]))
    # A method that failed leaves its place empty.
    wide = max(each.shape[1] for each in drawn)
    sheet = np.concatenate([np.pad(each, ((0, 0), (0, wide - each.shape[1]), (0, 0))) for each in drawn])
    Image.fromarray((255 * sheet).clip(0, 255).astype(np.uint8)).save(arguments.sheet)


if __name__ == "__main__":
    main()
