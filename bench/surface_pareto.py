"""Compare fields with Draco: bytes, and the errors of the mesh and of what is computed on it.

python -m bench.surface_pareto MESH... --fits FITS     # FITS/NAME.ndf of each

Draco has the mesh itself and decimated ones, with 9 to 12 bits. Both are compared with the input, divided flat into at
least 40,000 faces, and what Draco decodes is divided likewise, which costs no byte. Eigenvalues are those of the
intrinsic Delaunay Laplacian; geodesics are compared at the same 1,000 places. The table has the errors of each field,
and Draco's fewest bytes for the same error as a multiple of the field's.
"""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Iterator
from pathlib import Path

import DracoPy
import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.geometry.folds import area_vectors
from meshdeform.geometry.places import SurfaceTree, even_samples
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.collapse import base_of
from meshdeform.kinds.surface_fit.intrinsic import HeatGeodesics, delaunay, spectrum
from meshdeform.kinds.surface_fit.measures import distances, spread
from meshdeform.kinds.surface_fit.patches import divided
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Mesh = tuple[_Floats, _Index]
EIGENVALUES, SOURCES, PLACES = 20, 4, 1000
FINE = 40_000
"""Faces of what is compared, at least."""
FACES = (1000, 2000, 4000, 8000, 16_000)
BITS = (9, 10, 11, 12)
MEASURES = ("distance", "normals", "eigenvalues", "geodesics")


class Truth:
    """Eigenvalues and distances of a mesh, with which others are compared."""

    def __init__(self, mesh: CleanMesh) -> None:
        self.surface = MeshSurface(mesh)
        verts, faces = divided(mesh.verts, mesh.faces, FINE)
        intrinsic = delaunay(verts, faces)
        self.parts = mesh.topology.components
        self.eigenvalues = spectrum(intrinsic, EIGENVALUES)[0][self.parts :]
        solver = HeatGeodesics(intrinsic)
        cross = area_vectors(verts, faces)
        area = np.linalg.norm(cross, axis=1)
        face, weights = even_samples(area, PLACES, seed=1)
        self.places = np.einsum("pk,pkc->pc", weights, verts[faces[face]])
        self.normals = cross[face] / area[face, None]
        start = spread(verts, SOURCES)
        self.sources = verts[start]
        self.far = [(solver.distances([s])[faces[face]] * weights).sum(1) for s in start]

    def errors(self, verts: _Floats, faces: _Index) -> dict[str, float]:
        """Return the errors of a mesh by `MEASURES`: shares, and degrees of normals."""
        mesh = clean(verts, faces)
        intrinsic = delaunay(mesh.verts, mesh.faces)
        values = spectrum(intrinsic, EIGENVALUES)[0][self.parts :]
        solver = HeatGeodesics(intrinsic)
        face, weights = SurfaceTree.of(mesh.verts, mesh.faces).find(self.places, self.normals)
        shares = []
        for source, far in zip(self.sources, self.far, strict=True):
            own = solver.distances([int(np.linalg.norm(mesh.verts - source, axis=1).argmin())])
            found = (own[mesh.faces[face]] * weights).sum(1)
            both = np.isfinite(found) & np.isfinite(far)
            shares.append(np.abs(found - far)[both].mean() / far[both].mean())
        apart = distances(self.surface, mesh.verts, mesh.faces)
        eigenvalues = (np.abs(values - self.eigenvalues) / self.eigenvalues).mean()
        found = (apart["mean"], apart["normals_deg"], eigenvalues, np.mean(shares))
        return dict(zip(MEASURES, map(float, found), strict=True))


def draco(mesh: CleanMesh) -> Iterator[tuple[int, _Mesh]]:
    """Return the bytes of Draco's files of a mesh, and what it decodes, divided flat."""
    for count in FACES[: sum(c < len(mesh.faces) for c in FACES) + 1]:  # the last one may be the mesh itself
        verts, faces = base_of(mesh, count)
        for bits in BITS:
            data = DracoPy.encode(verts, faces.astype(np.uint32), quantization_bits=bits, compression_level=10)
            found = DracoPy.decode(data)
            corners = np.asarray(found.faces, np.int64).reshape(-1, 3)
            yield len(data), divided(np.asarray(found.points, np.float64), corners, FINE)


def row(path: Path, fits: Path) -> str:
    """Return a row of the table."""
    asset = load_asset(path.read_bytes(), path.name).surface
    mesh = clean(asset.positions, asset.triangles)
    truth, data = Truth(mesh), (fits / f"{path.stem}.ndf").read_bytes()
    field = read_field(data)
    ours = truth.errors(*field.unfold(math.ceil(math.log(FINE / len(field.faces), 4))))
    theirs = []
    for size, found in draco(mesh):
        with contextlib.suppress(RuntimeError):  # rounded so that triangles lie on a line, of which nothing is computed
            theirs.append((size, truth.errors(*found)))
    fewest = [min((size for size, errors in theirs if errors[by] <= ours[by]), default=0) for by in MEASURES]
    cells = [f"{path.stem}, {len(mesh.faces):,}", f"{len(data):,}", *(f"{ours[by]:.3%}" for by in MEASURES)]
    cells[3] = f"{ours['normals']:.1f}°"
    return "| " + " | ".join([*cells, *(f"{size / len(data):.2f}" if size else "-" for size in fewest)]) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--fits", type=Path, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    names = " | ".join([*MEASURES, *(f"Draco by {by}" for by in MEASURES)])
    print(f"| mesh, triangles | bytes | {names} |\n" + "|---" * 10 + "|")
    for path in given.meshes:
        print(row(path, given.fits), flush=True)


if __name__ == "__main__":
    main()
