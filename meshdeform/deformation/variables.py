"""Hold the variables of the optimisation, by default one Jacobian per face, integrated by the Poisson solve.

This way a gradient on one face moves the surface around it smoothly and at all scales. The optimisation uses its
variables only through the interface `Variables`, so a lattice (`lattice_field.py`) or an ablation can replace them.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.

Adam updates them::

    m <- b1 m + (1 - b1) g        v <- b2 v + (1 - b2) g^2        x <- x - lr m_hat / (sqrt(v_hat) + 1e-8)

torch's own optimiser is not used, because creating one loads torch's compiler and its dependencies, which takes longer
than a whole short run and as much memory as the prior. The results are bit-identical; a test compares them.

Source: Kingma & Ba 2015, Adam, algorithm 1.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from torch import Tensor

from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints
from meshdeform.deformation.degrees_of_freedom import DegreesOfFreedom, Hierarchy, OwnJacobians
from meshdeform.deformation.differentiable import LinearSystem, jacobians_of, placed_by, solve_linear
from meshdeform.deformation.handles import Handles
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.structure import Structure
from meshdeform.errors import CheckpointError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]
_EPSILON = 1e-8
_BETAS = (0.9, 0.999)


@dataclass(frozen=True)
class Elements:
    """The elements whose steps can be reverted: faces of the surface, or cells of a lattice."""

    corners: NDArray[np.int64]  # (E, K) int64: control points of each element
    component: NDArray[np.int64]
    """(E,) int64: connected component of each element, from 0; their steps can be shortened independently."""
    holding: Callable[[_Flags], _Flags] | None = None
    """Returns flags (E,) of the elements that hold a part of flagged faces (F,), or of a face beside one; None if the
    elements are the faces."""
    rigid: _Flags | None = None
    """(F,) bool: faces of rigid bodies, which do not give way to what surrounds them; None if there are none."""

    def __len__(self) -> int:
        return len(self.component)

    @classmethod
    def faces_of(cls, rest: RestMesh) -> Elements:
        """Return the faces of a mesh as elements."""
        return cls(rest.faces, rest.joined[rest.faces[:, 0]])

    @cached_property
    def _incidence(self) -> sparse.csr_matrix:
        """Return the matrix (E, N), one where an element has a control point."""
        rows = np.repeat(np.arange(len(self)), self.corners.shape[1])
        shape = len(self), int(self.corners.max(initial=-1)) + 1
        return sparse.csr_matrix((np.ones(len(rows)), (rows, self.corners.ravel())), shape=shape)

    def spread(self, flags: _Flags) -> _Flags:
        """Return flags (E,) of these elements and of all that share a control point with one of them."""
        # The pairs that share one are not listed: around one point, they are the square of its elements.
        return np.asarray(self._incidence @ (self._incidence.T @ flags.astype(np.float64)) > 0)

    def regions(self, inside: NDArray[np.int64]) -> tuple[int, NDArray[np.int64]]:
        """Return the number of connected groups of these elements, and the group of each."""
        own = self._incidence[inside]
        count, group = csgraph.connected_components(own @ own.T, directed=False)
        return count, group.astype(np.int64)

    def least_at_corners(self, values: _Floats, count: int) -> _Floats:
        """Return, for `count` control points, the least of 1 and the values (E,) of their elements."""
        least = np.ones(count)
        np.minimum.at(least, self.corners.ravel(), np.repeat(values, self.corners.shape[1]))
        return least

    def of_faces(self, flags: _Flags) -> _Flags:
        """Return flags (E,) of the elements that hold a part of a flagged face (F,)."""
        return flags if self.holding is None else self.holding(flags)


class Variables(Protocol):
    """Variables that an optimiser updates, and the shape that they represent."""

    tensors: dict[str, Tensor]
    """Leaf tensors with gradients, float64, by their names in checkpoints; the first one defines the shape."""

    rest: RestMesh
    """The mesh at rest; of a Poisson system, with its threshold for collapsed faces."""

    elements: Elements
    """The elements that a repair reverts."""

    local: bool
    """Whether every element has variables of its own, so that `adopt` can set the shape of a part."""

    resolution: float
    """Length in object units below which the variables do not control the shape; 0 if they control every face."""

    def begin_step(self, fraction: float) -> None:
        """Prepare for the next step, at this fraction of the run: some variables may not change before their time."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (E, 3, 3) float64 of the elements, the same tensor until the variables change."""

    def solve(self) -> Tensor:
        """Compute the control points (N, 3) float64, differentiable in `tensors`: vertices, or nodes of a lattice."""

    def verts(self, control_points: Tensor) -> Tensor:
        """Return the vertices (V, 3) float64 for the control points, differentiably."""

    def jacobian_penalty(self) -> Tensor:
        """Return the mean of ||J - I||^2 as a scalar, differentiable in `tensors`."""

    def dirichlet_penalty(self, control_points: Tensor) -> Tensor:
        """Return the mean logarithm of the elements' symmetric Dirichlet energy, differentiable in the argument."""

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each row of each of `tensors`, the least value among its elements."""

    def adopt(self, control_points: Tensor) -> None:
        """Set the variables to give these control points, up to a translation of all, as exactly as they can."""


class IntegratedJacobians:
    """Jacobians, and the control points that best fit them; what is common to faces and cells."""

    def __init__(self, system: LinearSystem, freedom: DegreesOfFreedom, handles: Handles | None) -> None:
        self._system, self._freedom, self._handles = system, freedom, handles
        self.tensors, self.local = freedom.tensors, freedom.local
        self._solved: tuple[Tensor, Tensor] | None = None

    def begin_step(self, fraction: float) -> None:
        """Free the degrees of freedom that are due."""
        self._freedom.begin_step(fraction)

    def jacobians(self) -> Tensor:
        """Return the Jacobians (E, 3, 3) of the elements."""
        return self._freedom.jacobians()

    def solve(self) -> Tensor:
        """Solve for the control points.

        The solution is reused while the Jacobians do not change: the step limit, the surface guard and the next step's
        loss share it.
        """
        jacobians = self.jacobians()
        known = self._solved[1] if self._solved is not None and torch.equal(self._solved[0], jacobians) else None
        solution = solve_linear(self._system, jacobians, known)
        if known is None:
            self._solved = (jacobians.detach().clone(), solution.detach().clone())
        return solution if self._handles is None else self._handles.pull(solution)

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each row of each of `tensors`, the least value among its elements."""
        return self._freedom.rows(of_element)


