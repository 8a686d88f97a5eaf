"""Compare `.ndf` files with other ways to send a surface: bytes, seconds, and errors of what is computed on it.

python bench/make_surfaces.py FOLDER     # and put other surfaces there
python -m bench.surface_pareto FOLDER/* -o pareto.json --plot pareto.svg --table
python -m bench.surface_pareto bunny.obj --fits FITS --rivals Draco --table     # of FITS/bunny.ndf
python -m bench.surface_pareto --from *.json --table

Every way is compared with the same reference: the input with its triangles divided, of at least 40,000 faces, so that
no way has its triangulation. Eigenvalues are those of the intrinsic Delaunay Laplacian; geodesic distances are compared
at the same 1,000 places. Rivals are divided flat to as many triangles as a field has, which costs no byte. A noisy
cloud is compared with the surface that it was sampled from, if `.truth.glb` is there.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from bench.surface_chart import COLOURS, draw, table
from bench.surface_rivals import read_source, rivals
from meshdeform.errors import AssetError
from meshdeform.geometry.places import even_samples
from meshdeform.kinds.surface_fit.base_mesh import base_of
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.kinds.surface_fit.gluing import fans, glue, topology
from meshdeform.kinds.surface_fit.intrinsic import HeatGeodesics, delaunay, spectrum
from meshdeform.kinds.surface_fit.measures import distances
from meshdeform.kinds.surface_fit.patches import divided, level_of
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface, Surface, surface_of

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
EIGENVALUES, SOURCES, PLACES = 20, 4, 1000
FIELDS = ((250, (4,), 24), (500, (4,), 32), (1000, (3,), 32), (2000, (3,), 32))
"""Faces of the base, levels of the same file, and width of the network."""
FINE = 40_000
"""Faces to which others are divided, at least."""


class Truth:
    """Eigenvalues and distances of the reference."""

    def __init__(self, surface: Surface) -> None:
        mesh = surface.reference
        verts, faces = mesh.verts, mesh.faces
        while len(faces) < 40_000:
            level = level_of(faces, len(verts), 1)
            verts, faces = np.einsum("pk,pkc->pc", level.weights, verts[level.corners]), level.faces
            if surface.kind != "mesh":
                verts, _ = surface.project(verts, np.zeros_like(verts))
        self.surface, self.components = surface, mesh.topology.components
        fine = clean(verts, faces)
        found = delaunay(fine.verts, fine.faces)
        self.eigenvalues, _ = spectrum(found, EIGENVALUES)
        solver = HeatGeodesics(found)
        corners = fine.verts[fine.faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1)
        face, weights = even_samples(area, PLACES, seed=1)
        self.places = np.einsum("pk,pkc->pc", weights, corners[face])
        self.normals = cross[face] / area[face, None]
        start = _spread(fine.verts, SOURCES)
        self.sources = fine.verts[start]
        self.far = [(solver.distances([s])[fine.faces[face]] * weights).sum(1) for s in start]

    def compare(self, mesh: CleanMesh) -> dict[str, float]:
        """Return errors and CPU seconds of a mesh: of preparing, and of solving for both tasks."""
        begin = time.process_time()
        intrinsic = delaunay(mesh.verts, mesh.faces)
        ready = time.process_time()
        values, _ = spectrum(intrinsic, EIGENVALUES)
        spectral = time.process_time()
        solver = HeatGeodesics(intrinsic)
        ours = MeshSurface(mesh)
        face, weights = ours._tree.find(self.places, self.normals)
        shares, geodesic = [], 0.0
        for source, far in zip(self.sources, self.far, strict=True):
            near = int(np.linalg.norm(mesh.verts - source, axis=1).argmin())
            start = time.process_time()
            own = solver.distances([near])
            geodesic += time.process_time() - start
            found = (own[mesh.faces[face]] * weights).sum(1)
            both = np.isfinite(found) & np.isfinite(far)
            shares.append(float(np.abs(found - far)[both].mean() / far[both].mean()))
        wanted = self.eigenvalues[self.components :]
        apart = np.abs(values[self.components :][: len(wanted)] - wanted) / wanted
        return {
            "eigenvalues": float(apart.mean()),
            "geodesics": float(np.mean(shares)),
            "distance": float(distances(self.surface, mesh.verts, mesh.faces)["mean"]),
            "all_delaunay": bool(intrinsic.certified),
            "prepare_s": ready - begin,
            "solve_s": spectral - ready + geodesic,
        }


def _spread(verts: _Floats, count: int) -> list[int]:
    found = [int(np.linalg.norm(verts - verts.mean(0), axis=1).argmax())]
    far = np.linalg.norm(verts - verts[found[0]], axis=1)
    while len(found) < count:
        found.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(verts - verts[found[-1]], axis=1))
    return found


def _manifold(verts: _Floats, faces: _Index) -> CleanMesh:
    """Return a mesh as it is, if it is a manifold; else what cleaning makes of it."""
    twin = glue(verts, faces)
    fewest, _ = fans(faces, twin)
    if fewest == len(np.unique(faces)) == len(verts):
        return CleanMesh(verts, faces, twin, topology(faces, twin), {})
    return clean(verts, faces)


def fit(surface: Surface, base_faces: int, width: int, steps: int) -> bytes:
    """Return a `.ndf`."""
    return fitted(surface, base_faces, width, steps)()


def fitted(surface: Surface, base_faces: int, width: int, steps: int) -> Callable[..., bytes]:
    """Return what writes a `.ndf`, with `scalars` or without."""
    frame = FieldFrame.around(surface.reference.verts)
    verts, faces = base_of(surface.reference, base_faces)
    base = encode_base(np.clip(frame.enter(verts), -1, 1), faces)
    found = FieldFit(surface, frame, base.verts, base.faces, FitOptions(steps, width=width))
    for _ in found:
        pass
    return partial(write_field, base, found.field, centre=frame.centre, scale=frame.scale, rounding=found.rounding)


def _unfolded(data: bytes, level: int) -> tuple[_Floats, _Index]:
    return read_field(data).unfold(level)


def _fine(unpack: Callable[[], tuple[_Floats, _Index]]) -> tuple[_Floats, _Index]:
    return divided(*unpack(), FINE)


def measure(
    path: Path, steps: int, fits: Path | None, methods: list[str], note: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Return a row for every way to send a surface; with `fits`, its only field is the one that lies there."""
    source = read_source(path.read_bytes(), path.name)
    surface = surface_of(source)
    known = path.with_suffix(".truth.glb")
    truth = Truth(MeshSurface(read_source(known.read_bytes(), known.name)) if known.exists() else surface)
    rows = []

    def add(method: str, setting: str, size: int, unpack: Callable[[], Any], **more: Any) -> None:
        begin = time.process_time()
        try:
            mesh = _manifold(*unpack())
            unpacked = time.process_time() - begin
            row = truth.compare(mesh) | {"faces": len(mesh.faces), "unpack_s": unpacked}
        except Exception as error:  # a way that makes no manifold of a surface is a result
            row = {"fails": f"{type(error).__name__}: {error}"}
        rows.append({"surface": path.stem, "method": method, "setting": setting, "bytes": size, **more, **row})
        note(json.dumps(rows[-1]))

    if fits is not None:
        data = (fits / f"{path.stem}.ndf").read_bytes()
        faces = read_field(data).header["faces"]
        level = 1 if faces >= FINE / 4 else math.ceil(math.log(FINE / faces, 4))
        add("ndf", f"base {faces}, level {level}", len(data), partial(_unfolded, data, level))
    for base_faces, levels, width in FIELDS if fits is None else ():
        begin = time.process_time()
        try:
            data = fit(surface, base_faces, width, steps)
        except AssetError as error:
            name = f"base {base_faces}"
            rows.append({"surface": path.stem, "method": "ndf", "setting": name, "bytes": None, "fails": str(error)})
            continue
        spent = time.process_time() - begin
        for level in levels:
            unpack = partial(_unfolded, data, level)
            add("ndf", f"base {base_faces}, level {level}", len(data), unpack, fit_s=spent)
    for rival in rivals(source, surface, methods):
        add(rival.method, rival.setting, rival.size, partial(_fine, rival.unpack))
    return rows


def main() -> None:
    """Measure, or read what was measured; draw, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", type=Path, nargs="*")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--from", dest="before", type=Path, nargs="*", default=[])
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--fits", type=Path, help="a folder of fields")
    parser.add_argument("--rivals", nargs="*", default=list(COLOURS))
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--plot-seconds", type=Path, help="the same over CPU seconds instead of bytes")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    torch.set_num_threads(1)
    rows: list[dict[str, Any]] = [row for path in given.before for row in json.loads(path.read_text())]
    for path in given.surfaces:
        if path.name.endswith(".truth.glb"):
            continue
        rows += measure(path, given.steps, given.fits, given.rivals, lambda line: print(line, flush=True))
        if given.output:
            given.output.write_text(json.dumps(rows, indent=1) + "\n")
    if given.plot:
        given.plot.write_text(draw(rows))
    if given.plot_seconds:
        given.plot_seconds.write_text(draw(rows, "seconds"))
    if given.table:
        print(table(rows))


if __name__ == "__main__":
    main()
