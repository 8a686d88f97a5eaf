"""Run the optimisation of the Jacobians step by step.

Each step solves for the vertices, renders four orthogonal views, evaluates the guidance and the regularisers, and
updates the Jacobians with Adam::

    verts = poisson(J)                  min_v sum_f |f| ||grad_f(v) - J_f||^2; or, with a lattice (`lattice_field.py`),
                                        W x(J) with x the nodes and W the weights with which vertices follow them
    image = combine(render(verts))      4 cameras at azimuth a + {0, 90, 180, 270} degrees, or the prior's own
    loss  = w_g guidance(image) + w_J mean ||J - I||^2 + w_L laplacian(verts) + w_n normals(verts)
            + w_d dirichlet(verts)                                  (a barrier; not in the paper)

On a surface, every connected component keeps its centre of mass, as in the paper. An asset of several components is
carried by a lattice instead (`stand_in.py`), which keeps them together. The centre of mass of the whole mesh stays
fixed: otherwise, a sphere that should become a mushroom would rise to where the cap is seen and never grow a stem.

Sources: Xu et al. 2024, FusionDeformer, eq. 6 to 13; Aigerman et al. 2022, Neural Jacobian Fields, eq. 2 and 4;
Gao et al. 2023, TextDeformer, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints, RigidBody
from meshdeform.deformation.decided import Decided, decide, stored_structure
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.orientation import AHEAD, Orientation
from meshdeform.deformation.regularizers import Pulls, Regularizers
from meshdeform.deformation.settings import Carrier, RunSettings, Safeguard
from meshdeform.deformation.stand_in import StandIn
from meshdeform.deformation.structure import UNKNOWN, Nature, Structure
from meshdeform.deformation.surface_guard import EVERY_STEPS, SurfaceGuard
from meshdeform.deformation.variables import Adam, Variables, copy_into
from meshdeform.errors import CheckpointError, NumericalError
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.tensors import arrays_of, faces_of, tensors_of
from meshdeform.guidance.base import Guidance, RegionalGuidance, ShapeGuidance, StepContext, torch_threads_for
from meshdeform.rendering.cameras import CameraRange, Framing
from meshdeform.rendering.shading import Renderer, Shading
from meshdeform.rendering.views import combine_views, sample_orthogonal_cameras

_PULLS = "pulls"
_REACHED = 1e-8
"""Value of a target's guidance that differs from zero by rounding only."""
_SOFT = 2 / 3
"""Share of the run after which the regularisers have their own weights."""
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """Result of one optimisation step."""

    step: int  # number of completed steps, from 1
    losses: dict[str, float]  # the weighted terms, their sum `total`, and the values that the guidance logs


