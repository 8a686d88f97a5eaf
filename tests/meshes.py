"""Make meshes, which hold arrays, of tensors, with which tests of optimisers compute."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from meshdeform.geometry.mesh import TriangleMesh

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

__all__ = ["mesh_of"]


def mesh_of(verts: Tensor | NDArray[np.float64], faces: Tensor | NDArray[np.int64]) -> TriangleMesh:
    """Return a mesh of vertices (V, 3) and faces (F, 3), whatever holds them."""
    return TriangleMesh(_array(verts), _array(faces))


def _array(values: Tensor | NDArray[Any]) -> NDArray[Any]:
    return values if isinstance(values, np.ndarray) else np.asarray(values.detach().numpy())
