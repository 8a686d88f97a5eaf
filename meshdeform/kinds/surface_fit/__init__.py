"""Neural displacement fields: a coarse base mesh and a small network that maps it to a surface.

`fit` makes the file `.ndf` of arrays, `unfold` makes a mesh of it, and `sample` places points on its surface.

Read in the order of the paper: `surface_sources` (project a point to the surface), `cleaning` and `collapse`
(the coarse mesh), `network` (the map), `fitting` (its optimisation), `container` and `reader` (the file `.ndf`),
`intrinsic` (Delaunay flips, Laplacian, spectrum, geodesics), `measures` (the report).

Source: Noma, Wang, Liu, Singh and Jacobson 2026, Mesh Processing Non-Meshes via Neural Displacement Fields.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any, Literal

    import numpy as np
    from numpy.typing import NDArray

    from meshdeform.kinds.surface_fit.surface_files import DistanceGrid, ImplicitNetwork, OrientedPoints

    _Floats = NDArray[np.float64]
    _Index = NDArray[np.int64]

NAMES = ("surface_fit",)

_SAMPLED_LEVEL = 3


def fit(
    source: tuple[_Floats, _Index] | OrientedPoints | DistanceGrid | ImplicitNetwork,
    base_faces: int = 1000,
    steps: int = 600,
    **options: Any,
) -> bytes:
    """Fit a field and return its `.ndf` file; needs torch.

    Parameters
    ----------
    source : ((V, 3) float64, (F, 3) int64), or a surface without triangles
        Vertices and faces of a mesh; or points, a grid or a network of `meshdeform.kinds.surface_fit.surface_files`.
    base_faces : int
        Faces of the base, at most; up to four times as many where fewer would fold over.
    steps : int
        Iterations of the optimiser.
    seed : int, default 0
        Of the first weights and all random draws.
    features, octaves, width, depth : int, default 8, 6, 32, 2
        Features of a vertex of the base, octaves of its position, neurons of a hidden layer, and hidden layers.

    Raises
    ------
    AssetError
        The surface cannot be fitted; the message says why and what to do.
    """
    from meshdeform.kinds.surface_fit.cleaning import clean
    from meshdeform.kinds.surface_fit.collapse import base_of
    from meshdeform.kinds.surface_fit.container import encode_base, write_field
    from meshdeform.kinds.surface_fit.fitting import FieldFit, FieldFrame, FitOptions
    from meshdeform.kinds.surface_fit.surface_sources import surface_of

    surface = surface_of(clean(*source) if isinstance(source, tuple) else source, base_faces)
    frame = FieldFrame.around(surface.reference.verts)
    verts, faces = base_of(surface.reference, base_faces)
    base = encode_base(frame.enter(verts).clip(-1, 1), faces)
    fitted = FieldFit(surface, frame, base.verts, base.faces, FitOptions(steps, **options))
    for _ in fitted:
        pass
    return write_field(base, fitted.field, centre=frame.centre, scale=frame.scale, rounding=fitted.rounding)


def unfold(data: bytes | Path, level: int) -> tuple[_Floats, _Index]:
    """Return the vertices (V, 3) float64 and faces (F 4^level, 3) int64 of a `.ndf` at a level; numpy only.

    Raises
    ------
    ValueError
        The file is damaged, incomplete, or of another version.
    """
    from meshdeform.kinds.surface_fit.reader import read_field

    return read_field(data).unfold(level)


def sample(
    data: bytes | Path, count: int, seed: int = 0, *, noise: Literal["white", "blue"] = "white"
) -> tuple[_Floats, _Floats]:
    """Return points (count, 3) float64 on the surface of a `.ndf`, and unit normals (count, 3) there.

    White noise is independent of each other and uniform by area; of blue noise, no two points are near each other.

    Raises
    ------
    ValueError
        The file is damaged, incomplete, or of another version.
    """
    from meshdeform.geometry.surface_samples import blue_samples, surface_samples

    mesh = unfold(data, _SAMPLED_LEVEL)
    if noise == "blue":
        return blue_samples(*mesh, count, seed)
    return surface_samples(*mesh, count, seed, independent=True)