class Deformation:
    """Optimisation of one mesh.

    Parameters
    ----------
    mesh : TriangleMesh, float64
        The welded rest mesh in the cameras' frame, where they see the unit sphere. If it is large, the run deforms a
        simplified mesh, which it follows (`stand_in.py`).
    guidance : Guidance
        Loss on the rendered views.
    device : str
        Device for rendering and guidance. The Jacobians and the solve stay on the CPU in float64.
    checkpoint : Checkpoint, optional
        A state of the same mesh and parameters from which to continue.
    initial : mapping of name to array, optional
        The tensors of a checkpoint of the same mesh, possibly made with other parameters. The run starts from its
        shape, with new optimiser moments and random numbers. Regularisers stay relative to the rest mesh. With
        `params.guidance.orientation` = `auto`, the turn is that of the checkpoint.
    bodies : sequence of RigidBody, optional
        What keeps its shape. A large mesh with bodies has no stand-in.
    appearance : Appearance, optional
        Look of the mesh, of which `rows` are its vertices, for guidance with a style of colours.
    constraints : Constraints
        Where the vertices of the mesh may go. A large mesh with handles has no stand-in.
    shares : sequence of (F,) float64
        For a `RegionalGuidance`: the share of each of its losses that each face of the mesh gets (`RegionalGradients`).
    front : Orientation
        The front of the mesh for `params.guidance.orientation` = `auto`.
    nature : Nature
        What is known of the mesh and of what it is to become.

    Attributes
    ----------
    pulls : Pulls
        How hard each regulariser pulls against the guidance, where that reaches all elements.

    Raises
    ------
    NumericalError
        The factorisation failed.
    CheckpointError
        The checkpoint or the initial shape belongs to another mesh.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        guidance: Guidance,
        params: RunSettings,
        *,
        device: str = "cpu",
        checkpoint: Checkpoint | None = None,
        initial: Mapping[str, NDArray[Any]] | None = None,
        bodies: Sequence[RigidBody] = (),
        appearance: Appearance | None = None,
        constraints: Constraints = UNCONSTRAINED,
        shares: Sequence[NDArray[np.float64]] = (),
        front: Orientation = AHEAD,
        nature: Nature = UNKNOWN,
    ) -> None:
        self.mesh = mesh
        self.params = params
        self.step = 0
        self._guidance = guidance
        self._device = device
        # Bodies and handles are vertices of the mesh itself.
        simplify = not bodies and not constraints.handles
        self._stand_in = StandIn(mesh, simplify=simplify, constraints=constraints)
        shown = self._stand_in.mesh
        self._shape = guidance if isinstance(guidance, ShapeGuidance) else None
        if self._shape is not None:
            self._shape.begin(shown)
        self._camera_range = CameraRange(
            params.elevation_min_deg, params.elevation_max_deg, params.fov_min_deg, params.fov_max_deg
        )
        self._framing = Framing(params.framing, params.framing_max)
        self._rest_extent = float(np.abs(shown.verts).max())
        worn = self._stand_in.wear(appearance) if guidance.style.shading in ("textured", "mixed") else None
        self._renderer = Renderer(faces_of(shown), len(shown.verts), guidance.style, device, appearance=worn)
        begun = None if initial is None else tensors_of(initial)
        if checkpoint is not None:
            self._decided = Decided.stored(checkpoint.tensors)
        elif initial is not None:
            self._decided = Decided.continued(initial, params.orientation)
        else:
            own = RestMesh.of(mesh)
            self._decided = decide(params, own, shown, front, nature, rigid=bool(bodies), local=bool(shares))
        self._variables = self._stand_in.carry(params.carrier, begun, bodies, self.structure)
        rest = self._variables.rest
        self._regional = RegionalGradients(shares, RestMesh.of(mesh), self._variables) if shares else None
        self._regularizers = Regularizers(rest)
        self._generator = torch.Generator().manual_seed(params.seed)
        tensors = list(self._variables.tensors.values())
        self._optimizer = Adam([{"params": tensors, "lr": params.learning_rate}])
        guarded = params.safeguard is not Safeguard.NONE
        self._guard = SurfaceGuard(params.safeguard, rest, self._variables) if guarded else None
        self.pulls = Pulls()
        self._consistent = True
        if begun is not None:
            copy_into(self._variables, begun)
        if self._guard is not None and (initial is not None or constraints.changes_start):
            self._guard.begin()
        if checkpoint is not None:
            self.restore(checkpoint)

    @property
    def orientation(self) -> Orientation:
        """The turn of the cameras."""
        return self._decided.orientation

    @property
    def structure(self) -> Structure | None:
        """What few degrees of freedom keep of the mesh; None if every element has its own Jacobian."""
        return self._decided.structure

    @property
    def carrier(self) -> dict[str, Any]:
        """The carrier of the mesh: its `kind`, the number of `cells` of a lattice, and the structure that is kept."""
        carrier: dict[str, Any] = {"kind": "surface" if self.cells is None else "lattice", "cells": self.cells}
        if self.structure is None:
            return carrier
        mirror = "".join("xyz"[plane] for plane in self.structure.planes) or None
        return {**carrier, "mirror": mirror, "level": self.structure.level}

    @property
    def cells(self) -> int | None:
        """Number of cells of the lattice that carries the mesh; None if its own surface does."""
        return len(self._variables.elements) if isinstance(self._variables, LatticeField) else None

    @property
    def warnings(self) -> list[str]:
        """Sentences for the user: what is coarser because many faces lie on or in each other."""
        lattice = self._variables.lattice.warnings if isinstance(self._variables, LatticeField) else []
        return [*(self._guard.warnings if self._guard is not None else []), *lattice]

    @property
    def optimized_faces(self) -> int:
        """Number of faces of the mesh, or of its stand-in if it has one."""
        return len(self._stand_in.mesh.faces)

    @property
    def simplified(self) -> bool:
        """Whether a stand-in is drawn in place of the mesh."""
        return self.optimized_faces != len(self.mesh.faces)

    @property
    def shading(self) -> Shading:
        """Shading of the pictures for the guidance: clay, `lambert`, where colours are asked for and there are none."""
        return self._renderer.shading

    @property
    def done(self) -> bool:
        """Whether all steps are completed."""
        return self.step >= self.params.steps

    def __iter__(self) -> Iterator[Step]:
        """Run the remaining steps; iteration can stop after any step and continue from `checkpoint`.

        A step that raises, for example because the device is out of memory, leaves the state as it was before it.

        Raises
        ------
        NumericalError
            A loss or a gradient is not finite.
        """
        while not self.done:
            with torch_threads_for(self._guidance):
                losses = self._advance()
            self.step += 1
            yield Step(self.step, losses)

    def verts(self) -> Tensor:
        """Return the deformed positions (V, 3) float64 in the rest mesh's frame.

        They have its centre of mass unless the guidance places them elsewhere.
        """
        with torch.no_grad():
            verts = self._stand_in.follow(self._variables)
            return verts if self._shape is None else verts + self._shape.offset

    def checkpoint(self) -> Checkpoint:
        """Copy the state from which the run can continue.

        Raises
        ------
        CheckpointError
            A step failed while it updated the variables, so the state is not consistent.
        """
        if not self._consistent:
            raise CheckpointError("The last step failed while it updated the state; use an earlier checkpoint.")
        tensors = self._variables.tensors
        moments = {
            f"{name}.{key}": value
            for name, parameter in tensors.items()
            for key, value in self._optimizer.state.get(parameter, {}).items()
        }
        guarded = self._guard.state if self._guard is not None else {}
        guiding = self._shape.state if self._shape is not None else {}
        state = {
            **tensors,
            **moments,
            **guarded,
            **guiding,
            _PULLS: self.pulls.sums,
            "generator": self._generator.get_state(),
        }
        return Checkpoint(self.step, {**arrays_of(state), **self._decided.to_state()})

    def _advance(self) -> dict[str, float]:
        # Before the optimiser updates the variables, a step changes only the generator.
        generator_state = self._generator.get_state()
        try:
            total, logs = self._loss()
        except BaseException:
            self._generator.set_state(generator_state)
            raise
        self._consistent = False
        self._optimizer.step()
        if self._guard is not None:
            # The last step is always checked, so the result is free of faults.
            due = (self.step + 1) % EVERY_STEPS == 0 or self.step + 1 == self.params.steps
            logs["held_share"] = self._guard.correct(self._optimizer) if due else 0.0
        self._consistent = True
        return {"total": total, **logs}

    def _loss(self) -> tuple[float, dict[str, float]]:
        p = self.params
        self._variables.begin_step(self.step / p.steps)
        control_points = self._variables.solve()
        verts = self._variables.verts(control_points)
        radius = self._framing.fitting_radius(self._rest_extent, float(verts.detach().abs().max()))
        cameras = sample_orthogonal_cameras(self._camera_range, self._generator, radius, self.orientation.turn_deg)
        scene = self._renderer.sample_scene(len(cameras.azimuths_deg), self._generator)
        shading = self._renderer.sample_shading(self._generator)
        image = combine_views(self._renderer.render(verts.to(self._device), cameras, scene, shading))
        context = StepContext(self.step, p.steps, cameras, self._generator)
        guidance, regional, logs = self._guided(image, verts, context)
        if self._shape is not None:
            of_shape, shape_logs = self._shape.shape_loss(verts, context)
            guidance, logs = guidance + of_shape, {**logs, **shape_logs}
            if guidance.item() < _REACHED:
                # The target is reached. Adam would scale up the rounding errors of the regularisers.
                return self._hold(verts, logs)
        regularizers = self._regularizers
        penalties: dict[str, tuple[float, Callable[[], Tensor]]] = {
            "jacobian": (p.jacobian_reg_weight, self._variables.jacobian_penalty),
            "laplacian": (p.laplacian_weight, lambda: regularizers.laplacian(verts)),
            "normal": (p.normal_weight, lambda: regularizers.normal(verts)),
            "dirichlet": (p.dirichlet_weight, lambda: self._variables.dirichlet_penalty(control_points)),
        }
        terms = {"guidance": p.guidance_weight * guidance}
        # A weight of 0 skips the penalty: 0 times an infinite penalty would be NaN.
        stiffness = self._stiffness(context.fraction)
        terms |= {name: stiffness * weight * penalty() for name, (weight, penalty) in penalties.items() if weight}
        total = torch.stack(list(terms.values())).sum()
        self._optimizer.zero_grad()
        if self._regional is not None and regional is not None:
            self._regional.add(regional)
        else:
            self.pulls.measure(terms, list(self._variables.tensors.values()), self.step)
        total.backward()  # type: ignore[no-untyped-call]
        # A tensor without a gradient is not free yet.
        gradients = [tensor.grad for tensor in self._variables.tensors.values() if tensor.grad is not None]
        finite = all(bool(torch.isfinite(gradient).all()) for gradient in gradients)
        if not math.isfinite(total.item()) or not finite:
            raise NumericalError(f"The loss or its gradient is not finite at step {self.step + 1}.")
        return total.item(), {**{k: v.item() for k, v in terms.items()}, **logs}

    def _guided(
        self, image: Tensor, verts: Tensor, context: StepContext
    ) -> tuple[Tensor, Tensor | None, dict[str, float]]:
        """Return the loss of the guidance, its gradient if it reaches only regions, and numbers for the log."""
        if self._regional is None or not isinstance(self._guidance, RegionalGuidance):
            loss, logs = self._guidance.loss(image, context)
            return loss.double().cpu(), None, logs
        losses, logs = self._guidance.losses(image, context)
        weighted = [self.params.guidance_weight * loss.double().cpu() for loss in losses]
        value = torch.stack([loss.detach().double().cpu() for loss in losses]).sum()
        # The vertices connect the value with the variables, in case no regulariser does.
        return value + 0.0 * verts.sum(), self._regional.of(weighted), logs

    def _hold(self, verts: Tensor, logs: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Return a loss of zero, with a gradient of zero."""
        self._optimizer.zero_grad()
        (verts.sum() * 0.0).backward()  # type: ignore[no-untyped-call]
        return 0.0, {"guidance": 0.0, **logs}

    def _stiffness(self, fraction: float) -> float:
        """Return the factor of the regularisers: from `params.stiffness` to 1 at two thirds of the run."""
        return float(self.params.stiffness ** max(0.0, 1 - fraction / _SOFT))

    def restore(self, checkpoint: Checkpoint) -> None:
        """Replace the state by a checkpoint of the same mesh and parameters.

        Raises
        ------
        CheckpointError
            The checkpoint belongs to another mesh.
        """
        state = tensors_of(checkpoint.tensors)
        copy_into(self._variables, state)
        for name, parameter in self._variables.tensors.items():
            self._optimizer.state[parameter] = {
                key.removeprefix(f"{name}."): value.clone()
                for key, value in state.items()
                if key.startswith(f"{name}.")
            }
        if self._guard is not None:
            self._guard.restore(state)
        if self._shape is not None:
            self._shape.restore(state)
        self._decided = Decided.stored(checkpoint.tensors)
        self.pulls.sums = state[_PULLS].clone()
        self._generator.set_state(state["generator"])
        self._consistent = True
        self.step = checkpoint.step