class JacobianField(IntegratedJacobians):
    """One Jacobian per face: ``verts = poisson(J)``.

    Every connected component of which nothing is kept keeps its centre of mass.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest.
    constraints : Constraints
        Of this mesh: kept vertices are pinned in the solve, and handles are part of it.
    structure : Structure, optional
        What few degrees of freedom keep. None: every face has a Jacobian of its own, as in the paper.

    Raises
    ------
    NumericalError
        The Poisson system could not be factored.
    """

    def __init__(
        self, mesh: TriangleMesh, constraints: Constraints = UNCONSTRAINED, structure: Structure | None = None
    ) -> None:
        poisson = PoissonSystem(mesh, constraints.kept)
        self.rest = rest = poisson.rest
        self._placement = constraints.placement(rest)
        requested = constraints.handles
        handles = Handles(requested, rest, self._placement, None, poisson.smooth) if requested else None
        super().__init__(poisson, _freedom_of_faces(rest, structure), handles)
        self._regularizers = Regularizers(rest)
        normals = torch.from_numpy(rest.normals)
        self._along_normal = normals[:, :, None] * normals[:, None, :]
        self.elements = Elements.faces_of(rest)
        self.resolution = 0.0

    def verts(self, control_points: Tensor) -> Tensor:
        """Return the argument, placed where the constraints allow: the control points are the vertices."""
        return control_points if self._placement is None else placed_by(self._placement, control_points)

    def jacobian_penalty(self) -> Tensor:
        """Return the area-weighted mean of ||J - I||^2."""
        return self._regularizers.jacobian(self.jacobians())

    def dirichlet_penalty(self, control_points: Tensor) -> Tensor:
        """Return the area-weighted mean symmetric Dirichlet energy of the faces, each in its plane."""
        return self._regularizers.dirichlet(self.verts(control_points))

    def adopt(self, control_points: Tensor) -> None:
        """Set the Jacobians to those of the map from rest; their normal part, which it does not determine, stays."""
        with torch.no_grad():
            jacobians = self.jacobians()
            of_map = jacobians_of(self.rest.gradient, control_points)
            self._freedom.correct(of_map + (jacobians - of_map) @ self._along_normal - jacobians)


def _freedom_of_faces(rest: RestMesh, structure: Structure | None) -> DegreesOfFreedom:
    if structure is None:
        return OwnJacobians("jacobians", len(rest.faces))
    centres = rest.verts[rest.faces].mean(1)
    return Hierarchy("face", centres, rest.normals, rest.box, structure)


def placed(variables: Variables) -> Tensor:
    """Return the vertices (V, 3) float64 that the variables represent, differentiably."""
    return variables.verts(variables.solve())


def copy_into(variables: Variables, state: Mapping[str, Tensor]) -> None:
    """Copy the tensors of a checkpoint into the variables.

    Raises CheckpointError: the tensors belong to another mesh, or to a run that optimises other variables.
    """
    with torch.no_grad():
        for name, parameter in variables.tensors.items():
            stored = state.get(name)
            if stored is None:
                raise CheckpointError(f"The checkpoint is of a run that does not optimise {name}.")
            if stored.shape != parameter.shape:
                raise CheckpointError(
                    f"The checkpoint is of another mesh: its {name} are {tuple(stored.shape)}, "
                    f"this mesh's {tuple(parameter.shape)}."
                )
            parameter.copy_(stored)


class Adam:
    """Adam over groups of tensors, each group with its own learning rate.

    Parameters
    ----------
    groups : iterable of dict
        Each with `params`, a list of tensors that require gradients, and `lr`, which may change between steps.

    Attributes
    ----------
    param_groups : list of dict
        The groups.
    state : dict of Tensor to dict
        State of each tensor after its first step: `step` () float32, the number of its steps; `exp_avg` m and
        `exp_avg_sq` v, with the tensor's shape and dtype.
    """

    def __init__(self, groups: Iterable[dict[str, Any]]) -> None:
        self.param_groups = [dict(group) for group in groups]
        self.state: defaultdict[Tensor, dict[str, Tensor]] = defaultdict(dict)

    def zero_grad(self) -> None:
        """Clear the gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Update every tensor that has a gradient."""
        first, second = _BETAS
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                state = self._state(parameter)
                state["step"] += 1
                done = float(state["step"])
                state["exp_avg"].lerp_(parameter.grad, 1 - first)
                state["exp_avg_sq"].mul_(second).addcmul_(parameter.grad, parameter.grad, value=1 - second)
                root = (1 - second**done) ** 0.5
                spread = (state["exp_avg_sq"].sqrt() / root).add_(_EPSILON)
                parameter.addcdiv_(state["exp_avg"], spread, value=-group["lr"] / (1 - first**done))

    def _state(self, parameter: Tensor) -> dict[str, Tensor]:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.tensor(0.0)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
        return state
