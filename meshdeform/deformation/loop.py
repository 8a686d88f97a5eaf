"""The whole optimisation: Jacobians in, deformed vertices out, one generator that yields after every step.

Each step solves for the vertices, draws four orthogonal views, asks the guidance for its gradient, adds the
regularisers and lets Adam move the Jacobians::

    verts = poisson(J) + t_c          min_v sum_f |f| ||grad_f(v) - J_f||^2 per component c, then its translation
                                      with sum_c |c| t_c = 0: the parts move, the whole stays
    image = combine(render(verts))    4 cameras at azimuth a + {0, 90, 180, 270} degrees
    loss  = w_g guidance(image) + w_J mean ||J - I||^2 + w_L laplacian(verts) + w_n normals(verts)
            + w_a attachments(verts)                                (assets of several parts; not in the paper)

The Poisson solution is unique up to one translation per connected component. The paper pins it; where an asset has
several components we optimise it as well (`translation_rate`; 0 is the paper), because a wheel must be able to follow
its car. The centre of mass of the whole stays: were it free, a sphere that shall become a mushroom would rise to where
the cap is seen and never grow a stem.

Sources: Xu et al. 2024, FusionDeformer, eq. 3 to 9; Aigerman et al. 2022, Neural Jacobian Fields, eq. 2 and 4;
Gao et al. 2023, TextDeformer, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from meshdeform.deformation.attachments import Attachments
from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.optimizer import make_optimizer
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.schedules import annealed
from meshdeform.deformation.settling import Settling
from meshdeform.deformation.smoothing import GradientSmoothing
from meshdeform.deformation.step_limit import StepLimit
from meshdeform.deformation.surface_guard import EVERY_STEPS, SurfaceGuard
from meshdeform.deformation.variables import copy_into, make_variables
from meshdeform.errors import CheckpointError, NumericalError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.base import Guidance, StepContext
from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import Renderer
from meshdeform.rendering.views import Views
from meshdeform.requests.document import ResolvedParams, Safeguard

__all__ = ["Deformation", "Step"]

_GRADE_SEED = 20_230_703
_GRADE_DRAWS = 8
"""Grids of views, each with its own cameras, timestep and noise, that a grade is the mean over."""


@dataclass(frozen=True)
class Step:
    """What one optimiser iteration did.

    Attributes
    ----------
    step : int
        How many are done, from 1.
    losses : dict
        The weighted terms, their sum `total`, and what the guidance says besides.
    """

    step: int
    losses: dict[str, float]


class Deformation:
    """One mesh on its way from rest to the result.

    Parameters
    ----------
    mesh : TriangleMesh, float64
        The welded rest mesh in the frame where the cameras see the unit sphere.
    guidance : Guidance
        What pulls.
    params : ResolvedParams
    device : str
        Where views are drawn and the guidance runs. The Jacobians and the solve stay on the CPU in float64.
    checkpoint : Checkpoint, optional
        A state of the same mesh and parameters to go on from.
    initial : mapping of name to Tensor, optional
        The tensors of a checkpoint of the same mesh, whose shape the run begins with; its parameters may be others, and
        neither its optimiser's moments nor its random numbers go on. Regularisers stay relative to the rest mesh.

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
        params: ResolvedParams,
        *,
        device: str = "cpu",
        checkpoint: Checkpoint | None = None,
        initial: Mapping[str, Tensor] | None = None,
    ) -> None:
        self.mesh = mesh
        self.params = params
        self.step = 0
        self._guidance = guidance
        self._device = device
        self._poisson = PoissonSystem(mesh)
        rest = self._poisson.rest
        self._regularizers = Regularizers(rest)
        self._attachments = Attachments(rest, rest.components)
        bounds = CameraRange(params.elevation_min_deg, params.elevation_max_deg, params.fov_min_deg, params.fov_max_deg)
        self._views = Views(
            params.views,
            bounds,
            guidance,
            resolution_start=params.resolution_start,
            coarse_until=params.coarse_until,
        )
        self._renderer = Renderer(mesh.faces, mesh.verts.shape[0], self._views.style, device)
        self._generator = torch.Generator().manual_seed(params.seed)
        self._variables = make_variables(params.parametrization, mesh, self._poisson)
        rates = self._variables.rates(params.translation_rate)
        self._optimizer = make_optimizer(
            params.optimizer,
            [
                {"params": [tensor], "lr": params.learning_rate * rates[name], "multiple": rates[name]}
                for name, tensor in self._variables.tensors.items()
            ],
        )
        self._smoothing = None
        if params.smoothing_start:
            self._smoothing = GradientSmoothing(mesh, params.smoothing_start, params.coarse_until)
        self._limit = StepLimit(rest, self._variables) if params.dirichlet_weight else None
        self._settling = None
        if params.stop_when_settled:
            diagonal = float((mesh.verts.amax(0) - mesh.verts.amin(0)).norm()) if len(mesh.verts) else 0.0
            self._settling = Settling(params.stop_when_settled, diagonal)
        guarded = params.safeguard is not Safeguard.NONE
        self._guard = SurfaceGuard(params.safeguard, rest, self._variables) if guarded else None
        self._whole = True
        if initial is not None:
            copy_into(self._variables, initial)
            if self._guard is not None:
                self._guard.begin()
        if checkpoint is not None:
            self.restore(checkpoint)

    @property
    def settled(self) -> bool:
        """Whether the run has ended before its last step, because the shape went nowhere any more.

        Asked at steps after which the guard has looked: what a run ends with is whole.
        """
        return self._settling is not None and self.step % EVERY_STEPS == 0 and self._settling.settled

    @property
    def done(self) -> bool:
        """Whether no step is left."""
        return self.step >= self.params.steps or self.settled

    def __iter__(self) -> Iterator[Step]:
        """Run the steps that are left; stop iterating at any time and `checkpoint` holds the rest.

        A step that raises, of a device without memory say, leaves the state as it was before it.

        Raises
        ------
        NumericalError
            A loss or a gradient is not finite.
        """
        while not self.done:
            losses = self._advance()
            self.step += 1
            yield Step(self.step, losses)

    def verts(self) -> Tensor:
        """Deformed positions (V, 3) float64 in the rest mesh's frame, with the rest mesh's centre of mass."""
        with torch.no_grad():
            return self._variables.place()

    @torch.no_grad()
    def grade(self) -> float:
        """How badly the shape shows what is asked for, as far as the guidance can tell; smaller is better.

        Every shape is asked about with the same cameras and noise, and the run's own random numbers stay where they
        are: shapes of the same guidance can be compared.
        """
        generator = torch.Generator().manual_seed(_GRADE_SEED)
        verts = self._variables.place().to(self._device)
        found = []
        for _ in range(_GRADE_DRAWS):
            cameras = self._views.sample(generator).to(self._device)
            image = self._views.arrange(self._renderer.render(verts, cameras))
            found.append(self._guidance.grade(image, StepContext(0, 1, cameras, generator)))
        return math.fsum(found) / len(found)

    def checkpoint(self) -> Checkpoint:
        """Everything that the rest of the run depends on, copied.

        Raises
        ------
        CheckpointError
            The optimiser itself failed in the midst of a step: there is no whole state any more.
        """
        if not self._whole:
            raise CheckpointError("The last step broke off while it was written; an earlier checkpoint must do.")
        tensors = self._variables.tensors
        moments = {
            f"{name}.{key}": value
            for name, parameter in tensors.items()
            for key, value in self._optimizer.state.get(parameter, {}).items()
        }
        whole = self._guard.state if self._guard is not None else {}
        pace = self._settling.state if self._settling is not None else {}
        state = {**tensors, **moments, **whole, **pace, "generator": self._generator.get_state()}
        return Checkpoint(self.step, {k: v.detach().clone() for k, v in state.items()})

    def _advance(self) -> dict[str, float]:
        # All that a step changes before the optimiser moves the variables is the generator.
        drawn = self._generator.get_state()
        try:
            total, logs, verts = self._loss()
        except BaseException:
            self._generator.set_state(drawn)
            raise
        self._whole = False
        for group in self._optimizer.param_groups:
            group["lr"] = group["multiple"] * self._between(self.params.learning_rate, self.params.learning_rate_end)
        old = self._limit.copy() if self._limit is not None else {}
        self._optimizer.step()
        if self._limit is not None:
            logs["limited_faces"] = float(self._limit.keep(self._optimizer, old, verts))
        if self._guard is not None:
            # The last step is always looked at: what a run ends with is whole.
            due = (self.step + 1) % EVERY_STEPS == 0 or self.step + 1 == self.params.steps
            logs["held_faces"] = float(self._guard.correct(self._optimizer)) if due else 0.0
        if self._settling is not None:
            self._settling.add(verts)
            logs["speed"] = self._settling.speed
        self._whole = True
        return {"total": total, **logs}

    @property
    def _fraction(self) -> float:
        return self.step / max(self.params.steps - 1, 1)

    def _between(self, begin: float, end: float) -> float:
        """What has this value at the first step and that at the last."""
        return annealed(begin, end, self._fraction, self.params.annealing)

    def _loss(self) -> tuple[float, dict[str, float], Tensor]:
        p = self.params
        cameras = self._views.sample(self._generator).to(self._device)
        verts = self._variables.place()
        renderer = self._renderer.at(self._views.size(self._fraction))
        image = self._views.arrange(renderer.render(verts.to(self._device), cameras))
        context = StepContext(self.step, p.steps, cameras, self._generator)
        guidance, logs = self._guidance.loss(image, context)
        keep, held = self._regularizers, self._between(1.0, p.regularizer_scale_end)
        terms = {
            "guidance": p.guidance_weight * guidance.double().cpu(),
            "jacobian": held * p.jacobian_reg_weight * keep.jacobian(self._variables.jacobians(), p.rigidity),
            "laplacian": held * p.laplacian_weight * keep.laplacian(verts),
            "normal": held * p.normal_weight * keep.normal(verts),
            "attachment": p.attachment_weight * self._attachments.penalty(verts),
        }
        if p.dirichlet_weight:
            terms["dirichlet"] = p.dirichlet_weight * keep.dirichlet(verts)
        total = torch.stack(list(terms.values())).sum()
        self._optimizer.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        if self._smoothing is not None:
            jacobians = self._variables.tensors["jacobians"]
            if jacobians.grad is not None:
                jacobians.grad = self._smoothing.apply(jacobians.grad, self._fraction)
        gradients = [tensor.grad for tensor in self._variables.tensors.values()]
        finite = all(gradient is not None and bool(torch.isfinite(gradient).all()) for gradient in gradients)
        if not math.isfinite(total.item()) or not finite:
            raise NumericalError(f"The loss or its gradient is not finite at step {self.step + 1}.")
        return total.item(), {**{k: v.item() for k, v in terms.items()}, **logs}, verts.detach()

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go on from a state of the same mesh and parameters, in place of the one that there is.

        Raises
        ------
        CheckpointError
            It belongs to another mesh.
        """
        state = checkpoint.tensors
        copy_into(self._variables, state)
        for name, parameter in self._variables.tensors.items():
            self._optimizer.state[parameter] = {
                key.removeprefix(f"{name}."): value.clone()
                for key, value in state.items()
                if key.startswith(f"{name}.")
            }
        if self._guard is not None:
            self._guard.restore(state)
        if self._settling is not None:
            self._settling.restore(state)
        self._generator.set_state(state["generator"])
        self._whole = True
        self.step = checkpoint.step