def stored_shape(
    mesh: TriangleMesh,
    state: Mapping[str, NDArray[Any]],
    carrier: Carrier,
    *,
    bodies: Sequence[RigidBody] = (),
    constraints: Constraints = UNCONSTRAINED,
) -> NDArray[np.float64]:
    """Return the vertices (V, 3) float64 of the shape in a checkpoint's tensors, in the frame of the mesh at rest.

    The arguments are those of a `Deformation` that would go on from it. Raises CheckpointError: it is of another mesh.
    """
    stand_in = StandIn(mesh, simplify=not bodies and not constraints.handles, constraints=constraints)
    tensors = tensors_of(state)
    variables = stand_in.carry(carrier, tensors, bodies, stored_structure(state))
    copy_into(variables, tensors)
    with torch.no_grad():
        return stand_in.follow(variables).numpy()


class RegionalGradients:
    """Gradients of several losses, of which each reaches a part of the surface.

    `shares`, sequence of (F,) float64: one for each loss: the share of its gradient that each face of the mesh gets;
    `mesh`: the whole mesh, at rest; `variables`: of this mesh or of its stand-in.
    """

    def __init__(self, shares: Sequence[_Floats], mesh: RestMesh, variables: Variables) -> None:
        self._variables = variables
        nearest = _nearest_faces(mesh, variables)
        chosen = shares if nearest is None else [of_face[nearest] for of_face in shares]
        self._shares = [torch.from_numpy(np.ascontiguousarray(of_row))[:, None, None] for of_row in chosen]

    def of(self, losses: Sequence[Tensor]) -> Tensor:
        """Return the sum of the gradients on the Jacobians (E, 3, 3); the graph of the losses is kept."""
        jacobians = self._variables.jacobians()
        total = torch.zeros_like(jacobians)
        for loss, share in zip(losses, self._shares, strict=True):
            total += share * torch.autograd.grad(loss, jacobians, retain_graph=True)[0]
        return total

    def add(self, gradient: Tensor) -> None:
        """Give the variables a gradient on the Jacobians, beside others; the graph is kept."""
        self._variables.jacobians().backward(gradient, retain_graph=True)  # type: ignore[no-untyped-call]


def _nearest_faces(mesh: RestMesh, variables: Variables) -> NDArray[np.int64] | None:
    """Return the face of the mesh that is nearest to each row of the variables; None if they are its faces."""
    if isinstance(variables, LatticeField):
        lattice = variables.lattice
        middles = lattice.origin + (lattice.cells + 0.5) * lattice.spacing
        return NearestPoints(mesh, middles, np.zeros_like(middles)).faces
    shown = variables.rest
    if shown.faces.shape == mesh.faces.shape:
        return None
    middles = shown.verts[shown.faces].mean(1)
    return NearestPoints(mesh, middles, shown.normals).faces
