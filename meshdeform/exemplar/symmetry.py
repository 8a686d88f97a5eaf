"""Tell across which planes through the middle a surface is its own mirror image.

Of samples, mirrored, the mean distance to the plane of the nearest sample counts, plus what it lies beside it by more
than the samples' spacing, at most 0.05 of the diagonal each.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import features, spread

__all__ = ["asymmetry", "symmetry_axes"]

_SAMPLES = 3000
_MOST, _LIMIT = 0.05, 0.01


def asymmetry(verts: Floats, faces: Index, axis: int) -> float:
    """Return how far a surface is from its mirror image across the plane through the origin, normal to an axis."""
    samples = spread(verts, faces, _SAMPLES, 6)
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    places, normals = samples.places * mirror, samples.normals * mirror
    tree = cKDTree(features(samples.places, samples.normals))
    nearest = tree.query(features(places, normals))[1]
    apart = places - samples.places[nearest]
    across = (apart * samples.normals[nearest]).sum(1)
    along = np.sqrt(np.maximum(np.square(apart).sum(1) - across**2, 0))
    corners = verts[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    beside = np.maximum(along - 1.5 * np.sqrt(area / _SAMPLES), 0)
    return float(np.minimum(np.abs(across) + beside, _MOST).mean())


def symmetry_axes(source: tuple[Floats, Index], goal: tuple[Floats, Index]) -> tuple[int, ...]:
    """Return the axes across which a source stays its own mirror image when it becomes a goal.

    Both are vertices (V, 3) and faces (F, 3). Left and right stay alike if they are; front and back only if those of
    the goal are, too.
    """
    axes = [0] if asymmetry(*source, 0) <= _LIMIT else []
    if asymmetry(*source, 2) <= _LIMIT and asymmetry(*goal, 2) <= _LIMIT:
        axes.append(2)
    return tuple(axes)
