"""Say by how many texels the colours of a textured asset slide on its field: from the asset to a level, and back.

python -m bench.surface_texture Duck.glb duck.ndf
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch

from meshdeform.assets import load_asset
from meshdeform.deformation.surface_colours import welded_appearance
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.places import NearestPlaces, even_samples
from meshdeform.geometry.quality import texel_corners
from meshdeform.geometry.weld import weld
from meshdeform.kinds.surface_fit import unfold

LEVEL, SAMPLES = 2, 20_000


def main() -> None:
    """Print the median and the 95th percentile."""
    asset, field = map(Path, sys.argv[1:])
    loaded = load_asset(asset.read_bytes(), asset.name)
    welded = weld(loaded.surface.positions, loaded.surface.triangles)
    look, whole = welded_appearance(loaded.appearance(), welded), welded.mesh
    if look is None:
        raise SystemExit("The asset has no colours.")
    texels = texel_corners(look)
    level = RestMesh.of(TriangleMesh(*map(torch.from_numpy, unfold(field, LEVEL))))
    face, weights = even_samples(whole.areas, SAMPLES, seed=0)
    points = np.einsum("pk,pkc->pc", weights, whole.verts.numpy()[whole.faces.numpy()[face]])
    there = NearestPlaces(level, points, whole.normals.numpy()[face])
    back = NearestPlaces(whole, there.blend(level.verts.numpy()), level.normals.numpy()[there.faces])
    ends = [np.einsum("pk,pkc->pc", w, texels[f]) for f, w in ((face, weights), (back.faces, back.weights))]
    slid = np.linalg.norm(ends[1] - ends[0], axis=1)
    slid = slid[np.isfinite(slid)]
    print(f"median {np.median(slid):.4f}, 95th percentile {np.quantile(slid, 0.95):.4f} texels")


if __name__ == "__main__":
    main()
