"""Gradient, mass and cotangent Laplacian of a triangle mesh, and what stands in for faces without area.

The gradient of the hat function of corner i on a face with unit normal n, area |f| and opposite edge e_i
(counter-clockwise) is (n x e_i) / (2 |f|). With G these gradients and M the areas, L = G^T M G is the cotangent
Laplacian.

Source: Botsch et al. 2010, Polygon Mesh Processing, sections 3.3.2 and 3.3.4.
"""

from __future__ import annotations

import warnings

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

__all__ = [
    "COLLAPSED_SHAPE",
    "collapsed_faces",
    "cotangent_laplacian",
    "gradient_matrix",
    "gradient_operator",
    "mass_matrix",
    "to_torch_csr",
    "vertex_areas",
]

COLLAPSED_SHAPE = 1e-6
"""A face is collapsed when its area is at most this times its longest edge squared (an equilateral one has 0.433)."""


def _edges_and_areas(
    verts: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Edges opposite to each corner (F, 3, 3), cross products (F, 3) and areas (F,)."""
    corners = verts[faces]
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    cross = np.cross(opposite[:, 2], -opposite[:, 1])
    return opposite, cross, 0.5 * np.linalg.norm(cross, axis=1)


def collapsed_faces(verts: Tensor, faces: Tensor, shape: float = COLLAPSED_SHAPE) -> Tensor:
    """Faces whose gradient means nothing: a point, a line, or so near to a line that 1 / area would swamp float64.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    shape : float
        Largest area over longest edge squared that counts as collapsed. Relative to the face itself, so the
        verdict depends neither on the object's units nor on how small the face is in it.

    Returns
    -------
    (F,) bool
    """
    opposite, _, areas = _edges_and_areas(verts.detach().numpy(), faces.numpy())
    longest = (opposite**2).sum(-1).max(-1, initial=0.0)
    return torch.from_numpy(~(areas > shape * longest))


def gradient_matrix(verts: Tensor, faces: Tensor, shape: float = COLLAPSED_SHAPE) -> sparse.csr_matrix:
    """`gradient_operator` as a scipy CSR matrix."""
    points, corners = verts.detach().numpy(), faces.numpy()
    n_faces = len(corners)
    opposite, cross, areas = _edges_and_areas(points, corners)
    collapsed = collapsed_faces(verts, faces, shape).numpy()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # n / (2 |f|) is the cross product over its own square.
        hats = np.cross((cross / (4 * areas**2)[:, None])[:, None], opposite)
    hats[collapsed] = 0.0
    squares = (opposite**2).sum(-1)
    longest = squares.argmax(1) if n_faces else np.empty(0, np.int64)
    f = np.flatnonzero(collapsed & (squares.max(-1, initial=0.0) > 0))
    k = longest[f]
    along = opposite[f, k] / squares[f, k][:, None]
    hats[f, (k + 2) % 3] = along
    hats[f, (k + 1) % 3] = -along
    rows = np.repeat(np.arange(3 * n_faces).reshape(n_faces, 1, 3), 3, axis=1)
    columns = np.repeat(corners[:, :, None], 3, axis=2)
    matrix = sparse.coo_matrix(
        (hats.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(3 * n_faces, len(points))
    )
    return matrix.tocsr()


def gradient_operator(verts: Tensor, faces: Tensor) -> Tensor:
    """Gradient of piecewise-linear functions on the mesh.

    Parameters
    ----------
    verts : (V, 3) float64
        Rest positions, object units.
    faces : (F, 3) int64

    Returns
    -------
    sparse CSR (3F, V) float64, 1 / object unit; row 3f + k is the k-th component of the gradient on face f.
    A collapsed face (see `collapsed_faces`) gets the derivative along its longest edge, its only reliable direction;
    a face that is one point gets zero rows. There are never NaN or huge entries.
    """
    return to_torch_csr(gradient_matrix(verts, faces))


def mass_matrix(verts: Tensor, faces: Tensor) -> Tensor:
    """Diagonal (F,) float64 of the mass matrix: the faces' areas, exactly zero for collapsed faces."""
    _, _, areas = _edges_and_areas(verts.detach().numpy(), faces.numpy())
    return torch.where(collapsed_faces(verts, faces), 0.0, torch.from_numpy(areas))


def vertex_areas(verts: Tensor, faces: Tensor) -> Tensor:
    """Barycentric areas (V,) float64: a third of each incident face; their sum is the surface's area."""
    share = (mass_matrix(verts, faces) / 3).repeat_interleave(3)
    return torch.zeros(verts.shape[0], dtype=torch.float64).index_add(0, faces.reshape(-1), share)


def cotangent_laplacian(verts: Tensor, faces: Tensor) -> Tensor:
    """Positive semi-definite cotangent Laplacian L = G^T M G.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    sparse CSR (V, V) float64, dimensionless, symmetric; its kernel holds the constants of each component.
    """
    gradient = gradient_matrix(verts, faces)
    mass = sparse.diags(mass_matrix(verts, faces).repeat_interleave(3).numpy())
    return to_torch_csr((gradient.T @ mass @ gradient).tocsr())


def to_torch_csr(matrix: sparse.csr_matrix) -> Tensor:
    """Copy a scipy CSR matrix to a torch sparse CSR tensor of float64."""
    matrix.sort_indices()
    with warnings.catch_warnings():
        # torch announces CSR as beta once a process; the products we use of it are stable.
        warnings.filterwarnings("ignore", category=UserWarning, message=".*[Ss]parse")
        return torch.sparse_csr_tensor(
            torch.from_numpy(matrix.indptr.astype(np.int64)),
            torch.from_numpy(matrix.indices.astype(np.int64)),
            torch.from_numpy(matrix.data.astype(np.float64)),
            size=matrix.shape,
            dtype=torch.float64,
            check_invariants=True,
        )
