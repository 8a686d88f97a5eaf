"""Measure how far pictures of other shapes guide a sphere: ``python bench/silhouettes.py MESH... [options]``.

The masks of each mesh, and of a table of five boxes, are drawn from the azimuths, and a sphere of 5,120 faces is fitted
to them, as in jobs with ``guidance=silhouettes``. Printed are the overlaps (intersection over union, 128 x 128 pixels:
mean and least of the views, %) after some steps, flipped faces, added self-intersections, the mean symmetric Dirichlet
energy, and CPU seconds. With ``--target`` the sphere is fitted to the mesh itself, and overlaps are those where it
stands. ``--set NAME=VALUE`` changes parameters; ``--picture FILE`` draws what is covered too much in
red and what is missing in blue.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch

from meshdeform.assets import load_asset
from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.weld import weld
from meshdeform.guidance.silhouettes import SilhouetteGuidance, SilhouetteTerm, SilhouetteView
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.rendering.rasterizer import CoverageRenderer
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from training.shapes import box

IDENTITY = {"id": "silhouettes", "revision": "", "sha256": ""}
SIDE = 512


def table() -> TriangleMesh:
    """Return a table: a top and four legs."""
    parts = [box(2, (1.0, 0.08, 0.7)).verts + torch.tensor([0.0, 0.5, 0.0])]
    legs = [(x, z) for x in (-0.43, 0.43) for z in (-0.28, 0.28)]
    parts += [box(2, (0.09, 0.9, 0.09)).verts + torch.tensor([x, 0.05, z]) for x, z in legs]
    faces = box(2, (1.0, 1.0, 1.0)).faces
    return TriangleMesh(torch.cat(parts), torch.cat([faces + n * len(parts[0]) for n in range(len(parts))]))


def framed(mesh: TriangleMesh) -> TriangleMesh:
    return Frame.around(mesh.verts).place(mesh)


def view_of(mesh: TriangleMesh, azimuth: float, elevation: float) -> SilhouetteView:
    cameras = fixed_cameras(
        azimuth, elevation, 20.0, views=1, fitting_radius=1.05 * float(mesh.verts.norm(dim=1).max())
    )
    covered = CoverageRenderer(mesh.faces, len(mesh.verts), SIDE).render(mesh.verts.float(), cameras)[0]
    return SilhouetteView(np.asarray(covered.numpy() > 0.5), azimuth, elevation)


def load(path: Path) -> TriangleMesh:
    surface = load_asset(path.read_bytes(), path.name).surface
    return weld(surface.positions, surface.triangles).mesh


def fitted(name: str, goal: TriangleMesh, arguments: argparse.Namespace) -> list[np.ndarray]:
    """Fit a sphere, print its row, and return the pictures of its views: too much in red, missing in blue."""
    rest = framed(icosphere(4))
    elevations = arguments.elevations or [0.0] * len(arguments.azimuths)
    places = list(zip(arguments.azimuths, elevations, strict=True))
    views = [view_of(framed(goal), *place) for place in places]
    changes = dict(each.split("=", 1) for each in arguments.set)
    changes = {key: json.loads(value) if value[:1] in "[{-0123456789" else value for key, value in changes.items()}
    listed = [{"azimuth": azimuth, "elevation": elevation} for azimuth, elevation in places]
    kind = {"guidance": "target"} if arguments.target else {"guidance": "silhouettes", "silhouettes": listed}
    params = resolve(DeformParams.model_validate(grouped({**kind, "preset": "balanced", **changes})))
    term = SilhouetteTerm(views)
    guidance = (
        TargetGuidance(framed(goal), point_weight=params.point_weight)
        if arguments.target
        else SilhouetteGuidance(term, params.silhouette_weight, IDENTITY)
    )
    run = Deformation(rest, guidance, params)
    if arguments.target:
        term.begin(rest)

    def overlaps(verts: torch.Tensor) -> list[float]:
        if not arguments.target:
            return term.overlaps(verts)
        radius = 1.05 * float(framed(goal).verts.norm(dim=1).max())
        found = []
        for view in views:
            cameras = fixed_cameras(view.azimuth_deg, view.elevation_deg, 20.0, views=1, fitting_radius=radius)
            placed = (verts + guidance.offset).float()
            covered = CoverageRenderer(rest.faces, len(verts), SIDE).render(placed, cameras)[0].numpy() > 0.5
            found.append(float((covered & view.mask).sum() / (covered | view.mask).sum()))
        return found

    cells = [_cell(overlaps(rest.verts))]
    spent = time.process_time()
    for step in run:
        if step.step in arguments.at:
            cells.append(_cell(overlaps(run.verts())))
    spent = time.process_time() - spent
    verts = run.verts()
    cells.append(_cell(overlaps(verts)))
    found = measure(rest.verts.numpy(), rest.faces.numpy(), verts.numpy())
    quality = f"{found.flipped_faces}, {found.self_intersections_added} | {found.symmetric_dirichlet_mean:.2f}"
    print(f"| {name} | {' | '.join(cells)} | {quality} | {spent:.0f} |", flush=True)
    # White where both are, red: covered too much, blue: missing.
    return [np.stack([a, a & m, m], -1).astype(np.uint8) * 255 for a, m in term.masks(verts)]


def _cell(overlaps: list[float]) -> str:
    return f"{100 * np.mean(overlaps):.1f}, {100 * min(overlaps):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("meshes", type=Path, nargs="*")
    parser.add_argument("--target", action="store_true")
    parser.add_argument("--no-table", action="store_true")
    parser.add_argument(
        "--azimuths", type=lambda text: [float(each) for each in text.split(",")], default="0,45,90,135"
    )
    parser.add_argument("--elevations", type=lambda text: [*map(float, text.split(","))], help="default: 0")
    parser.add_argument("--at", type=lambda text: [int(each) for each in text.split(",")], default="50,100,150,200")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    shapes = {path.stem: load(path) for path in arguments.meshes}
    if not arguments.no_table:
        shapes["table"] = table()
    steps = " | ".join(["0", *map(str, arguments.at), "end"])
    print(f"| shape | {steps} | flipped, new cuts | distortion | CPU s |\n|{'---|' * (len(arguments.at) + 6)}")
    rows = [np.concatenate(fitted(name, goal, arguments), 1) for name, goal in shapes.items()]
    if arguments.picture:
        from PIL import Image

        picture = Image.fromarray(np.concatenate(rows))
        picture.resize((2 * picture.width, 2 * picture.height), Image.Resampling.NEAREST).save(arguments.picture)


if __name__ == "__main__":
    main()
