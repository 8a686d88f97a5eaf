"""Compare the way through Jacobian space with straight lines of vertices, on bends of a bar and on files.

python bench/paths.py                          # a bar bent by 60 to 240 degrees: length and volume half way
python bench/paths.py SOURCE RESULT PICTURE    # the frames of a result as a picture, straight lines below
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from meshdeform.assets import load_asset
from meshdeform.deformation.path import ShapePath
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.quality import measure
from meshdeform.rendering.studio import Pose, Studio
from meshdeform.runs.strength import AssetPath
from meshdeform.runs.surfaces import read_result
from training.shapes import cylinder

LENGTH = 4.0
BAR = cylinder(0.25, LENGTH, 24, 48)
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5)


def bend(verts: Tensor, degrees: float) -> Tensor:
    """Bend along Y about an axis parallel to Z."""
    radius = LENGTH / math.radians(degrees)
    angle, arm = (verts[:, 1] + LENGTH / 2) / radius, radius - verts[:, 0]
    return torch.stack([radius - arm * angle.cos(), arm * angle.sin() - LENGTH / 2, verts[:, 2]], 1)


def figures(verts: Tensor) -> str:
    """Return the length along the bar and the volume relative to rest, and the flipped faces."""
    a, b = edges_of(BAR.faces).edges.T
    along = (BAR.verts[a] - BAR.verts[b])[:, [0, 2]].abs().sum(1) < 1e-9
    length = (verts[a] - verts[b]).norm(dim=1)[along].mean() / (BAR.verts[a] - BAR.verts[b]).norm(dim=1)[along].mean()
    found = measure(BAR.verts.numpy(), BAR.faces.numpy(), verts.numpy())
    return f"{float(length):.3f} | {found.volume_ratio:.3f} | {found.flipped_faces}"


def bends() -> None:
    """Print a table of bends, half way."""
    print("| bend | length | volume | flips | straight: length | volume | flips |\n|---|---|---|---|---|---|---|")
    for degrees in (60, 120, 180, 240):
        result = bend(BAR.verts, degrees)
        half = ShapePath(BAR, result).at(0.5)
        print(f"| {degrees} | {figures(half)} | {figures((BAR.verts + result) / 2)} |")
    path = ShapePath(BAR, bend(BAR.verts, 120))
    between = (path.at(0.5) + path.at(0.625)) / 2
    print(f"120 degrees, on a straight line between two of 8 frames: {figures(between)}")


def pictures(source: Path, result: Path, picture: Path) -> None:
    """Draw the shapes of a path in a row, and those of straight lines below."""
    asset = load_asset(source.read_bytes(), source.name)
    end = read_result(result.read_bytes()).surface
    path = AssetPath(asset, end.positions)
    found = [path.at(share) for share in SHARES]
    rest = asset.surface.positions
    rows = [
        [Pose(shape.positions, shape.normals) for shape in found],
        [Pose((1 - t) * rest + t * end.positions, shape.normals) for t, shape in zip(SHARES, found, strict=True)],
    ]
    studio = Studio(asset.appearance(), (*rows[0], *rows[1]), size=256, azimuths_deg=[30.0])
    drawn = [np.concatenate([studio.photograph(pose, (30.0,))[0] for pose in row], 1) for row in rows]
    Image.fromarray(np.concatenate(drawn)).save(picture)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        pictures(*map(Path, sys.argv[1:4]))
    else:
        bends()
