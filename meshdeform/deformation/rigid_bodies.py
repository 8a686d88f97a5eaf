"""Keep bodies in shape: replace their vertices by the rigid motion or similarity that fits the lattice's map best.

With p_i the vertices of a body at rest, q_i where the lattice takes them, w_i their areas and a_i = p_i - mean(p)::

    v_i = mean(q) + s R a_i        M = sum_i w_i q_i a_i^T        R = argmax_{R in SO(3)} <R, M>
                                   s = <R, M> / sum_i w_i |a_i|^2 for a similarity, else 1

The gradient is exact. With P = R^T M, a change of M turns the rotation by the vector (tr(P) I - P)^-1 vee(R^T dM -
dM^T R), which exists for every body that is not mirrored, also for those of revolution, where that of the singular
vectors does not. M gets a millionth of its greatest possible size along I: without it, a body whose points lie on a
line could turn about it at random.

Sources: Kabsch 1976, A solution for the best rotation to relate two sets of vectors; Umeyama 1991, Least-Squares
Estimation of Transformation Parameters Between Two Point Patterns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.deformation.constraints import RigidBody
from meshdeform.deformation.settings import Rigidity
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.tensors import sparse_product

_STEADINESS = 1e-6
_LEAST_STIFFNESS = 1e-12


class RigidBodies:
    """The bodies of one mesh.

    `bodies`: no two share a vertex; `members`, (V,) bool: vertices of any body.
    """

    def __init__(self, rest: RestMesh, bodies: Sequence[RigidBody]) -> None:
        count, total = len(bodies), len(rest.verts)
        members = np.concatenate([body.verts for body in bodies])
        if len(np.unique(members)) < len(members):
            raise ValueError("two bodies share a vertex")
        owner = np.repeat(np.arange(count), [len(body.verts) for body in bodies])
        weights = np.concatenate([_shares(rest.vertex_areas[body.verts]) for body in bodies])
        points = rest.verts
        self._means = sparse.csr_matrix((weights, (owner, members)), shape=(count, total))
        self._owners = sparse.csr_matrix((np.ones(len(members)), (members, owner)), shape=(total, count))
        arms = np.zeros_like(points)
        arms[members] = points[members] - (self._means @ points)[owner]
        spread = self._means @ (arms**2).sum(1)
        self._arms = torch.from_numpy(arms)
        self._spread = torch.from_numpy(np.where(spread > 0, spread, 1.0))
        self._similar = torch.tensor([body.mode is Rigidity.SIMILARITY for body in bodies]) & torch.from_numpy(
            spread > 0
        )
        self.members = np.zeros(total, bool)
        self.members[members] = True
        self._free = torch.from_numpy(~self.members).double()[:, None]

    def place(self, verts: Tensor) -> Tensor:
        """Return vertices (V, 3) float64 with those of the bodies moved back into shape; differentiable once."""
        products = (verts[:, :, None] * self._arms[:, None, :]).reshape(-1, 9)
        moments = sparse_product(self._means, products).view(-1, 3, 3)
        steady = _STEADINESS * self._spread[:, None, None] * torch.eye(3, dtype=torch.float64)
        rotations: Tensor = _ClosestRotation.apply(moments + steady)  # type: ignore[no-untyped-call]
        scales = torch.where(self._similar, (rotations * moments).sum((1, 2)) / self._spread, 1.0)
        maps = sparse_product(self._owners, (scales[:, None, None] * rotations).view(-1, 9)).view(-1, 3, 3)
        centres = sparse_product(self._owners, sparse_product(self._means, verts))
        return verts * self._free + centres + (maps * self._arms[:, None, :]).sum(2)


class _ClosestRotation(torch.autograd.Function):
    """The rotations (K, 3, 3) R that maximise <R, M>."""

    @staticmethod
    def forward(ctx: FunctionCtx, moments: Tensor) -> Tensor:
        u, _, vh = torch.linalg.svd(moments.detach())
        signs = torch.ones(len(moments), 3, dtype=torch.float64)
        signs[:, 2] = torch.linalg.det(u @ vh).sign()
        rotations: Tensor = (u * signs[:, None, :]) @ vh
        ctx.save_for_backward(rotations, rotations.mT @ moments)
        return rotations

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> Tensor:
        rotations, stretch = ctx.saved_tensors  # type: ignore[attr-defined]
        identity = torch.eye(3, dtype=torch.float64)
        trace = stretch.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
        stiffness = (1 + _LEAST_STIFFNESS) * trace * identity - stretch
        turned = rotations.mT @ gradient
        solution = torch.linalg.solve(stiffness, _vee(turned - turned.mT))
        moments: Tensor = rotations @ _cross_matrix(solution)
        return moments


def _vee(skew: Tensor) -> Tensor:
    """Return the vectors (K, 3) of skew-symmetric matrices (K, 3, 3)."""
    return torch.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)


def _cross_matrix(vectors: Tensor) -> Tensor:
    """Return the matrices (K, 3, 3) that multiply by vectors (K, 3) as a cross product."""
    x, y, z = vectors.unbind(1)
    zero = torch.zeros_like(x)
    entries: Tensor = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1)
    return entries.view(-1, 3, 3)


def _shares(areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return weights that sum to 1: by area, or equal ones where nothing has an area."""
    total = float(areas.sum())
    return areas / total if total > 0 else np.full(len(areas), 1 / len(areas))
